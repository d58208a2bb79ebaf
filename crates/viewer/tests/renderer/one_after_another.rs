//! One ray marcher for many states, as the window has it: what it keeps must not be seen.

use std::sync::Arc;

use voxrole_viewer::reference::{RayMarcher, SampleCounts};
use voxrole_viewer::scene::Surfaces;
use voxrole_viewer::state::{Camera, Classification, Integration, Projection, Technique};
use voxrole_viewer::{ViewState, Watch};

use crate::phantom::Phantom;

/// What is changed from one picture to the next, and stays.
const CHANGES: [fn(&mut ViewState); 16] = [
    |state| state.camera.orbit(30.0, 10.0),
    |state| state.transfer_function.regions[0].color = [0.1, 0.9, 0.4],
    |state| state.transfer_function.regions[0].opacity *= 0.5,
    |state| state.transfer_function.emphasis.high.d_c *= 3.0,
    |state| state.render_settings.shading.occlusion = 0.8,
    |state| state.clipping.planes.push("20,10,0.2".parse().expect("a plane")),
    |state| state.transfer_function.curve = "0,ff0000,0;60,00ff00,0.2".parse().expect("a curve"),
    |state| state.transfer_function.classification = Classification::Value,
    |state| state.render_settings.integration = Integration::FrontToBack,
    |state| state.render_settings.step = 3.0,
    |state| state.render_settings.technique = Technique::Slices,
    |state| state.transfer_function.classification = Classification::Roles,
    |state| state.camera.projection = Projection::Orthographic,
    |state| state.scene.isosurfaces = vec!["100,FF0000".parse().expect("an isosurface")],
    |state| state.transfer_function.classification = Classification::Value,
    |state| state.render_settings.integration = Integration::PostClassified,
];

#[test]
fn what_is_kept_between_pictures_changes_nothing() {
    let phantom = Phantom::concentric_shells();
    let (volume, mut state) = (phantom.texels(), phantom.state(Camera::default()));
    let mut kept = RayMarcher::new(&volume, &state, [64, 48]).expect("a size");
    for (number, change) in CHANGES.iter().enumerate() {
        change(&mut state);
        let surfaces = Arc::new(Surfaces::of(&state, &volume).expect("a scene"));
        // Drafts are smaller.
        for size in [[16, 12], [64, 48]] {
            kept.look_at(&state, size, Arc::clone(&surfaces)).expect("a size");
            let fresh = RayMarcher::new(&volume, &state, size).expect("a size");
            assert!(kept.draw_and_count() == fresh.draw_and_count(), "after change {number}, {size:?}");
        }
    }
    assert!(kept.look_at(&state, [0, 5], Arc::default()).is_err());
}

#[test]
fn what_reaches_farther_for_another_reason_is_seen() {
    let phantom = Phantom::concentric_shells();
    let (volume, mut state) = (phantom.texels(), phantom.state(Camera::default()));
    state.render_settings.integration = Integration::PostClassified;
    for d_c in [0.5, 1.0, 2.0, 3.0] {
        let mut set = |d_c, step| {
            state.transfer_function.emphasis.high.d_c = d_c;
            state.transfer_function.emphasis.low.d_c = d_c;
            state.render_settings.step = step;
            state.clone()
        };
        let mut kept = RayMarcher::new(&volume, &set(d_c, 1.0), [64, 48]).expect("a size");
        let _ = kept.draw();
        // As far as macrocells are asked this is the same.
        let after = set(d_c + 0.25, 0.5);
        kept.look_at(&after, [64, 48], Arc::default()).expect("a size");
        let fresh = RayMarcher::new(&volume, &after, [64, 48]).expect("a size");
        assert!(kept.draw_and_count() == fresh.draw_and_count(), "{d_c}");
    }
}

#[test]
fn a_picture_that_is_given_up_takes_no_samples() {
    let phantom = Phantom::ball();
    let (volume, state) = (phantom.texels(), phantom.state(Camera::default()));
    let marcher = RayMarcher::new(&volume, &state, [40, 30]).expect("a size");
    let watch = Watch::default();
    let (light, counts) = marcher.watched_light(&watch);
    assert_eq!((light.pixels.len(), watch.rows()), (40 * 30, 30));
    assert!(counts.taken > 0);
    let watch = Watch::default();
    watch.give_up();
    assert_eq!((marcher.watched_light(&watch).1, watch.rows()), (SampleCounts::default(), 0));
}
