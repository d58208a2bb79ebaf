//! A box of voxels with its surroundings, as the filter's inner loop wants it.

use std::ops::Range;

use multiversion::multiversion;

use crate::working_field::{Field, dims_of, voxels};

/// Voxels that are computed at once; a divisor of the boxes' padded width.
pub const LANES: usize = 16;

/// Stands for what is not there: so far from every value that it has no weight, and still finite, so that its weight times
/// its difference is 0.
pub const MISSING: f32 = f32::from_bits(0x7e80_0000); // 2¹²⁶

/// A box of a field and `reach` samples beyond each of its faces; all numbers scaled by one factor. Samples that are NaN,
/// infinite or outside the volume are [`MISSING`]. Memory is kept from box to box.
#[derive(Debug, Default)]
pub struct PaddedBox {
    /// x fastest; rows are filled up to whole [`LANES`].
    pub samples: Vec<f32>,
    /// Samples from one row, and from one slice, to the next.
    pub strides: [usize; 2],
    reach: [usize; 3],
}

impl PaddedBox {
    /// Copies the box `region` (ranges along x, y, z) of a field, which must lie inside of it.
    pub fn load(&mut self, field: &Field, region: &[Range<usize>; 3], reach: [usize; 3], scale: f32) {
        let [nx, ny, nz] = dims_of(field);
        let [width, height, depth] = [0, 1, 2].map(|axis| region[axis].len() + 2 * reach[axis]);
        let row_len = width - region[0].len() + region[0].len().next_multiple_of(LANES);
        self.strides = [row_len, row_len * height];
        self.reach = reach;
        self.samples.resize(self.strides[1] * depth, MISSING);
        let first = region[0].start.saturating_sub(reach[0]);
        let inside = first..(region[0].end + reach[0]).min(nx);
        let skipped = first + reach[0] - region[0].start;
        let source = voxels(field);
        for (row, out) in self.samples.chunks_exact_mut(row_len).enumerate() {
            let y = (region[1].start + row % height).checked_sub(reach[1]).filter(|y| *y < ny);
            let z = (region[2].start + row / height).checked_sub(reach[2]).filter(|z| *z < nz);
            out.fill(MISSING);
            let (Some(y), Some(z)) = (y, z) else { continue };
            let samples = &source[(z * ny + y) * nx..][inside.clone()];
            for (out, &sample) in out[skipped..].iter_mut().zip(samples) {
                let scaled = sample * scale;
                *out = if scaled.abs() < MISSING { scaled } else { MISSING };
            }
        }
    }

    /// The smallest and the largest sample that is there; infinite and the wrong way round without any.
    #[must_use]
    pub fn extremes(&self) -> [f32; 2] {
        extremes(&self.samples)
    }

    /// Where the box's row at (y, z), counted from its first one, begins in [`Self::samples`].
    #[must_use]
    pub fn row_start(&self, [y, z]: [usize; 2]) -> usize {
        let [row, slice] = self.strides;
        (z + self.reach[2]) * slice + (y + self.reach[1]) * row + self.reach[0]
    }
}

#[multiversion(targets("x86_64+avx2"))]
fn extremes(samples: &[f32]) -> [f32; 2] {
    let (blocks, rest) = samples.as_chunks::<LANES>();
    let (mut lows, mut highs) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
    for block in blocks {
        for lane in 0..LANES {
            // What is missing is larger than anything.
            lows[lane] = if block[lane] < lows[lane] { block[lane] } else { lows[lane] };
            let known = if block[lane] < MISSING { block[lane] } else { f32::NEG_INFINITY };
            highs[lane] = if known > highs[lane] { known } else { highs[lane] };
        }
    }
    let known = |sample: &f32| *sample < MISSING;
    let low = lows.into_iter().chain(rest.iter().copied()).fold(f32::INFINITY, f32::min);
    let high = highs.into_iter().chain(rest.iter().copied().filter(known)).fold(f32::NEG_INFINITY, f32::max);
    [low, high]
}
