//! Opacity integrated along steps needs far fewer of them.

use voxrole_tests::comparison::{assert_same, difference, draw_on_cpu, draw_on_gpu, gpu_or_skip};
use voxrole_viewer::Picture;
use voxrole_viewer::bench::{Row, measure};
use voxrole_viewer::reference::RayMarcher;
use voxrole_viewer::state::{Camera, Integration, Technique};

use crate::phantom::Phantom;

#[test]
fn a_step_of_a_voxel_is_as_good_as_many_short_ones() {
    let phantom = Phantom::ball();
    let mut state = phantom.state(Camera::default());
    state.transfer_function.emphasis = "concave,1,3,7".parse().expect("an emphasis");
    state.render_settings.image_size = [40, 40];
    let mut rows = measure(&phantom.texels(), &state).expect("something is visible");
    assert_eq!(rows.len(), 36);
    rows.retain(|row| row.technique == Technique::Rays);
    let of = |integration, step| {
        let row = rows.iter().find(|row| (row.integration, row.step) == (integration, step));
        row.copied().expect("is measured")
    };
    let errors = |integration| -> Vec<f64> {
        rows.iter().filter(|row| row.integration == integration).map(|row| row.error).collect()
    };
    // Shorter steps are better, from the longest on.
    let post = errors(Integration::PostClassified);
    assert!(post.windows(2).all(|pair| pair[1] < pair[0]), "{post:?}");
    let Row { error, largest, samples, .. } = of(Integration::Preintegrated, 1.0);
    let short = of(Integration::PostClassified, 0.125);
    assert!(error < 0.5 * short.error && largest <= 1, "{error} of {largest}, {short:?}");
    assert!(4 * samples.taken < short.samples.taken, "{samples:?} {short:?}");
}

#[test]
fn both_ways_come_to_the_same_picture() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    for emphasis in ["concave,1,3,3", "linear,0.1,15", "convex,0.7,2,3/concave,1,4,5"] {
        let mut state = phantom.state(Camera::default());
        state.transfer_function.emphasis = emphasis.parse().expect("an emphasis");
        state.render_settings.step = 1.0 / 32.0;
        let pictures = [Integration::Preintegrated, Integration::PostClassified].map(|integration| {
            state.render_settings.integration = integration;
            RayMarcher::new(&volume, &state, [40, 40]).expect("a size").light().0
        });
        let squares: f32 =
            pictures[0].pixels.iter().zip(&pictures[1].pixels).map(|(a, b)| (a.light - b.light).length_squared()).sum();
        let difference = (squares / (4 * 40 * 40) as f32).sqrt();
        assert!(difference < 0.25 / 255.0, "{emphasis}: {difference}");
    }
}

#[test]
fn jitter_makes_grain_of_rings_and_no_more_of_it() {
    let phantom = Phantom::ball();
    let volume = phantom.texels();
    let mut state = phantom.state(Camera::default());
    state.transfer_function.emphasis = "concave,1,3,7".parse().expect("an emphasis");
    state.render_settings.image_size = [64, 64];
    state.render_settings.integration = Integration::PostClassified;
    let mut draw = |step, jitter| {
        (state.render_settings.step, state.render_settings.jitter) = (step, jitter);
        draw_on_cpu(&volume, &state)
    };
    let truth = draw(1.0 / 32.0, false);
    let [rings, grain] = [false, true].map(|jitter| draw(1.0, jitter));
    let [of_rings, of_grain] = [&rings, &grain].map(|picture| difference(picture, &truth).0);
    assert!(of_grain < 1.25 * of_rings && of_grain > 0.5 * of_rings, "{of_rings} {of_grain}");
    // Averaged over blocks of pixels the grain is gone, and rings are not.
    let mean = |picture: &Picture, x: u32, y: u32| -> f64 {
        let pixels = (0..64).map(|pixel| picture.pixel(8 * x + pixel % 8, 8 * y + pixel / 8)[0]);
        pixels.map(f64::from).sum::<f64>() / 64.0
    };
    let off = |picture: &Picture| -> f64 {
        let blocks = (0..64).map(|block| (block % 8, block / 8));
        blocks.map(|(x, y)| (mean(picture, x, y) - mean(&truth, x, y)).powi(2)).sum()
    };
    assert!(off(&grain) < 0.5 * off(&rings), "{} {}", off(&grain), off(&rings));
    // Short steps need none.
    assert!(difference(&draw(1.0 / 16.0, true), &truth).0 < 0.1);
}

#[test]
fn gpu_and_cpu_jitter_alike() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_jitter_alike") else { return };
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    let mut state = phantom.state(Camera::default());
    state.render_settings.jitter = true;
    state.render_settings.step = 1.0;
    state.render_settings.integration = Integration::PostClassified;
    for leaps in [true, false] {
        state.render_settings.leaps = leaps;
        assert_same("jittered", &draw_on_cpu(&volume, &state), &draw_on_gpu(&gpu, &volume, &state));
    }
}
