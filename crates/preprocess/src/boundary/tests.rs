//! Every degenerate case, and the naive twin of the rays.

use ndarray::Array3;
use proptest::prelude::*;
use voxrole_pack::{GridGeometry, Scalars};

use super::*;
use crate::Grid;
use crate::central_difference::derivatives;
use crate::directional_derivative::{EdgeOperator, Stencils};
use crate::sampler::GRAZE;
use crate::settings::Method;
use crate::working_field::dims_of;

struct Scene {
    field: WorkingField,
    derivatives: Derivatives,
    cells: CellDistances,
}

impl Scene {
    fn new(dims: [u32; 3], values: Vec<f32>) -> Self {
        let geometry = GridGeometry::axis_aligned(dims, [1.0, 1.0, 1.5]);
        let grid = Grid::new("test", geometry, Scalars::F32(values)).expect("a grid");
        let field = WorkingField::new(&grid).expect("a field");
        let derivatives = derivatives(&field, EdgeOperator::SecondDerivative);
        let cells = CellDistances::new(&derivatives.second_derivative);
        Self { field, derivatives, cells }
    }

    fn line(values: &[f32]) -> Self {
        Self::new([values.len() as u32, 1, 1], values.to_vec())
    }

    fn roles(&self, settings: &Settings) -> (Vec<Role>, Work) {
        let gradient = Gradient::Central2 { values: voxels(&self.field.values), stencils: Stencils::new(&self.field) };
        let tracer = Tracer::new(
            &self.field,
            &self.derivatives,
            &self.cells,
            gradient,
            None,
            &GradientFloor::ROUNDING,
            settings,
        );
        let [nx, ny, nz] = self.field.dims();
        let mut work = Work::default();
        let voxels = (0..nx * ny * nz).map(|v| [v % nx, v / nx % ny, v / (nx * ny)]);
        let roles = voxels.map(|voxel| tracer.role(voxel, &mut work)).collect();
        (roles, work)
    }

    /// Signed distances of a line by the release rule, NaN for misses and infinite for masked voxels.
    fn distances(&self) -> Vec<f32> {
        let (roles, _) = self.roles(&Settings::new(Method::Fast));
        roles.iter().map(distance).collect()
    }
}

fn distance(role: &Role) -> f32 {
    match role {
        Role::Masked => f32::INFINITY,
        Role::Miss => f32::NAN,
        Role::Hit(hit) => hit.distance,
    }
}

fn assert_close(found: &[f32], expected: &[f32]) {
    let close = |a: f32, b: f32| (a.is_nan() && b.is_nan()) || a == b || (a - b).abs() < 1e-4;
    let agree = found.len() == expected.len() && found.iter().zip(expected).all(|(&a, &b)| close(a, b));
    assert!(agree, "found {found:?}, expected {expected:?}");
}

const NONE: f32 = f32::NAN;

#[test]
fn a_binary_step_lies_midway() {
    let found = Scene::line(&[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]).distances();
    assert_close(&found, &[NONE, NONE, -0.5, 0.5, NONE, NONE]);
}

#[test]
fn falling_values_put_the_high_side_first() {
    let found = Scene::line(&[1.0, 1.0, 1.0, 0.0, 0.0, 0.0]).distances();
    assert_close(&found, &[NONE, NONE, 0.5, -0.5, NONE, NONE]);
}

#[test]
fn a_voxel_on_the_maximum_is_the_boundary() {
    let found = Scene::line(&[0.0, 0.0, 0.5, 1.0, 1.0]).distances();
    assert_close(&found, &[NONE, -1.0, 0.0, 1.0, NONE]);
}

#[test]
fn a_plateau_of_zeros_has_its_boundary_in_the_middle_from_both_sides_and_within() {
    // f'' is + at 1, exactly 0 from 2 to 4 and − at 5.
    let found = Scene::line(&[0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 4.0]).distances();
    assert_close(&found, &[NONE, -2.0, -1.0, 0.0, 1.0, 2.0, NONE]);
}

#[test]
fn a_ramp_without_a_change_of_sign_has_no_boundary() {
    assert_close(&Scene::line(&[0.0, 1.0, 2.0, 3.0, 4.0]).distances(), &[NONE; 5]);
    // + 0 +: convex throughout.
    assert_close(&Scene::line(&[0.0, 0.0, 1.0, 2.0, 4.0, 8.0]).distances(), &[NONE; 6]);
}

#[test]
fn a_phantom_edge_is_never_a_hit() {
    // Steep, flat, steep: f'' goes from − to + in the middle, where g has its minimum.
    let found = Scene::line(&[-30.0, -12.0, -4.0, -1.0, 1.0, 4.0, 12.0, 30.0]).distances();
    assert_close(&found, &[NONE; 8]);
}

#[test]
fn on_a_phantom_edge_both_rays_climb_and_the_nearer_boundary_counts() {
    // Gradients rise to both sides of voxel 4, where f'' is exactly 0; the boundary below is nearer.
    let found = Scene::line(&[0.0, 0.0, 4.0, 8.0, 9.0, 10.0, 12.0, 16.0, 24.0, 24.0, 24.0]).distances();
    assert!(found[4] > 0.0 && found[4] < 3.0, "{found:?}");
    assert!(found[6] < 0.0 && found[3] > 0.0, "{found:?}");
}

#[test]
fn bad_voxels_mask_their_stencil_and_stop_rays() {
    let mut values = vec![0.0, 0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0, 1.0];
    values[0] = f32::NAN;
    let found = Scene::line(&values).distances();
    assert!(found[0].is_infinite() && found[1].is_infinite());
    assert!(found[2].is_finite() && found[6].is_finite(), "{found:?}");
    values[4] = f32::INFINITY;
    let found = Scene::line(&values).distances();
    assert!(found[3..=5].iter().all(|distance| distance.is_infinite()), "{found:?}");
    assert!(found[2].is_nan() && found[6].is_nan(), "{found:?}");
}

#[test]
fn d_max_ends_a_ray_and_work_is_counted() {
    let values: Vec<f32> = (0..30).map(|x| 1.0 / (1.0 + (-(x as f32 - 14.5) / 3.0).exp())).collect();
    let scene = Scene::line(&values);
    let short = Settings { d_max: 5.0, ..Settings::new(Method::Fast) };
    let (roles, work) = scene.roles(&short);
    let hits = roles.iter().filter(|role| matches!(role, Role::Hit(_))).count();
    assert_eq!(hits, 10);
    assert!(roles.iter().all(|role| distance(role).is_nan() || distance(role).abs() <= 5.0));
    assert_eq!(work.flat + work.skipped + work.traced, 30);
    let (unskipped, more) = scene.roles(&Settings { skip: false, ..short });
    assert_eq!(roles, unskipped);
    assert!(more.samples > 2 * work.samples && more.traced == 30, "{more:?} {work:?}");
}

/// The naive twin of the release rule: samples every step of both rays in full, and bisects between samples.
fn naive(scene: &Scene, settings: &Settings, voxel: [usize; 3]) -> Option<f32> {
    let f2 = &scene.derivatives.second_derivative;
    let dims = dims_of(f2);
    let gradient = Stencils::new(&scene.field).gradient(voxels(&scene.field.values), voxel);
    let here = f2[[voxel[2], voxel[1], voxel[0]]];
    if gradient.length() <= GRADIENT_FLOOR || here.is_nan() {
        return None;
    }
    let spacing = Vec3::from_array(scene.field.spacing);
    let at = |t: f32| -> Option<f32> {
        let offset = gradient / gradient.length() / spacing * t;
        let mut sum = 0.0;
        for corner in 0..8 {
            let mut weight = 1.0;
            let mut index = [0; 3];
            for axis in 0..3 {
                let (position, last) = (voxel[axis] as f32 + offset[axis], (dims[axis] - 1) as f32);
                if position < -GRAZE || position > last + GRAZE {
                    return None;
                }
                let position = position.clamp(0.0, last);
                let floor = position.floor().min((dims[axis].max(2) - 2) as f32);
                let upper = corner >> axis & 1;
                weight *= if upper == 1 { position - floor } else { 1.0 - (position - floor) };
                index[axis] = (floor as usize + upper).min(dims[axis] - 1);
            }
            sum += weight * f2[[index[2], index[1], index[0]]];
        }
        Some(sum)
    };
    let sign = here.signum();
    let mut inside = 0.0;
    for k in 1..=(settings.d_max / settings.step).round() as u32 {
        let outside = k as f32 * settings.step as f32;
        let q = sign * at(sign * outside)?;
        if q.is_nan() {
            return None;
        }
        if q < 0.0 {
            let mut known = true;
            let t = bisect(inside, outside, |t| {
                let q = at(sign * t).map_or(f32::NAN, |f2| sign * f2);
                known &= !q.is_nan();
                q > 0.0
            });
            return known.then_some(-sign * t);
        }
        inside = outside;
    }
    None
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn rays_equal_their_naive_twin_and_skipping_changes_nothing(
        seed in any::<u32>(),
        smooth in 1_usize..4,
        step in prop::sample::select(vec![0.05, 0.2, 0.5, 1.0]),
        hole in any::<bool>(),
        // Where only one axis matters, all rays run along edges and faces of cells.
        varies_along in prop::sample::select(vec![[1, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    ) {
        let dims = [11_usize, 9, 8];
        let mut noise = Array3::from_shape_fn((dims[2], dims[1], dims[0]), |(k, j, i)| {
            let [i, j, k] = [i * varies_along[0], j * varies_along[1], k * varies_along[2]];
            (((k * 131 + j) * 137 + i) as u32 ^ seed).wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32
        });
        noise = crate::gaussian::gaussian(&noise, [1.0; 3], smooth as f32 * 0.6, 4);
        // Which of two cells a ray along their common face takes is up to rounding: one of them may have the hole.
        if hole && varies_along == [1, 1, 1] {
            noise[[4, 4, 5]] = f32::NAN;
        }
        let scene = Scene::new(dims.map(|dim| dim as u32), voxels(&noise).to_vec());
        for climb in [Climb::Release, Climb::Literal] {
            let settings = Settings { climb, step, d_max: 6.0, ..Settings::new(Method::Fast) };
            let (skipping, work) = scene.roles(&settings);
            let (tracing, all_work) = scene.roles(&Settings { skip: false, ..settings });
            prop_assert_eq!(&skipping, &tracing);
            prop_assert!(work.samples <= all_work.samples);
            if climb == Climb::Literal {
                continue;
            }
            for (voxel, role) in skipping.iter().enumerate() {
                let position = [voxel % dims[0], voxel / dims[0] % dims[1], voxel / (dims[0] * dims[1])];
                // Plateaus of f'' have a rule of their own.
                if scene.derivatives.second_derivative[[position[2], position[1], position[0]]] == 0.0 {
                    continue;
                }
                let (found, expected) = (distance(role), naive(&scene, &settings, position));
                match role {
                    // The two round positions differently: a sample exactly on a face may fall outside for one of them.
                    Role::Hit(_) => prop_assert!(
                        expected.is_some_and(|expected| (expected - found).abs() < 2e-3),
                        "{:?}: {} {:?}", position, found, expected
                    ),
                    Role::Miss | Role::Masked => prop_assert!(expected.is_none(), "{:?}: {:?}", position, expected),
                }
            }
        }
    }
}
