//! Means over boxes: repeated three times, a box comes close to a Gaussian.
//!
//! Source: W. M. Wells, Efficient synthesis of Gaussian filters by cascaded uniform filters, 1986. Sums are whole numbers, so
//! that a mean has the same bits however it is gathered.

use fearless_simd::{Simd, SimdBase, dispatch, f32x16};
use rayon::prelude::*;
use voxrole_preprocess::simd;

/// Repetitions: the peak of three is 6 % lower than the Gaussian's, and nowhere are they farther off.
const REPETITIONS: usize = 3;

/// Cells of a row that are summed at once.
const LANES: usize = 16;

/// Blurs shares of 65535 on a grid, x fastest, by a Gaussian of a standard deviation along each axis in cells, or the
/// nearest that boxes of whole cells have, of up to [`Mean::LARGEST`] of them; 0 lies outside.
pub fn blur([nx, ny, nz]: [usize; 3], mut shares: Vec<u16>, sigmas: [f32; 3]) -> Vec<u16> {
    let [along_x, along_y, along_z] = sigmas.map(reach);
    // Both lie within layers.
    shares.par_chunks_mut(nx * ny).for_each_init(Lines::default, |lines, layer| {
        if along_x > 0 {
            dispatch!(simd::level(), simd => lines.blur_rows(simd, layer, nx, along_x));
        }
        if along_y > 0 {
            lines.gather(nx, layer.chunks_exact(nx));
            dispatch!(simd::level(), simd => lines.blur_across(simd, along_y));
            lines.store(layer.chunks_exact_mut(nx));
        }
    });
    if along_z == 0 {
        return shares;
    }
    // Rows at the same place of all layers make a layer of their own.
    let mut turned = vec![0; shares.len()];
    turned.par_chunks_mut(nx * nz).enumerate().for_each_init(Lines::default, |lines, (y, turned)| {
        lines.gather(nx, (0..nz).map(|z| &shares[(z * ny + y) * nx..][..nx]));
        dispatch!(simd::level(), simd => lines.blur_across(simd, along_z));
        lines.store(turned.chunks_exact_mut(nx));
    });
    shares.par_chunks_mut(nx).enumerate().with_min_len(ny).for_each(|(row, shares)| {
        shares.copy_from_slice(&turned[((row % ny) * nz + row / ny) * nx..][..nx]);
    });
    shares
}

/// How many cells a box reaches to either side: the variance of [`REPETITIONS`] boxes of `2r + 1` is `r (r + 1)`.
fn reach(sigma: f32) -> usize {
    ((sigma.mul_add(sigma, 0.25).sqrt() - 0.5).round() as usize).min(Mean::LARGEST / 2)
}

/// What is blurred: whole numbers, which floats hold exactly, and so do sums of [`Mean::LARGEST`] of them. Rows are a
/// multiple of [`LANES`] wide; what lies behind their ends is no cell's.
///
/// Loops of vectors and no iterators, as what std calls might be compiled without the level's instructions.
#[derive(Default)]
struct Lines {
    width: usize,
    shares: Vec<f32>,
    means: Vec<f32>,
}

impl Lines {
    /// Blurs along the rows of a layer.
    #[inline(always)]
    fn blur_rows<S: Simd>(&mut self, simd: S, layer: &mut [u16], width: usize, reach: usize) {
        let mean = Mean::over(2 * reach + 1);
        let padded = width.next_multiple_of(LANES);
        // As much as the last lanes read beyond the row.
        for row in [&mut self.shares, &mut self.means] {
            row.clear();
            row.resize(padded + 2 * reach, 0.0);
        }
        for row in layer.chunks_exact_mut(width) {
            load(row, &mut self.shares[reach..]);
            for _ in 0..REPETITIONS {
                let mut first = 0;
                while first < padded {
                    let mut sum = f32x16::splat(simd, 0.0);
                    let mut ahead = 0;
                    while ahead <= 2 * reach {
                        sum += vector(simd, &self.shares, first + ahead);
                        ahead += 1;
                    }
                    mean.of(sum).store_slice(&mut self.means[reach + first..][..LANES]);
                    first += LANES;
                }
                self.means[reach + width..].fill(0.0);
                std::mem::swap(&mut self.shares, &mut self.means);
            }
            store(&self.shares[reach..], row);
        }
    }

    /// Takes rows of `width` cells that lie behind each other.
    fn gather<'a>(&mut self, width: usize, rows: impl ExactSizeIterator<Item = &'a [u16]>) {
        self.width = width.next_multiple_of(LANES);
        self.shares.resize(rows.len() * self.width, 0.0);
        self.shares.chunks_exact_mut(self.width).zip(rows).for_each(|(shares, row)| load(row, shares));
    }

    /// Gives them back.
    fn store<'a>(&self, rows: impl Iterator<Item = &'a mut [u16]>) {
        self.shares.chunks_exact(self.width).zip(rows).for_each(|(shares, row)| store(shares, row));
    }

    /// Blurs across the rows.
    #[inline(always)]
    fn blur_across<S: Simd>(&mut self, simd: S, reach: usize) {
        let mean = Mean::over(2 * reach + 1);
        self.means.resize(self.shares.len(), 0.0);
        for _ in 0..REPETITIONS {
            self.take_means(simd, reach, mean);
            std::mem::swap(&mut self.shares, &mut self.means);
        }
    }

    /// The means over `2 · reach + 1` rows, by sums that move along.
    #[inline(always)]
    fn take_means<S: Simd>(&mut self, simd: S, reach: usize, mean: Mean) {
        let Self { width, shares, means } = self;
        let (width, rows) = (*width, shares.len() / *width);
        let mut first = 0;
        while first < width {
            let mut sum = f32x16::splat(simd, 0.0);
            let mut row = 0;
            while row < reach.min(rows) {
                sum += vector(simd, shares, row * width + first);
                row += 1;
            }
            row = 0;
            while row < rows {
                if row + reach < rows {
                    sum += vector(simd, shares, (row + reach) * width + first);
                }
                mean.of(sum).store_slice(&mut means[row * width + first..][..LANES]);
                if row >= reach {
                    sum -= vector(simd, shares, (row - reach) * width + first);
                }
                row += 1;
            }
            first += LANES;
        }
    }
}

#[inline(always)]
fn vector<S: Simd>(simd: S, numbers: &[f32], first: usize) -> f32x16<S> {
    f32x16::from_slice(simd, &numbers[first..][..LANES])
}

fn load(row: &[u16], shares: &mut [f32]) {
    shares.iter_mut().zip(row).for_each(|(share, &stored)| *share = f32::from(stored));
}

fn store(numbers: &[f32], shares: &mut [u16]) {
    shares.iter_mut().zip(numbers).for_each(|(share, &number)| *share = (number + WHOLE).to_bits() as u16);
}

/// Added to a smaller number it leaves no bits behind its point, and the nearest whole number in its lowest ones.
const WHOLE: f32 = 8_388_608.0;

/// Division of a sum of shares by their count, rounded to the nearest whole number.
#[derive(Clone, Copy)]
struct Mean(f32);

impl Mean {
    /// Most cells of a box.
    const LARGEST: usize = 63;

    /// Of an odd count.
    fn over(count: usize) -> Self {
        Self(1.0 / count as f32)
    }

    /// A multiplication in place of the division: that is off by 2⁻²³ of at most 2¹⁶, which is less than the 1/126 that a
    /// quotient of an odd number up to [`Self::LARGEST`] is away from where rounding changes.
    #[inline(always)]
    fn of<S: Simd>(self, sum: f32x16<S>) -> f32x16<S> {
        (sum * self.0 + WHOLE) - WHOLE
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The same, cell by cell.
    fn naive(dims: [usize; 3], shares: &[u16], sigmas: [f32; 3]) -> Vec<u16> {
        let mut shares = shares.to_vec();
        for axis in 0..3 {
            let reach = reach(sigmas[axis]) as i64;
            for _ in 0..if reach > 0 { REPETITIONS } else { 0 } {
                let stride = [1, dims[0], dims[0] * dims[1]][axis];
                let mean = |cell: usize| {
                    let place = (cell / stride % dims[axis]) as i64;
                    let inside = (-reach..=reach).filter(|off| (0..dims[axis] as i64).contains(&(place + off)));
                    let sum: u64 =
                        inside.map(|off| u64::from(shares[(cell as i64 + off * stride as i64) as usize])).sum();
                    let count = 2 * reach as u64 + 1;
                    ((sum + count / 2) / count) as u16
                };
                shares = (0..shares.len()).map(mean).collect();
            }
        }
        shares
    }

    proptest! {
        #[test]
        fn sums_that_move_along_equal_their_naive_twin(
            dims in (1_usize..20, 1_usize..9, 1_usize..9),
            sigmas in [0_f32..6.0, 0_f32..6.0, 0_f32..6.0],
            seed in prop::collection::vec(any::<u16>(), 1..99),
        ) {
            let dims = [dims.0, dims.1, dims.2];
            let shares: Vec<u16> = seed.into_iter().cycle().take(dims.iter().product()).collect();
            let naive = naive(dims, &shares, sigmas);
            prop_assert_eq!(blur(dims, shares, sigmas), naive);
        }

        #[test]
        fn division_is_exact(reach in 1_usize..32, shares in 0_u64..=65535) {
            let count = 2 * reach as u64 + 1;
            let mean = Mean::over(count as usize);
            for sum in [shares * count, (shares * count).saturating_sub(1), shares * count / 2, count * 65535] {
                let found: [f32; LANES] =
                    dispatch!(simd::level(), simd => mean.of(f32x16::splat(simd, sum as f32)).into());
                prop_assert_eq!(found[0] as u64, (sum + count / 2) / count);
            }
        }
    }

    #[test]
    fn a_point_becomes_a_gaussian() {
        let mut shares = vec![0; 61];
        shares[30] = u16::MAX;
        let blurred = blur([61, 1, 1], shares, [4.5, 0.0, 0.0]);
        let total: f64 = blurred.iter().map(|&share| f64::from(share)).sum();
        assert!((total / 65535.0 - 1.0).abs() < 1e-3, "{total}");
        let peak = (std::f64::consts::TAU * 20.0).sqrt().recip();
        for (x, &share) in blurred.iter().enumerate() {
            let exact = peak * (-0.5 * ((x as f64 - 30.0) / 20_f64.sqrt()).powi(2)).exp();
            // Boxes of whole cells are off by a little more than those of any width.
            assert!((f64::from(share) / 65535.0 - exact).abs() < 0.07 * peak, "{x}: {share} is not {exact}");
        }
    }
}
