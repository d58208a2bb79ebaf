//! A histogram as a table.

use std::fmt::Write;

use voxrole_pack::Histogram;

use super::{HistogramLabels, bin_edge, check, quantities, with_unit};
use crate::Result;

/// A histogram as comma-separated values: one row a bin with its middle, lower and upper edge along each axis and its
/// count.
///
/// The header names the columns with their units in brackets. One-dimensional histograms list every bin,
/// two-dimensional ones only bins that hold a voxel, first axis fastest. Numbers are written so that they read back
/// exactly.
///
/// # Errors
/// [`crate::Error::Parameter`] for a histogram whose axes and counts do not fit its kind.
pub fn histogram_csv(histogram: &Histogram, labels: &HistogramLabels<'_>) -> Result<String> {
    check(histogram)?;
    let axes = &histogram.shape.axes;
    let mut table = String::new();
    for quantity in quantities(histogram.shape.kind, labels.length_unit) {
        let unit = quantity.unit.replace([',', '"', '\n', '\r'], " ");
        for suffix in ["", "_low", "_high"] {
            table.push_str(&with_unit(&format!("{}{suffix}", quantity.column), &unit));
            table.push(',');
        }
    }
    table.push_str("count\n");

    for (bin, &count) in histogram.counts.iter().enumerate() {
        if count == 0 && axes.len() > 1 {
            continue;
        }
        let mut rest = bin;
        for axis in axes {
            let along = rest % axis.bins as usize;
            rest /= axis.bins as usize;
            let [low, high] = [along, along + 1].map(|bin| bin_edge(axis, bin));
            let _infallible = write!(table, "{},{low},{high},", axis.bin_center(along));
        }
        let _infallible = writeln!(table, "{count}");
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use voxrole_pack::histogram::HistogramShape;
    use voxrole_pack::{HistogramAxis, HistogramKind};

    use super::*;

    #[test]
    fn two_dimensional_tables_list_occupied_bins() {
        let axes =
            vec![HistogramAxis { low: 0.0, high: 4.0, bins: 4 }, HistogramAxis { low: -1.0, high: 1.0, bins: 2 }];
        let shape = HistogramShape { kind: HistogramKind::ValueSecondDerivative, axes };
        let histogram = Histogram { shape, counts: vec![0, 7, 0, 0, 0, 0, 2, 0] };
        let table = histogram_csv(&histogram, &HistogramLabels { source: "", length_unit: "mm" }).expect("valid");
        let lines: Vec<_> = table.lines().collect();
        assert_eq!(lines.len(), 3);
        assert!(lines[0].starts_with("value,value_low,value_high,second_derivative [value / mm²],"), "{}", lines[0]);
        assert!(lines[0].ends_with(",count"));
        assert_eq!(lines[1], "1.5,1,2,-0.5,-1,0,7");
        assert_eq!(lines[2], "2.5,2,3,0.5,0,1,2");
    }

    #[test]
    fn one_dimensional_tables_list_every_bin() {
        let axes = vec![HistogramAxis { low: -2.0, high: 2.0, bins: 4 }];
        let shape = HistogramShape { kind: HistogramKind::Distance, axes };
        let histogram = Histogram { shape, counts: vec![0, 5, 3, 0] };
        let table = histogram_csv(&histogram, &HistogramLabels::default()).expect("valid");
        let expected = "signed_distance [world unit],signed_distance_low [world unit],\
                        signed_distance_high [world unit],count\n\
                        -1.5,-2,-1,0\n-0.5,-1,0,5\n0.5,0,1,3\n1.5,1,2,0\n";
        assert_eq!(table, expected);
    }

    #[test]
    fn counts_that_do_not_fit_are_refused() {
        let axes = vec![HistogramAxis { low: -2.0, high: 2.0, bins: 4 }];
        let shape = HistogramShape { kind: HistogramKind::Distance, axes };
        let histogram = Histogram { shape, counts: vec![0; 5] };
        assert!(histogram_csv(&histogram, &HistogramLabels::default()).is_err());
    }
}
