//! The camera by hand.

use egui::{Event, Modifiers, MouseWheelUnit, PointerButton, TouchPhase, Vec2, vec2};
use egui_kittest::kittest::Queryable;
use voxrole_viewer::state::Camera;

use crate::{PICTURE, drag, open, rect_of, settle};

#[test]
fn the_camera_follows_a_slow_hand() {
    let Some(mut harness) = open() else { return };
    let middle = rect_of(&harness, PICTURE).center();
    let button = |pos, pressed| Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    harness.hover_at(middle);
    harness.step();
    harness.event(button(middle, true));
    harness.step();
    let mut azimuths = Vec::new();
    for point in 1..=30 {
        harness.event(Event::PointerMoved(middle + vec2(point as f32, 0.0)));
        harness.step();
        azimuths.push(harness.state().view.camera.azimuth);
    }
    harness.event(button(middle + vec2(30.0, 0.0), false));
    harness.step();
    // The first few points may still become a click.
    let turned = azimuths[29] - azimuths[9];
    assert!((turned + 8.0).abs() < 0.01, "{azimuths:?}");
}

#[test]
fn the_hand_orbits_pans_zooms_and_resets() {
    let Some(mut harness) = open() else { return };
    let middle = rect_of(&harness, PICTURE).center();
    let start = harness.state().view.camera;
    drag(&mut harness, PointerButton::Primary, Modifiers::NONE, middle, middle + vec2(50.0, 25.0));
    let orbited = harness.state().view.camera;
    assert!((orbited.azimuth - (start.azimuth - 20.0)).abs() < 1.0, "{orbited:?}");
    assert!((orbited.elevation - (start.elevation + 10.0)).abs() < 1.0, "{orbited:?}");
    assert_eq!(orbited.pan, [0.0; 2]);

    drag(&mut harness, PointerButton::Primary, Modifiers::SHIFT, middle, middle + vec2(40.0, 0.0));
    drag(&mut harness, PointerButton::Secondary, Modifiers::NONE, middle, middle + vec2(0.0, -40.0));
    let panned = harness.state().view.camera;
    assert!(panned.pan[0] < 0.0 && panned.pan[1] < 0.0, "the volume goes right and up: {panned:?}");
    assert_eq!(panned.azimuth, orbited.azimuth);

    harness.hover_at(middle);
    harness.step();
    harness.event(Event::MouseWheel {
        unit: MouseWheelUnit::Point,
        delta: Vec2::new(0.0, 100.0),
        source: egui::MouseWheelSource::Wheel,
        phase: TouchPhase::Move,
        modifiers: Modifiers::NONE,
    });
    settle(&mut harness);
    assert!(harness.state().view.camera.zoom > 1.1, "{}", harness.state().view.camera.zoom);

    for _ in 0..2 {
        harness.get_by_label(PICTURE).click();
    }
    settle(&mut harness);
    assert_eq!(harness.state().view.camera, Camera::default());
}
