//! Accuracy of distance and gradient at the hit against phantoms with exact truth.

use voxrole_preprocess::phantom::{Phantom, PhantomSettings};
use voxrole_preprocess::prepare::compute_roles;
use voxrole_preprocess::progress::Silent;
use voxrole_preprocess::report::Stopwatch;
use voxrole_preprocess::settings::{Climb, Method, Settings};

/// Errors of the voxels whose true distance is within two blurs.
#[derive(Debug)]
struct Accuracy {
    hit_rate: f64,
    rms: f64,
    wrong: usize,
    /// Voxels anywhere that hit more than half a voxel off.
    wrong_anywhere: usize,
    gradient_bias: f64,
}

fn measure(phantom: Phantom, phantom_settings: &PhantomSettings, settings: &Settings) -> Accuracy {
    let grid = phantom.generate(phantom_settings).expect("a phantom");
    let truth = phantom.truth(phantom_settings).expect("its truth");
    let (prepared, _) = compute_roles(&grid, settings, &Silent, &mut Stopwatch::new()).expect("roles");
    let scale = prepared.field.smallest_spacing;
    let blur = phantom_settings.blur * scale;
    let exact = phantom.scene(phantom_settings).expect("a scene").boundaries[0].gradient_magnitude();
    let (mut within, mut hits, mut squares, mut wrong, mut wrong_anywhere, mut bias) = (0, 0, 0.0, 0, 0, 0.0);
    for (voxel, &truth) in truth.iter().enumerate() {
        let distance = f64::from(prepared.roles.distance[voxel]) * scale;
        let error = distance - f64::from(truth);
        let off = error.is_nan() || error.abs() > 0.5 * scale;
        wrong_anywhere += usize::from(distance.is_finite() && off);
        if truth.is_nan() || f64::from(truth).abs() > 2.0 * blur {
            continue;
        }
        within += 1;
        if distance.is_finite() {
            hits += 1;
            squares += (error / scale).powi(2);
            wrong += usize::from(off);
            bias += f64::from(prepared.roles.hit_gradient[voxel]) * prepared.field.gradient_scale() / exact - 1.0;
        }
    }
    let count = f64::from(hits);
    Accuracy {
        hit_rate: count / f64::from(within),
        rms: (squares / count).sqrt(),
        wrong,
        wrong_anywhere,
        gradient_bias: bias / count,
    }
}

#[test]
fn blurred_ball() {
    for blur in [0.7, 1.0, 1.5, 2.0] {
        let phantom = PhantomSettings { blur, ..PhantomSettings::default() };
        for climb in [Climb::Release, Climb::Literal] {
            let settings = Settings { climb, ..Settings::new(Method::Fast) };
            eprintln!("{blur} {climb}: {:?}", measure(Phantom::Ball, &phantom, &settings));
        }
    }
}
