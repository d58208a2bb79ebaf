//! How the picture is drawn: sampling, light, background.

use egui::{Checkbox, Slider, Ui};

use super::form::{color_row, rows, slider_row};
use crate::state::{Classification, Integration, RenderSettings, Technique};

/// Smallest and largest step of the slider, in multiples of the smallest voxel spacing.
const STEPS: std::ops::RangeInclusive<f32> = 0.0625..=2.0;

/// Technique, step, background, light and shading.
pub fn render_settings_ui(ui: &mut Ui, settings: &mut RenderSettings, classification: Classification) {
    ui.horizontal(|ui| {
        for technique in Technique::ALL {
            let choice = ui.selectable_value(&mut settings.technique, technique, technique.name());
            choice.on_hover_text(explanation(technique));
        }
    });
    rows(ui, "render settings", |ui| {
        let step = Slider::new(&mut settings.step, STEPS).logarithmic(true).max_decimals(3);
        slider_row(
            ui,
            "step (voxels)",
            "Distance between samples or slices, in multiples of the smallest voxel spacing",
            true,
            step,
        );
        let share = |number| Slider::new(number, 0.0..=1.0).fixed_decimals(2);
        let shading = &mut settings.shading;
        slider_row(ui, "ambient", "Light from everywhere", true, share(&mut shading.ambient));
        slider_row(ui, "diffuse", "Light by the angle to the lamp", true, share(&mut shading.diffuse));
        slider_row(ui, "specular", "Highlights", true, share(&mut shading.specular));
        let help = "How much darker creases and insides are: what lies among much that is drawn gets less light";
        slider_row(ui, "occlusion", help, true, share(&mut shading.occlusion));
        let light = &mut settings.light;
        let azimuth = Slider::new(&mut light.azimuth, -180.0..=180.0).fixed_decimals(0).suffix("°");
        slider_row(ui, "light azimuth", "To the right", true, azimuth);
        let elevation = Slider::new(&mut light.elevation, -90.0..=90.0).fixed_decimals(0).suffix("°");
        slider_row(ui, "light elevation", "Upwards", true, elevation);
        color_row(ui, "background", &mut settings.background);
    });
    ui.checkbox(&mut settings.light.follows_camera, "light follows the camera");
    let has_jitter = settings.technique == Technique::Rays && !settings.goes_by_cells(classification);
    let jitter = ui.add_enabled(has_jitter, Checkbox::new(&mut settings.jitter, "jittered steps"));
    jitter.on_hover_text("Rays begin at places of their own: what long steps miss shows as grain, not as rings");
    let mut integrates = settings.integration != Integration::PostClassified;
    let checkbox = ui.checkbox(&mut integrates, "opacity integrated along steps");
    if checkbox.on_hover_text("No boundary is missed between two samples; without, steps have to be short").changed() {
        settings.integration = if integrates { Integration::Preintegrated } else { Integration::PostClassified };
    }
}

/// What a technique does, in a line.
fn explanation(technique: Technique) -> &'static str {
    match technique {
        Technique::Rays => "Samples along each pixel's ray",
        Technique::Slices => "Samples on planes across the viewing direction",
        Technique::Stacks => "Samples on the voxels' own planes and between them, across the nearest axis of the grid",
    }
}
