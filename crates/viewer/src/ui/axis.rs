//! Plots: where numbers lie on the screen, and their ticks.

use egui::{Align2, Painter, Pos2, Rect, Stroke, StrokeKind, Ui, Vec2, pos2, vec2};

use voxrole_preprocess::plot::numbers::ticks;

use super::theme;

/// Room for the labels to the left of a plot, in points.
const LEFT: f32 = 46.0;
/// Room to the right of a plot: half of the last tick's label.
const RIGHT: f32 = 14.0;
/// Room for the vertical axis' title above a plot.
const ABOVE: f32 = 18.0;
/// Room for ticks and title below a plot.
const BELOW: f32 = 34.0;
/// Length of a tick.
const TICK: f32 = 4.0;

/// A plot's place on the screen and the numbers that it spans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlotArea {
    /// Where on the screen.
    pub rect: Rect,
    /// Numbers at the left and right edge; rising.
    pub x: [f64; 2],
    /// Numbers at the lower and upper edge; rising.
    pub y: [f64; 2],
}

impl PlotArea {
    /// Takes the ui's whole width, and `height` points with axes and titles.
    pub fn allocate(ui: &mut Ui, height: f32, x: [f64; 2], y: [f64; 2]) -> Self {
        let (_, whole) = ui.allocate_space(vec2(ui.available_width(), height));
        let rect = Rect::from_min_max(whole.min + vec2(LEFT, ABOVE), whole.max - vec2(RIGHT, BELOW));
        Self { rect, x, y }
    }

    /// The place of a pair of numbers.
    #[must_use]
    pub fn screen_from_plot(&self, [x, y]: [f64; 2]) -> Pos2 {
        let share = |number: f64, [low, high]: [f64; 2]| ((number - low) / (high - low)) as f32;
        let (right, up) = (share(x, self.x), share(y, self.y));
        pos2(self.rect.left() + right * self.rect.width(), self.rect.bottom() - up * self.rect.height())
    }

    /// The pair of numbers at a place, which is brought into the plot first.
    #[must_use]
    pub fn plot_from_screen(&self, place: Pos2) -> [f64; 2] {
        let place = self.rect.clamp(place);
        let right = f64::from((place.x - self.rect.left()) / self.rect.width());
        let up = f64::from((self.rect.bottom() - place.y) / self.rect.height());
        [mix(self.x, right), mix(self.y, up)]
    }

    /// Draws frame, ticks and titles.
    pub fn paint_axes(&self, painter: &Painter, x_title: &str, y_title: &str) {
        let line = Stroke::new(1.0, theme::PLOT_LINE);
        let color = painter.ctx().global_style().visuals.text_color().gamma_multiply(0.85);
        let font = theme::tick_font();
        painter.rect_stroke(self.rect, 0.0, line, StrokeKind::Outside);
        for (number, label) in ticks(self.x, (self.rect.width() / 58.0) as usize) {
            let foot = pos2(self.screen_from_plot([number, self.y[0]]).x, self.rect.bottom());
            painter.line_segment([foot, foot + vec2(0.0, TICK)], line);
            painter.text(foot + vec2(0.0, TICK + 1.0), Align2::CENTER_TOP, label, font.clone(), color);
        }
        for (number, label) in ticks(self.y, (self.rect.height() / 34.0) as usize) {
            let foot = pos2(self.rect.left(), self.screen_from_plot([self.x[0], number]).y);
            painter.line_segment([foot, foot - vec2(TICK, 0.0)], line);
            painter.text(foot - vec2(TICK + 2.0, 0.0), Align2::RIGHT_CENTER, label, font.clone(), color);
        }
        let below = self.rect.center_bottom() + vec2(0.0, BELOW - 1.0);
        painter.text(below, Align2::CENTER_BOTTOM, x_title, font.clone(), color);
        let above = pos2(self.rect.left() - LEFT + 4.0, self.rect.top() - 4.0);
        painter.text(above, Align2::LEFT_BOTTOM, y_title, font, color);
    }

    /// Writes into the upper right corner above the plot.
    pub fn paint_note(&self, painter: &Painter, note: &str) {
        let color = painter.ctx().global_style().visuals.text_color();
        let place = self.rect.right_top() - vec2(0.0, 4.0);
        painter.text(place, Align2::RIGHT_BOTTOM, note, theme::tick_font(), color);
    }

    /// Numbers per point along both axes.
    #[must_use]
    pub fn plot_per_screen(&self) -> [f64; 2] {
        let Vec2 { x, y } = self.rect.size();
        [(self.x[1] - self.x[0]) / f64::from(x), (self.y[1] - self.y[0]) / f64::from(y)]
    }
}

fn mix([low, high]: [f64; 2], share: f64) -> f64 {
    (high - low).mul_add(share, low)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn screen_and_plot_are_inverse() {
        let rect = Rect::from_min_max(pos2(100.0, 50.0), pos2(300.0, 150.0));
        let area = PlotArea { rect, x: [-1000.0, 3000.0], y: [0.0, 50.0] };
        assert_eq!(area.screen_from_plot([-1000.0, 0.0]), rect.left_bottom());
        assert_eq!(area.screen_from_plot([3000.0, 50.0]), rect.right_top());
        let [x, y] = area.plot_from_screen(area.screen_from_plot([250.0, 20.0]));
        assert!((x - 250.0).abs() < 1e-3 && (y - 20.0).abs() < 1e-4);
        assert_eq!(area.plot_from_screen(pos2(0.0, 999.0)), [-1000.0, 0.0]);
        assert_eq!(area.plot_per_screen(), [20.0, 0.5]);
    }
}
