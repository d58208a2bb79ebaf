//! A field continued a little beyond its faces, so that kernels need no border rule of their own.

use ndarray::{ArrayViewMut3, Axis, s};
use rayon::prelude::*;
use voxrole_pack::error::vec_with_capacity;

use crate::Result;
use crate::continuation::Continued;
use crate::working_field::{Field, dims_of};

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
        Self::new_in(Vec::new(), field)
    }

    /// The same in memory that was used before.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(crate) fn new_in(memory: Vec<f32>, field: &Field) -> Result<Self> {
        let mut padded = Self::unset(memory, dims_of(field))?;
        let mut inside = padded.inside_mut();
        let slices: Vec<_> = inside.axis_iter_mut(Axis(0)).zip(field.axis_iter(Axis(0))).collect();
        // Added to 0 so that −0 becomes 0, as in every sum beyond the faces.
        slices.into_par_iter().for_each(|(mut to, from)| to.zip_mut_with(&from, |to, from| *to = 0.0 + from));
        padded.continue_beyond_faces();
        Ok(padded)
    }

    /// Any numbers inside and around the faces of a field of `dims` voxels, in memory that was used before where there is
    /// enough of it.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(crate) fn unset(mut values: Vec<f32>, dims: [usize; 3]) -> Result<Self> {
        let len = Self::memory_len(dims);
        if values.capacity() < len {
            drop(values);
            return Ok(Self { values: zeros(len)?, dims });
        }
        // The slack is zeros.
        values.truncate(len - SLACK);
        values.resize(len, 0.0);
        Ok(Self { values, dims })
    }

    /// Samples that a field of `dims` voxels takes up.
    pub(crate) fn memory_len(dims: [usize; 3]) -> usize {
        strides(dims)[1] * padded_len(dims[2]) + SLACK
    }

    /// The memory, for [`Self::unset`].
    pub(crate) fn into_memory(self) -> Vec<f32> {
        self.values
    }

    /// The samples inside the faces, indexed (z, y, x).
    pub(crate) fn inside_mut(&mut self) -> ArrayViewMut3<'_, f32> {
        let [nx, ny, nz] = self.dims.map(padded_len);
        let shape = (nz, ny, nx);
        let all = ArrayViewMut3::from_shape(shape, &mut self.values[..nx * ny * nz]).expect("as many as were made");
        let [nx, ny, nz] = self.dims.map(|dim| PADDING..PADDING + dim);
        all.slice_move(s![nz, ny, nx])
    }

    /// Makes what lies beyond the faces of what lies inside.
    pub(crate) fn continue_beyond_faces(&mut self) {
        let dims @ [nx, ny, nz] = self.dims;
        let [row_len, slice_len] = self.strides();
        let count = slice_len * padded_len(nz);
        let (before, rest) = self.values[..count].split_at_mut(PADDING * slice_len);
        let (inside, behind) = rest.split_at_mut(nz * slice_len);
        inside.par_chunks_mut(slice_len).for_each(|slice| {
            let (before, rest) = slice.split_at_mut(PADDING * row_len);
            let (inside, behind) = rest.split_at_mut(ny * row_len);
            inside.chunks_exact_mut(row_len).for_each(|row| continue_row(row, nx));
            for (y, row) in beyond(before, behind, row_len, ny) {
                sum_of_rows(row, Continued::new(y, ny).terms(ny).map(|(j, weight)| (&inside[j * row_len..], weight)));
            }
        });
        let inside = &*inside;
        let slices: Vec<_> = beyond(before, behind, slice_len, nz).collect();
        slices.into_par_iter().for_each(|(z, slice)| {
            for (y, row) in slice.chunks_exact_mut(row_len).enumerate() {
                sum_of_rows(row, rows_around(inside, dims, [y as isize - PADDING as isize, z]));
            }
        });
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

/// Rows or slices before the first one inside and behind the last, each with its index.
fn beyond<'a>(
    before: &'a mut [f32],
    behind: &'a mut [f32],
    each: usize,
    len: usize,
) -> impl Iterator<Item = (isize, &'a mut [f32])> {
    let before = (-(PADDING as isize)..).zip(before.chunks_exact_mut(each));
    before.chain((len as isize..).zip(behind.chunks_exact_mut(each)))
}

/// The rows inside, already continued along x, that the row at (y, z) is a sum of, with their weights.
fn rows_around(inside: &[f32], [nx, ny, nz]: [usize; 3], [y, z]: [isize; 2]) -> impl Iterator<Item = (&[f32], f32)> {
    let [row_len, slice_len] = strides([nx, ny, nz]);
    Continued::new(z, nz).terms(nz).flat_map(move |(k, weight_z)| {
        let terms = Continued::new(y, ny).terms(ny);
        terms.map(move |(j, weight_y)| (&inside[k * slice_len + (PADDING + j) * row_len..], weight_y * weight_z))
    })
}

fn sum_of_rows<'a>(out: &mut [f32], rows: impl Iterator<Item = (&'a [f32], f32)>) {
    out.fill(0.0);
    for (row, weight) in rows {
        out.iter_mut().zip(row).for_each(|(out, value)| *out += weight * value);
    }
}

/// Continues a padded row of `len` samples.
fn continue_row(row: &mut [f32], len: usize) {
    let inside = PADDING..PADDING + len;
    for place in (0..row.len()).filter(|place| !inside.contains(place)) {
        let continued = Continued::new(place as isize - PADDING as isize, len);
        row[place] =
            continued.terms(len).map(|(inside, weight)| weight * row[PADDING + inside]).fold(0.0, |a, b| a + b);
    }
}

/// Zeros, written by all threads, so that each is given its part of the memory at the same time.
fn zeros(len: usize) -> Result<Vec<f32>> {
    const BLOCK: usize = 1 << 12;
    let blocks = len.div_ceil(BLOCK);
    let mut values: Vec<[f32; BLOCK]> = vec_with_capacity(blocks, "the padded value field")?;
    (0..blocks).into_par_iter().map(|_| [0.0; BLOCK]).collect_into_vec(&mut values);
    let mut values = values.into_flattened();
    values.truncate(len);
    Ok(values)
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
