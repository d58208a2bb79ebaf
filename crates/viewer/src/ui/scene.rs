//! What is drawn beside the volume: lines that measure it, and surfaces.

use std::path::Path;

use egui::{Button, Ui};

use super::form::{color_button, number_value};
use crate::state::{Isosurface, Scene};

/// Checkboxes for the lines, and the surfaces one by one; `range` is that of the volume's values.
pub fn scene_ui(ui: &mut Ui, scene: &mut Scene, range: [f64; 2]) {
    ui.horizontal_wrapped(|ui| {
        ui.checkbox(&mut scene.bounding_box, "bounding box");
        ui.checkbox(&mut scene.axes, "axes").on_hover_text("Arrows along the world's x, y and z: red, green, blue");
        let scale_bar = ui.checkbox(&mut scene.scale_bar, "scale bar");
        scale_bar.on_hover_text("In perspective it holds at the depth of the volume's middle");
    });
    let [low, high] = range.map(|value| value as f32);
    let mut removed = None;
    for (index, Isosurface { value, color }) in scene.isosurfaces.iter_mut().enumerate() {
        ui.push_id(("isosurface", index), |ui| {
            ui.horizontal(|ui| {
                let number = index + 1;
                ui.label("isosurface at");
                let edit = number_value(value, low..=high).speed((high - low) / 500.0);
                ui.add(edit).accessible_name(format!("Value of isosurface {number}"));
                color_button(ui, &format!("Colour of isosurface {number}"), color);
                if ui.small_button("×").accessible_name(format!("Remove isosurface {number}")).clicked() {
                    removed = Some(index);
                }
            });
        });
    }
    if let Some(index) = removed.take() {
        scene.isosurfaces.remove(index);
    }
    for (index, mesh) in scene.meshes.iter_mut().enumerate() {
        ui.push_id(("mesh", index), |ui| {
            ui.horizontal(|ui| {
                let name = Path::new(&mesh.path).file_name().unwrap_or_default().to_string_lossy();
                ui.label(name).on_hover_text(&mesh.path);
                color_button(ui, &format!("Colour of mesh {}", index + 1), &mut mesh.color);
                if ui.small_button("×").accessible_name(format!("Remove mesh {}", index + 1)).clicked() {
                    removed = Some(index);
                }
            });
        });
    }
    if let Some(index) = removed {
        scene.meshes.remove(index);
    }
    let has_room = scene.meshes.len() + scene.isosurfaces.len() < Scene::MOST_SURFACES && low < high;
    let button = ui.add_enabled(has_room, Button::new("Add isosurface"));
    if button.on_hover_text("An opaque surface of one value, which starts in the middle of the volume's").clicked() {
        scene.isosurfaces.push(Isosurface { value: 0.5 * (low + high), color: Isosurface::DEFAULT_COLOR });
    }
}
