//! Gradient magnitude and second derivative along the gradient: what they are, and the stencils of central differences.

use fearless_simd::{Simd, prelude::*};
use glam::Vec3;
use ndarray::Array3;
use voxrole_pack::scalar::par_range_within;

use crate::stencil::AxisStencil;
use crate::working_field::{Field, WorkingField, voxels};

/// g = ‖∇f‖ and f'' = nᵀHn at every voxel; NaN where any of the 19 samples of the stencil is.
#[derive(Clone, Debug)]
pub struct Derivatives {
    /// Gradient magnitude, in working units.
    pub gradient_magnitude: Field,
    /// The edge operator: f'' along the gradient, or PLUS, in working units; 0 where the gradient is.
    pub second_derivative: Field,
}

impl Derivatives {
    /// Zeros for a volume of `dims` voxels along x, y, z.
    #[must_use]
    pub fn zeros(dims: [usize; 3]) -> Self {
        Self::unset([Vec::new(), Vec::new()], dims)
    }

    /// Any numbers for a volume of `dims` voxels, in memory that was used before; zeros where there is not enough of it.
    #[must_use]
    pub fn unset(memory: [Vec<f32>; 2], [nx, ny, nz]: [usize; 3]) -> Self {
        let shape = (nz, ny, nx);
        let [gradient_magnitude, second_derivative] = memory.map(|mut memory| {
            if memory.capacity() < nx * ny * nz {
                return Array3::zeros(shape);
            }
            memory.resize(nx * ny * nz, 0.0);
            Array3::from_shape_vec(shape, memory).expect("a number for every voxel")
        });
        Self { gradient_magnitude, second_derivative }
    }

    /// The memory, for [`Self::unset`].
    #[must_use]
    pub fn into_memory(self) -> [Vec<f32>; 2] {
        [self.gradient_magnitude, self.second_derivative].map(|field| field.into_raw_vec_and_offset().0)
    }

    /// Smallest and largest finite gradient magnitude and second derivative; 0 where there is none.
    #[must_use]
    pub fn ranges(&self) -> [[f32; 2]; 2] {
        let range = |field| par_range_within(voxels(field), f32::MIN, f32::MAX).unwrap_or_default();
        [range(&self.gradient_magnitude), range(&self.second_derivative)]
    }
}

/// Second derivatives up to this magnitude are rounding, not data: 32 units in the last place of the largest value over
/// L_min², which is what the differences and splines of this crate make of a ramp rounded to f32.
///
/// Working values are at most 1, so the threshold is relative to the data.
pub const EDGE_FLOOR: f32 = 32.0 / (1 << 24) as f32;

/// What is zero on an edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum EdgeOperator {
    /// f'' = nᵀHn, eq. (2) of the paper. On a blurred edge of curvature radius R it vanishes about σ²/R to the inside of a
    /// ball's true surface.
    #[default]
    SecondDerivative,
    /// PLUS, half of `f'' + ∇²f`, which is f'' on a straight edge. The Laplacian errs to the other side, so that the sum
    /// keeps to the true surface (Verbeek and van Vliet, *On the location error of curved edges in low-pass filtered 2-D
    /// and 3-D images*, IEEE PAMI 16(7), 1994).
    Plus,
}

impl EdgeOperator {
    /// The gradient magnitude and the operator from (fx, fy, fz, fxx, fyy, fzz, fxy, fxz, fyz). NaN in any makes both
    /// NaN; the operator is 0 where the gradient is.
    #[inline(always)]
    #[must_use]
    pub fn apply(self, [x, y, z, xx, yy, zz, xy, xz, yz]: [f32; 9]) -> (f32, f32) {
        let squared = x * x + y * y + z * z;
        let along = (x * x * xx + y * y * yy + z * z * zz) + 2.0 * (x * y * xy + x * z * xz + y * z * yz);
        // Where the gradient is 0 so is `along`, unless a sample is NaN; dividing by 1 keeps both cases apart from 0/0.
        let second = along / if squared > 0.0 { squared } else { 1.0 };
        let edge = match self {
            Self::SecondDerivative => second,
            Self::Plus if squared > 0.0 => 0.5 * (second + (xx + yy + zz)),
            Self::Plus => second,
        };
        // What is no more than rounding has no sign, and so no crossing. NaN stays.
        let edge = if edge.abs() <= EDGE_FLOOR { 0.0 } else { edge };
        // A NaN in the Hessian's samples alone must mask the magnitude too: 0 · NaN is NaN.
        (squared.sqrt() + 0.0 * edge, edge)
    }

    /// [`Self::apply`], lane by lane.
    #[inline(always)]
    pub(crate) fn apply_to_lanes<S: Simd>(
        self,
        simd: S,
        [x, y, z, xx, yy, zz, xy, xz, yz]: [S::f32s; 9],
    ) -> (S::f32s, S::f32s) {
        let (zero, two) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 2.0));
        let squared = x * x + y * y + z * z;
        let along = (x * x * xx + y * y * yy + z * z * zz) + two * (x * y * xy + x * z * xz + y * z * yz);
        // Where nothing changes, as in masked background, there is nothing to divide.
        if (squared.simd_eq(zero) & along.simd_eq(zero)).all_true() {
            return (zero, zero);
        }
        let rises = squared.simd_gt(zero);
        let second = along / rises.select(squared, S::f32s::splat(simd, 1.0));
        let edge = match self {
            Self::SecondDerivative => second,
            Self::Plus => rises.select(S::f32s::splat(simd, 0.5) * (second + (xx + yy + zz)), second),
        };
        let edge = edge.abs().simd_le(S::f32s::splat(simd, EDGE_FLOOR)).select(zero, edge);
        (squared.sqrt() + zero * edge, edge)
    }
}

/// Stencils of the three axes of a field.
#[derive(Clone, Copy, Debug)]
pub struct Stencils {
    /// Along x, y, z.
    pub(crate) axes: [AxisStencil; 3],
    dims: [usize; 3],
}

impl Stencils {
    /// The stencils of a field.
    #[must_use]
    pub fn new(field: &WorkingField) -> Self {
        let dims = field.dims();
        Self { axes: std::array::from_fn(|axis| AxisStencil::new(dims[axis], field.spacing[axis])), dims }
    }

    /// ∇f at voxel (i, j, k), eq. (1) of the paper, with the border rule of [`AxisStencil`].
    #[inline(always)]
    #[must_use]
    pub fn gradient(&self, values: &[f32], [i, j, k]: [usize; 3]) -> Vec3 {
        let [nx, ny, _] = self.dims;
        let at = |i: usize, j: usize, k: usize| values[(k * ny + j) * nx + i];
        let [x, y, z] = &self.axes;
        // Spelled out: std's `map` of arrays would be called for each axis of each voxel.
        let (x, y, z) = (x.taps(i), y.taps(j), z.taps(k));
        Vec3::new(
            x.weights.first([at(x.index[0], j, k), at(x.index[1], j, k), at(x.index[2], j, k)]),
            y.weights.first([at(i, y.index[0], k), at(i, y.index[1], k), at(i, y.index[2], k)]),
            z.weights.first([at(i, j, z.index[0]), at(i, j, z.index[1]), at(i, j, z.index[2])]),
        )
    }
}
