//! The picture: orbit, zoom and pan by hand.

use egui::{
    Align2, Color32, FontId, Painter, PointerButton, Rect, Response, Role, Sense, Ui, Vec2, WidgetInfo, pos2, vec2,
};
use voxrole_pack::WorldFrame;

use super::preview::Preview;
use super::theme;
use crate::scene::ScaleBar;
use crate::state::{Camera, ViewState};
use crate::volume::VolumeDescription;

/// Degrees that the camera walks for a point of the hand's way.
const DEGREES_PER_POINT: f32 = 0.4;
/// Points of scrolling that magnify by e.
const SCROLL_POINTS: f32 = 300.0;
/// Length of the axes in the corner, in points.
const TRIAD: f32 = 26.0;

/// Fills the ui with the picture.
pub fn viewport_ui(ui: &mut Ui, view: &mut ViewState, preview: &mut Preview, volume: &VolumeDescription) {
    let rect = ui.available_rect_before_wrap();
    let response = ui.allocate_rect(rect, Sense::click_and_drag());
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, "Picture of the volume"));
    move_camera(ui, &response, &mut view.camera);

    let pixels = rect.size() * ui.pixels_per_point();
    let size = [pixels.x, pixels.y].map(|side| side.round().max(1.0) as u32);
    preview.update(ui.ctx(), view, size);

    let painter = ui.painter().with_clip_rect(rect);
    let background = theme::color32(view.render_settings.background);
    painter.rect_filled(rect, 0.0, background);
    if let Some(texture) = preview.texture() {
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        painter.image(texture, rect, whole, Color32::WHITE);
    }
    let ink = readable_on(background);
    paint_triad(&painter, rect, &view.camera, volume.frame, ink);
    paint_help(&painter, rect, ink);
    if let Some(bar) = view.scene.scale_bar.then(|| ScaleBar::new(view, volume, size)).flatten() {
        paint_scale_bar(&painter, rect, &bar, ui.pixels_per_point(), ink);
    }
    if let Some(error) = preview.error() {
        painter.text(rect.center(), Align2::CENTER_CENTER, error, FontId::proportional(14.0), theme::ERROR);
    }
}

fn move_camera(ui: &Ui, response: &Response, camera: &mut Camera) {
    let shift = ui.input(|input| input.modifiers.shift);
    let motion = response.drag_delta();
    let by = |button| response.dragged_by(button);
    if by(PointerButton::Middle) || by(PointerButton::Secondary) || (by(PointerButton::Primary) && shift) {
        let shorter = response.rect.size().min_elem().max(1.0);
        camera.pan_by(motion.x / shorter, -motion.y / shorter);
    } else if by(PointerButton::Primary) && motion != Vec2::ZERO {
        // The near side follows the hand, so the camera walks the other way.
        camera.orbit(-motion.x * DEGREES_PER_POINT, motion.y * DEGREES_PER_POINT);
    }
    if response.double_clicked() {
        *camera = Camera::default();
    }
    if response.hovered() {
        let (scroll, pinch) = ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
        let factor = (scroll / SCROLL_POINTS).exp() * pinch;
        if factor != 1.0 {
            camera.zoom_by(factor);
        }
    }
}

/// The world's axes in the lower left corner, by the letters that their ends have.
fn paint_triad(painter: &Painter, rect: Rect, camera: &Camera, frame: WorldFrame, ink: Color32) {
    let names = match frame {
        WorldFrame::Unspecified => ["x", "y", "z"],
        WorldFrame::LeftPosteriorSuperior => ["L", "P", "S"],
    };
    let axes = camera.axes();
    let origin = rect.left_bottom() + vec2(TRIAD + 16.0, -TRIAD - 16.0);
    for (axis, name) in names.into_iter().enumerate() {
        let towards = vec2(axes.right[axis], -axes.up[axis]);
        // What points away from the viewer is drawn fainter.
        let color = if axes.forward[axis] > 0.3 { ink.gamma_multiply(0.5) } else { ink };
        painter.line_segment([origin, origin + towards * TRIAD], (1.5, color));
        let beyond = origin + towards * TRIAD + 8.0 * towards.normalized();
        if towards.length() > 0.15 {
            painter.text(beyond, Align2::CENTER_CENTER, name, theme::tick_font(), color);
        }
    }
}

fn paint_help(painter: &Painter, rect: Rect, ink: Color32) {
    let help = "drag: orbit    shift or right drag: pan    scroll: zoom    double-click: reset";
    let ink = ink.gamma_multiply(0.7);
    let text = painter.layout_no_wrap(help.to_owned(), theme::tick_font(), ink);
    // Where there is no room for it beside the axes, the buttons' tips say the same.
    if text.size().x + 3.0 * TRIAD + 20.0 < rect.width() {
        painter.galley(rect.right_bottom() - text.size() - vec2(10.0, 8.0), text, ink);
    }
}

/// A bar of a round length, above the help.
fn paint_scale_bar(painter: &Painter, rect: Rect, bar: &ScaleBar, pixels_per_point: f32, ink: Color32) {
    let right = rect.right_bottom() - vec2(12.0, 36.0);
    let left = right - vec2(bar.pixels / pixels_per_point, 0.0);
    painter.line_segment([left, right], (2.5, ink));
    let above = left.lerp(right, 0.5) - vec2(0.0, 4.0);
    painter.text(above, Align2::CENTER_BOTTOM, &bar.label, FontId::proportional(13.0), ink);
}

/// Light grey on dark, dark grey on light.
fn readable_on(background: Color32) -> Color32 {
    let [red, green, blue, _] = background.to_array().map(f32::from);
    let lightness = 0.2126 * red + 0.7152 * green + 0.0722 * blue;
    Color32::from_gray(if lightness < 128.0 { 190 } else { 50 })
}
