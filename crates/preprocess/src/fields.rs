//! Layers of a packed file in physical units, as `export` and `slice` give them.

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use voxrole_pack::quantization::decode_normal;
use voxrole_pack::{DistanceQuantization, LayerKind, Reader, with_scalars};

use crate::Result;

/// A scalar quantity per voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Field {
    /// The physical value.
    Value,
    /// Signed distance to the boundary in world units, positive on the high-value side; NaN without a boundary.
    Distance,
    /// Gradient magnitude at the hit; NaN without a boundary.
    HitGradient,
    /// What the voxel is to its boundary: see [`RoleCode`].
    Role,
    /// Gradient magnitude at the voxel.
    GradientMagnitude,
    /// Second derivative along the gradient at the voxel.
    SecondDerivative,
}

/// The numbers of [`Field::Role`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RoleCode {
    /// A sample of the voxel's stencil is NaN or infinite.
    Masked = -1,
    /// No boundary within `d_max`.
    None = 0,
    /// On the boundary: at most half of L_min away.
    Boundary = 1,
    /// Farther, on the high-value side.
    HighSide = 2,
    /// Farther, on the low-value side.
    LowSide = 3,
}

/// Reads a quantity of every voxel, x fastest, as f32.
///
/// Distances err by at most [`DistanceQuantization::error_bound`], magnitudes at the hit by at most
/// [`voxrole_pack::HitGradientQuantization::error_bound`]; the other quantities are as exact as f32.
///
/// # Errors
/// [`crate::Error::Pack`] when the file is damaged or has no such layer, or memory runs out.
pub fn read_field(reader: &Reader, field: Field) -> Result<Vec<f32>> {
    Ok(match field {
        Field::Value => {
            use voxrole_pack::scalar::Scalar;
            let (scalars, slope, intercept) = reader.read_value()?;
            with_scalars!(&scalars, values => {
                values.par_iter().map(|&value| slope.mul_add(value.to_f64(), intercept) as f32).collect()
            })
        }
        Field::Distance => {
            let quantization = reader.distance_quantization()?;
            let stored = reader.read_distance(0)?;
            stored.into_par_iter().map(|stored| quantization.decode(stored).unwrap_or(f32::NAN)).collect()
        }
        Field::HitGradient => {
            let quantization = reader.hit_gradient_quantization()?;
            let stored = reader.read_hit_gradient(0)?;
            stored.into_par_iter().map(|stored| quantization.decode(stored).unwrap_or(f32::NAN)).collect()
        }
        Field::Role => {
            let quantization = reader.distance_quantization()?;
            let half = 0.5 * reader.header().geometry.smallest_spacing() as f32;
            let stored = reader.read_distance(0)?;
            stored.into_par_iter().map(|stored| role_code(&quantization, stored, half) as i8).map(f32::from).collect()
        }
        Field::GradientMagnitude => reader.read_layer(LayerKind::GradientMagnitude)?,
        Field::SecondDerivative => reader.read_layer(LayerKind::SecondDerivative)?,
    })
}

fn role_code(quantization: &DistanceQuantization, stored: i16, half: f32) -> RoleCode {
    match quantization.decode(stored) {
        None if stored == DistanceQuantization::MASKED => RoleCode::Masked,
        None => RoleCode::None,
        Some(distance) if distance.abs() <= half => RoleCode::Boundary,
        Some(distance) if distance > 0.0 => RoleCode::HighSide,
        Some(_) => RoleCode::LowSide,
    }
}

/// Reads the unit gradient direction of every voxel with a boundary, along the world's axes; NaN without one. Errs by at
/// most [`voxrole_pack::quantization::NORMAL_ERROR_BOUND`].
///
/// # Errors
/// As [`read_field`].
pub fn read_normals(reader: &Reader) -> Result<Vec<[f32; 3]>> {
    let world_from_axes = reader.header().geometry.world_from_axes();
    let stored = reader.read_layer::<u16>(LayerKind::Normal)?;
    let in_world = |normal: Vec3| (world_from_axes * DVec3::from(normal)).as_vec3();
    Ok(stored
        .into_par_iter()
        .map(|stored| decode_normal(stored).map_or([f32::NAN; 3], |normal| in_world(normal).to_array()))
        .collect())
}
