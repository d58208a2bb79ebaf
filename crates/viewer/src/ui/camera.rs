//! Where the picture is taken from.

use egui::{Slider, Ui};

use super::form::{rows, slider_row};
use crate::state::{Camera, CameraPreset, Projection};

/// The sides to look from, projection and magnification.
pub fn camera_ui(ui: &mut Ui, camera: &mut Camera) {
    ui.horizontal_wrapped(|ui| {
        for preset in CameraPreset::ALL {
            if ui.small_button(preset.name()).on_hover_text("Look from this side").clicked() {
                camera.look_from(preset);
            }
        }
        if ui.small_button("reset").on_hover_text("Back to the first view; or double-click the picture").clicked() {
            *camera = Camera::default();
        }
    });
    ui.horizontal(|ui| {
        ui.selectable_value(&mut camera.projection, Projection::Perspective, "perspective");
        ui.selectable_value(&mut camera.projection, Projection::Orthographic, "orthographic");
    });
    rows(ui, "camera", |ui| {
        let [least, most] = Camera::ZOOM_RANGE;
        let zoom = Slider::new(&mut camera.zoom, least..=most).logarithmic(true).max_decimals(2);
        slider_row(ui, "zoom", "Magnification; or scroll over the picture", true, zoom);
        let azimuth = Slider::new(&mut camera.azimuth, -180.0..=180.0).fixed_decimals(0).suffix("°");
        slider_row(ui, "azimuth", "Angle around the world's z axis; or drag the picture", true, azimuth);
        let elevation = Slider::new(&mut camera.elevation, -90.0..=90.0).fixed_decimals(0).suffix("°");
        slider_row(ui, "elevation", "Angle above the world's xy plane; or drag the picture", true, elevation);
    });
}
