//! Opacity by value alone: control points one by one, and what they come to over the volume's values.

use egui::{Button, Role, Sense, Ui, WidgetInfo, pos2, vec2};

use super::form::{color_button, number_value};
use super::theme;
use crate::state::{Classification, ControlPoint, Curve, TransferFunction};

/// Height of the plot, in points.
const HEIGHT: f32 = 44.0;
/// What a fresh point adds.
const FRESH: ControlPoint = ControlPoint { value: 0.0, color: [1.0; 3], opacity: 0.2 };

/// What decides, the curve, and its points; `range` is that of the volume's values.
pub fn curve_ui(ui: &mut Ui, transfer_function: &mut TransferFunction, range: [f64; 2]) {
    let TransferFunction { classification, curve, .. } = transfer_function;
    ui.horizontal(|ui| {
        let roles = ui.selectable_value(classification, Classification::Roles, "at boundaries");
        roles.on_hover_text("As one more region: times the opacity by distance to the boundary");
        let value = ui.selectable_value(classification, Classification::Value, "everywhere");
        value.on_hover_text("The curve alone, boundary or not: classical volume rendering");
    });
    let [low, high] = range.map(|end| end as f32);
    if *classification == Classification::Value && curve.points().is_empty() {
        ui.small("Nothing is drawn without a point of the curve.");
    }
    paint(ui, curve, [low, high]);
    let mut points = curve.points().to_vec();
    let mut removed = None;
    for index in 0..points.len() {
        // Points stay in order.
        let least = index.checked_sub(1).map_or(f32::MIN, |before| points[before].value.next_up());
        let most = points.get(index + 1).map_or(f32::MAX, |after| after.value.next_down());
        ui.push_id(("point", index), |ui| {
            ui.horizontal(|ui| {
                let ControlPoint { value, color, opacity } = &mut points[index];
                let number = index + 1;
                color_button(ui, &format!("Colour of point {number}"), color);
                let edit = number_value(value, least..=most).speed((high - low) / 500.0).prefix("v ");
                ui.add(edit).accessible_name(format!("Value of point {number}"));
                let edit = number_value(opacity, 0.0..=1.0).speed(0.005).prefix("αu ");
                ui.add(edit).accessible_name(format!("Opacity of point {number}"));
                if ui.small_button("×").accessible_name(format!("Remove point {number}")).clicked() {
                    removed = Some(index);
                }
            });
        });
    }
    if let Some(index) = removed {
        points.remove(index);
    }
    let button = ui.add_enabled(low < high, Button::new("Add point"));
    if button.on_hover_text("Behind the last one; the curve is straight between points").clicked() {
        let value = points.last().map_or(low, |last| last.value + 0.125 * (high - low));
        points.push(ControlPoint { value, ..points.last().copied().unwrap_or(FRESH) });
    }
    if points != curve.points() {
        *curve = Curve::from_points(points);
    }
}

/// Columns in the curve's colour, as high as it is opaque.
fn paint(ui: &mut Ui, curve: &Curve, [low, high]: [f32; 2]) {
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), HEIGHT), Sense::hover());
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, "Opacity by value"));
    let painter = ui.painter().with_clip_rect(rect);
    painter.rect_filled(rect, 0.0, theme::PLOT_GROUND);
    let columns = rect.width().max(1.0) as usize;
    for column in 0..columns {
        let share = (column as f32 + 0.5) / columns as f32;
        if let Some((color, opacity)) = curve.at(low + share * (high - low)).filter(|(_, opacity)| *opacity > 0.0) {
            let x = rect.left() + column as f32 + 0.5;
            let top = pos2(x, rect.bottom() - opacity * rect.height());
            painter.line_segment([pos2(x, rect.bottom()), top], (1.0, theme::color32(color)));
        }
    }
}
