//! A histogram as a picture.

use std::ops::Range;

use image::RgbImage;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use voxrole_pack::{Histogram, HistogramKind};

use super::axis::{BinWindow, TickedAxis};
use super::colour::viridis;
use super::lettering::{AXIS_TITLE_SIZE, FAINT_INK, GRID, INK, TICK_SIZE, provide_font, style};
use super::numbers::{group_thousands, short_number};
use super::{HistogramLabels, Quantity, check, png_from_image, quantities, with_unit};
use crate::{Error, Result};

/// Width of the picture in pixels.
const WIDTH: u32 = 900;
/// Height of the picture in pixels.
const HEIGHT: u32 = 700;
/// Height of the band that holds the title.
const TITLE_BAND: u32 = 72;
/// Left edge of the band that holds the colour bar.
const COLOUR_BAND: u32 = 770;
/// Height of the band below the axes.
const TICK_BAND: u32 = 64;

const BAR: RGBColor = RGBColor(49, 104, 142);
const BOUNDARY: RGBColor = RGBColor(208, 32, 32);
/// Where a bar's foot lies on the axis of counts, so that a bin of one voxel has a bar at all.
const BAR_FOOT: f64 = 0.5;

type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;
/// A rectangle of pixels: columns and rows.
type PixelRange = (Range<i32>, Range<i32>);

/// A histogram as the bytes of a PNG file of 900 × 700 pixels, on a white ground.
///
/// Two-dimensional histograms are a map of bins coloured by the logarithm of their count, with a colour bar; empty bins
/// are white. Where several bins fall on a pixel it shows the fullest. The distance histogram is bars on a logarithmic
/// axis, with a mark at the boundary. An axis more than half of which is empty is zoomed to its occupied bins and 5 %
/// beside them, and its title says so. An empty histogram is a picture that says so. No system font is needed.
///
/// # Errors
/// [`Error::Parameter`] for a histogram whose axes and counts do not fit its kind.
pub fn histogram_png(histogram: &Histogram, labels: &HistogramLabels<'_>) -> Result<Vec<u8>> {
    png_from_image(&histogram_image(histogram, labels)?)
}

fn histogram_image(histogram: &Histogram, labels: &HistogramLabels<'_>) -> Result<RgbImage> {
    check(histogram)?;
    provide_font()?;
    let mut pixels = vec![255; WIDTH as usize * HEIGHT as usize * 3];
    {
        let root = BitMapBackend::with_buffer(&mut pixels, (WIDTH, HEIGHT)).into_drawing_area();
        draw(&root, histogram, labels)
            .and_then(|()| Ok(root.present()?))
            .map_err(|error| Error::Parameter(format!("the histogram could not be drawn: {error}")))?;
    }
    Ok(RgbImage::from_raw(WIDTH, HEIGHT, pixels).expect("the buffer was made for this size"))
}

type Drawn = std::result::Result<(), Box<dyn std::error::Error + Send + Sync>>;

fn draw(root: &Area<'_>, histogram: &Histogram, labels: &HistogramLabels<'_>) -> Drawn {
    draw_title(root, histogram, labels)?;
    let (_, body) = root.split_vertically(TITLE_BAND);
    if histogram.shape.kind == HistogramKind::Distance {
        draw_bars(root, &body, histogram, labels)
    } else {
        draw_map(root, &body, histogram, labels)
    }
}

fn draw_title(root: &Area<'_>, histogram: &Histogram, labels: &HistogramLabels<'_>) -> Drawn {
    let title = match histogram.shape.kind {
        HistogramKind::ValueGradient => "Value and gradient magnitude of every voxel",
        HistogramKind::ValueSecondDerivative => "Value and second derivative of every voxel",
        HistogramKind::ValueHitGradient => "Voxels by their value and the gradient at their hit",
        HistogramKind::HitValueHitGradient => "Voxels by value and gradient at their hit",
        HistogramKind::Distance => "Voxels by their distance to the boundary",
    };
    let bins: Vec<_> = histogram.shape.axes.iter().map(|axis| axis.bins.to_string()).collect();
    let most = histogram.counts.iter().copied().max().unwrap_or(0);
    let counted = format!(
        "{} voxels in {} bins, at most {} in one",
        group_thousands(histogram.total()),
        bins.join(" × "),
        group_thousands(most)
    );
    let source = shortened(labels.source, 36);
    let subtitle = if source.is_empty() { counted } else { format!("{source}: {counted}") };
    root.draw_text(title, &style(24, &INK), (24, 14))?;
    root.draw_text(&subtitle, &style(TICK_SIZE, &FAINT_INK), (24, 44))?;
    Ok(())
}

/// `text` without control characters, its middle left out where it is longer than `most` characters.
fn shortened(text: &str, most: usize) -> String {
    let characters: Vec<char> = text.chars().filter(|character| !character.is_control()).collect();
    if characters.len() <= most {
        return characters.into_iter().collect();
    }
    let half = (most - 1) / 2;
    let (start, end) = (&characters[..half], &characters[characters.len() - half..]);
    start.iter().chain(&['…']).chain(end).collect()
}

/// The title of an axis; where only a part of it is shown a shorter one, with the whole range.
fn axis_title(quantity: &Quantity, window: &BinWindow, [low, high]: [f64; 2]) -> String {
    if window.zoomed {
        let short = with_unit(quantity.symbol, &quantity.unit);
        let [low, high] = [low, high].map(short_number);
        format!("{short}, zoomed from {low} … {high}")
    } else {
        with_unit(quantity.title, &quantity.unit)
    }
}

/// The axes with their ticks and titles; returns the pixels between them.
fn draw_axes(
    area: &Area<'_>,
    [x_axis, y_axis]: [TickedAxis; 2],
    [x_title, y_title]: [&str; 2],
) -> std::result::Result<PixelRange, Box<dyn std::error::Error + Send + Sync>> {
    let mut chart = ChartBuilder::on(area)
        .margin_left(16)
        .margin_right(18)
        .margin_bottom(8)
        .set_label_area_size(LabelAreaPosition::Left, 92)
        .set_label_area_size(LabelAreaPosition::Bottom, TICK_BAND - 8)
        .build_cartesian_2d(x_axis, y_axis)?;
    chart
        .configure_mesh()
        .bold_line_style(GRID)
        .axis_style(INK)
        .label_style(style(TICK_SIZE, &INK))
        .axis_desc_style(style(AXIS_TITLE_SIZE, &INK))
        .x_desc(x_title)
        .y_desc(y_title)
        .draw()?;
    Ok(chart.plotting_area().get_pixel_range())
}

/// The bins that hold a voxel, as a range along the axis that `along` takes a bin's place on.
fn occupied(counts: &[u64], along: impl Fn(usize) -> usize) -> Option<Range<usize>> {
    counts.iter().enumerate().filter(|(_, count)| **count > 0).fold(None, |range, (bin, _)| {
        let place = along(bin);
        Some(range.map_or(place..place + 1, |range: Range<usize>| range.start.min(place)..range.end.max(place + 1)))
    })
}

/// A joint histogram as a map, with its colour bar.
fn draw_map(root: &Area<'_>, body: &Area<'_>, histogram: &Histogram, labels: &HistogramLabels<'_>) -> Drawn {
    let [x, y] = [&histogram.shape.axes[0], &histogram.shape.axes[1]];
    let width = x.bins as usize;
    let columns = BinWindow::around(x, occupied(&histogram.counts, |bin| bin % width));
    let rows = BinWindow::around(y, occupied(&histogram.counts, |bin| bin / width));
    let quantities = quantities(histogram.shape.kind, labels.length_unit);
    let titles =
        [axis_title(&quantities[0], &columns, [x.low, x.high]), axis_title(&quantities[1], &rows, [y.low, y.high])];

    let (left, right) = body.split_horizontally(COLOUR_BAND);
    let axes = [TickedAxis::linear(columns.low, columns.high), TickedAxis::linear(rows.low, rows.high)];
    let frame = draw_axes(&left, axes, [&titles[0], &titles[1]])?;

    let most = histogram.counts.iter().copied().max().unwrap_or(0);
    if most == 0 {
        return draw_notice(root, &frame, "This histogram is empty: no voxel was counted.");
    }
    // At least two, so that the scale of colours has a length.
    let top = most.max(2) as f64;
    let (pixel_columns, pixel_rows) = (frame.0.len(), frame.1.len());
    for (row, y_pixel) in frame.1.clone().rev().enumerate() {
        let bins_up = rows.bins_of_pixel(row, pixel_rows);
        for (column, x_pixel) in frame.0.clone().enumerate() {
            let bins_across = columns.bins_of_pixel(column, pixel_columns);
            let fullest = bins_up
                .clone()
                .flat_map(|up| &histogram.counts[up * width + bins_across.start..up * width + bins_across.end])
                .copied()
                .max()
                .unwrap_or(0);
            if fullest > 0 {
                root.draw_pixel((x_pixel, y_pixel), &count_colour(fullest as f64, top))?;
            }
        }
    }
    draw_colour_bar(root, &right, top)
}

/// Viridis by the logarithm of a count of at least 1, yellow at `top`.
fn count_colour(count: f64, top: f64) -> RGBColor {
    let [red, green, blue] = viridis(count.ln() / top.ln());
    RGBColor(red, green, blue)
}

/// What colour means which count.
fn draw_colour_bar(root: &Area<'_>, area: &Area<'_>, top: f64) -> Drawn {
    let mut chart = ChartBuilder::on(area)
        .margin_left(4)
        .margin_right(16)
        .margin_bottom(TICK_BAND)
        .set_label_area_size(LabelAreaPosition::Right, 88)
        .build_cartesian_2d(RangedCoordf64::from(0.0..1.0), TickedAxis::log_counts(1.0, top))?;
    chart
        .configure_mesh()
        .disable_mesh()
        .disable_x_axis()
        .set_tick_mark_size(LabelAreaPosition::Right, 5)
        .axis_style(INK)
        .label_style(style(TICK_SIZE, &INK))
        .axis_desc_style(style(AXIS_TITLE_SIZE, &INK))
        .y_desc("voxels per bin, log scale")
        .draw()?;
    let (columns, rows) = chart.plotting_area().get_pixel_range();
    let last = (rows.len() - 1).max(1) as f64;
    for (step, y_pixel) in rows.rev().enumerate() {
        let colour = count_colour((step as f64 / last * top.ln()).exp(), top);
        for x_pixel in columns.clone() {
            root.draw_pixel((x_pixel, y_pixel), &colour)?;
        }
    }
    Ok(())
}

/// The distance histogram as bars.
fn draw_bars(root: &Area<'_>, body: &Area<'_>, histogram: &Histogram, labels: &HistogramLabels<'_>) -> Drawn {
    let axis = &histogram.shape.axes[0];
    let window = BinWindow::around(axis, occupied(&histogram.counts, |bin| bin));
    let quantities = quantities(histogram.shape.kind, labels.length_unit);
    let x_title = axis_title(&quantities[0], &window, [axis.low, axis.high]);
    let most = histogram.counts.iter().copied().max().unwrap_or(0);
    // The fullest bar leaves room for the words above it.
    let top = BAR_FOOT * (most.max(10) as f64 / BAR_FOOT).powf(1.07);
    let axes = [TickedAxis::linear(window.low, window.high), TickedAxis::log_counts(BAR_FOOT, top)];
    let frame = draw_axes(body, axes, [&x_title, "voxels per bin, log scale"])?;
    if most == 0 {
        return draw_notice(root, &frame, "This histogram is empty: no voxel has a boundary.");
    }

    let (columns, rows) = frame.clone();
    for (column, x_pixel) in columns.clone().enumerate() {
        let bins = window.bins_of_pixel(column, columns.len());
        let Some(fullest) = histogram.counts[bins].iter().copied().max().filter(|count| *count > 0) else { continue };
        let share = (fullest as f64 / BAR_FOOT).ln() / (top / BAR_FOOT).ln();
        let height = ((share * rows.len() as f64).round() as i32).max(1);
        for y_pixel in rows.end - height..rows.end {
            root.draw_pixel((x_pixel, y_pixel), &BAR)?;
        }
    }
    draw_boundary_mark(root, &frame, &window)
}

/// A line at distance 0, and which side is which.
fn draw_boundary_mark(root: &Area<'_>, (columns, rows): &PixelRange, window: &BinWindow) -> Drawn {
    if window.low >= 0.0 || window.high <= 0.0 {
        return Ok(());
    }
    let share = -window.low / (window.high - window.low);
    let x = columns.start + (share * columns.len() as f64).round() as i32;
    root.draw(&PathElement::new(vec![(x, rows.start), (x, rows.end - 1)], BOUNDARY.stroke_width(1)))?;
    let y = rows.start + 6;
    let side = |text: &str, position: i32, anchor: HPos, colour: &RGBColor| {
        let style = style(TICK_SIZE, colour).pos(Pos::new(anchor, VPos::Top));
        root.draw_text(text, &style, (position, y))
    };
    side("← lower value", x - 8, HPos::Right, &BOUNDARY)?;
    side("higher value →", x + 8, HPos::Left, &BOUNDARY)?;
    Ok(())
}

/// A sentence in the middle of the frame.
fn draw_notice(root: &Area<'_>, (columns, rows): &PixelRange, text: &str) -> Drawn {
    let style = style(20, &INK).pos(Pos::new(HPos::Center, VPos::Center));
    root.draw_text(text, &style, ((columns.start + columns.end) / 2, (rows.start + rows.end) / 2))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use voxrole_pack::HistogramAxis;
    use voxrole_pack::histogram::HistogramShape;

    use super::*;

    const LABELS: HistogramLabels<'_> = HistogramLabels { source: "ball.nrrd", length_unit: "mm" };

    fn joint(bins: [u32; 2], filled: &[([usize; 2], u64)]) -> Histogram {
        let axes = bins.map(|bins| HistogramAxis { low: 0.0, high: 1.0, bins }).to_vec();
        let mut counts = vec![0; bins[0] as usize * bins[1] as usize];
        for ([x, y], count) in filled {
            counts[y * bins[0] as usize + x] = *count;
        }
        Histogram { shape: HistogramShape { kind: HistogramKind::ValueGradient, axes }, counts }
    }

    fn distance(counts: Vec<u64>) -> Histogram {
        let axes = vec![HistogramAxis { low: -15.0, high: 15.0, bins: counts.len() as u32 }];
        Histogram { shape: HistogramShape { kind: HistogramKind::Distance, axes }, counts }
    }

    /// The smallest rectangle left of column `end` that holds every pixel of a colour: left, right, top, bottom.
    fn extent_of(image: &RgbImage, end: u32, colour: [u8; 3]) -> Option<[u32; 4]> {
        let pixels = image.enumerate_pixels().filter(|(x, _, pixel)| *x < end && pixel.0 == colour);
        pixels.fold(None, |extent, (x, y, _)| {
            let [left, right, top, bottom] = extent.unwrap_or([x, x, y, y]);
            Some([left.min(x), right.max(x), top.min(y), bottom.max(y)])
        })
    }

    #[test]
    fn bins_have_their_counts_colour_at_their_place() {
        let filled = [([0, 0], 1), ([3, 3], 1000), ([0, 3], 10), ([1, 1], 100)];
        let image = histogram_image(&joint([4, 4], &filled), &LABELS).expect("a valid histogram");
        let [lowest, highest, tenth] = [0.0, 1.0, 1.0 / 3.0].map(viridis);
        let low = extent_of(&image, COLOUR_BAND, lowest).expect("the bin of count 1 is drawn");
        let high = extent_of(&image, COLOUR_BAND, highest).expect("the fullest bin is drawn");
        let left_top = extent_of(&image, COLOUR_BAND, tenth).expect("the bin of count 10 is drawn");
        let [width, height] = [low[1] - low[0] + 1, low[3] - low[2] + 1];
        // A quarter of the frame each, which leaves room for titles and ticks.
        assert!((150..=170).contains(&width) && (130..=145).contains(&height), "{low:?}");
        assert!(high[0].abs_diff(low[0] + 3 * width) <= 3 && low[2].abs_diff(high[2] + 3 * height) <= 3, "{high:?}");
        assert_eq!([left_top[0], left_top[2]], [low[0], high[2]]);
        // The bin above the first is empty.
        assert_eq!(image.get_pixel(low[0] + width / 2, low[2] - height / 2).0, [255; 3]);
    }

    #[test]
    fn axes_ticks_and_titles_are_drawn() {
        let image = histogram_image(&joint([4, 4], &[([0, 0], 1), ([3, 3], 9)]), &LABELS).expect("a valid histogram");
        let dark_in = |columns: Range<u32>, rows: Range<u32>| {
            let pixels = columns.flat_map(|x| rows.clone().map(move |y| (x, y)));
            pixels.filter(|(x, y)| image.get_pixel(*x, *y).0[0] < 100).count()
        };
        assert!(dark_in(24..600, 10..40) > 500, "title");
        assert!(dark_in(200..700, HEIGHT - 30..HEIGHT) > 60, "title below");
        assert!(dark_in(0..30, 150..550) > 200, "title at the left");
        assert!(dark_in(120..740, HEIGHT - 60..HEIGHT - 32) > 60, "ticks below");
        assert!(dark_in(50..100, 80..630) > 60, "ticks at the left");
        assert!(dark_in(800..850, 80..630) > 10, "ticks of the colour bar");
    }

    #[test]
    fn pictures_decode_to_the_stated_size() {
        for histogram in [joint([300, 1000], &[([299, 999], 5)]), distance(vec![0, 1, 2, 3])] {
            let bytes = histogram_png(&histogram, &LABELS).expect("a valid histogram");
            let image = image::load_from_memory(&bytes).expect("a PNG file");
            assert_eq!([image.width(), image.height()], [WIDTH, HEIGHT]);
        }
    }

    #[test]
    fn a_single_voxel_among_many_bins_is_seen() {
        let image =
            histogram_image(&joint([4096, 4096], &[([0, 0], 7), ([4095, 4095], 1), ([2222, 1111], 1)]), &LABELS)
                .expect("a valid histogram");
        let extent = extent_of(&image, COLOUR_BAND, viridis(0.0)).expect("single voxels are drawn");
        assert!(extent[1] - extent[0] > 200, "{extent:?}");
    }

    #[test]
    fn bars_grow_with_the_logarithm_of_their_count() {
        let bar = [BAR.0, BAR.1, BAR.2];
        let image = histogram_image(&distance(vec![1, 10, 100, 1000]), &LABELS).expect("a valid histogram");
        let [left, right, _, bottom] = extent_of(&image, WIDTH, bar).expect("bars are drawn");
        let heights = [1, 3, 5, 7].map(|eighth| {
            let x = left + (right - left) * eighth / 8;
            (0..=bottom).rev().take_while(|y| image.get_pixel(x, *y).0 == bar).count()
        });
        let decade = heights[1] - heights[0];
        assert!(heights[0] > 20 && decade > 100, "{heights:?}");
        assert!(heights.windows(2).all(|pair| (pair[1] - pair[0]).abs_diff(decade) <= 2), "{heights:?}");
        let mark = extent_of(&image, WIDTH, [BOUNDARY.0, BOUNDARY.1, BOUNDARY.2]).expect("distance 0 is marked");
        assert!(mark[0] > left && mark[1] < right);
    }

    #[test]
    fn empty_histograms_say_so() {
        for (histogram, other) in [
            (joint([8, 8], &[]), joint([8, 8], &[([1, 1], 1), ([7, 7], 1)])),
            (distance(vec![0; 8]), distance(vec![1, 0, 0, 0, 0, 0, 0, 1])),
        ] {
            let empty = histogram_image(&histogram, &LABELS).expect("a valid histogram");
            let middle = |image: &RgbImage| {
                (300..600)
                    .flat_map(|x| (330..370).map(move |y| (x, y)))
                    .filter(|(x, y)| image.get_pixel(*x, *y).0[0] < 80)
                    .count()
            };
            assert!(middle(&empty) > 300, "a sentence stands in the middle");
            assert!(middle(&histogram_image(&other, &LABELS).expect("a valid histogram")) < 30);
        }
    }

    #[test]
    fn histograms_that_do_not_fit_their_kind_are_refused() {
        let good = joint([4, 4], &[]);
        let mut lacking = good.clone();
        lacking.counts.pop();
        let mut flat = good.clone();
        flat.shape.axes[1].high = 0.0;
        let mut endless = good.clone();
        endless.shape.axes[1].high = f64::INFINITY;
        let mut without_bins = good.clone();
        without_bins.shape.axes[0].bins = 0;
        without_bins.counts.clear();
        let mut wrong_kind = good;
        wrong_kind.shape.kind = HistogramKind::Distance;
        for bad in [lacking, flat, endless, without_bins, wrong_kind] {
            assert!(matches!(histogram_png(&bad, &LABELS), Err(Error::Parameter(_))), "{:?}", bad.shape);
        }
    }

    #[test]
    fn long_names_lose_their_middle() {
        assert_eq!(shortened("abc\n", 5), "abc");
        assert_eq!(shortened("abcdefghij", 5), "ab…ij");
    }
}
