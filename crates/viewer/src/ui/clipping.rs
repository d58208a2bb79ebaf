//! What is cut away: a box of voxels, and planes.

use egui::{DragValue, Slider, Ui};

use super::form::{rows, slider_row};
use crate::state::{Camera, ClipPlane, Clipping, Crop};

/// The ends of the box, and the planes one by one; `dims` are the volume's voxels.
pub fn clipping_ui(ui: &mut Ui, clipping: &mut Clipping, camera: &Camera, dims: [u32; 3]) {
    for ((name, ends), dim) in ["x", "y", "z"].into_iter().zip(&mut clipping.crop.ends).zip(dims) {
        ui.horizontal(|ui| {
            ui.label(format!("{name} from voxel"));
            let last = dim.saturating_sub(1) as f32;
            // An end that cuts nothing is shown as the volume's own.
            let mut shown = [ends[0].max(0.0), ends[1].min(last)];
            let [first, end] = shown;
            let low = ui
                .add(voxel_value(&mut shown[0]).range(0.0..=end))
                .accessible_name(format!("First voxel along {name}"));
            ui.label("to");
            let high = ui
                .add(voxel_value(&mut shown[1]).range(first..=last))
                .accessible_name(format!("Last voxel along {name}"));
            if low.changed() || high.changed() {
                let [low, high] = shown;
                ends[0] = if low > 0.0 { low } else { f32::NEG_INFINITY };
                ends[1] = if high < last { high } else { f32::INFINITY };
            }
        });
    }
    let mut removed = None;
    for (index, plane) in clipping.planes.iter_mut().enumerate() {
        ui.push_id(index, |ui| removed = plane_ui(ui, index + 1, plane).then_some(index).or(removed));
    }
    if let Some(index) = removed {
        clipping.planes.remove(index);
    }
    ui.horizontal(|ui| {
        let has_room = clipping.planes.len() < Clipping::MOST_PLANES;
        let button = ui.add_enabled(has_room, egui::Button::new("Cut here"));
        if button.on_hover_text("A plane through the middle that faces the camera").clicked() {
            let Camera { azimuth, elevation, .. } = *camera;
            clipping.planes.push(ClipPlane { azimuth, elevation, offset: 0.0 });
        }
        let is_whole = *clipping == Clipping::default();
        if ui.add_enabled(!is_whole, egui::Button::new("Whole volume")).clicked() {
            *clipping = Clipping { crop: Crop::default(), planes: Vec::new() };
        }
    });
}

/// One plane; true when it is to be removed.
fn plane_ui(ui: &mut Ui, number: usize, plane: &mut ClipPlane) -> bool {
    let remove = ui
        .horizontal(|ui| {
            ui.label(format!("Plane {number}"));
            ui.small_button("×").accessible_name(format!("Remove plane {number}")).clicked()
        })
        .inner;
    rows(ui, "plane", |ui| {
        let angle = |angle, most: f32| Slider::new(angle, -most..=most).fixed_decimals(0).suffix("°");
        slider_row(ui, "faces azimuth", "As the camera's", true, angle(&mut plane.azimuth, 180.0));
        slider_row(ui, "faces elevation", "As the camera's", true, angle(&mut plane.elevation, 90.0));
        let offset = Slider::new(&mut plane.offset, -1.0..=1.0).fixed_decimals(2);
        slider_row(ui, "offset", "From the volume's middle, in radii of the volume", true, offset);
    });
    remove
}

fn voxel_value(voxel: &mut f32) -> DragValue<'_> {
    DragValue::new(voxel).speed(0.25).fixed_decimals(0)
}
