//! The kernels that differentiate the value field, by name.

use std::fmt;
use std::str::FromStr;

use glam::Vec3;

use crate::bspline::{Coefficients, Degree, Evaluator};
use crate::central_difference::derivatives_into;
use crate::directional_derivative::{Derivatives, EdgeOperator, Stencils};
use crate::gaussian::{gaussian, radius_of};
use crate::holes::Holes;
use crate::padded_field::{PADDING, PaddedField};
use crate::separable_derivative::{SeparableKernel, separable_derivatives_into};
use crate::working_field::{Field, WorkingField, voxels};
use crate::{Error, Result};

/// How the value field is differentiated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Kernel {
    /// Central differences of second order, eq. (1) of the paper.
    #[default]
    Central2,
    /// Central differences of fourth order.
    Central4,
    /// The interpolating cubic B-spline.
    CubicSpline,
    /// The interpolating quintic B-spline.
    QuinticSpline,
    /// The derivative of a Gaussian of this σ in multiples of L_min: the field convolved with it, then differentiated as a
    /// quintic spline, which on a field that smooth is exact to rounding.
    Gaussian(f64),
}

impl Kernel {
    /// The spline that the kernel is the derivative of, if it is one.
    #[must_use]
    pub const fn spline(self) -> Option<Degree> {
        match self {
            Self::Central2 | Self::Central4 => None,
            Self::CubicSpline => Some(Degree::Cubic),
            Self::QuinticSpline | Self::Gaussian(_) => Some(Degree::Quintic),
        }
    }

    /// σ of the Gaussian that is part of the kernel, if there is one, in multiples of L_min.
    #[must_use]
    pub const fn sigma(self) -> Option<f32> {
        if let Self::Gaussian(sigma) = self { Some(sigma as f32) } else { None }
    }
}

impl fmt::Display for Kernel {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Central2 => formatter.write_str("central2"),
            Self::Central4 => formatter.write_str("central4"),
            Self::CubicSpline => formatter.write_str("bspline3"),
            Self::QuinticSpline => formatter.write_str("bspline5"),
            Self::Gaussian(sigma) => write!(formatter, "gaussian:{sigma}"),
        }
    }
}

impl FromStr for Kernel {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "central2" => Ok(Self::Central2),
            "central4" => Ok(Self::Central4),
            "bspline3" => Ok(Self::CubicSpline),
            "bspline5" => Ok(Self::QuinticSpline),
            _ => text.strip_prefix("gaussian:").and_then(|sigma| sigma.parse().ok()).map(Self::Gaussian).ok_or_else(|| {
                Error::Parameter(format!(
                    "`{text}` is none of central2, central4, bspline3, bspline5, gaussian:SIGMA (such as gaussian:1.5)"
                ))
            }),
        }
    }
}

/// What gives the gradient of a differentiated field at its voxels.
#[derive(Debug)]
pub enum GradientSource {
    /// Differences of the values themselves.
    Central2,
    /// Differences of the values with their continuation.
    Central4(PaddedField),
    /// A spline through the values.
    Spline(Coefficients),
}

impl GradientSource {
    /// Its memory, for [`differentiate_into`].
    #[must_use]
    pub fn into_memory(self) -> Vec<f32> {
        match self {
            Self::Central2 => Vec::new(),
            Self::Central4(field) => field.into_memory(),
            Self::Spline(coefficients) => coefficients.field.into_memory(),
        }
    }
}

/// Differentiates a field. A [`Kernel::Gaussian`] smooths it first.
///
/// Voxels from which the kernel reaches a NaN are NaN in both results. A spline reaches every voxel, with weights that
/// decay by 0.27 (cubic) or 0.43 (quintic) a voxel; it is fitted to holes filled from their rims ([`Holes`]), and voxels
/// within one or two of a hole are masked.
///
/// # Errors
/// [`Error::Pack`] when memory runs out.
pub fn differentiate(
    field: &mut WorkingField,
    kernel: Kernel,
    operator: EdgeOperator,
) -> Result<(Derivatives, GradientSource)> {
    let mut derivatives = Derivatives::zeros(field.dims());
    let source = differentiate_into(field, kernel, operator, &mut derivatives, Vec::new())?;
    Ok((derivatives, source))
}

/// As [`differentiate`], into fields that exist already; what gives the gradient is made in `memory`, if that is enough.
///
/// # Errors
/// As [`differentiate`].
///
/// # Panics
/// When `derivatives` are not of the field's dimensions.
pub fn differentiate_into(
    field: &mut WorkingField,
    kernel: Kernel,
    operator: EdgeOperator,
    derivatives: &mut Derivatives,
    memory: Vec<f32>,
) -> Result<GradientSource> {
    if let Kernel::Gaussian(sigma) = kernel {
        let radius = radius_of(sigma as f32, field.spacing);
        field.values = gaussian(&field.values, field.spacing, sigma as f32, radius);
    }
    Ok(match kernel.spline() {
        None if kernel == Kernel::Central2 => {
            derivatives_into(field, operator, derivatives);
            GradientSource::Central2
        }
        None => {
            let padded = PaddedField::new_in(memory, &field.values)?;
            separable_derivatives_into(&padded, field.spacing, &SeparableKernel::CENTRAL_4, operator, derivatives);
            GradientSource::Central4(padded)
        }
        Some(degree) => {
            let (values, holes) = Holes::filled(&field.values);
            let coefficients = Coefficients::new_in(memory, &values, degree)?;
            let kernel = SeparableKernel::spline(degree);
            separable_derivatives_into(&coefficients.field, field.spacing, &kernel, operator, derivatives);
            let radius = if degree == Degree::Cubic { 1 } else { PADDING };
            holes.mask(&mut derivatives.gradient_magnitude, radius);
            holes.mask(&mut derivatives.second_derivative, radius);
            GradientSource::Spline(coefficients)
        }
    })
}

/// The spline through a derived field that may have holes.
///
/// # Errors
/// [`Error::Pack`] when memory runs out.
pub fn spline_through(field: &Field, degree: Degree) -> Result<Coefficients> {
    Coefficients::new(&Holes::filled(field).0, degree)
}

/// The gradient at voxels.
#[derive(Clone, Copy)]
pub enum Gradient<'a> {
    /// See [`GradientSource::Central2`].
    Central2 {
        /// The field's values.
        values: &'a [f32],
        /// Its stencils.
        stencils: Stencils,
    },
    /// See [`GradientSource::Central4`].
    Central4 {
        /// The continued field.
        field: &'a PaddedField,
        /// Voxels per L_min along each axis.
        per_length: Vec3,
    },
    /// See [`GradientSource::Spline`].
    Spline(Evaluator<'a>),
}

impl<'a> Gradient<'a> {
    /// The gradients of `field` that `source` knows.
    #[must_use]
    pub fn new(field: &'a WorkingField, source: &'a GradientSource) -> Self {
        match source {
            GradientSource::Central2 => {
                Self::Central2 { values: voxels(&field.values), stencils: Stencils::new(field) }
            }
            GradientSource::Central4(padded) => {
                Self::Central4 { field: padded, per_length: Vec3::from_array(field.spacing.map(f32::recip)) }
            }
            GradientSource::Spline(coefficients) => Self::Spline(Evaluator::new(coefficients, field.spacing)),
        }
    }

    /// ∇f at a voxel, per L_min.
    #[inline(always)]
    #[must_use]
    pub fn at(&self, voxel: [usize; 3]) -> Vec3 {
        match self {
            Self::Central2 { values, stencils } => stencils.gradient(values, voxel),
            Self::Central4 { field, per_length } => {
                let [row, slice] = field.strides();
                let center = voxel.map(|index| index + PADDING);
                let center = center[2] * slice + center[1] * row + center[0];
                let [_, next, after] = SeparableKernel::CENTRAL_4.first;
                let along = |stride: usize| {
                    let rise = |steps: usize| {
                        field.values()[center + steps * stride] - field.values()[center - steps * stride]
                    };
                    next * rise(1) + after * rise(2)
                };
                Vec3::new(along(1), along(row), along(slice)) * *per_length
            }
            Self::Spline(evaluator) => evaluator.gradient_at_sample(voxel),
        }
    }
}

#[cfg(test)]
mod tests {
    use voxrole_pack::{GridGeometry, Scalars};

    use super::*;
    use crate::Grid;

    const KERNELS: [Kernel; 5] =
        [Kernel::Central2, Kernel::Central4, Kernel::CubicSpline, Kernel::QuinticSpline, Kernel::Gaussian(1.25)];

    fn sampled(dims: [u32; 3], spacing: [f64; 3], function: impl Fn([f64; 3]) -> f64) -> WorkingField {
        let mut values = Vec::new();
        for k in 0..dims[2] {
            for j in 0..dims[1] {
                for i in 0..dims[0] {
                    let place = [(i, 0), (j, 1), (k, 2)].map(|(index, axis)| f64::from(index) * spacing[axis]);
                    values.push(function(place));
                }
            }
        }
        let geometry = GridGeometry::axis_aligned(dims, spacing);
        WorkingField::new(&Grid::new("test", geometry, Scalars::F64(values)).expect("a grid")).expect("a field")
    }

    #[test]
    fn what_memory_held_before_changes_nothing() {
        for (dims, kernel) in [[9, 7, 8], [9, 1, 8], [2, 5, 1]].into_iter().flat_map(|dims| KERNELS.map(|k| (dims, k)))
        {
            let field = sampled(dims, [1.0, 1.5, 1.0], |[x, y, z]| (x + 0.3 * y * z).sin());
            let (expected, source) = differentiate(&mut field.clone(), kernel, EdgeOperator::Plus).expect("fits");
            let memory = || vec![f32::NAN; 4000];
            let mut found = Derivatives::unset([memory(), memory()], field.dims());
            let again =
                differentiate_into(&mut field.clone(), kernel, EdgeOperator::Plus, &mut found, memory()).expect("fits");
            assert_eq!(found.into_memory(), expected.into_memory(), "{kernel} {dims:?}");
            assert_eq!(again.into_memory(), source.into_memory(), "{kernel} {dims:?}");
        }
    }

    #[test]
    fn names_are_read_as_written() {
        for kernel in KERNELS {
            assert_eq!(kernel.to_string().parse::<Kernel>().expect("its own name"), kernel);
        }
        for wrong in ["", "central3", "gaussian", "gaussian:x", "bspline"] {
            assert!(wrong.parse::<Kernel>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn every_kernel_is_exact_on_ramps_up_to_the_last_voxel() {
        for kernel in KERNELS {
            let mut field = sampled([12, 9, 10], [1.0, 2.0, 1.5], |[x, y, z]| 2.0 * x + y - 0.5 * z);
            let expected = Vec3::new(2.0, 1.0, -0.5) / field.gradient_scale() as f32;
            let (derivatives, source) =
                differentiate(&mut field, kernel, EdgeOperator::SecondDerivative).expect("fits");
            let gradient = Gradient::new(&field, &source);
            for ((k, j, i), &g) in derivatives.gradient_magnitude.indexed_iter() {
                assert!((g / expected.length() - 1.0).abs() < 2e-5, "{kernel} at {i} {j} {k}: {g}");
                let found = gradient.at([i, j, k]);
                assert!((found - expected).length() < 2e-5 * expected.length(), "{kernel} at {i} {j} {k}: {found}");
                assert!(derivatives.second_derivative[[k, j, i]].abs() < 3e-6, "{kernel}");
            }
        }
    }

    #[test]
    fn gradients_have_the_magnitude_of_the_field() {
        for kernel in KERNELS {
            let mut field = sampled([9, 8, 7], [1.0, 1.5, 2.0], |[x, y, z]| (x - 0.3 * y).sin() * (0.7 * z).cos());
            let (derivatives, source) =
                differentiate(&mut field, kernel, EdgeOperator::SecondDerivative).expect("fits");
            let gradient = Gradient::new(&field, &source);
            for ((k, j, i), &g) in derivatives.gradient_magnitude.indexed_iter() {
                assert!((gradient.at([i, j, k]).length() - g).abs() < 2e-6, "{kernel} at {i} {j} {k}");
            }
        }
    }

    /// Root mean square errors of gradient and f'' at the places that a grid of spacing `h` and its refinements share.
    fn errors(kernel: Kernel, h: f64, refinement: u32) -> [f64; 2] {
        // Far enough from the faces for what their continuation changes to have decayed.
        let (spacing, inner) = (h / f64::from(refinement), 20 * refinement);
        let dims = [40 * refinement + 1; 3];
        let mut field = sampled(dims, [spacing; 3], |[x, y, z]| (x + 0.3 * y).sin() * (0.7 * z).cos());
        let (derivatives, source) = differentiate(&mut field, kernel, EdgeOperator::SecondDerivative).expect("fits");
        let gradient = Gradient::new(&field, &source);
        let mut squares = [0.0_f64; 2];
        let offsets = (0..125).map(|place| [place % 5, place / 5 % 5, place / 25].map(|steps| steps * refinement));
        for offset in offsets {
            let place = offset.map(|offset| (inner - 2 * refinement + offset) as usize);
            let [x, y, z] = place.map(|index| index as f64 * spacing);
            let (phase, depth) = (x + 0.3 * y, 0.7 * z);
            let (across, along) = (phase.cos() * depth.cos(), -0.7 * phase.sin() * depth.sin());
            let exact = glam::DVec3::new(across, 0.3 * across, along);
            let (curved, mixed) = (-phase.sin() * depth.cos(), -0.7 * phase.cos() * depth.sin());
            let hessian = glam::DMat3::from_cols_array_2d(&[
                [curved, 0.3 * curved, mixed],
                [0.3 * curved, 0.09 * curved, 0.3 * mixed],
                [mixed, 0.3 * mixed, 0.49 * curved],
            ]);
            let normal = exact.normalize();
            let found = gradient.at(place).as_dvec3() * field.gradient_scale();
            let [i, j, k] = place;
            let second = f64::from(derivatives.second_derivative[[k, j, i]]) * field.second_derivative_scale();
            squares[0] += (found - exact).length_squared();
            squares[1] += (second - normal.dot(hessian * normal)).powi(2);
        }
        squares.map(|sum| (sum / 125.0).sqrt())
    }

    #[test]
    fn errors_fall_with_the_spacing_as_theory_says() {
        // Differences: their Taylor series (Abramowitz and Stegun, 25.3). Splines of odd degree n: O(h^(n+1)) for the first
        // derivative at the knots, where it gains an order, and O(h^(n−1)) for the second (Swartz and Varga, *Error bounds
        // for spline and L-spline interpolation*, J. Approximation Theory 6, 1972). A Gaussian of a fixed width in voxels
        // changes the function by σ²h²/2 times its second derivative.
        for (kernel, h, expected) in [
            (Kernel::Central2, 0.4, [2.0, 2.0]),
            (Kernel::Central4, 0.8, [4.0, 4.0]),
            (Kernel::CubicSpline, 0.8, [4.0, 2.0]),
            (Kernel::QuinticSpline, 1.0, [6.0, 4.0]),
            (Kernel::Gaussian(1.0), 0.3, [2.0, 2.0]),
        ] {
            let [coarse, fine] = [1, 2].map(|refinement| errors(kernel, h, refinement));
            for quantity in 0..2 {
                let order = (coarse[quantity] / fine[quantity]).log2();
                eprintln!("{kernel}: order {order:.2} from {:e}, {:e}", coarse[quantity], fine[quantity]);
                // The quintic spline's next term still counts where the first is above the rounding of f32.
                let more = if kernel == Kernel::QuinticSpline { 0.5 } else { 0.3 };
                assert!(
                    (-0.3..more).contains(&(order - expected[quantity])),
                    "{kernel}: order {order} of {:?}",
                    expected[quantity]
                );
            }
        }
    }

    #[test]
    fn a_bad_voxel_masks_what_its_kernel_reaches() {
        for (kernel, masked) in [
            (Kernel::Central2, 19),
            (Kernel::Central4, 61),
            (Kernel::CubicSpline, 27),
            (Kernel::QuinticSpline, 125),
            (Kernel::Gaussian(1.0), 125),
        ] {
            let mut field = sampled([15, 15, 15], [1.0; 3], |[x, y, z]| {
                if [x, y, z] == [7.0; 3] { f64::INFINITY } else { x.sin() + y.cos() * z }
            });
            let (derivatives, _) = differentiate(&mut field, kernel, EdgeOperator::Plus).expect("fits");
            for found in [&derivatives.gradient_magnitude, &derivatives.second_derivative] {
                assert_eq!(voxels(found).iter().filter(|value| value.is_nan()).count(), masked, "{kernel}");
            }
        }
    }
}
