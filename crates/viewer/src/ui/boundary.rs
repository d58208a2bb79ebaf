//! αd, the opacity by distance to the boundary.

use egui::{Slider, Ui};

use super::form::{rows, slider_row};
use crate::state::{BoundaryEmphasis, EmphasisKind, TwoSidedEmphasis};

/// Largest exponent of the slider.
const MOST_N: f32 = 16.0;

/// The settings of αd, once for both sides or for each; `d_max` in multiples of the smallest voxel spacing.
pub fn boundary_ui(ui: &mut Ui, emphasis: &mut TwoSidedEmphasis, d_max: f32) {
    let id = ui.scope_id().with("each side");
    let mut each_side = emphasis.high != emphasis.low || ui.data(|data| data.get_temp(id)).unwrap_or(false);
    let checkbox = ui.checkbox(&mut each_side, "Each side its own");
    if checkbox.on_hover_text("Another opacity where values are higher than where they are lower").changed() {
        ui.data_mut(|data| data.insert_temp(id, each_side));
    }
    if each_side {
        for (name, side) in
            [("High-value side, d > 0", &mut emphasis.high), ("Low-value side, d < 0", &mut emphasis.low)]
        {
            ui.weak(name);
            ui.push_id(name, |ui| side_ui(ui, side, d_max));
        }
    } else {
        side_ui(ui, &mut emphasis.high, d_max);
        emphasis.low = emphasis.high;
    }
}

/// Kind, opacity on the boundary, reach and exponent, and the paper's five settings.
fn side_ui(ui: &mut Ui, emphasis: &mut BoundaryEmphasis, d_max: f32) {
    ui.horizontal(|ui| {
        for kind in EmphasisKind::ALL {
            ui.selectable_value(&mut emphasis.kind, kind, kind.name()).on_hover_text(formula(kind));
        }
    });
    rows(ui, "emphasis", |ui| {
        let a = Slider::new(&mut emphasis.a, 0.0..=1.0).fixed_decimals(2);
        slider_row(ui, "a", "Opacity on the boundary itself", true, a);
        let d_c = Slider::new(&mut emphasis.d_c, 0.1..=d_max.max(0.2)).fixed_decimals(2).logarithmic(true);
        let help = "Distance from which on nothing is drawn, in multiples of the smallest voxel spacing";
        slider_row(ui, "d_c (voxels)", help, true, d_c);
        let has_exponent = emphasis.kind != EmphasisKind::Linear;
        let n = Slider::new(&mut emphasis.n, 1.0..=MOST_N).fixed_decimals(1);
        slider_row(
            ui,
            "n",
            "Exponent: the larger, the thinner a concave and the thicker a convex boundary",
            has_exponent,
            n,
        );
    });
    ui.horizontal_wrapped(|ui| {
        ui.weak("Presets:").on_hover_text("The five settings of the paper's figure 9, all reaching to d_max");
        for (name, preset) in BoundaryEmphasis::figure_9(d_max) {
            if ui.selectable_label(*emphasis == preset, name).clicked() {
                *emphasis = preset;
            }
        }
    });
}

fn formula(kind: EmphasisKind) -> &'static str {
    match kind {
        EmphasisKind::Linear => "a (1 − d/d_c)",
        EmphasisKind::Concave => "a (1 − d/d_c)^n: thin boundaries",
        EmphasisKind::Convex => "a (1 − (d/d_c)^n): thick, opaque boundaries",
    }
}
