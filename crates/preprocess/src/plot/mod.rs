//! Pictures and tables of histograms and slices, as bytes of a PNG, CSV or `.npy` file; charts, as PNG or SVG.

mod axis;
mod chart;
pub mod colour;
mod field_slice;
mod histogram;
mod histogram_csv;
mod histogram_npy;
mod label_placement;
mod lettering;
mod marker;
pub mod numbers;
mod slice;
mod text_coverage;

use std::io::Cursor;

use image::{ImageFormat, RgbImage};
use voxrole_pack::{Histogram, HistogramAxis, HistogramKind};

use crate::{Error, Result};
pub use chart::{AxisScale, Chart, ChartAxis, Line, Point, Series, chart_png, chart_svg};
pub use field_slice::field_slice_png;
pub use histogram::histogram_png;
pub use histogram_csv::histogram_csv;
pub use histogram_npy::{HistogramArrays, histogram_npy};
pub use marker::SeriesStyle;
pub use slice::{SliceAxis, SliceShading};
pub use text_coverage::{TextCoverage, text_coverage};

/// What a histogram's plot and table say about where it comes from.
#[derive(Clone, Copy, Debug, Default)]
pub struct HistogramLabels<'a> {
    /// The volume's name, for the title.
    pub source: &'a str,
    /// Unit of the world's lengths (`mm`), or empty where none is known.
    pub length_unit: &'a str,
}

/// What an axis counts: what it is, its name as a column, and its unit. Values have the input's unit, which no file
/// format read here names.
struct Quantity {
    title: &'static str,
    /// A shorter title.
    symbol: &'static str,
    column: &'static str,
    unit: String,
}

/// A name with its unit in brackets, or the bare name where there is no unit.
fn with_unit(name: &str, unit: &str) -> String {
    if unit.is_empty() { name.to_owned() } else { format!("{name} [{unit}]") }
}

/// The quantities of a histogram's axes, in their order.
fn quantities(kind: HistogramKind, length_unit: &str) -> Vec<Quantity> {
    let length: String = if length_unit.is_empty() { "world unit" } else { length_unit }.chars().take(12).collect();
    let value = |title, symbol| Quantity { title, symbol, column: "value", unit: String::new() };
    let gradient =
        |title, symbol| Quantity { title, symbol, column: "gradient_magnitude", unit: format!("value / {length}") };
    match kind {
        HistogramKind::ValueGradient => vec![value("value v", "v"), gradient("gradient magnitude g", "g")],
        HistogramKind::ValueSecondDerivative => {
            let second_derivative = Quantity {
                title: "second directional derivative f''",
                symbol: "f''",
                column: "second_derivative",
                unit: format!("value / {length}²"),
            };
            vec![value("value v", "v"), second_derivative]
        }
        HistogramKind::ValueHitGradient => {
            vec![value("value v of the voxel", "v"), gradient("gradient magnitude g at its hit", "g at the hit")]
        }
        HistogramKind::HitValueHitGradient => vec![
            value("value v at the hit", "v at the hit"),
            gradient("gradient magnitude g at the hit", "g at the hit"),
        ],
        HistogramKind::Distance => vec![Quantity {
            title: "signed distance d to the boundary",
            symbol: "d",
            column: "signed_distance",
            unit: length,
        }],
    }
}

/// The lower edge of a bin; with the number of bins, the upper edge of the last.
fn bin_edge(axis: &HistogramAxis, bin: usize) -> f64 {
    (axis.high - axis.low).mul_add(bin as f64 / f64::from(axis.bins), axis.low)
}

/// Checks that a histogram can be drawn and listed.
fn check(histogram: &Histogram) -> Result<()> {
    let shape = &histogram.shape;
    let name = shape.kind.name();
    let axes = if shape.kind == HistogramKind::Distance { 1 } else { 2 };
    if shape.axes.len() != axes {
        return Err(Error::Parameter(format!("histogram {name} has {} axes instead of {axes}", shape.axes.len())));
    }
    for axis in &shape.axes {
        let usable = axis.bins > 0 && axis.low < axis.high && (axis.high - axis.low).is_finite();
        if !(usable && axis.bin_width() > 0.0) {
            return Err(Error::Parameter(format!(
                "histogram {name} has an axis of {} bins from {} to {}, which cannot be drawn",
                axis.bins, axis.low, axis.high
            )));
        }
    }
    if shape.bin_count() != Some(histogram.counts.len() as u64) {
        return Err(Error::Parameter(format!(
            "histogram {name} has {} counts for {:?} bins",
            histogram.counts.len(),
            shape.axes.iter().map(|axis| axis.bins).collect::<Vec<_>>()
        )));
    }
    Ok(())
}

/// The bytes of a PNG file.
fn png_from_image(image: &RgbImage) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    image
        .write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png)
        .map_err(|error| Error::Parameter(format!("the picture could not be encoded as PNG: {error}")))?;
    Ok(bytes)
}
