//! Numerical stability: what must not change a volume's roles, and volumes that no scanner makes.

use voxrole_pack::{GridGeometry, ScalarType, Scalars};
use voxrole_preprocess::Grid;
use voxrole_preprocess::phantom::{Phantom, PhantomSettings};
use voxrole_preprocess::prepare::compute_roles;
use voxrole_preprocess::progress::Silent;
use voxrole_preprocess::report::Stopwatch;
use voxrole_preprocess::roles::Roles;
use voxrole_preprocess::settings::{Method, Settings};

/// Farther than this from a boundary, three blurs, the gradient of a noiseless phantom comes near the floor.
const SURE: f32 = 4.5;

const METHODS: [Method; 4] = [Method::Paper, Method::Fast, Method::Accurate, Method::Auto];

fn roles_by(grid: &Grid, settings: &Settings) -> Roles {
    compute_roles(grid, settings, &Silent, &mut Stopwatch::new()).expect("roles").0.roles
}

fn roles(grid: &Grid, method: Method) -> Roles {
    roles_by(grid, &Settings::new(method))
}

/// Two shells off the grid's symmetry, on 40 × 36 × 32 voxels.
fn shells() -> PhantomSettings {
    PhantomSettings { dims: [40, 36, 32], scalar_type: ScalarType::F64, ..PhantomSettings::default() }
}

fn values(grid: &Grid) -> Vec<f64> {
    (0..grid.scalars.len()).map(|voxel| grid.physical(voxel)).collect()
}

fn grid(dims: [u32; 3], spacing: [f64; 3], values: Vec<f64>) -> Grid {
    Grid::new("stress", GridGeometry::axis_aligned(dims, spacing), Scalars::F64(values)).expect("a grid")
}

/// How two volumes' roles differ: the share of voxels of which only one has a hit within [`SURE`], and the largest
/// difference of distances in multiples of L_min, over all but the given share of the voxels.
fn difference(a: &[f32], b: &[f32], tail: f64) -> (f64, f32) {
    assert_eq!(a.len(), b.len());
    let is_unequal = |(a, b): &(&f32, &f32)| a.is_finite() != b.is_finite() && a.abs().min(b.abs()) <= SURE;
    let unequal = a.iter().zip(b).filter(is_unequal).count();
    let mut off: Vec<f32> =
        a.iter().zip(b).filter(|(a, b)| a.is_finite() && b.is_finite()).map(|(a, b)| (a - b).abs()).collect();
    off.sort_by(f32::total_cmp);
    let place = ((1.0 - tail) * off.len() as f64) as usize;
    (unequal as f64 / a.len() as f64, off.get(place.min(off.len().saturating_sub(1))).copied().unwrap_or(0.0))
}

/// Asserts that two volumes have the same roles but for rounding, which decides only where a voxel has two boundaries at
/// the same distance or a gradient at the floor.
fn assert_alike(name: &str, a: &[f32], b: &[f32], largest: f32) {
    // The literal rule compares samples of g that in flat regions differ by rounding alone.
    let (most, largest) = if name.starts_with("paper") { (0.02, 0.05) } else { (0.002, largest) };
    let (unequal, off) = difference(a, b, most);
    assert!(
        unequal <= most && off <= largest,
        "{name}: {unequal} of the voxels have one hit only, distances differ by {off}"
    );
    assert!(a.iter().any(|d| d.is_finite()), "{name}: no hit at all");
}

#[test]
fn the_value_s_scale_and_offset_do_not_matter() {
    let settings = shells();
    for method in METHODS {
        let expected = roles(&Phantom::Shells.generate(&settings).expect("a phantom"), method);
        for (value_scale, value_offset) in [
            (1e6, 0.0),
            (1e-6, 0.0),
            (1e30, 0.0),
            (1e-30, 0.0),
            (1e300, 0.0),
            (1e-300, 0.0),
            (1.0, 1e6),
            (1.0, -1e6),
            (1e-6, 1.0),
            (1e30, -1e36),
        ] {
            let settings = PhantomSettings { value_scale, value_offset, ..settings.clone() };
            let found = roles(&Phantom::Shells.generate(&settings).expect("a phantom"), method);
            let name = format!("{method}, scale {value_scale:e}, offset {value_offset:e}");
            assert_alike(&name, &found.distance, &expected.distance, 2e-3);
        }
        // A power of two changes no digit.
        let settings = PhantomSettings { value_scale: 1024.0, ..settings.clone() };
        let found = roles(&Phantom::Shells.generate(&settings).expect("a phantom"), method);
        let bits = |roles: &Roles| roles.distance.iter().map(|d| d.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&found), bits(&expected), "{method}");
    }
}

#[test]
fn a_large_offset_of_integers_does_not_matter() {
    let phantom = Phantom::Shells.generate(&shells()).expect("a phantom");
    let scaled = |offset: f64| {
        let values = values(&phantom).into_iter().map(|value| (value * 2000.0).round() + offset).collect::<Vec<_>>();
        let stored = Scalars::I32(values.into_iter().map(|value| value as i32).collect());
        Grid::new("offset", phantom.geometry.clone(), stored).expect("a grid")
    };
    for method in METHODS {
        let expected = roles(&scaled(0.0), method);
        for offset in [2e9, -2e9] {
            let found = roles(&scaled(offset), method);
            assert_alike(&format!("{method}, offset {offset:e}"), &found.distance, &expected.distance, 1e-3);
        }
    }
}

#[test]
fn turning_values_upside_down_turns_the_distance_s_sign() {
    let phantom = Phantom::Shells.generate(&shells()).expect("a phantom");
    let negated = grid([40, 36, 32], [1.0; 3], values(&phantom).into_iter().map(|value| -value).collect());
    for method in METHODS {
        let (found, expected) = (roles(&negated, method), roles(&phantom, method));
        let turned: Vec<f32> = found.distance.iter().map(|d| -d).collect();
        if matches!(method, Method::Paper | Method::Fast) {
            let same = turned.iter().zip(&expected.distance).all(|(a, b)| a == b || (!a.is_finite() && !b.is_finite()));
            assert!(same, "{method}: not equal to the last bit");
        }
        assert_alike(&format!("{method}, negated"), &turned, &expected.distance, 2e-4);
    }
}

#[test]
fn permuting_and_flipping_axes_permutes_and_flips_the_roles() {
    let dims = [40_usize, 36, 32];
    let phantom = Phantom::Shells.generate(&shells()).expect("a phantom");
    let source = values(&phantom);
    let index = |[i, j, k]: [usize; 3], [nx, ny, _]: [usize; 3]| (k * ny + j) * nx + i;
    for (order, flip) in [
        ([1, 0, 2], [false; 3]),
        ([2, 1, 0], [false; 3]),
        ([1, 2, 0], [false; 3]),
        ([0, 1, 2], [true, false, false]),
        ([0, 1, 2], [false, true, true]),
        ([2, 0, 1], [true, true, true]),
    ] {
        let turned_dims = order.map(|axis: usize| dims[axis]);
        // The voxel of the first volume that lies at a place of the turned one.
        let origin = |place: [usize; 3]| {
            let mut voxel = [0; 3];
            for axis in 0..3 {
                voxel[order[axis]] = if flip[axis] { turned_dims[axis] - 1 - place[axis] } else { place[axis] };
            }
            index(voxel, dims)
        };
        let places: Vec<[usize; 3]> = (0..source.len())
            .map(|v| [v % turned_dims[0], v / turned_dims[0] % turned_dims[1], v / (turned_dims[0] * turned_dims[1])])
            .collect();
        let turned = places.iter().map(|&place| source[origin(place)]).collect();
        let turned = grid(turned_dims.map(|dim| dim as u32), [1.0; 3], turned);
        for method in METHODS {
            let (found, expected) = (roles(&turned, method), roles(&phantom, method));
            let expected: Vec<f32> = places.iter().map(|&place| expected.distance[origin(place)]).collect();
            assert_alike(&format!("{method}, axes {order:?}, flipped {flip:?}"), &found.distance, &expected, 5e-4);
        }
    }
}

#[test]
fn the_spacing_s_scale_does_not_matter() {
    let settings = PhantomSettings { spacing: [1.0, 1.5, 1.25], ..shells() };
    for method in METHODS {
        let expected = roles(&Phantom::Shells.generate(&settings).expect("a phantom"), method);
        for scale in [1e-9, 1e-3, 1e3, 1e9] {
            let settings = PhantomSettings { spacing: settings.spacing.map(|h| h * scale), ..settings.clone() };
            let found = roles(&Phantom::Shells.generate(&settings).expect("a phantom"), method);
            assert_alike(&format!("{method}, spacing {scale:e}"), &found.distance, &expected.distance, 1e-3);
        }
    }
}

#[test]
fn the_grid_s_rotation_does_not_matter_statistically() {
    // Method, and its largest rms error in voxels whichever way the grid is turned.
    for (method, largest) in [(Method::Fast, 0.022), (Method::Accurate, 0.0012), (Method::Auto, 0.0012)] {
        for rotation in [[0.0; 3], [45.0, 0.0, 0.0], [20.0, 35.0, 10.0], [45.0, 35.264, 0.0]] {
            let settings = PhantomSettings { rotation, ..PhantomSettings::default() };
            let grid = Phantom::Ball.generate(&settings).expect("a phantom");
            let truth = Phantom::Ball.truth(&settings).expect("its truth");
            let found = roles(&grid, method);
            let near = || truth.iter().zip(&found.distance).filter(|(truth, _)| truth.abs() <= 3.0);
            let hits = near().filter(|(_, d)| d.is_finite());
            let squares: f64 = hits.clone().map(|(truth, d)| f64::from(truth - d).powi(2)).sum();
            let rms = (squares / hits.clone().count() as f64).sqrt();
            assert!(hits.count() == near().count() && rms <= largest, "{method} {rotation:?}: rms {rms}");
        }
    }
}

/// Asserts what must hold for any volume whatever, and returns its hits.
fn assert_sane(name: &str, grid: &Grid, settings: &Settings) -> u64 {
    let found = roles_by(grid, settings);
    let d_max = settings.d_max as f32 * 1.0001;
    for (voxel, &distance) in found.distance.iter().enumerate() {
        let [g, value] = [found.hit_gradient[voxel], found.hit_value[voxel]];
        if distance.is_finite() {
            assert!(distance.abs() <= d_max && g > 0.0 && g.is_finite() && value.is_finite(), "{name}: {distance} {g}");
        } else {
            assert!(g.is_nan() && (distance.is_nan() || distance == f32::INFINITY), "{name}: {distance} {g}");
        }
    }
    found.hits
}

fn every_method(name: &str, grid: &Grid) -> [u64; 4] {
    METHODS.map(|method| assert_sane(&format!("{name}, {method}"), grid, &Settings::new(method)))
}

/// A deterministic hash in 0..1.
fn hash(voxel: usize) -> f64 {
    let bits = (voxel as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let bits = (bits ^ (bits >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (bits >> 40) as f64 / f64::from(1 << 24)
}

#[test]
fn volumes_without_any_edge_have_no_boundary() {
    for dims in [[1, 1, 1], [2, 2, 2], [1, 1, 30], [17, 1, 1], [9, 11, 1], [12, 12, 12]] {
        let count = dims.iter().product::<u32>() as usize;
        for value in [0.0, 7.5, -1e300, 1e-310] {
            assert_eq!(
                every_method("constant", &grid(dims, [1.0; 3], vec![value; count])),
                [0; 4],
                "{dims:?} {value:e}"
            );
        }
        let ramp = (0..count).map(|voxel| (voxel % dims[0] as usize) as f64).collect();
        assert_eq!(every_method("ramp", &grid(dims, [1.0; 3], ramp)), [0; 4], "{dims:?}");
    }
}

#[test]
fn thin_and_tiny_volumes_are_volumes() {
    // A blurred step along the one long axis: every method finds it where it is.
    let step = |i: usize| 1.0 / (1.0 + (-(i as f64 - 60.5) / 0.9).exp());
    for axis in 0..3 {
        let mut dims = [1_u32; 3];
        dims[axis] = 121;
        let line = grid(dims, [1.0, 2.0, 3.0], (0..121).map(step).collect());
        for method in [Method::Fast, Method::Accurate, Method::Auto] {
            let found = roles(&line, method);
            for voxel in 58..64 {
                let expected = voxel as f32 - 60.5;
                let distance = found.distance[voxel];
                // Distances are in multiples of L_min, which is the one spacing that an axis of one voxel does not lessen.
                let scale = [1.0, 2.0, 3.0][axis];
                assert!((distance / scale - expected).abs() < 0.05, "{method}, axis {axis}: {distance} {expected}");
            }
        }
    }
    for dims in [[2, 2, 2], [2, 1, 3], [3, 3, 3], [5, 2, 1], [4, 4, 1]] {
        let count = dims.iter().product::<u32>() as usize;
        every_method("noise", &grid(dims, [1.0, 0.5, 2.0], (0..count).map(hash).collect()));
    }
}

#[test]
fn ideal_steps_have_one_boundary_halfway() {
    let dims = [24, 20, 16];
    let halved = |voxel: usize| if voxel % 24 < 12 { 10.0 } else { 200.0 };
    let step = grid(dims, [1.0; 3], (0..24 * 20 * 16).map(halved).collect());
    // Differences see the two voxels on either side; a spline overshoots and has faint false ones farther out, which is why
    // `auto` takes differences here.
    for method in [Method::Fast, Method::Auto] {
        let found = roles(&step, method);
        assert_eq!(found.hits, 2 * 20 * 16, "{method}");
        for (voxel, distance) in found.distance.iter().enumerate().filter(|(_, d)| d.is_finite()) {
            let expected = (voxel % 24) as f32 - 11.5;
            assert!((distance - expected).abs() < 1e-3, "{method}: {distance} {expected}");
        }
    }
    let accurate = roles(&step, Method::Accurate);
    let right = |voxel: usize| (accurate.distance[voxel] - ((voxel % 24) as f32 - 11.5)).abs() < 1e-3;
    let wrong = (0..24 * 20 * 16).find(|&voxel| (11..13).contains(&(voxel % 24)) && !right(voxel));
    assert!(wrong.is_none(), "accurate: {:?}", wrong.map(|voxel| (voxel % 24, accurate.distance[voxel])));
}

#[test]
fn volumes_that_no_scanner_makes_are_survived() {
    let dims = [20_u32, 18, 16];
    let count = dims.iter().product::<u32>() as usize;
    let place = |voxel: usize| [voxel % 20, voxel / 20 % 18, voxel / 360];
    let make = |value: &dyn Fn(usize) -> f64| grid(dims, [1.0; 3], (0..count).map(value).collect());
    every_method("checkerboard", &make(&|voxel| (place(voxel).iter().sum::<usize>() % 2) as f64));
    every_method("stripes", &make(&|voxel| (place(voxel)[0] % 2) as f64));
    every_method("spike", &make(&|voxel| f64::from(u8::from(voxel == count / 2))));
    every_method("noise", &make(&hash));
    every_method("denormals", &make(&|voxel| hash(voxel) * 1e-310));
    every_method("huge", &make(&|voxel| (hash(voxel) - 0.5) * f64::MAX));
    every_method("steep", &make(&|voxel| (place(voxel)[0] as f64 * 3.0).exp()));
    // f'' exactly 0 on a plateau between two curved parts.
    let plateau = |x: f64| {
        if x < 6.0 {
            -(6.0 - x).powi(2)
        } else if x > 12.0 {
            (x - 12.0).powi(2)
        } else {
            0.0
        }
    };
    every_method("plateau", &make(&|voxel| 10.0 * place(voxel)[0] as f64 + plateau(place(voxel)[0] as f64)));
    for stored in [
        Scalars::U8((0..count).map(|voxel| if voxel % 3 == 0 { 255 } else { 0 }).collect()),
        Scalars::I8((0..count).map(|voxel| if voxel % 5 == 0 { -128 } else { 127 }).collect()),
        Scalars::I16((0..count).map(|voxel| if place(voxel)[1] < 9 { i16::MIN } else { i16::MAX }).collect()),
        Scalars::U32((0..count).map(|voxel| if place(voxel)[2] < 8 { 0 } else { u32::MAX }).collect()),
        Scalars::I32((0..count).map(|voxel| if place(voxel)[0] < 9 { i32::MIN } else { i32::MAX }).collect()),
        Scalars::F32((0..count).map(|voxel| if place(voxel)[0] < 9 { f32::MIN } else { f32::MAX }).collect()),
    ] {
        let limits = Grid::new("limits", GridGeometry::axis_aligned(dims, [1.0; 3]), stored).expect("a grid");
        every_method("limits", &limits);
    }
}

#[test]
fn bad_voxels_of_every_density_mask_only_their_surroundings() {
    let phantom = Phantom::Shells.generate(&shells()).expect("a phantom");
    let clean = values(&phantom);
    for (name, bad) in [("NaN", f64::NAN), ("infinity", f64::INFINITY), ("-infinity", f64::NEG_INFINITY)] {
        for share in [1e-4, 0.01, 0.1, 0.5, 0.99] {
            let values =
                clean.iter().enumerate().map(|(voxel, &v)| if hash(voxel) < share { bad } else { v }).collect();
            every_method(&format!("{share} of {name}"), &grid([40, 36, 32], [1.0; 3], values));
        }
    }
    // A block of bad voxels in a corner: far from it nothing changes, by more than the decay of a spline's reach.
    let in_block = |voxel: usize| voxel % 40 < 6 && voxel / 40 % 36 < 6 && voxel / 1440 < 6;
    let values = clean.iter().enumerate().map(|(voxel, &v)| if in_block(voxel) { f64::NAN } else { v }).collect();
    let holed = grid([40, 36, 32], [1.0; 3], values);
    for method in METHODS {
        let (found, expected) = (roles(&holed, method), roles(&phantom, method));
        let far = |voxel: &usize| voxel % 40 > 18 || voxel / 40 % 36 > 18 || voxel / 1440 > 18;
        let [found, expected] = [&found, &expected]
            .map(|roles| (0..clean.len()).filter(far).map(|voxel| roles.distance[voxel]).collect::<Vec<_>>());
        assert_alike(&format!("{method}, a block of NaN"), &found, &expected, 1e-3);
    }
}

#[test]
fn steps_and_reaches_of_every_length_agree() {
    let phantom =
        Phantom::Ball.generate(&PhantomSettings { dims: [48; 3], ..PhantomSettings::default() }).expect("fits");
    for method in METHODS {
        let base = Settings::new(method);
        let expected = roles_by(&phantom, &base);
        for step in [0.05, 0.1, 0.5, 1.0] {
            let found = roles_by(&phantom, &Settings { step, ..base });
            // The literal rule depends on the step by its nature: it stops where two samples fall.
            if method != Method::Paper {
                assert_alike(&format!("{method}, step {step}"), &found.distance, &expected.distance, 1e-3);
            }
        }
        for d_max in [1.0, 2.5, 30.0, 60.0] {
            let settings = Settings { d_max, ..base };
            assert_sane(&format!("{method}, d_max {d_max}"), &phantom, &settings);
            let found = roles_by(&phantom, &settings);
            let same = found.distance.iter().zip(&expected.distance).filter(|(_, b)| f64::from(b.abs()) < d_max - 0.3);
            for (a, b) in same {
                assert!(a == b, "{method}, d_max {d_max}: {a} {b}");
            }
        }
    }
}

#[test]
fn thin_layers_down_to_one_voxel() {
    // Thickness in voxels, and the share of both faces' voxels that `auto` must hit within half a voxel of the face. A
    // blur of 1 moves the faces of thinner layers apart; docs/accuracy.md has the figures.
    for (thickness, share) in [(4.0, 0.99), (3.0, 0.99), (2.0, 0.99), (1.5, 0.99), (1.0, 0.0)] {
        let settings = PhantomSettings { dims: [72; 3], thickness, blur: 1.0, ..PhantomSettings::default() };
        let scene = Phantom::SlabPair.scene(&settings).expect("a scene");
        let grid = Phantom::SlabPair.generate(&settings).expect("a phantom");
        let found = roles(&grid, Method::Auto);
        let (mut near, mut kept, mut sum) = (0.0, 0.0, 0.0);
        for (voxel, &distance) in found.distance.iter().enumerate() {
            let place = [voxel % 72, voxel / 72 % 72, voxel / 5184];
            if place.iter().any(|index| !(4..68).contains(index)) {
                continue;
            }
            let point =
                grid.geometry.world_from_index().transform_point3(glam::DVec3::from_array(place.map(|i| i as f64)));
            for boundary in &scene.boundaries {
                let truth = boundary.signed_distance(point);
                if truth.abs() <= 0.25 {
                    near += 1.0;
                    let error = (f64::from(distance) - truth).abs();
                    if error <= 1.0 {
                        kept += 1.0;
                        sum += error;
                    }
                }
            }
        }
        eprintln!(
            "thickness {thickness}: {:.4} of the faces' voxels hit, off by {:.3} voxel in the mean",
            kept / near,
            sum / kept
        );
        assert!(kept / near >= share, "thickness {thickness}: {}", kept / near);
    }
}
