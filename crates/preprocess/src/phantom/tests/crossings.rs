//! The formula's own zero crossings of f''.

use super::*;
use crate::phantom::Crossing;

fn scene(phantom: Phantom, settings: &PhantomSettings) -> Scene {
    phantom.scene(settings).expect("valid settings")
}

#[test]
fn of_a_profile_on_the_distance_it_lies_on_the_surface() {
    let settings = settings([64; 3]);
    for (phantom, step) in [(Phantom::Ball, 1.0), (Phantom::Torus, 1.0)] {
        let scene = scene(phantom, &settings);
        let peak = step / (1.5 * std::f64::consts::TAU.sqrt());
        let mut found = 0;
        for point in scattered_points(settings.middle(), 31.0) {
            let distance = scene.signed_distance(point).expect("a surface");
            let Some(crossing) = scene.crossing(point, 15.0) else {
                assert!(distance.abs() > 15.0, "{} {point}: {distance}", phantom.name());
                continue;
            };
            found += 1;
            assert!((crossing.distance - distance).abs() < 1e-8, "{} {point}: {crossing:?}", phantom.name());
            assert!((crossing.gradient_magnitude / peak - 1.0).abs() < 1e-12, "{} {crossing:?}", phantom.name());
            assert!((crossing.value - 0.5 * step).abs() < 1e-9, "{} {crossing:?}", phantom.name());
        }
        assert!(found > 150, "{}: {found}", phantom.name());
    }
}

#[test]
fn of_a_blurred_ball_it_lies_inside_by_the_square_of_the_blur_over_the_radius() {
    for blur in [0.7, 1.5, 2.5] {
        let scene = scene(Phantom::BlurredBall, &PhantomSettings { blur, ..settings([64; 3]) });
        let centre = DVec3::new(31.8, 31.3, 31.6);
        for r in [13.0, 17.0, 19.9, 22.0, 27.0] {
            let point = centre + r * DVec3::new(0.36, -0.48, 0.8);
            let crossing = scene.crossing(point, 15.0).expect("a crossing");
            let surface = scene.signed_distance(point).expect("a surface");
            let shift = crossing.distance - surface;
            // R − s²/R up to the fourth power of s/R.
            let expected = -blur * blur / 20.0;
            assert!((shift - expected).abs() < 3.0 * blur.powi(4) / 8000.0, "{blur} {r}: {shift} {expected}");
            assert!(scene.second_derivative(centre + (20.0 + shift) * DVec3::X).abs() < 1e-10);
        }
    }
}

#[test]
fn two_slabs_have_four() {
    for (thickness, blur) in [(4.0, 1.0), (10.0, 1.5), (1.5, 1.0), (1.5, 1.5)] {
        let settings = PhantomSettings { thickness, blur, ..settings([64; 3]) };
        let scene = scene(Phantom::SlabPair, &settings);
        let normal = DVec3::new(0.8, 0.48, 0.36);
        let centre = DVec3::new(31.8, 31.3, 31.6);
        let mut places: Vec<(f64, f64)> = (0..1201)
            .map(|index| f64::from(index) * 0.05 - 30.0)
            .filter_map(|along| {
                let point = centre + along * normal;
                let Crossing { distance, gradient_magnitude, .. } = scene.crossing(point, 15.0)?;
                let uphill = scene.gradient(point).dot(normal).signum();
                Some((along - distance * uphill, gradient_magnitude))
            })
            .collect();
        places.sort_by(|a, b| a.0.total_cmp(&b.0));
        places.dedup_by(|a, b| (a.0 - b.0).abs() < 1e-6);
        assert_eq!(places.len(), 4, "{thickness} {blur}: {places:?}");
        let truth = [-8.0 - thickness, -8.0, 8.0, 8.0 + thickness];
        for ((place, peak), surface) in places.iter().zip(truth) {
            // Thin slabs push their crossings apart: those of the narrowest bump of all lie one blur from its middle.
            let outwards = (place.abs() - surface.abs()) * if surface.abs() == 8.0 { -1.0 } else { 1.0 };
            assert!(outwards > -1e-9 && outwards < 0.9 * blur, "{thickness} {blur}: {places:?}, {outwards}");
            if thickness >= 8.0 * blur.min(1.25) {
                assert!((place - surface).abs() < 1e-3, "{thickness} {blur}: {places:?}");
                let step = if *place < 0.0 { 1.0 } else { 0.6 };
                assert!((peak * blur * std::f64::consts::TAU.sqrt() / step - 1.0).abs() < 1e-3, "{places:?}");
            }
        }
    }
}

#[test]
fn every_one_is_a_maximum_of_g_on_the_side_where_g_rises() {
    let settings = PhantomSettings { blur: 2.0, ..settings([48; 3]) };
    for phantom in Phantom::ALL {
        let scene = scene(phantom, &settings);
        let mut found = 0;
        for point in scattered_points(settings.middle(), 20.0) {
            let Some(crossing) = scene.crossing(point, 10.0) else { continue };
            found += 1;
            let derivatives = scene.derivatives(point);
            let normal = derivatives.direction().expect("a gradient where there is a crossing");
            // Positive distance: the boundary lies downhill.
            assert_eq!(crossing.distance < 0.0, derivatives.second_derivative() > 0.0, "{} {point}", phantom.name());
            let at = |t: f64| scene.derivatives(point - t * normal);
            let hit = at(crossing.distance);
            let scale = scene.largest_step() / scene.smallest_detail().powi(2);
            assert!(hit.second_derivative().abs() < 1e-9 * scale, "{} {point}: {hit:?}", phantom.name());
            assert!(hit.gradient.dot(normal) > 0.0, "{} {point}: the field falls there", phantom.name());
            let beside = 1e-5 * scene.smallest_detail();
            let [low_side, high_side] = [1.0, -1.0].map(|k| at(crossing.distance + k * beside).second_derivative());
            assert!(low_side > 0.0 && high_side < 0.0, "{} {point}: {low_side} {high_side}", phantom.name());
            assert_eq!(crossing.gradient_magnitude, hit.gradient_magnitude());
            assert_eq!(crossing.value, scene.value(point - crossing.distance * normal));
        }
        assert!(found > 80, "{}: {found}", phantom.name());
    }
}

#[test]
fn on_the_edge_itself_the_distance_is_0_and_on_a_minimum_of_g_the_nearer_edge_counts() {
    let plane = |offset, step| Boundary { surface: Surface::HalfSpace { normal: DVec3::X, offset }, step, blur: 1.0 };
    let scene = |boundaries| Scene { low: 0.0, value_range: [0.0, 2.0], boundaries, shapes: vec![] };
    let one = scene(vec![plane(0.0, 1.0)]);
    assert_eq!(one.crossing(DVec3::ZERO, 5.0).expect("itself").distance, 0.0);
    // Halfway between two equal steps up f'' is 0 and g has its minimum.
    let two = scene(vec![plane(-3.0, 1.0), plane(3.0, 1.0)]);
    assert_eq!(two.second_derivative(DVec3::ZERO), 0.0);
    let crossing = two.crossing(DVec3::ZERO, 5.0).expect("one of the two");
    assert!((crossing.distance.abs() - 3.0).abs() < 1e-3, "{crossing:?}");
    assert_eq!(two.crossing(DVec3::ZERO, 2.5), None);
    // Up and down again: in the middle the gradient vanishes.
    let bump = scene(vec![plane(-3.0, 1.0), plane(3.0, -1.0)]);
    assert_eq!(bump.crossing(DVec3::ZERO, 5.0), None);
    assert_eq!(one.crossing(DVec3::new(100.0, 0.0, 0.0), 1000.0), None, "the gradient underflows");
}

#[test]
fn reach_ends_the_search() {
    let scene = scene(Phantom::Ball, &settings([64; 3]));
    let point = DVec3::new(31.8 + 25.0, 31.3, 31.6);
    assert_eq!(scene.crossing(point, 4.999), None);
    let crossing = scene.crossing(point, 5.001).expect("just within reach");
    assert!((crossing.distance + 5.0).abs() < 1e-9, "outside is the low side: {crossing:?}");
}

#[test]
fn a_volume_of_them_is_the_same_as_one_at_a_time_for_any_number_of_threads() {
    let settings = PhantomSettings { rotation: [10.0, 20.0, 30.0], spacing: [1.0, 1.0, 1.5], ..settings([24, 20, 16]) };
    for phantom in [Phantom::Torus, Phantom::Junction, Phantom::MarschnerLobb] {
        let (scene, geometry) = (scene(phantom, &settings), settings.geometry());
        let with_threads = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
            pool.install(|| scene.crossing_volume(&geometry, 6.0).expect("fits"))
        };
        let volume = with_threads(1);
        assert_eq!(volume, with_threads(3), "{}", phantom.name());
        let some: Vec<usize> = (0..volume.len()).step_by(37).rev().collect();
        let expected: Vec<_> = some.iter().map(|&voxel| volume[voxel]).collect();
        assert_eq!(scene.crossings_of(&geometry, &some, 6.0), expected, "{}", phantom.name());
        for voxel in some {
            let index = DVec3::new((voxel % 24) as f64, (voxel / 24 % 20) as f64, (voxel / 480) as f64);
            let point = geometry.world_from_index().transform_point3(index);
            if scene.signed_distance(point).is_none_or(|distance| distance.abs() < 6.0) {
                assert_eq!(volume[voxel], scene.crossing(point, 6.0), "{} {point}", phantom.name());
            }
        }
        assert!(volume.iter().flatten().count() > 500, "{}", phantom.name());
    }
}

#[test]
fn distances_as_a_volume_hold_nan_where_there_is_none() {
    let settings = settings([32; 3]);
    let distances = Phantom::BlurredBall.crossing_distances(&settings).expect("valid settings");
    let truth = Phantom::BlurredBall.truth(&settings).expect("valid settings");
    let pairs = distances.iter().zip(&truth).filter(|(distance, _)| distance.is_finite());
    let shifts: Vec<f32> = pairs.map(|(distance, truth)| distance - truth).collect();
    // R = 10 and s = 1.5: s²/R = 0.225.
    assert!(shifts.len() > 20_000 && shifts.iter().all(|shift| (shift + 0.225).abs() < 0.01), "{}", shifts.len());
    assert!(distances[0].is_nan() == truth[0].is_nan());
}
