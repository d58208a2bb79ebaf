//! Gradient magnitude and f'' by central differences, in one pass over the value field.

use std::ops::Range;

use multiversion::multiversion;
use rayon::prelude::*;

use crate::directional_derivative::{Derivatives, EdgeOperator, Stencils};
use crate::row_windows::{WINDOW, windows};
use crate::stencil::{AxisStencil, Taps, weighted_sum};
use crate::working_field::{WorkingField, voxels, voxels_mut};

/// Computes [`Derivatives`]: `f'' = ∇fᵀH∇f / ‖∇f‖²`, eq. (2) of the paper, H by second differences.
///
/// Second order in the spacing. On an edge blurred by 1.5 voxels nᵀHn errs by 4.7 %, half of what ∇‖∇f‖·n does.
#[must_use]
pub fn derivatives(field: &WorkingField, operator: EdgeOperator) -> Derivatives {
    let mut derivatives = Derivatives::zeros(field.dims());
    derivatives_into(field, operator, &mut derivatives);
    derivatives
}

/// As [`derivatives`], into fields that exist already.
///
/// Per voxel 4 bytes are read and 8 written, for 63 operations on f32 (39 products, 22 sums, a division and a root), 8 voxels
/// at a time with AVX2: the processor is busier than its memory. The slices beside a slice are still in the cache.
///
/// # Panics
/// When `derivatives` are not of the field's dimensions.
pub fn derivatives_into(field: &WorkingField, operator: EdgeOperator, derivatives: &mut Derivatives) {
    let Derivatives { gradient_magnitude, second_derivative } = derivatives;
    let shape = field.values.dim();
    assert!(gradient_magnitude.dim() == shape && second_derivative.dim() == shape, "fields of one volume");
    let [nx, ny, _] = field.dims();
    let stencils = Stencils::new(field);
    let source = voxels(&field.values);
    voxels_mut(gradient_magnitude)
        .par_chunks_mut(nx * ny)
        .zip(voxels_mut(second_derivative).par_chunks_mut(nx * ny))
        .enumerate()
        .for_each_init(
            || FirstDerivatives { y: vec![0.0; nx], z: vec![0.0; nx] },
            |first, (k, (slice_g, slice_f2))| {
                let slice = Slice { source, stencils: &stencils, k };
                differentiate_slice(&slice, operator, first, slice_g, slice_f2);
            },
        );
}

/// The slice that is differentiated.
struct Slice<'a> {
    /// The whole field.
    source: &'a [f32],
    stencils: &'a Stencils,
    /// Its index.
    k: usize,
}

/// First derivatives of one row, whose neighbours in x are needed too.
struct FirstDerivatives {
    y: Vec<f32>,
    z: Vec<f32>,
}

#[multiversion(targets("x86_64+avx2"))]
fn differentiate_slice(
    slice: &Slice<'_>,
    operator: EdgeOperator,
    first: &mut FirstDerivatives,
    slice_g: &mut [f32],
    slice_f2: &mut [f32],
) {
    // Spelled out, so that no loop asks which it is.
    match operator {
        EdgeOperator::SecondDerivative => {
            slice.differentiate(EdgeOperator::SecondDerivative, first, slice_g, slice_f2);
        }
        EdgeOperator::Plus => slice.differentiate(EdgeOperator::Plus, first, slice_g, slice_f2),
    }
}

impl Slice<'_> {
    #[inline(always)]
    fn differentiate(
        &self,
        operator: EdgeOperator,
        first: &mut FirstDerivatives,
        slice_g: &mut [f32],
        slice_f2: &mut [f32],
    ) {
        let nx = first.y.len();
        let rows_per_slice = slice_g.len() / nx;
        let [x_axis, y_axis, z_axis] = &self.stencils.axes;
        let z = z_axis.taps(self.k);
        for (j, (row_g, row_f2)) in slice_g.chunks_exact_mut(nx).zip(slice_f2.chunks_exact_mut(nx)).enumerate() {
            let y = y_axis.taps(j);
            let rows = Rows::new(&y, &z, |k, j| &self.source[(k * rows_per_slice + j) * nx..][..nx]);
            if y.is_central() && z.is_central() {
                rows.differentiate::<true>(x_axis, operator, first, row_g, row_f2);
            } else {
                rows.differentiate::<false>(x_axis, operator, first, row_g, row_f2);
            }
        }
    }
}

/// The rows around a row, with their weights.
#[derive(Clone, Copy)]
struct Rows<'a> {
    y: &'a Taps,
    z: &'a Taps,
    /// By tap along z, then along y.
    plane: [[&'a [f32]; 3]; 3],
    along_y: [&'a [f32]; 3],
    along_z: [&'a [f32]; 3],
    center: &'a [f32],
}

impl<'a> Rows<'a> {
    #[inline(always)]
    fn new(y: &'a Taps, z: &'a Taps, row: impl Fn(usize, usize) -> &'a [f32]) -> Self {
        let at = |c: usize, b: usize| row(z.index[c], y.index[b]);
        let plane = [[at(0, 0), at(0, 1), at(0, 2)], [at(1, 0), at(1, 1), at(1, 2)], [at(2, 0), at(2, 1), at(2, 2)]];
        let along_z = [plane[0][y.center], plane[1][y.center], plane[2][y.center]];
        Self { y, z, plane, along_y: plane[z.center], along_z, center: along_z[z.center] }
    }

    /// Some samples of every row.
    #[inline(always)]
    fn part(&self, samples: &Range<usize>) -> Self {
        let [low, middle, high] = self.plane;
        Self {
            plane: [part(low, samples), part(middle, samples), part(high, samples)],
            along_y: part(self.along_y, samples),
            along_z: part(self.along_z, samples),
            center: &self.center[samples.clone()],
            ..*self
        }
    }

    /// `CENTRAL` promises that both taps are: what has no weight is left out then.
    #[inline(always)]
    fn differentiate<const CENTRAL: bool>(
        &self,
        axis: &AxisStencil,
        operator: EdgeOperator,
        first: &mut FirstDerivatives,
        row_g: &mut [f32],
        row_f2: &mut [f32],
    ) {
        let len = row_g.len();
        differences::<CENTRAL>(self.y.first, self.along_y, &mut first.y[..len]);
        differences::<CENTRAL>(self.z.first, self.along_z, &mut first.z[..len]);
        for x in [0, len - 1] {
            let taps = axis.taps(x);
            let [a, b, c] = taps.index;
            let lines = [self.center, &first.y, &first.z];
            let samples = [0, 1, 2].map(|line: usize| [lines[line][a], lines[line][b], lines[line][c]]);
            (row_g[x], row_f2[x]) = operator.apply(self.partials::<CENTRAL, false>(x, &taps, samples));
        }
        if len < 3 {
            return;
        }
        let taps = axis.taps(1);
        for part in windows(len - 2) {
            let start = part.start + 1;
            if part.len() == WINDOW {
                self.differentiate_inside::<CENTRAL>(start..start + WINDOW, &taps, operator, first, row_g, row_f2);
            } else {
                self.differentiate_inside::<CENTRAL>(start..part.end + 1, &taps, operator, first, row_g, row_f2);
            }
        }
    }

    /// Samples that have a neighbour on both sides.
    #[inline(always)]
    fn differentiate_inside<const CENTRAL: bool>(
        &self,
        inside: Range<usize>,
        taps: &Taps,
        operator: EdgeOperator,
        first: &FirstDerivatives,
        row_g: &mut [f32],
        row_f2: &mut [f32],
    ) {
        let rows = self.part(&inside);
        let [value, y, z] = [shifted(self.center, &inside), shifted(&first.y, &inside), shifted(&first.z, &inside)];
        let (row_g, row_f2) = (&mut row_g[inside.clone()], &mut row_f2[inside.clone()]);
        for x in 0..inside.len() {
            let samples =
                [[value[0][x], value[1][x], value[2][x]], [y[0][x], y[1][x], y[2][x]], [z[0][x], z[1][x], z[2][x]]];
            (row_g[x], row_f2[x]) = operator.apply(rows.partials::<CENTRAL, true>(x, taps, samples));
        }
    }

    /// The partial derivatives at sample `x`; `samples` are the taps' values and first derivatives along y and z.
    #[inline(always)]
    fn partials<const CENTRAL: bool, const CENTRAL_X: bool>(
        &self,
        x: usize,
        taps: &Taps,
        [value, y, z]: [[f32; 3]; 3],
    ) -> [f32; 9] {
        let center = if CENTRAL_X { 1 } else { taps.center };
        let [low, middle, high] = self.plane;
        let along_y = |rows: [&[f32]; 3]| difference::<CENTRAL>(self.y.first, [rows[0][x], rows[1][x], rows[2][x]]);
        let yz = [along_y(low), if CENTRAL { 0.0 } else { along_y(middle) }, along_y(high)];
        [
            difference::<CENTRAL_X>(taps.first, value),
            y[center],
            z[center],
            weighted_sum(taps.second, value),
            weighted_sum(self.y.second, [self.along_y[0][x], self.along_y[1][x], self.along_y[2][x]]),
            weighted_sum(self.z.second, [self.along_z[0][x], self.along_z[1][x], self.along_z[2][x]]),
            difference::<CENTRAL_X>(taps.first, y),
            difference::<CENTRAL_X>(taps.first, z),
            difference::<CENTRAL>(self.z.first, yz),
        ]
    }
}

#[inline(always)]
fn part<'a>([a, b, c]: [&'a [f32]; 3], samples: &Range<usize>) -> [&'a [f32]; 3] {
    [&a[samples.clone()], &b[samples.clone()], &c[samples.clone()]]
}

/// Some samples of a line, with those below and above them.
#[inline(always)]
fn shifted<'a>(line: &'a [f32], samples: &Range<usize>) -> [&'a [f32]; 3] {
    let Range { start, end } = *samples;
    [&line[start - 1..end - 1], &line[start..end], &line[start + 1..end + 1]]
}

#[inline(always)]
fn differences<const CENTRAL: bool>(weights: [f32; 3], [a, b, c]: [&[f32]; 3], out: &mut [f32]) {
    let len = out.len();
    let (a, b, c) = (&a[..len], &b[..len], &c[..len]);
    for x in 0..len {
        out[x] = difference::<CENTRAL>(weights, [a[x], b[x], c[x]]);
    }
}

/// [`weighted_sum`], where `CENTRAL` promises that the middle sample has no weight.
#[inline(always)]
fn difference<const CENTRAL: bool>(weights: [f32; 3], samples: [f32; 3]) -> f32 {
    if CENTRAL { weights[0] * samples[0] + weights[2] * samples[2] } else { weighted_sum(weights, samples) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use voxrole_pack::{GridGeometry, Scalars};

    use super::*;
    use crate::Grid;
    use crate::working_field::Field;

    fn field(dims: [u32; 3], spacing: [f64; 3], values: Vec<f32>) -> WorkingField {
        let geometry = GridGeometry::axis_aligned(dims, spacing);
        WorkingField::new(&Grid::new("test", geometry, Scalars::F32(values)).expect("a grid")).expect("a field")
    }

    fn sampled(dims: [u32; 3], spacing: [f64; 3], function: impl Fn(f64, f64, f64) -> f64) -> WorkingField {
        let mut values = Vec::new();
        for k in 0..dims[2] {
            for j in 0..dims[1] {
                for i in 0..dims[0] {
                    let [x, y, z] = [(i, 0), (j, 1), (k, 2)].map(|(index, axis)| f64::from(index) * spacing[axis]);
                    values.push(function(x, y, z) as f32);
                }
            }
        }
        field(dims, spacing, values)
    }

    /// The naive twin: every partial derivative as a tensor product of one-dimensional stencils, voxel by voxel.
    fn naive(field: &WorkingField) -> Vec<(f32, f32)> {
        let [nx, ny, nz] = field.dims();
        let stencils = Stencils::new(field);
        let source = voxels(&field.values);
        let mut out = Vec::new();
        for k in 0..nz {
            for j in 0..ny {
                for i in 0..nx {
                    let taps = [(0, i), (1, j), (2, k)].map(|(axis, index)| stencils.axes[axis].taps(index));
                    let one = |taps: &Taps| std::array::from_fn(|tap| if tap == taps.center { 1.0 } else { 0.0 });
                    let at = |a: usize, b: usize, c: usize| {
                        source[(taps[2].index[c] * ny + taps[1].index[b]) * nx + taps[0].index[a]]
                    };
                    let product = |x: [f32; 3], y: [f32; 3], z: [f32; 3]| {
                        weighted_sum(
                            x,
                            std::array::from_fn(|a| {
                                weighted_sum(
                                    z,
                                    std::array::from_fn(|c| weighted_sum(y, std::array::from_fn(|b| at(a, b, c)))),
                                )
                            }),
                        )
                    };
                    let [x, y, z] = &taps;
                    let (ix, iy, iz) = (one(x), one(y), one(z));
                    out.push(EdgeOperator::SecondDerivative.apply([
                        product(x.first, iy, iz),
                        product(ix, y.first, iz),
                        product(ix, iy, z.first),
                        product(x.second, iy, iz),
                        product(ix, y.second, iz),
                        product(ix, iy, z.second),
                        product(x.first, y.first, iz),
                        product(x.first, iy, z.first),
                        product(ix, y.first, z.first),
                    ]));
                }
            }
        }
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn equals_its_naive_twin(
            short in prop::array::uniform3(1_u32..8),
            long in prop::option::of(1_u32..200),
            seed in any::<u32>(),
        ) {
            let dims = [long.unwrap_or(short[0]), short[1], short[2]];
            let count = dims.iter().product::<u32>();
            let values = (0..count).map(|i| (i.wrapping_mul(2_654_435_761) ^ seed) as f32 / 1e9).collect();
            let field = field(dims, [1.0, 1.5, 2.25], values);
            let fast = derivatives(&field, EdgeOperator::SecondDerivative);
            let pairs = voxels(&fast.gradient_magnitude).iter().zip(voxels(&fast.second_derivative));
            for (found, expected) in pairs.zip(naive(&field)) {
                prop_assert_eq!((*found.0, *found.1), expected);
            }
        }
    }

    #[test]
    fn exact_on_ramps_up_to_the_last_voxel() {
        let field = sampled([5, 6, 7], [1.0, 2.0, 4.0], |x, y, z| 2.0 * x + y - 0.5 * z);
        let expected = (2.0_f64 * 2.0 + 1.0 + 0.25).sqrt() / field.gradient_scale();
        let found = derivatives(&field, EdgeOperator::SecondDerivative);
        for (&g, &f2) in voxels(&found.gradient_magnitude).iter().zip(voxels(&found.second_derivative)) {
            assert!((f64::from(g) / expected - 1.0).abs() < 1e-6);
            assert!(f2.abs() < 1e-6);
        }
    }

    #[test]
    fn one_bad_voxel_masks_its_stencil_and_nothing_else() {
        let mut values: Vec<f32> = (0..7 * 7 * 7).map(|i| (i % 11) as f32).collect();
        values[(3 * 7 + 3) * 7 + 3] = f32::INFINITY;
        let found = derivatives(&field([7; 3], [1.0; 3], values), EdgeOperator::SecondDerivative);
        let masked = |field: &Field| voxels(field).iter().filter(|value| value.is_nan()).count();
        assert_eq!(masked(&found.gradient_magnitude), 19);
        assert_eq!(masked(&found.second_derivative), 19);
    }

    #[test]
    fn a_constant_volume_has_no_derivatives() {
        let found = derivatives(&field([3, 1, 4], [1.0; 3], vec![0.3; 12]), EdgeOperator::SecondDerivative);
        assert!(voxels(&found.gradient_magnitude).iter().chain(voxels(&found.second_derivative)).all(|&v| v == 0.0));
    }
}
