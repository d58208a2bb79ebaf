//! Rows and sections that settings are laid out in.

use std::ops::RangeInclusive;

use egui::emath::Numeric;
use egui::{CollapsingHeader, DragValue, Grid, RichText, Slider, SliderClamping, Ui, WidgetText};

use super::theme;

/// Width of a row's label in points.
const LABEL_WIDTH: f32 = 96.0;
/// Width of a number beside a slider in points.
const NUMBER_WIDTH: f32 = 52.0;

/// A part of a side panel with a title that folds it away.
pub fn section<R>(ui: &mut Ui, title: &str, add_contents: impl FnOnce(&mut Ui) -> R) -> Option<R> {
    let header = CollapsingHeader::new(RichText::new(title).strong().size(14.0)).default_open(true);
    let shown = header.show_unindented(ui, add_contents);
    ui.add_space(4.0);
    ui.separator();
    shown.body_returned
}

/// Rows with a label to the left and something to the right.
pub fn rows<R>(ui: &mut Ui, name: &str, add_contents: impl FnOnce(&mut Ui) -> R) -> R {
    ui.spacing_mut().slider_width = (ui.available_width() - LABEL_WIDTH - NUMBER_WIDTH - 24.0).max(60.0);
    Grid::new(name).num_columns(2).min_col_width(LABEL_WIDTH).spacing([8.0, 3.0]).show(ui, add_contents).inner
}

/// A row with a slider. Its number stays as it is until somebody moves it, also where it has more digits than are shown or lies
/// beyond the slider's ends.
pub fn slider_row(ui: &mut Ui, label: &str, help: &str, enabled: bool, slider: Slider<'_>) {
    let label = ui.label(label).on_hover_text(help);
    ui.spacing_mut().interact_size.x = NUMBER_WIDTH;
    let slider = slider.clamping(SliderClamping::Edits);
    ui.add_enabled(enabled, slider).labelled_by(label.id).on_hover_text(help);
    ui.end_row();
}

/// A number to drag or type within a range; like a slider's it stays as it is until somebody changes it.
pub fn number_value<N: Numeric>(number: &mut N, range: RangeInclusive<N>) -> DragValue<'_> {
    DragValue::new(number).range(range).clamp_existing_to_range(false)
}

/// A row with a colour in display values that opens a picker.
pub fn color_row(ui: &mut Ui, label: &str, color: &mut [f32; 3]) {
    ui.label(label);
    color_button(ui, label, color);
    ui.end_row();
}

/// A colour in display values that opens a picker.
pub fn color_button(ui: &mut Ui, name: &str, color: &mut [f32; 3]) {
    let mut bytes = theme::bytes(*color);
    let response = ui.color_edit_button_srgb(&mut bytes).accessible_name(name);
    // Written back only when changed, so that a colour with more than 8 bits keeps them.
    if response.changed() {
        *color = bytes.map(|channel| f32::from(channel) / 255.0);
    }
}

/// A row of plain text, closer to the next one than rows that are clicked.
pub fn text_row(ui: &mut Ui, label: &str, text: impl Into<WidgetText>) {
    ui.spacing_mut().interact_size.y = 0.0;
    ui.label(RichText::new(label).weak());
    ui.label(text);
    ui.end_row();
}
