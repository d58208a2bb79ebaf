//! The brush that paints regions over the histogram, and erases what was painted.

use egui::{CursorIcon, DragValue, Painter, PointerButton, Pos2, Rect, Response, Stroke, Ui};

use super::axis::PlotArea;
use super::histogram::HistogramPanel;
use super::region_grip::{place_in, screen_rect};
use super::theme;
use crate::state::{PaintedMap, Region, Shape, TransferFunction};

/// Radii of the brush, in points.
const RADII: [f32; 2] = [2.0, 60.0];

/// What dragging over the histogram does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tool {
    /// Moves, resizes and draws boxes and other outlines.
    Outline,
    /// Paints.
    Paint,
    /// Erases what was painted.
    Erase,
}

/// What paints.
pub struct Brush {
    /// What dragging does.
    pub tool: Tool,
    /// In points.
    pub radius: f32,
    /// Which region is being painted, and up to where.
    stroke: Option<(usize, Pos2)>,
}

impl Default for Brush {
    fn default() -> Self {
        Self { tool: Tool::Outline, radius: 14.0, stroke: None }
    }
}

/// The choice of what dragging does, and the brush's size.
pub fn brush_ui(ui: &mut Ui, brush: &mut Brush) {
    ui.horizontal(|ui| {
        for (tool, name, help) in [
            (Tool::Outline, "Outline", "Drag to move, resize or draw regions"),
            (
                Tool::Paint,
                "Paint",
                "Drag to paint the selected region, or a new one where none that is painted is selected",
            ),
            (Tool::Erase, "Erase", "Drag to erase what was painted"),
        ] {
            ui.selectable_value(&mut brush.tool, tool, name).on_hover_text(help);
        }
        ui.add_enabled_ui(brush.tool != Tool::Outline, |ui| {
            ui.weak("brush");
            let [least, most] = RADII;
            let radius = DragValue::new(&mut brush.radius).range(least..=most).speed(0.2).fixed_decimals(0);
            ui.add(radius)
                .on_hover_text("Radius on the screen; its outer half is soft")
                .accessible_name("Radius of the brush");
        });
    });
}

/// Paints or erases where the pointer was dragged to, or clicked.
pub fn paint_regions(
    ui: &Ui,
    panel: &mut HistogramPanel,
    response: &Response,
    area: &PlotArea,
    regions: &mut Vec<Region>,
) {
    let is_down = response.is_pointer_button_down_on() && ui.input(|input| input.pointer.primary_down());
    let ends = response.clicked() || response.drag_stopped_by(PointerButton::Primary);
    if let (true, Some(to)) = (is_down || ends, response.interact_pointer_pos()) {
        let from = panel.brush.stroke.or_else(|| {
            let press = ui.input(|input| input.pointer.press_origin()).unwrap_or(to);
            begin(panel, area, regions, press).map(|index| (index, press))
        });
        panel.brush.stroke = from.map(|(index, _)| (index, to));
        if let Some((index, from)) = from
            && let Some(Region { shape: Shape::Painted(map), value, gradient, .. }) = regions.get_mut(index)
        {
            let Brush { tool, radius, .. } = panel.brush;
            stroke(map, screen_rect([*value, *gradient], area), [from, to], radius, tool == Tool::Erase);
        }
    }
    if !is_down {
        panel.brush.stroke = None;
    }
}

/// The region that a stroke is for: the selected one, if it is painted; or else a new one, or the uppermost one that has
/// something to erase.
fn begin(panel: &mut HistogramPanel, area: &PlotArea, regions: &mut Vec<Region>, press: Pos2) -> Option<usize> {
    let is_painted = |index: &usize| matches!(regions.get(*index), Some(Region { shape: Shape::Painted(_), .. }));
    let selected = panel.selected.filter(is_painted);
    let index = match panel.brush.tool {
        Tool::Outline => None,
        _ if selected.is_some() => selected,
        Tool::Paint if regions.len() >= TransferFunction::MOST_REGIONS => None,
        Tool::Paint => {
            let [value, gradient] = panel.span().map(|span| span.map(|end| end as f32));
            let shape = Shape::Painted(PaintedMap::blank());
            regions.push(Region { shape, value, gradient, softness: 0.0, ..panel.new_region(regions) });
            Some(regions.len() - 1)
        }
        Tool::Erase => regions.iter().rposition(|region| {
            let Shape::Painted(map) = &region.shape else { return false };
            map.weight_at(place_in(screen_rect([region.value, region.gradient], area), press)) > 0.0
        }),
    };
    panel.selected = index.or(panel.selected);
    index
}

fn stroke(map: &mut PaintedMap, rect: Rect, ends: [Pos2; 2], radius: f32, erase: bool) {
    let [from, to] = ends.map(|end| place_in(rect, end));
    map.stroke(from, to, [radius / rect.width(), radius / rect.height()], erase);
}

/// Shows how far the brush under the pointer reaches.
pub fn show_brush(painter: &Painter, brush: &Brush, pointer: Pos2) {
    if brush.tool != Tool::Outline {
        painter.ctx().set_cursor_icon(CursorIcon::Crosshair);
        let color = theme::ACCENT;
        painter.circle_stroke(pointer, brush.radius, Stroke::new(1.0, color));
        painter.circle_stroke(pointer, 0.5 * brush.radius, Stroke::new(1.0, color.gamma_multiply(0.5)));
    }
}
