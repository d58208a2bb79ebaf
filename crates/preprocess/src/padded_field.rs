//! A field continued a little beyond its faces, so that kernels need no border rule of their own.

use rayon::prelude::*;
use voxrole_pack::error::vec_with_capacity;

use crate::Result;
use crate::continuation::Continued;
use crate::working_field::{Field, dims_of, voxels};

/// Samples beyond each face: what a kernel of five taps reaches, and a quintic spline in the outermost cells.
pub const PADDING: usize = 2;
/// Samples behind the last one that may be loaded, though their weight is 0.
const SLACK: usize = 3;

/// A field that goes on beyond its faces as in [`Continued`].
#[derive(Clone, Debug)]
pub struct PaddedField {
    values: Vec<f32>,
    dims: [usize; 3],
}

impl PaddedField {
    /// Continues a field.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when memory runs out.
    pub fn new(field: &Field) -> Result<Self> {
        let dims = dims_of(field);
        let [row_len, slice_len] = strides(dims);
        let count = slice_len * padded_len(dims[2]);
        let mut values = vec_with_capacity(count + SLACK, "the padded value field")?;
        values.resize(count + SLACK, 0.0);
        values[..count].par_chunks_mut(slice_len).enumerate().for_each(|(k, slice)| {
            let mut extended = vec![0.0; row_len];
            for (j, out) in slice.chunks_mut(row_len).enumerate() {
                padded_row(field, [j, k].map(|index| index as isize - PADDING as isize), out, &mut extended);
            }
        });
        Ok(Self { values, dims })
    }

    /// Voxels along x, y, z without padding.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// The padded volume, x fastest; behind its last sample follow three zeros.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Samples from one padded row, and from one padded slice, to the next.
    #[must_use]
    pub fn strides(&self) -> [usize; 2] {
        strides(self.dims)
    }
}

/// Samples from one padded row, and from one padded slice, to the next.
fn strides([nx, ny, _]: [usize; 3]) -> [usize; 2] {
    let row = padded_len(nx);
    [row, row * padded_len(ny)]
}

/// Samples along a padded axis. An axis of one voxel is given a cell too.
fn padded_len(len: usize) -> usize {
    len.max(2) + 2 * PADDING
}

/// The padded row at (y, z), inside or beyond the faces.
fn padded_row(field: &Field, [y, z]: [isize; 2], out: &mut [f32], extended: &mut [f32]) {
    let [nx, ny, nz] = dims_of(field);
    out.fill(0.0);
    let source = voxels(field);
    // A row beyond the faces is a sum of rows inside.
    for (k, weight_z) in Continued::new(z, nz).terms(nz) {
        for (j, weight_y) in Continued::new(y, ny).terms(ny) {
            let weight = weight_y * weight_z;
            let row = &source[(k * ny + j) * nx..][..nx];
            extend(row, extended);
            out.iter_mut().zip(&*extended).for_each(|(out, value)| *out += weight * value);
        }
    }
}

/// A row with its continuation.
fn extend(row: &[f32], out: &mut [f32]) {
    let inside = PADDING..PADDING + row.len();
    out[inside.clone()].copy_from_slice(row);
    for place in (0..out.len()).filter(|place| !inside.contains(place)) {
        let continued = Continued::new(place as isize - PADDING as isize, row.len());
        out[place] = continued.terms(row.len()).map(|(inside, weight)| weight * row[inside]).sum();
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    #[test]
    fn every_axis_is_mirrored_in_its_end_points() {
        for len in 1..6 {
            let line: Vec<f32> = (0..len).map(|i| ((i * i * 7) % 11) as f32).collect();
            let expected: Vec<f32> = (-2..len.max(2) as isize + 2)
                .map(|index| Continued::new(index, len).terms(len).map(|(inside, weight)| weight * line[inside]).sum())
                .collect();
            for axis in 0..3 {
                let mut shape = [1; 3];
                shape[axis] = len;
                let field = Array3::from_shape_vec((shape[2], shape[1], shape[0]), line.clone()).expect("shape");
                let padded = PaddedField::new(&field).expect("fits");
                let [row, slice] = padded.strides();
                let strides = [1, row, slice];
                let start: usize = (0..3).filter(|&other| other != axis).map(|other| 2 * strides[other]).sum();
                let found: Vec<f32> =
                    (0..len.max(2) + 4).map(|index| padded.values()[start + index * strides[axis]]).collect();
                assert_eq!(found, expected, "axis {axis}");
            }
        }
    }

    #[test]
    fn corners_of_a_ramp_are_the_ramp_s() {
        let ramp = |x: f32, y: f32, z: f32| x + 10.0 * y + 100.0 * z;
        let field = Array3::from_shape_fn((3, 2, 4), |(k, j, i)| ramp(i as f32, j as f32, k as f32));
        let padded = PaddedField::new(&field).expect("fits");
        let [row, slice] = padded.strides();
        for (index, &found) in padded.values()[..slice * 7].iter().enumerate() {
            let place = [index % row, index % slice / row, index / slice].map(|index| index as f32 - 2.0);
            assert_eq!(found, ramp(place[0], place[1], place[2]));
        }
    }
}
