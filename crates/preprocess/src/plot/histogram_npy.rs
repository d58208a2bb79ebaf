//! A histogram as numpy's arrays.

use voxrole_pack::Histogram;
use voxrole_pack::scalar::LittleEndian;

use super::{bin_edge, check, quantities};
use crate::Result;
use crate::export::npy;

/// Bytes of `.npy` files.
pub struct HistogramArrays {
    /// The counts, u64, with one axis for each quantity: `counts[i, j]` is the count of bin i of the first and bin j of the
    /// second, as of `numpy.histogram2d`.
    pub counts: Vec<u8>,
    /// For each axis the quantity's name and the edges of its bins, f64, one more than there are bins.
    pub edges: Vec<(&'static str, Vec<u8>)>,
}

/// A histogram as what `numpy.histogram` and `numpy.histogram2d` return.
///
/// # Errors
/// [`crate::Error::Parameter`] for a histogram whose axes and counts do not fit its kind.
pub fn histogram_npy(histogram: &Histogram) -> Result<HistogramArrays> {
    check(histogram)?;
    let axes = &histogram.shape.axes;
    let shape: Vec<usize> = axes.iter().map(|axis| axis.bins as usize).collect();
    let mut counts = npy::header("<u8", true, &shape);
    u64::append_le(&histogram.counts, &mut counts);
    let edges = quantities(histogram.shape.kind, "").into_iter().zip(axes).map(|(quantity, axis)| {
        let edges: Vec<f64> = (0..=axis.bins as usize).map(|bin| bin_edge(axis, bin)).collect();
        let mut bytes = npy::header("<f8", false, &[edges.len()]);
        f64::append_le(&edges, &mut bytes);
        (quantity.column, bytes)
    });
    Ok(HistogramArrays { counts, edges: edges.collect() })
}

#[cfg(test)]
mod tests {
    use voxrole_pack::histogram::HistogramShape;
    use voxrole_pack::{HistogramAxis, HistogramKind};

    use super::*;

    #[test]
    fn counts_and_edges_are_written_to_the_byte() {
        let axes =
            vec![HistogramAxis { low: 0.0, high: 4.0, bins: 2 }, HistogramAxis { low: -1.0, high: 1.0, bins: 1 }];
        let shape = HistogramShape { kind: HistogramKind::ValueGradient, axes };
        let arrays = histogram_npy(&Histogram { shape, counts: vec![7, 256] }).expect("valid");
        assert!(String::from_utf8_lossy(&arrays.counts).contains("'fortran_order': True, 'shape': (2, 1), }"));
        assert!(arrays.counts.ends_with(&[7, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0]));
        let [(first, value), (second, gradient)] = arrays.edges.as_slice() else { panic!("two axes") };
        assert_eq!((*first, *second), ("value", "gradient_magnitude"));
        assert!(value.ends_with(&[0.0_f64, 2.0, 4.0].map(f64::to_le_bytes).concat()));
        assert!(gradient.ends_with(&[-1.0_f64, 1.0].map(f64::to_le_bytes).concat()));
    }
}
