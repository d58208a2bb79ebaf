//! Charts of points and lines, as PNG and SVG.

use image::RgbImage;
use plotters::coord::Shift;
use plotters::coord::ranged1d::Ranged;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axis::TickedAxis;
use super::label_placement::{Label, nearest_point, place_labels};
use super::lettering::{AXIS_TITLE_SIZE, FAINT_INK, GRID, INK, TICK_SIZE, provide_font, style, text_width};
use super::marker::{SeriesStyle, draw_marker};
use super::png_from_image;
use crate::{Error, Result};

/// Width and height of a chart in pixels.
const SIZE: (u32, u32) = (1120, 760);
/// Height of the band that holds the title.
const TITLE_BAND: u32 = 76;
/// Height of the band below the axis.
const TICK_BAND: u32 = 64;
const LABEL_SIZE: i32 = 14;
const MARKER_RADIUS: i32 = 5;
/// Height of a line of the legend.
const LEGEND_LINE: i32 = 26;
/// Width of the line and marker before a name in the legend.
const LEGEND_SAMPLE: i32 = 44;
/// Share of an axis that stays free beyond the data on either side.
const FREE: f64 = 0.05;
/// The same along x where points have labels.
const FREE_FOR_LABELS: f64 = 0.14;
/// How far below the smallest positive number 0 stands on a logarithmic axis, in decades.
const ZERO_BELOW: f64 = 0.5;

/// Length of a dash.
const DASH: f64 = 8.0;
/// Length of a dash and the gap behind it.
const DASH_AND_GAP: f64 = 13.0;

/// How numbers lie along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisScale {
    /// Evenly.
    Linear,
    /// By their logarithm; what is not positive is not drawn.
    Log,
    /// By their logarithm, with a place for 0 below the smallest.
    LogOrZero,
}

/// An axis of a chart.
#[derive(Clone, Debug)]
pub struct ChartAxis {
    /// What it counts, with its unit.
    pub title: String,
    /// How.
    pub scale: AxisScale,
}

/// A point of a series.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Point {
    /// Its place on the axes; it is left out where that is not finite.
    pub place: [f64; 2],
    /// What is written beside it.
    pub label: Option<String>,
    /// Whether its marker is white inside.
    pub hollow: bool,
}

/// What joins the points of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// Nothing.
    None,
    /// A line.
    Solid,
    /// A dashed line.
    Dashed,
    /// A grey line, and no markers.
    Bare,
}

/// Points that belong together.
#[derive(Clone, Debug)]
pub struct Series {
    /// The name in the legend.
    pub name: String,
    /// The points, in the order in which they are joined.
    pub points: Vec<Point>,
    /// What joins them.
    pub line: Line,
    /// How they look.
    pub style: SeriesStyle,
}

/// A chart with its legend at the right.
#[derive(Clone, Debug)]
pub struct Chart {
    /// What it shows, in a line.
    pub title: String,
    /// More about it, in a line.
    pub subtitle: String,
    /// The horizontal axis.
    pub x: ChartAxis,
    /// The vertical axis.
    pub y: ChartAxis,
    /// What is drawn, the first at the back.
    pub series: Vec<Series>,
}

/// A chart as the bytes of a PNG file of 1120 × 760 pixels. No system font is needed.
///
/// # Errors
/// [`Error::Parameter`] for a chart without a point that can be drawn.
pub fn chart_png(chart: &Chart) -> Result<Vec<u8>> {
    let (width, height) = SIZE;
    let mut pixels = vec![255; width as usize * height as usize * 3];
    draw(&BitMapBackend::with_buffer(&mut pixels, SIZE).into_drawing_area(), chart)?;
    png_from_image(&RgbImage::from_raw(width, height, pixels).expect("the buffer was made for this size"))
}

/// A chart as SVG, drawn by the same code as [`chart_png`].
///
/// # Errors
/// As [`chart_png`].
pub fn chart_svg(chart: &Chart) -> Result<String> {
    let mut text = String::new();
    draw(&SVGBackend::with_string(&mut text, SIZE).into_drawing_area(), chart)?;
    Ok(text)
}

fn draw<DB: DrawingBackend>(root: &DrawingArea<DB, Shift>, chart: &Chart) -> Result<()>
where
    DB::ErrorType: 'static,
{
    provide_font()?;
    let axes = [Placing::new(chart, 0)?, Placing::new(chart, 1)?];
    let failed = |error: Failure| Error::Parameter(format!("the chart could not be drawn: {error}"));
    Canvas { root, chart, axes }.draw().map_err(failed)
}

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// How numbers become places along one axis.
#[derive(Clone, Copy, Debug)]
struct Placing {
    scale: AxisScale,
    /// Smallest and largest place of the data.
    ends: [f64; 2],
    /// Where 0 stands on [`AxisScale::LogOrZero`], if the data hold one.
    zero: Option<f64>,
}

impl Placing {
    fn new(chart: &Chart, along: usize) -> Result<Self> {
        let scale = if along == 0 { chart.x.scale } else { chart.y.scale };
        let numbers = || chart.series.iter().flat_map(|series| &series.points).map(|point| point.place[along]);
        let bare = Self { scale, ends: [0.0; 2], zero: None };
        let ends = numbers()
            .filter_map(|number| bare.place(number))
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], place| [low.min(place), high.max(place)]);
        let has_zero = scale == AxisScale::LogOrZero && numbers().any(|number| number == 0.0);
        match (ends[0].is_finite(), has_zero) {
            (true, false) => Ok(Self { ends, ..bare }),
            (true, true) => {
                Ok(Self { ends: [ends[0] - ZERO_BELOW, ends[1]], zero: Some(ends[0] - ZERO_BELOW), ..bare })
            }
            // Nothing but zeros: they stand below 1.
            (false, true) => Ok(Self { ends: [-ZERO_BELOW, 0.0], zero: Some(-ZERO_BELOW), ..bare }),
            (false, false) => Err(Error::Parameter(format!("the chart `{}` has no point to draw", chart.title))),
        }
    }

    fn place(&self, number: f64) -> Option<f64> {
        let place = match self.scale {
            AxisScale::Linear => number,
            AxisScale::Log => number.log10(),
            AxisScale::LogOrZero if number == 0.0 => self.zero?,
            AxisScale::LogOrZero => number.log10(),
        };
        place.is_finite().then_some(place)
    }

    /// The axis, with `free` of its length left free on either side.
    fn axis(&self, free: f64) -> TickedAxis {
        let length = (self.ends[1] - self.ends[0]).max(if self.scale == AxisScale::Linear { 1e-12 } else { 0.3 });
        let [low, high] = [self.ends[0] - free * length, self.ends[0] + (1.0 + free) * length];
        match (self.scale, self.zero) {
            (AxisScale::Linear, _) => TickedAxis::linear(low, high),
            (_, None) => TickedAxis::log(10_f64.powf(low), 10_f64.powf(high)),
            (_, Some(zero)) => {
                TickedAxis::log(10_f64.powf(zero + 0.4 * ZERO_BELOW), 10_f64.powf(high)).with_zero_at(zero, low)
            }
        }
    }
}

struct Canvas<'a, DB: DrawingBackend> {
    root: &'a DrawingArea<DB, Shift>,
    chart: &'a Chart,
    axes: [Placing; 2],
}

impl<DB: DrawingBackend> Canvas<'_, DB>
where
    DB::ErrorType: 'static,
{
    fn draw(&self) -> std::result::Result<(), Failure> {
        self.root.fill(&WHITE)?;
        self.root.draw_text(&self.chart.title, &style(24, &INK), (24, 14))?;
        self.root.draw_text(&self.chart.subtitle, &style(TICK_SIZE, &FAINT_INK), (24, 46))?;
        let (_, body) = self.root.split_vertically(TITLE_BAND);
        let widest = self.chart.series.iter().map(|series| text_width(&series.name, TICK_SIZE)).max().unwrap_or(0);
        let legend = SIZE.0 as i32 - widest - LEGEND_SAMPLE - 24;
        let (left, _) = body.split_horizontally(legend);

        let labelled = self.chart.series.iter().flat_map(|series| &series.points).any(|point| point.label.is_some());
        let free = if labelled { FREE_FOR_LABELS } else { FREE };
        let axes = [self.axes[0].axis(free), self.axes[1].axis(FREE)];
        let mut builder = ChartBuilder::on(&left);
        builder
            .margin_left(16)
            .margin_right(12)
            .margin_bottom(8)
            .set_label_area_size(LabelAreaPosition::Left, 92)
            .set_label_area_size(LabelAreaPosition::Bottom, TICK_BAND - 8);
        let mut frame = builder.build_cartesian_2d(axes[0].clone(), axes[1].clone())?;
        frame
            .configure_mesh()
            .bold_line_style(GRID)
            .axis_style(INK)
            .label_style(style(TICK_SIZE, &INK))
            .axis_desc_style(style(AXIS_TITLE_SIZE, &INK))
            .x_desc(&self.chart.x.title)
            .y_desc(&self.chart.y.title)
            .draw()?;
        let (columns, rows) = frame.plotting_area().get_pixel_range();
        let pixel = |place: [f64; 2]| {
            let [x, y] = [self.axes[0].place(place[0])?, self.axes[1].place(place[1])?];
            // Rows count downwards.
            Some((axes[0].map(&x, (columns.start, columns.end)), axes[1].map(&y, (rows.end, rows.start))))
        };
        self.draw_series(&pixel)?;
        self.draw_labels(&pixel, [columns.start + 4, rows.start + 4, columns.end - 4, rows.end - 4])?;
        self.draw_legend((legend, rows.start + LEGEND_LINE / 2))?;
        self.root.present()?;
        Ok(())
    }

    fn draw_series(&self, pixel: &dyn Fn([f64; 2]) -> Option<(i32, i32)>) -> std::result::Result<(), Failure> {
        for series in &self.chart.series {
            let places = series.points.iter().filter_map(|point| pixel(point.place)).collect();
            self.draw_line(places, series)?;
        }
        for series in self.chart.series.iter().filter(|series| series.line != Line::Bare) {
            for point in &series.points {
                if let Some(place) = pixel(point.place) {
                    draw_marker(self.root, place, series.style, MARKER_RADIUS, point.hollow)?;
                }
            }
        }
        Ok(())
    }

    fn draw_line(&self, places: Vec<(i32, i32)>, series: &Series) -> std::result::Result<(), Failure> {
        let colour = series.style.colour();
        match series.line {
            Line::None => {}
            Line::Solid => self.root.draw(&PathElement::new(places, colour.stroke_width(2)))?,
            Line::Dashed => {
                for dash in dashes(&places) {
                    self.root.draw(&PathElement::new(dash.to_vec(), colour.stroke_width(2)))?;
                }
            }
            Line::Bare => self.root.draw(&PathElement::new(places, RGBColor(160, 160, 160).stroke_width(2)))?,
        }
        Ok(())
    }

    fn draw_labels(
        &self,
        pixel: &dyn Fn([f64; 2]) -> Option<(i32, i32)>,
        frame: [i32; 4],
    ) -> std::result::Result<(), Failure> {
        let marked = self.chart.series.iter().filter(|series| series.line != Line::Bare);
        let points: Vec<(&Point, (i32, i32))> =
            marked.flat_map(|series| &series.points).filter_map(|point| Some((point, pixel(point.place)?))).collect();
        let markers: Vec<(i32, i32)> = points.iter().map(|(_, place)| *place).collect();
        let named: Vec<(&str, Label)> = points
            .iter()
            .filter_map(|(point, place)| {
                let text = point.label.as_deref()?;
                Some((text, Label { point: *place, width: text_width(text, LABEL_SIZE) }))
            })
            .collect();
        let labels: Vec<Label> = named.iter().map(|(_, label)| label.clone()).collect();
        let places = place_labels(&labels, &markers, [LABEL_SIZE, MARKER_RADIUS + 2], frame);
        for ((_, label), place) in named.iter().zip(&places) {
            let end = nearest_point(*place, label.point);
            let apart = (end.0 - label.point.0).abs().max((end.1 - label.point.1).abs());
            if apart > MARKER_RADIUS + 3 {
                self.root.draw(&PathElement::new(vec![label.point, end], RGBColor(170, 170, 170).stroke_width(1)))?;
            }
        }
        for ((text, _), [left, top, _, bottom]) in named.iter().zip(places) {
            let style = style(LABEL_SIZE, &INK).pos(Pos::new(HPos::Left, VPos::Center));
            self.root.draw_text(text, &style, (left, (top + bottom) / 2))?;
        }
        Ok(())
    }

    fn draw_legend(&self, (x, mut y): (i32, i32)) -> std::result::Result<(), Failure> {
        for series in self.chart.series.iter().filter(|series| !series.name.is_empty()) {
            self.draw_line(vec![(x + 4, y), (x + LEGEND_SAMPLE - 8, y)], series)?;
            if series.line != Line::Bare {
                // Filled and hollow points of one series stand for the same thing in two states.
                let hollow = series.points.iter().all(|point| point.hollow) && series.line != Line::None;
                draw_marker(self.root, (x + LEGEND_SAMPLE / 2 - 2, y), series.style, MARKER_RADIUS, hollow)?;
            }
            let style = style(TICK_SIZE, &INK).pos(Pos::new(HPos::Left, VPos::Center));
            self.root.draw_text(&series.name, &style, (x + LEGEND_SAMPLE, y))?;
            y += LEGEND_LINE;
        }
        Ok(())
    }
}

/// The dashes of a dashed line, which go on around corners.
fn dashes(places: &[(i32, i32)]) -> Vec<[(i32, i32); 2]> {
    let mut dashes = Vec::new();
    let mut walked = 0.0;
    for ends in places.windows(2) {
        let [from, to] = [ends[0], ends[1]].map(|(x, y)| [f64::from(x), f64::from(y)]);
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        let at = |along: f64| {
            let share = (along / length).clamp(0.0, 1.0);
            [0, 1].map(|axis| (to[axis] - from[axis]).mul_add(share, from[axis]).round() as i32).into()
        };
        let first = (walked / DASH_AND_GAP).floor() as i64;
        let last = ((walked + length) / DASH_AND_GAP).floor() as i64;
        for count in first..=last {
            let start = (count as f64 * DASH_AND_GAP - walked).max(0.0);
            let end = (count as f64 * DASH_AND_GAP + DASH - walked).min(length);
            if end > start {
                dashes.push([at(start), at(end)]);
            }
        }
        walked += length;
    }
    dashes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(places: &[[f64; 2]], scale: AxisScale) -> Chart {
        let axis = |title: &str, scale| ChartAxis { title: title.into(), scale };
        let point = |&place: &[f64; 2]| Point { place, ..Point::default() };
        Chart {
            title: "a title".into(),
            subtitle: "and more".into(),
            x: axis("across", AxisScale::Linear),
            y: axis("up", scale),
            series: vec![Series {
                name: "a & b".into(),
                points: places.iter().map(point).collect(),
                line: Line::Solid,
                style: SeriesStyle::nth(0),
            }],
        }
    }

    /// Middle of the pixels of the first colour within the frame, by column.
    fn rows_of_markers(chart: &Chart) -> Vec<u32> {
        let mut chart = chart.clone();
        chart.series[0].line = Line::None;
        let image = image::load_from_memory(&chart_png(&chart).expect("draws")).expect("a PNG file").to_rgb8();
        assert_eq!(image.dimensions(), SIZE);
        let colour = SeriesStyle::nth(0).colour();
        let is_colour = |x: u32, y: u32| image.get_pixel(x, y).0 == [colour.0, colour.1, colour.2];
        let frame = 0..SIZE.0 - 120;
        let columns: Vec<Vec<u32>> = frame.map(|x| (0..SIZE.1).filter(|&y| is_colour(x, y)).collect()).collect();
        // The tallest column of each marker.
        let runs = columns.split(|column: &Vec<u32>| column.is_empty()).filter(|run| !run.is_empty());
        runs.filter_map(|run| run.iter().max_by_key(|column| column.len())).map(|rows| rows[rows.len() / 2]).collect()
    }

    #[test]
    fn logarithms_are_evenly_spaced_and_zero_stands_below() {
        let rows = rows_of_markers(&chart(&[[0.0, 1e-3], [1.0, 1e-2], [2.0, 1e-1]], AxisScale::Log));
        assert_eq!(rows.len(), 3);
        assert!((rows[0] - rows[1]).abs_diff(rows[1] - rows[2]) <= 2, "{rows:?}");
        let rows = rows_of_markers(&chart(&[[0.0, 0.0], [1.0, 1e-2], [2.0, 1e-1]], AxisScale::LogOrZero));
        assert!(rows.len() == 3 && rows[0] > rows[1] && rows[1] > rows[2], "{rows:?}");
        // A logarithm has no place for 0.
        assert_eq!(rows_of_markers(&chart(&[[0.0, 0.0], [1.0, 1e-2], [2.0, 1e-1]], AxisScale::Log)).len(), 2);
    }

    #[test]
    fn svg_holds_the_same_texts() {
        let chart = chart(&[[0.0, 1.0], [1.0, 20.0]], AxisScale::Log);
        let svg = chart_svg(&chart).expect("draws");
        for text in ["a title", "and more", "across", "up", "a &amp; b", "monospace", "</svg>"] {
            assert!(svg.contains(text), "{text}");
        }
    }

    #[test]
    fn dashes_cover_their_share_of_the_line() {
        let drawn = dashes(&[(0, 0), (130, 0), (130, 65)]);
        let length = |[a, b]: &[(i32, i32); 2]| (b.0 - a.0) + (b.1 - a.1);
        assert_eq!(drawn.iter().map(length).sum::<i32>(), 15 * 8);
        assert_eq!([drawn[0], drawn[1], drawn[10]], [[(0, 0), (8, 0)], [(13, 0), (21, 0)], [(130, 0), (130, 8)]]);
        assert!(dashes(&[(3, 3)]).is_empty() && dashes(&[(3, 3), (3, 3)]).is_empty());
    }

    #[test]
    fn a_chart_without_points_is_refused_and_one_point_is_enough() {
        assert!(matches!(chart_png(&chart(&[], AxisScale::Log)), Err(Error::Parameter(_))));
        assert!(chart_png(&chart(&[[1.0, -1.0]], AxisScale::Log)).is_err());
        assert!(chart_png(&chart(&[[1.0, 1.0]], AxisScale::Log)).is_ok());
        assert!(chart_png(&chart(&[[1.0, 0.0]], AxisScale::LogOrZero)).is_ok());
    }
}
