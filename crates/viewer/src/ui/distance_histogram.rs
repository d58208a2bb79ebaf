//! The histogram of signed distances with αd drawn over it.

use egui::{Painter, Pos2, Rect, Role, Sense, Stroke, Ui, WidgetInfo, vec2};
use voxrole_pack::Histogram;
use voxrole_preprocess::plot::numbers::group_thousands;

use super::axis::PlotArea;
use super::theme;
use crate::classify::opacity_by_distance;
use crate::state::TwoSidedEmphasis;

/// Height of the plot with its axes, in points.
const HEIGHT: f32 = 136.0;

/// Bars of log counts over distance in multiples of the smallest voxel spacing, and αd from 0 to 1 as a curve.
pub fn distance_histogram_ui(ui: &mut Ui, histogram: &Histogram, smallest_spacing: f64, emphasis: &TwoSidedEmphasis) {
    let axis = &histogram.shape.axes[0];
    let area = PlotArea::allocate(ui, HEIGHT, [axis.low, axis.high].map(|end| end / smallest_spacing), [0.0, 1.0]);
    let response = ui.interact(area.rect, ui.scope_id().with("distances"), Sense::hover());
    response
        .widget_info(|| WidgetInfo::labeled(Role::Image, true, "Histogram of distances with the opacity by distance"));
    let painter = ui.painter().with_clip_rect(area.rect);
    painter.rect_filled(area.rect, 0.0, theme::PLOT_GROUND);
    paint_bars(&painter, &area, &histogram.counts);
    painter.line(curve(&area, emphasis), Stroke::new(2.0, theme::PLOT_CURVE));
    area.paint_axes(ui.painter(), "signed distance d to the boundary (voxels)", "αd over log counts");
    if let Some(pointer) = response.hover_pos() {
        let [distance, _] = area.plot_from_screen(pointer);
        let count = histogram.counts[axis.bin_of(distance * smallest_spacing)];
        let opacity = opacity_at(emphasis, distance);
        area.paint_note(
            ui.painter(),
            &format!("d {distance:.1}   αd {opacity:.2}   {} voxels", group_thousands(count)),
        );
    }
}

fn paint_bars(painter: &Painter, area: &PlotArea, counts: &[u64]) {
    let most = counts.iter().copied().max().unwrap_or(0);
    let scale = 0.96 / (most as f64).ln_1p().max(f64::MIN_POSITIVE);
    // Whole pixels, because bars that share one would leave seams.
    let pixel = 1.0 / painter.pixels_per_point();
    let columns = (area.rect.width() / pixel) as usize;
    for column in 0..columns {
        let shown = column * counts.len() / columns..((column + 1) * counts.len()).div_ceil(columns);
        let count = counts[shown].iter().copied().max().unwrap_or(0);
        let height = ((count as f64).ln_1p() * scale) as f32 * area.rect.height();
        let foot = area.rect.left_bottom() + vec2(column as f32 * pixel, 0.0);
        painter.rect_filled(
            Rect::from_min_max(foot - vec2(0.0, height), foot + vec2(pixel, 0.0)),
            0.0,
            theme::PLOT_BAR,
        );
    }
}

/// One point a pixel, so that a thin αd keeps its tip.
fn curve(area: &PlotArea, emphasis: &TwoSidedEmphasis) -> Vec<Pos2> {
    let count = (area.rect.width().ceil() as usize * 2).max(2);
    let [low, high] = area.x;
    // The middle is one of the points: αd has its peak there.
    (0..=count)
        .map(|point| {
            let distance = (high - low).mul_add(point as f64 / count as f64, low);
            area.screen_from_plot([distance, f64::from(opacity_at(emphasis, distance))])
        })
        .collect()
}

/// αd at a signed distance.
fn opacity_at(emphasis: &TwoSidedEmphasis, distance: f64) -> f32 {
    let distance = distance as f32;
    opacity_by_distance(emphasis.side(distance), distance.abs())
}

#[cfg(test)]
mod tests {
    use egui::pos2;

    use super::*;
    use crate::state::BoundaryEmphasis;

    #[test]
    fn the_curve_peaks_at_a_and_ends_at_zero() {
        let rect = Rect::from_min_max(pos2(0.0, 0.0), pos2(301.0, 100.0));
        let area = PlotArea { rect, x: [-15.0, 15.0], y: [0.0, 1.0] };
        let emphasis = BoundaryEmphasis { a: 0.75, d_c: 0.5, n: 7.0, ..BoundaryEmphasis::default() };
        let points = curve(&area, &emphasis.into());
        let highest = points.iter().map(|point| point.y).fold(f32::INFINITY, f32::min);
        assert!((highest - 25.0).abs() < 1e-3, "{highest}");
        assert_eq!([points[0].y, points[points.len() - 1].y], [100.0, 100.0]);
    }
}
