//! Scale, offset, quantisation and noise of the stored numbers.

use super::*;

fn float(scalar_type: ScalarType) -> PhantomSettings {
    PhantomSettings { scalar_type, ..settings([20, 16, 12]) }
}

#[test]
fn scale_and_offset_are_exact_to_the_type() {
    for phantom in [Phantom::Shells, Phantom::Box, Phantom::MarschnerLobb] {
        let plain = values(phantom, &float(ScalarType::F64));
        for (scale, offset) in [(1e30, 0.0), (1e-30, 0.0), (1.0, 1e6), (-2.5, 1e6), (1e-6, 1.0), (-1e30, 3e29)] {
            let mapped = PhantomSettings { value_scale: scale, value_offset: offset, ..float(ScalarType::F64) };
            let expected = plain.iter().map(|value| scale.mul_add(*value, offset));
            assert!(values(phantom, &mapped).into_iter().eq(expected), "{} {scale} {offset}", phantom.name());
            let single = PhantomSettings { scalar_type: ScalarType::F32, ..mapped };
            let expected = plain.iter().map(|value| f64::from(scale.mul_add(*value, offset) as f32));
            assert!(values(phantom, &single).into_iter().eq(expected), "{} {scale} {offset}", phantom.name());
        }
    }
}

#[test]
fn the_scene_has_the_values_that_are_stored() {
    for (scale, offset) in [(1e30, 0.0), (1e-30, 0.0), (4.0, 1e6), (-1.0, 0.0)] {
        let mapped = PhantomSettings { value_scale: scale, value_offset: offset, ..float(ScalarType::F64) };
        for phantom in Phantom::ALL.into_iter().filter(|phantom| *phantom != Phantom::SlabPair) {
            let (scene, plain) = (phantom.scene(&mapped).expect("a scene"), float(ScalarType::F64));
            let plain = phantom.scene(&plain).expect("a scene");
            let rounding = f64::EPSILON * (4.0 * scale.abs() + offset);
            for (index, value) in values(phantom, &mapped).iter().enumerate().step_by(7) {
                let point = DVec3::new((index % 20) as f64, (index / 20 % 16) as f64, (index / 320) as f64);
                assert!((scene.value(point) - value).abs() <= rounding, "{} {scale} {offset}", phantom.name());
                // Turned upside down every distance changes its sign and nothing else does.
                let (a, b) = (plain.signed_distance(point), scene.signed_distance(point));
                assert_eq!(a.map(|distance| distance * scale.signum()), b, "{} {scale}", phantom.name());
                let (a, b) = (plain.crossing(point, 6.0), scene.crossing(point, 6.0));
                assert_eq!(a.is_some(), b.is_some(), "{} {scale} {point}", phantom.name());
                let (Some(a), Some(b)) = (a, b) else { continue };
                assert!((a.distance * scale.signum() - b.distance).abs() < 1e-8, "{} {a:?} {b:?}", phantom.name());
                let ratio = b.gradient_magnitude / (a.gradient_magnitude * scale.abs());
                assert!((ratio - 1.0).abs() < 1e-8, "{} {a:?} {b:?}", phantom.name());
            }
        }
    }
}

#[test]
fn twelve_bits_end_at_4095() {
    let twelve =
        PhantomSettings { scalar_type: ScalarType::U16, quantization: Some(Quantization::U12), ..settings([64; 3]) };
    let clean = Phantom::Ball.generate(&twelve).expect("a volume");
    assert_eq!(clean.scalars.scalar_type(), ScalarType::U16);
    assert_eq!(clean.scalars.finite_range(), Some([320.0, 3760.0]));
    let noisy = Phantom::Ball.generate(&PhantomSettings { noise: 0.5, ..twelve.clone() }).expect("a volume");
    assert_eq!(noisy.scalars.finite_range(), Some([0.0, 4095.0]));
    let own = Quantization { plateaus: [-50.0, 70.0], limits: [-60.0, 75.0] };
    let own = PhantomSettings { scalar_type: ScalarType::I16, quantization: Some(own), noise: 0.5, ..twelve };
    let found = Phantom::Ball.generate(&own).expect("a volume").scalars.finite_range();
    assert_eq!(found, Some([-60.0, 75.0]));
}

#[test]
fn rician_noise_lifts_what_is_dark_and_keeps_what_is_bright() {
    let rician = |noise| PhantomSettings { noise, noise_kind: NoiseKind::Rician, ..settings([48; 3]) };
    let clean = values(Phantom::Ball, &rician(0.0));
    let noisy = values(Phantom::Ball, &rician(0.05));
    let mean_where = |wanted: fn(f64) -> bool| {
        let (sum, count) = clean
            .iter()
            .zip(&noisy)
            .filter(|(clean, _)| wanted(**clean))
            .fold((0.0, 0.0), |(sum, count), (clean, noisy)| (sum + noisy - clean, count + 1.0));
        sum / count
    };
    // Rayleigh: σ√(π/2); at twenty times the noise: σ²/2v.
    let dark = mean_where(|value| value < 1e-6);
    assert!((dark / (0.05 * std::f64::consts::FRAC_PI_2.sqrt()) - 1.0).abs() < 0.01, "{dark}");
    let bright = mean_where(|value| value > 1.0 - 1e-6);
    assert!((bright - 0.05 * 0.05 / 2.0).abs() < 0.002, "{bright}");
    assert!(noisy.iter().all(|value| *value >= 0.0));
}

#[test]
fn rician_noise_is_the_same_for_any_number_of_threads() {
    let settings = PhantomSettings {
        noise: 0.05,
        noise_kind: NoiseKind::Rician,
        rotation: [5.0, 6.0, 7.0],
        ..settings([33, 20, 17])
    };
    let with_threads = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
        pool.install(|| Phantom::Box.generate(&settings).expect("valid settings").voxels_sha256())
    };
    assert_eq!(with_threads(1), with_threads(5));
}
