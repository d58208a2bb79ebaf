//! Pictures and sessions saved in the window, and sessions that were saved of another volume.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use voxrole_pack::Reader;
use voxrole_tests::comparison::{draw_on_cpu, draw_on_gpu};
use voxrole_viewer::state::{Camera, SavedVolume};
use voxrole_viewer::ui::ViewerWindow;
use voxrole_viewer::ui::kept_window::KeptWindow;
use voxrole_viewer::ui::opened_volume::OpenedVolume;
use voxrole_viewer::{Gpu, ViewState};

use crate::{CPU, GPU, harness, open, open_on, render_state, settle, shells, texels};

/// Lets the window go on until the picture is written.
pub fn wait_for_file(harness: &mut Harness<'_, ViewerWindow>) {
    let start = Instant::now();
    while harness.state().save.is_saving() {
        assert!(start.elapsed().as_secs() < 120, "the picture is not written");
        std::thread::sleep(Duration::from_millis(2));
        harness.step();
    }
    harness.run();
}

#[test]
fn saved_pictures_are_the_renderer_s_own_and_never_replace_a_stranger_s_file_unasked() {
    for device in [CPU, GPU] {
        let Some(mut harness) = open_on(device) else { return };
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("window-saved.png");
        std::fs::write(&path, b"something else").expect("writes");
        assert_eq!(harness.state().save.path, shells().with_extension("png").display().to_string());
        let window = harness.state_mut();
        window.save.path = path.display().to_string();
        window.view.render_settings.image_size = [120, 90];
        let view = window.view.clone();
        settle(&mut harness);
        harness.get_by_label("Save PNG").click();
        settle(&mut harness);
        assert_eq!(std::fs::read(&path).expect("reads"), b"something else");
        harness.get_by_label("Replace PNG").click();
        harness.step();
        assert!(harness.state().save.is_saving(), "the window goes on meanwhile");
        wait_for_file(&mut harness);

        let saved = image::open(&path).expect("a picture").into_rgba8();
        assert_eq!(saved.dimensions(), (120, 90));
        assert!(saved.pixels().any(|pixel| pixel != saved.get_pixel(60, 45)), "the picture is uniform");
        let gpu = Gpu::new().expect("opened before");
        let expected = if device.cpu { draw_on_cpu(&texels(), &view) } else { draw_on_gpu(&gpu, &texels(), &view) };
        assert!(saved.as_raw() == &expected.rgba, "window and `render` draw the same picture");
    }
}

#[cfg(unix)]
#[test]
fn the_volume_that_is_shown_is_not_replaced() {
    let Some(mut harness) = open_on(CPU) else { return };
    let before = std::fs::read(shells()).expect("reads");
    for (path, reason) in [
        (shells().to_owned(), "name it so"),
        // A link of the right name to it.
        (Path::new(env!("CARGO_TARGET_TMPDIR")).join("window-linked.png"), "overwritten"),
    ] {
        if path != shells() {
            let _ = std::fs::remove_file(&path);
            std::os::unix::fs::symlink(shells(), &path).expect("links");
        }
        harness.state_mut().save.path = path.display().to_string();
        for _ in 0..2 {
            harness.get_by_label("Save PNG").click();
            harness.run();
            assert!(!harness.state().save.is_saving());
            harness.get_by_label_contains(reason);
        }
    }
    assert!(std::fs::read(shells()).expect("reads") == before);
}

#[test]
fn a_session_of_another_volume_is_told_of() {
    let Some(render_state) = render_state() else { return };
    let reader = Reader::open(shells()).expect("opens");
    let volume = OpenedVolume::read(shells(), &reader, &texels().description).expect("has histograms");
    let this = SavedVolume::of(&volume.header);
    let mut window = KeptWindow::new(volume);
    let session = |volume: Option<SavedVolume>| ViewState { volume, ..window.view.clone() };
    let [own, none] = [session(Some(this.clone())), session(None)];
    let other = session(Some(SavedVolume { name: "head.nrrd".into(), value_range: [-1000.0, 3000.0] }));
    for session in [own, none] {
        assert_eq!(window.open_session(session), None);
    }
    // Regions are proposed where a session draws nothing, as for `render`.
    let (mut session, proposed) = (window.view.clone(), window.view.transfer_function.regions.clone());
    session.transfer_function.regions.clear();
    window.open_session(session.clone());
    assert!(!proposed.is_empty() && window.view.transfer_function.regions == proposed);
    session.transfer_function.curve = "0,FF0000,0.5".parse().expect("a curve");
    window.open_session(session);
    assert_eq!(window.view.transfer_function.regions, []);
    let told = window.open_session(other).expect("is another").to_owned();
    assert!(told.contains("saved of head.nrrd (values -1000 to 3000)"), "{told}");
    window.view.render_settings.step = 4.0;
    assert_eq!(window.view.volume, Some(this), "what is saved next is of this volume");
    let window = window.open(&render_state, &Arc::new(texels()), CPU).expect("fits the device");
    let harness = harness(render_state, window);
    harness.get_by_label_contains("session was saved of head.nrrd");
}

#[test]
fn what_a_session_says_stays_as_it_is_until_somebody_changes_it() {
    let Some(mut harness) = open() else { return };
    let state = &mut harness.state_mut().view;
    state.camera = Camera { azimuth: 270.5, elevation: 35.264, zoom: 0.333_33, ..Camera::default() };
    state.render_settings.step = 4.0;
    (state.render_settings.light.azimuth, state.render_settings.shading.ambient) = (-200.25, 0.123_456);
    state.transfer_function.emphasis = "linear,0.004,20/concave,1,0.05,30".parse().expect("an emphasis");
    state.clipping.planes = vec!["270,10.5,0.123456".parse().expect("a plane")];
    // Narrower than a hand can make one.
    state.transfer_function.regions = vec!["0.5:0.50001,0.1:0.10001,FFFFFF".parse().expect("a region")];
    let before = state.clone();
    settle(&mut harness);
    assert_eq!(harness.state().view, before);
}
