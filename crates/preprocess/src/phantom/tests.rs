use glam::DVec3;

use super::test_support::{differences, scattered_points};
use super::*;

mod crossings;
mod placement;
mod values;

/// The phantoms whose parts all follow the distance to a surface.
fn of_boundaries() -> impl Iterator<Item = Phantom> {
    let made_of_boundaries =
        |phantom: &Phantom| !phantom.scene(&settings([64; 3])).expect("a scene").boundaries.is_empty();
    Phantom::ALL.into_iter().filter(made_of_boundaries)
}

fn settings(dims: [u32; 3]) -> PhantomSettings {
    PhantomSettings { dims, ..PhantomSettings::default() }
}

fn values(phantom: Phantom, settings: &PhantomSettings) -> Vec<f64> {
    let grid = phantom.generate(settings).expect("valid settings");
    (0..grid.scalars.len()).map(|index| grid.physical(index)).collect()
}

#[test]
fn names_lead_back() {
    for phantom in Phantom::ALL {
        assert_eq!(Phantom::from_name(phantom.name()), Some(phantom));
        assert!(!phantom.description().is_empty());
    }
    assert_eq!(Phantom::from_name("cube"), None);
}

#[test]
fn the_ball_is_the_one_its_description_promises() {
    let scene = Phantom::Ball.scene(&settings([64; 3])).expect("valid settings");
    let centre = DVec3::new(31.8, 31.3, 31.6);
    assert!((scene.signed_distance(centre).expect("a surface") - 20.0).abs() < 1e-12);
    assert!((scene.value(centre + DVec3::new(0.0, 20.0, 0.0)) - 0.5).abs() < 1e-12);
    // One blur outside: half of erfc(1/√2), the normal distribution's tail beyond one deviation.
    assert!((scene.value(centre + DVec3::new(21.5, 0.0, 0.0)) - 0.158_655_253_931_457).abs() < 1e-12);
    let peak = scene.gradient_magnitude_at_boundary(centre).expect("a boundary");
    assert!((peak - 0.265_961_520_267_622).abs() < 1e-12);
}

#[test]
fn the_three_balls_are_those_of_the_benchmark() {
    let scene = Phantom::ThreeBalls.scene(&settings([256; 3])).expect("valid settings");
    let expected = [
        ([128.3, 127.8, 128.1], 80.0, 0.5, 1.0),
        ([90.0, 120.0, 130.0], 25.0, 0.3, 1.5),
        ([160.0, 140.0, 120.0], 30.0, -0.2, 1.2),
    ];
    for (boundary, (centre, radius, step, blur)) in scene.boundaries.iter().zip(expected) {
        let surface = Surface::Ball { centre: DVec3::from_array(centre), radius };
        assert_eq!(*boundary, Boundary { surface, step, blur });
    }
    // The dark ball: its outside is the side of the higher value.
    let depth = scene.signed_distance(DVec3::new(160.0, 140.0, 120.0)).expect("a surface");
    assert!((depth + 30.0).abs() < 1e-12);
}

#[test]
fn derivatives_of_every_scene_agree_with_differences() {
    let settings = PhantomSettings { spacing: [0.7, 0.7, 1.1], ..settings([64, 64, 48]) };
    for phantom in Phantom::ALL {
        let scene = phantom.scene(&settings).expect("valid settings");
        let (detail, step) = (scene.smallest_detail(), scene.largest_step());
        for point in scattered_points(settings.middle(), 25.0) {
            let found = scene.derivatives(point);
            let (gradient, hessian) =
                differences(point, 1e-2 * detail, |place| scene.value(place), |place| scene.gradient(place));
            let error = (gradient - found.gradient).length() * detail / step;
            assert!(error < 1e-8, "{} {point}: {error}", phantom.name());
            let error = (hessian - found.hessian).to_cols_array().into_iter().fold(0.0, |a: f64, b| a.max(b.abs()));
            assert!(error * detail * detail / step < 1e-6, "{} {point}: {error}", phantom.name());
            let laplacian = hessian.x_axis.x + hessian.y_axis.y + hessian.z_axis.z;
            assert!((scene.laplacian(point) - laplacian).abs() * detail * detail / step < 1e-6);
            let normal = gradient.normalize_or_zero();
            if gradient.length() * detail > 1e-4 * step {
                let along = normal.dot(hessian * normal);
                assert!((scene.second_derivative(point) - along).abs() * detail * detail / step < 1e-5);
            }
        }
    }
}

#[test]
fn truth_is_signed_by_the_value_and_ends_at_its_reach() {
    let settings = PhantomSettings { spacing: [0.5, 0.5, 1.5], ..settings([64, 64, 32]) };
    for phantom in of_boundaries() {
        let scene = phantom.scene(&settings).expect("valid settings");
        let truth = phantom.truth(&settings).expect("valid settings");
        let mut found = [0_usize; 3];
        for (index, &distance) in truth.iter().enumerate() {
            let point = DVec3::new((index % 64) as f64, (index / 64 % 64) as f64, (index / 4096) as f64)
                * DVec3::from_array(settings.spacing);
            if distance.is_nan() {
                assert!(scene.signed_distance(point).expect("a surface").abs() > 7.5, "{} {point}", phantom.name());
                found[2] += 1;
                continue;
            }
            assert!(distance.abs() <= 7.5, "{} {point}", phantom.name());
            let boundary = scene.nearest_boundary(point).expect("a boundary");
            let beyond_half = boundary.value(point) - boundary.step.min(0.0) > 0.5 * boundary.step.abs();
            assert_eq!(distance > 0.0, beyond_half, "{} {point} {distance}", phantom.name());
            found[usize::from(distance > 0.0)] += 1;
        }
        assert!(found[0] > 500 && found[1] > 500, "{}: both sides {found:?}", phantom.name());
    }
    let truth = Phantom::Ball.truth(&settings).expect("valid settings");
    assert!(truth[0].is_nan(), "the corner is far from the ball");
}

#[test]
fn noise_is_the_same_for_any_number_of_threads() {
    let settings = PhantomSettings { noise: 0.05, seed: 3, ..settings([33, 20, 17]) };
    let with_threads = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
        pool.install(|| Phantom::Shells.generate(&settings).expect("valid settings").voxels_sha256())
    };
    assert_eq!(with_threads(1), with_threads(2));
    assert_eq!(with_threads(1), with_threads(7));
    let other = PhantomSettings { seed: 4, ..settings.clone() };
    assert_ne!(with_threads(1), Phantom::Shells.generate(&other).expect("valid settings").voxels_sha256());
}

#[test]
fn noise_is_a_share_of_the_largest_step() {
    let clean = PhantomSettings { scalar_type: ScalarType::F64, ..settings([32; 3]) };
    let noisy = PhantomSettings { noise: 0.1, ..clean.clone() };
    for (phantom, step) in [(Phantom::Ball, 1.0), (Phantom::ThreeBalls, 0.5), (Phantom::Shells, 0.7)] {
        let pairs = values(phantom, &noisy).into_iter().zip(values(phantom, &clean));
        let variance = pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / 32_768.0;
        assert!((variance.sqrt() / (0.1 * step) - 1.0).abs() < 0.02, "{}: {}", phantom.name(), variance.sqrt());
    }
}

#[test]
fn integers_hold_the_stated_range_rounded_to_the_nearest() {
    let float = PhantomSettings { scalar_type: ScalarType::F64, ..settings([64; 3]) };
    let exact = values(Phantom::ThreeBalls, &float);
    for scalar_type in ScalarType::ALL {
        let Some([low, high]) = stored_range(scalar_type) else { continue };
        let grid =
            Phantom::ThreeBalls.generate(&PhantomSettings { scalar_type, ..float.clone() }).expect("valid settings");
        assert_eq!(grid.scalars.scalar_type(), scalar_type);
        for (index, value) in exact.iter().enumerate() {
            let stored = low + value / 0.8 * (high - low);
            assert!((grid.scalars.get(index) - stored).abs() <= 0.5 + 1e-6, "{} {index}", scalar_type.name());
        }
        let [darkest, brightest] = grid.scalars.finite_range().expect("a volume holds numbers");
        assert!(
            darkest == low && (high - brightest).abs() <= 1.0 + 1e-4 * (high - low),
            "{}: {darkest} {brightest}",
            scalar_type.name()
        );
    }
}

#[test]
fn strong_noise_is_clamped_to_the_type() {
    let settings = PhantomSettings { noise: 2.0, scalar_type: ScalarType::U8, ..settings([16; 3]) };
    let grid = Phantom::Ball.generate(&settings).expect("valid settings");
    assert_eq!(grid.scalars.finite_range(), Some([0.0, 255.0]));
}

#[test]
fn unusable_settings_are_refused() {
    let good = settings([8; 3]);
    for bad in [
        PhantomSettings { dims: [0, 8, 8], ..good.clone() },
        PhantomSettings { dims: [u32::MAX; 3], ..good.clone() },
        PhantomSettings { spacing: [1.0, -1.0, 1.0], ..good.clone() },
        PhantomSettings { blur: 0.0, ..good.clone() },
        PhantomSettings { blur: f64::NAN, ..good.clone() },
        PhantomSettings { noise: -0.1, ..good.clone() },
        PhantomSettings { thickness: 0.0, ..good.clone() },
        PhantomSettings { thickness: f64::INFINITY, ..good.clone() },
        PhantomSettings { rotation: [0.0, f64::NAN, 0.0], ..good.clone() },
        PhantomSettings { offset: [0.0, 0.0, f64::INFINITY], ..good.clone() },
        PhantomSettings { value_scale: 0.0, ..good.clone() },
        PhantomSettings { value_scale: 1e39, ..good.clone() },
        PhantomSettings { value_scale: 1e-39, ..good.clone() },
        PhantomSettings { value_offset: f64::NAN, ..good.clone() },
        PhantomSettings { value_scale: 2.0, scalar_type: ScalarType::U8, ..good.clone() },
        PhantomSettings { quantization: Some(Quantization::U12), ..good.clone() },
        PhantomSettings { quantization: Some(Quantization::U12), scalar_type: ScalarType::U8, ..good.clone() },
    ] {
        assert!(Phantom::Ball.generate(&bad).is_err(), "{bad:?}");
        assert!(Phantom::Ball.truth(&bad).is_err(), "{bad:?}");
    }
    // 2³¹ · 2²⁰ · 4 voxels can be counted but not held.
    let huge = PhantomSettings { dims: [1 << 31, 1 << 20, 4], ..good };
    assert!(matches!(Phantom::Ball.generate(&huge), Err(Error::OutOfMemory { .. })));
    // Two slabs of 4 voxels and the gap between them are longer than 8 voxels.
    let message = Phantom::SlabPair.generate(&settings([8; 3])).expect_err("too thick").to_string();
    assert!(message.contains("4 voxels thick"), "{message}");
    let message = Phantom::MarschnerLobb.truth(&settings([8; 3])).expect_err("no surface").to_string();
    assert!(message.contains("never sharp"), "{message}");
}
