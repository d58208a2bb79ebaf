//! Opacity integrated along steps needs far fewer of them.

use voxrole_viewer::reference::RayMarcher;
use voxrole_viewer::state::{Camera, Integration};
use voxrole_viewer::{ViewState, VolumeTexels};

use crate::phantom::Phantom;

/// Root-mean-square difference of the light of two pictures.
fn difference(volume: &VolumeTexels, a: &ViewState, b: &ViewState) -> f32 {
    let light = |state| RayMarcher::new(volume, state, [40, 40]).expect("a size").light().0.pixels;
    let (a, b) = (light(a), light(b));
    let squares: f32 = a.iter().zip(&b).map(|(a, b)| (a.light - b.light).length_squared()).sum();
    (squares / (4 * a.len()) as f32).sqrt()
}

#[test]
fn a_step_of_a_voxel_is_as_good_as_many_short_ones() {
    let phantom = Phantom::ball();
    let volume = phantom.texels();
    let mut reference = phantom.state(Camera::default());
    reference.transfer_function.emphasis = "concave,1,3,7".parse().expect("an emphasis");
    reference.render_settings.termination_opacity = 1.0;
    let error = |integration, step| {
        let mut state = reference.clone();
        state.render_settings.integration = integration;
        state.render_settings.step = step;
        let mut truth = reference.clone();
        truth.render_settings.integration = Integration::PostClassified;
        truth.render_settings.step = 1.0 / 64.0;
        difference(&volume, &state, &truth)
    };
    let [long, short] = [1.0, 0.25].map(|step| error(Integration::PostClassified, step));
    let integrated = error(Integration::Preintegrated, 1.0);
    println!("post-classified: {long} with a step of 1, {short} of 1/4; preintegrated: {integrated} of 1");
    assert!(integrated < 0.5 * short && integrated < 0.05 * long, "{integrated} {short} {long}");
}

#[test]
fn both_ways_come_to_the_same_picture() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    for emphasis in ["concave,1,3,3", "linear,0.1,15", "convex,0.7,2,3/concave,1,4,5"] {
        let mut state = phantom.state(Camera::default());
        state.transfer_function.emphasis = emphasis.parse().expect("an emphasis");
        state.render_settings.step = 1.0 / 32.0;
        let mut other = state.clone();
        other.render_settings.integration = Integration::PostClassified;
        let difference = difference(&volume, &state, &other);
        assert!(difference < 0.25 / 255.0, "{emphasis}: {difference}");
    }
}
