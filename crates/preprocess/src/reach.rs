//! How far a voxel's role depends on the volume around it.

use crate::bilateral;
use crate::bspline::Degree;
use crate::differentiation::Kernel;
use crate::gaussian::radius_of;
use crate::holes::LAYERS;
use crate::padded_field::PADDING;
use crate::reconstruction::Reconstruction;
use crate::settings::{Settings, Smoothing};

/// Voxels along each axis beyond which nothing changes a voxel's role; `spacing` in multiples of L_min. `has_bad` says
/// that the volume has voxels that are NaN or infinite, which are filled before a filter that would spread them.
#[must_use]
pub fn reach(settings: &Settings, spacing: [f32; 3], has_bad: bool) -> [usize; 3] {
    let filling = if has_bad { LAYERS + 1 } else { 0 };
    let spline = |degree: Degree| filling + degree.reach() + PADDING;
    let smoothing = match settings.smoothing.placement {
        Smoothing::None => 0,
        Smoothing::GaussianValue => filling + settings.smoothing.radius,
        Smoothing::BilateralValue | Smoothing::BilateralDerivatives => 0,
    };
    let is_bilateral =
        matches!(settings.smoothing.placement, Smoothing::BilateralValue | Smoothing::BilateralDerivatives);
    let bilateral = if is_bilateral { bilateral::reach(settings.smoothing.radius) } else { [0; 3] };
    let kernel = match settings.kernel {
        Kernel::Gaussian(sigma) => filling + radius_of(sigma as f32, spacing),
        _ => 0,
    } + settings.kernel.spline().map_or(PADDING, spline);
    // A spline's cell depends on two samples beyond its corners.
    let reconstruction = match settings.reconstruction {
        Reconstruction::Linear => 0,
        Reconstruction::Exact => PADDING + 1,
        Reconstruction::Cubic => spline(Degree::Cubic) + PADDING + 1,
        Reconstruction::Quintic => spline(Degree::Quintic) + PADDING + 1,
    };
    // A crossing is looked for, and an edge's blur is measured, up to L_min behind the end of a ray; a ray ends in a cell.
    std::array::from_fn(|axis| {
        let ray = ((settings.d_max + 1.0) / f64::from(spacing[axis])).ceil() as usize + 1;
        ray + reconstruction + kernel + smoothing + bilateral[axis]
    })
}
