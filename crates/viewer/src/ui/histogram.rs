//! The joint histogram of value and gradient magnitude at the hit, with the regions over it.

use egui::epaint::EllipseShape;
use egui::{
    Color32, ColorImage, Key, Painter, Pos2, Rect, Response, Role, Sense, Stroke, StrokeKind, TextureHandle,
    TextureOptions, Ui, Vec2, WidgetInfo, pos2,
};
use voxrole_pack::Histogram;
use voxrole_preprocess::plot::colour::viridis;
use voxrole_preprocess::plot::numbers::{group_thousands, short_number};

use super::axis::PlotArea;
use super::brush::{Brush, Tool, brush_ui, paint_regions, show_brush};
use super::opened_volume::OpenedVolume;
use super::painted_maps::PaintedMaps;
use super::region_grip::{Grip, region_at, screen_rect};
use super::theme;
use crate::state::{Region, Shape, TransferFunction};

/// Height of the plot with its axes, in points.
const HEIGHT: f32 = 270.0;
/// Side of a selected region's handles, in points.
const HANDLE: f32 = 7.0;
/// Bins beside the occupied ones that are shown too, as a share of those.
const MARGIN: f64 = 0.04;

/// Which values are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HistogramView {
    /// Each voxel's own value: what the regions look up.
    Voxel,
    /// The value at each voxel's hit: the paper's graph, where a boundary is a spot.
    Hit,
}

/// The panel's own state.
pub struct HistogramPanel {
    /// Which histogram is shown.
    pub view: HistogramView,
    /// The selected region.
    pub selected: Option<usize>,
    /// What paints.
    pub brush: Brush,
    maps: PaintedMaps,
    x: [f64; 2],
    y: [f64; 2],
    textures: [Option<TextureHandle>; 2],
    drag: Option<RegionDrag>,
}

/// A region that follows the pointer.
#[derive(Clone)]
enum RegionDrag {
    /// One that was there before.
    Change { index: usize, grip: Grip, start: Region, from: [f64; 2] },
    /// One that is being drawn.
    Draw { index: usize, from: [f64; 2] },
}

impl HistogramPanel {
    /// Shows the bins of both histograms that are occupied.
    #[must_use]
    pub fn new(volume: &OpenedVolume) -> Self {
        let [x, y] = occupied(&[&volume.value_hit, &volume.hit_hit]);
        let (brush, maps) = (Brush::default(), PaintedMaps::default());
        Self { view: HistogramView::Voxel, selected: None, brush, maps, x, y, textures: [None, None], drag: None }
    }

    /// The same for another window: textures are of the one that has shown them.
    #[must_use]
    pub fn without_textures(self) -> Self {
        Self { maps: PaintedMaps::default(), textures: [None, None], drag: None, ..self }
    }

    /// The values and gradient magnitudes that the plot spans.
    #[must_use]
    pub fn span(&self) -> [[f64; 2]; 2] {
        [self.x, self.y]
    }

    /// A region in the plot's middle, in the colour that is the furthest from those of all others.
    #[must_use]
    pub fn new_region(&self, regions: &[Region]) -> Region {
        let middle = |[low, high]: [f64; 2]| [0.4, 0.6].map(|share| (high - low).mul_add(share, low) as f32);
        let color = theme::new_region_color(regions.iter().map(|region| theme::bytes(region.color)));
        Region {
            shape: Shape::Box,
            value: middle(self.x),
            gradient: middle(self.y),
            color: color.map(|channel| f32::from(channel) / 255.0),
            opacity: 0.5,
            softness: Region::DEFAULT_SOFTNESS,
            emphasis: None,
        }
    }
}

/// The histogram; regions are dragged, resized by their edges and corners, drawn on free ground, painted by the brush, and
/// removed with Delete.
pub fn histogram_ui(ui: &mut Ui, panel: &mut HistogramPanel, volume: &OpenedVolume, regions: &mut Vec<Region>) {
    ui.horizontal(|ui| {
        ui.selectable_value(&mut panel.view, HistogramView::Voxel, "Value of voxel").on_hover_text(
            "Counts every voxel at its own value and the gradient magnitude at its hit: what the regions look up",
        );
        ui.selectable_value(&mut panel.view, HistogramView::Hit, "Value at hit").on_hover_text(
            "Counts every voxel at the value and the gradient magnitude of the boundary that it leads to: each \
             boundary is one spot",
        );
    });
    brush_ui(ui, &mut panel.brush);
    let area = PlotArea::allocate(ui, HEIGHT, panel.x, panel.y);
    let response = ui.interact(area.rect, ui.scope_id().with("regions"), Sense::click_and_drag());
    response.widget_info(|| {
        WidgetInfo::labeled(Role::Canvas, true, "Histogram of value and gradient magnitude at the hit")
    });
    edit_regions(ui, panel, &response, &area, regions);

    let painter = ui.painter().with_clip_rect(area.rect);
    painter.rect_filled(area.rect, 0.0, theme::PLOT_GROUND);
    let (histogram, texture) = match panel.view {
        HistogramView::Voxel => (&volume.value_hit, &mut panel.textures[0]),
        HistogramView::Hit => (&volume.hit_hit, &mut panel.textures[1]),
    };
    let texture = texture.get_or_insert_with(|| {
        ui.ctx().load_texture(histogram.shape.kind.name(), image(histogram), TextureOptions::NEAREST)
    });
    painter.image(texture.id(), area.rect, shown_part(histogram, &area), Color32::WHITE);
    for (index, region) in regions.iter().enumerate() {
        let is_selected = panel.selected == Some(index);
        if let Shape::Painted(map) = &region.shape {
            let color = theme::color32(region.color).gamma_multiply(if is_selected { 0.55 } else { 0.4 });
            panel.maps.paint(&painter, map, screen_rect([region.value, region.gradient], &area), color);
        }
        paint_region(&painter, region, &area, is_selected);
    }
    panel.maps.retain(regions);
    let x_title = if panel.view == HistogramView::Voxel { "value v of the voxel" } else { "value v at the hit" };
    area.paint_axes(ui.painter(), x_title, &format!("g at the hit ({})", volume.gradient_unit()));
    if let Some(pointer) = response.hover_pos() {
        show_brush(&painter, &panel.brush, pointer);
        area.paint_note(ui.painter(), &note(histogram, area.plot_from_screen(pointer)));
    }
}

fn edit_regions(ui: &Ui, panel: &mut HistogramPanel, response: &Response, area: &PlotArea, regions: &mut Vec<Region>) {
    panel.selected = panel.selected.filter(|&index| index < regions.len());
    if panel.brush.tool == Tool::Outline {
        drag_regions(ui, panel, response, area, regions);
    } else {
        paint_regions(ui, panel, response, area, regions);
    }
    let delete = ui.input(|input| input.key_pressed(Key::Delete)) && !ui.ctx().egui_wants_keyboard_input();
    if let (true, Some(index)) = (delete, panel.selected) {
        regions.remove(index);
        panel.selected = None;
        panel.drag = None;
    }
}

fn drag_regions(ui: &Ui, panel: &mut HistogramPanel, response: &Response, area: &PlotArea, regions: &mut Vec<Region>) {
    let grabbed = |pointer: Pos2, selected| region_at(regions, selected, area, pointer);
    if response.drag_started_by(egui::PointerButton::Primary)
        && let Some(press) = ui.input(|input| input.pointer.press_origin())
    {
        let from = area.plot_from_screen(press);
        panel.drag = Some(match grabbed(press, panel.selected) {
            Some((index, grip)) => RegionDrag::Change { index, grip, start: regions[index].clone(), from },
            None => RegionDrag::Draw { index: regions.len(), from },
        });
    } else if response.clicked()
        && let Some(pointer) = response.interact_pointer_pos()
    {
        panel.selected = grabbed(pointer, panel.selected).map(|(index, _)| index);
    } else if let Some((_, grip)) = response.hover_pos().and_then(|pointer| grabbed(pointer, panel.selected)) {
        ui.ctx().set_cursor_icon(grip.cursor());
    }
    if let (Some(drag), Some(pointer)) = (panel.drag.clone(), response.interact_pointer_pos()) {
        follow(panel, drag, area.plot_from_screen(pointer), area, regions);
    }
    if !response.dragged() && !response.drag_started() {
        panel.drag = None;
    }
}

/// Brings the region that is dragged to the pointer.
fn follow(panel: &mut HistogramPanel, drag: RegionDrag, to: [f64; 2], area: &PlotArea, regions: &mut Vec<Region>) {
    match drag {
        RegionDrag::Change { index, grip, start, from } => {
            if let Some(region) = regions.get_mut(index) {
                // From where it was grabbed, so that rounding does not add up over a long drag.
                *region = grip.drag(&start, [to[0] - from[0], to[1] - from[1]], area);
                panel.selected = Some(index);
            }
        }
        RegionDrag::Draw { index, from } => {
            let per_point = area.plot_per_screen();
            if (0..2).any(|axis| (to[axis] - from[axis]).abs() < 2.0 * per_point[axis]) {
                return;
            }
            if regions.len() == index && index < TransferFunction::MOST_REGIONS {
                regions.push(panel.new_region(regions));
            }
            if let Some(region) = regions.get_mut(index) {
                let range = |axis: usize| [from[axis].min(to[axis]) as f32, from[axis].max(to[axis]) as f32];
                [region.value, region.gradient] = [range(0), range(1)];
                panel.selected = Some(index);
            }
        }
    }
}

fn paint_region(painter: &Painter, region: &Region, area: &PlotArea, selected: bool) {
    let rect = screen_rect([region.value, region.gradient], area);
    let color = theme::color32(region.color);
    let fill = color.gamma_multiply(if selected { 0.28 } else { 0.16 });
    let stroke = Stroke::new(if selected { 2.5 } else { 1.5 }, color);
    // Where the fade ends and the region has its full opacity.
    let full = rect.shrink2(rect.size() * region.softness.clamp(0.0, 0.5));
    let inner = Stroke::new(if region.softness > 0.0 { 1.0 } else { 0.0 }, color.gamma_multiply(0.45));
    // The screen's y points down, gradient magnitudes up.
    let corner = |&[x, y]: &[f32; 2]| pos2(rect.left() + x * rect.width(), rect.bottom() - y * rect.height());
    let corners: Vec<Pos2> = region.shape.corners().iter().map(corner).collect();
    match region.shape {
        Shape::Box => {
            painter.rect_filled(rect, 0.0, fill);
            painter.rect_stroke(full, 0.0, inner, StrokeKind::Middle);
            painter.rect_stroke(rect, 0.0, stroke, StrokeKind::Middle);
        }
        Shape::Ellipse => {
            let ellipse = |rect: Rect, fill, stroke| EllipseShape {
                center: rect.center(),
                radius: 0.5 * rect.size(),
                fill,
                stroke,
                angle: 0.0,
            };
            painter.add(ellipse(rect, fill, stroke));
            painter.add(ellipse(full, Color32::TRANSPARENT, inner));
        }
        Shape::Triangle => _ = painter.add(egui::Shape::convex_polygon(corners, fill, stroke)),
        Shape::Polygon(_) => _ = painter.add(egui::Shape::closed_line(corners, stroke)),
        Shape::Painted(_) => _ = painter.rect_stroke(rect, 0.0, inner, StrokeKind::Middle),
    }
    if selected {
        for handle in handles(rect) {
            let square = Rect::from_center_size(handle, Vec2::splat(HANDLE));
            painter.rect(square, 1.0, Color32::WHITE, Stroke::new(1.0, Color32::BLACK), StrokeKind::Middle);
        }
    }
}

fn handles(rect: Rect) -> [Pos2; 8] {
    let (middle, [left, right], [top, bottom]) =
        (rect.center(), [rect.left(), rect.right()], [rect.top(), rect.bottom()]);
    [
        pos2(left, top),
        pos2(middle.x, top),
        pos2(right, top),
        pos2(left, middle.y),
        pos2(right, middle.y),
        pos2(left, bottom),
        pos2(middle.x, bottom),
        pos2(right, bottom),
    ]
}

/// One pixel a bin, the largest gradient magnitude in the first row; colour grows with the logarithm of the count.
fn image(histogram: &Histogram) -> ColorImage {
    let [width, height] = bins(histogram);
    let most = histogram.counts.iter().copied().max().unwrap_or(0);
    let scale = 1.0 / (most as f64).ln_1p().max(f64::MIN_POSITIVE);
    let rows = histogram.counts.chunks_exact(width).rev();
    let pixels = rows.flatten().map(|&count| {
        if count == 0 {
            return theme::PLOT_GROUND;
        }
        let [red, green, blue] = viridis((count as f64).ln_1p() * scale);
        Color32::from_rgb(red, green, blue)
    });
    ColorImage::new([width, height], pixels.collect())
}

/// The part of [`fn@image`] that the plot spans, in shares of its sides.
fn shown_part(histogram: &Histogram, area: &PlotArea) -> Rect {
    let share = |axis: usize, number: f64| {
        let axis = &histogram.shape.axes[axis];
        ((number - axis.low) / (axis.high - axis.low)) as f32
    };
    Rect::from_min_max(
        pos2(share(0, area.x[0]), 1.0 - share(1, area.y[1])),
        pos2(share(0, area.x[1]), 1.0 - share(1, area.y[0])),
    )
}

fn note(histogram: &Histogram, [value, gradient]: [f64; 2]) -> String {
    let [x, y] = [&histogram.shape.axes[0], &histogram.shape.axes[1]];
    let count = histogram.counts[y.bin_of(gradient) * x.bins as usize + x.bin_of(value)];
    format!("v {}   g {}   {} voxels", short_number(value), short_number(gradient), group_thousands(count))
}

fn bins(histogram: &Histogram) -> [usize; 2] {
    [0, 1].map(|axis| histogram.shape.axes[axis].bins as usize)
}

/// The span of the occupied bins of histograms with equal axes, with a margin; everything where none is occupied.
fn occupied(histograms: &[&Histogram]) -> [[f64; 2]; 2] {
    let axes = &histograms[0].shape.axes;
    let [width, height] = bins(histograms[0]);
    let mut span = [[usize::MAX, 0]; 2];
    for histogram in histograms {
        for (bin, _) in histogram.counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            for (axis, place) in [bin % width, bin / width].into_iter().enumerate() {
                span[axis] = [span[axis][0].min(place), span[axis][1].max(place + 1)];
            }
        }
    }
    let range = |axis: usize, bins: usize| {
        let [first, end] = span[axis];
        let axis = &axes[axis];
        if first >= end {
            return [axis.low, axis.high];
        }
        let margin = ((end - first) as f64 * MARGIN).ceil() as usize;
        [first.saturating_sub(margin), (end + margin).min(bins)]
            .map(|edge| (edge as f64).mul_add(axis.bin_width(), axis.low))
    };
    [range(0, width), range(1, height)]
}

#[cfg(test)]
mod tests {
    use voxrole_pack::histogram::HistogramShape;
    use voxrole_pack::{HistogramAxis, HistogramKind};

    use super::*;

    fn histogram(occupied: &[(usize, u64)]) -> Histogram {
        let axes =
            vec![HistogramAxis { low: 0.0, high: 100.0, bins: 100 }, HistogramAxis { low: 0.0, high: 50.0, bins: 50 }];
        let mut counts = vec![0; 5000];
        occupied.iter().for_each(|&(bin, count)| counts[bin] = count);
        Histogram { shape: HistogramShape { kind: HistogramKind::ValueHitGradient, axes }, counts }
    }

    #[test]
    fn the_plot_spans_what_either_histogram_occupies() {
        let (first, second) = (histogram(&[(2010, 5)]), histogram(&[(3959, 5)]));
        assert_eq!(occupied(&[&first, &second]), [[8.0, 62.0], [19.0, 41.0]]);
        assert_eq!(occupied(&[&histogram(&[])]), [[0.0, 100.0], [0.0, 50.0]]);
    }

    #[test]
    fn the_picture_has_its_largest_g_on_top_and_empty_bins_are_ground() {
        let image = image(&histogram(&[(4907, 1000), (7, 1)]));
        let [red, green, blue] = viridis(1.0);
        assert_eq!(image.pixels[7], Color32::from_rgb(red, green, blue));
        assert_eq!(image.pixels[8], theme::PLOT_GROUND);
        assert!(image.pixels[4907] != theme::PLOT_GROUND && image.pixels[4907] != image.pixels[7]);
    }

    #[test]
    fn the_note_counts_the_bin_under_the_pointer() {
        assert_eq!(note(&histogram(&[(2010, 1234)]), [10.5, 20.5]), "v 10.5   g 20.5   1,234 voxels");
    }
}
