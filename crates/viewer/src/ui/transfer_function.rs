//! The list of regions: colour, extent, opacity and soft edge of each.

use std::ops::RangeInclusive;

use egui::{ComboBox, Response, Ui};
use voxrole_preprocess::plot::numbers::short_number;

use super::form::{color_button, number_value};
use super::histogram::HistogramPanel;
use crate::state::{Region, Shape, TransferFunction};

/// The regions one by one, and buttons that add one or bring back the proposed ones.
pub fn transfer_function_ui(ui: &mut Ui, panel: &mut HistogramPanel, regions: &mut Vec<Region>, proposed: &[Region]) {
    let mut removed = None;
    for (index, region) in regions.iter_mut().enumerate() {
        ui.push_id(index, |ui| {
            if region_row(ui, index, region, &mut panel.selected) {
                removed = Some(index);
            }
            if panel.selected == Some(index) {
                extent_row(ui, index, region, panel.span());
            }
        });
    }
    if let Some(index) = removed {
        regions.remove(index);
        // Those after it move up.
        panel.selected = match panel.selected {
            Some(selected) if selected == index => None,
            Some(selected) if selected > index => Some(selected - 1),
            other => other,
        };
    }
    if regions.is_empty() {
        ui.weak("No region: nothing is drawn. Add one, or draw one in the histogram.");
    }
    ui.horizontal(|ui| {
        let add = ui.add_enabled(regions.len() < TransferFunction::MOST_REGIONS, egui::Button::new("Add region"));
        if add.on_hover_text("Or drag over free ground in the histogram").clicked() {
            regions.push(panel.new_region(regions));
            panel.selected = Some(regions.len() - 1);
        }
        let propose = ui.add_enabled(regions.as_slice() != proposed, egui::Button::new("Proposed regions"));
        if propose.on_hover_text("Back to the regions of the first picture").clicked() {
            *regions = proposed.to_vec();
            panel.selected = None;
        }
    });
}

/// Colour, place, opacity and softness; true when the region is to be removed.
fn region_row(ui: &mut Ui, index: usize, region: &mut Region, selected: &mut Option<usize>) -> bool {
    let number = index + 1;
    let mut remove = false;
    ui.horizontal(|ui| {
        color_button(ui, &format!("Colour of region {number}"), &mut region.color);
        let is_selected = *selected == Some(index);
        if ui.selectable_label(is_selected, format!("Region {number}")).clicked() {
            *selected = if is_selected { None } else { Some(index) };
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let button = ui.small_button("×").on_hover_text("Remove (Delete)");
            remove = button.accessible_name(format!("Remove region {number}")).clicked();
            ui.add_enabled_ui(!matches!(region.shape, Shape::Painted(_)), |ui| {
                share_value(ui, &mut region.softness, 0.5, &format!("Soft edge of region {number}"))
                    .on_hover_text("Share of the region's width and height over which it fades out, at each edge")
                    .on_disabled_hover_text("As soft as it is painted");
                ui.weak("soft");
            });
            share_value(ui, &mut region.opacity, 1.0, &format!("Opacity of region {number}"))
                .on_hover_text("Opacity of a path as long as the smallest voxel spacing");
            ui.weak("opacity");
        });
    });
    remove
}

/// The exact extent of the selected region.
fn extent_row(ui: &mut Ui, index: usize, region: &mut Region, [value_span, gradient_span]: [[f64; 2]; 2]) {
    let number = index + 1;
    ui.horizontal(|ui| {
        ui.add_space(30.0);
        ui.weak("v");
        range_values(ui, &mut region.value, value_span, &format!("value of region {number}"));
        ui.add_space(8.0);
        ui.weak("g");
        range_values(ui, &mut region.gradient, gradient_span, &format!("gradient magnitude of region {number}"));
    });
    ui.horizontal(|ui| {
        ui.add_space(30.0);
        ui.weak("outline");
        shape_menu(ui, number, region);
    });
}

/// The outline; a polygon's corners come from the command line or a session, and stay as they are. What is painted begins as
/// the outline was.
fn shape_menu(ui: &mut Ui, number: usize, region: &mut Region) {
    let name = |shape: &Shape| match shape {
        Shape::Box => "box",
        Shape::Ellipse => "ellipse",
        Shape::Triangle => "triangle",
        Shape::Polygon(_) => "polygon",
        Shape::Painted(_) => "painted",
    };
    let Region { shape, softness, .. } = region;
    let is_painted = matches!(shape, Shape::Painted(_));
    let menu = ComboBox::from_id_salt("shape").selected_text(name(shape)).width(62.0);
    let response = menu.show_ui(ui, |ui| {
        for choice in [Shape::Box, Shape::Ellipse, Shape::Triangle] {
            let text = name(&choice);
            if ui.selectable_value(shape, choice, text).changed() && is_painted {
                *softness = Region::DEFAULT_SOFTNESS;
            }
        }
        if ui.selectable_label(is_painted, "painted").clicked() && !is_painted {
            *shape = Shape::Painted(shape.painted(*softness));
            *softness = 0.0;
        }
    });
    response.response.accessible_name(format!("Outline of region {number}"));
}

fn share_value(ui: &mut Ui, share: &mut f32, most: f32, name: &str) -> Response {
    let value = number_value(share, 0.0..=most).speed(0.005).fixed_decimals(2);
    ui.add_sized([40.0, 18.0], value).accessible_name(name)
}

/// Two numbers that stay in order.
fn range_values(ui: &mut Ui, range: &mut [f32; 2], span: [f64; 2], name: &str) {
    let speed = (span[1] - span[0]) / 400.0;
    let least = ((span[1] - span[0]) / 4096.0) as f32;
    let [low, high] = *range;
    let [low_end, high_end] = range;
    // Apart also where values are so large that `least` is lost in rounding.
    let lowest = f32::MIN..=(high - least).min(high.next_down());
    let highest = (low + least).max(low.next_up())..=f32::MAX;
    range_end(ui, low_end, lowest, speed).accessible_name(format!("Lowest {name}"));
    ui.label("to");
    range_end(ui, high_end, highest, speed).accessible_name(format!("Highest {name}"));
}

fn range_end(ui: &mut Ui, end: &mut f32, range: RangeInclusive<f32>, speed: f64) -> Response {
    let value = number_value(end, range).speed(speed).custom_formatter(|number, _| short_number(number));
    ui.add_sized([56.0, 18.0], value)
}
