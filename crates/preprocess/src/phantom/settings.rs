//! How to make a phantom.

use glam::DVec3;
use voxrole_pack::{GridGeometry, ScalarType};

use super::{NoiseKind, Quantization, rotation};
use crate::{Error, Result};

/// How to make a phantom.
#[derive(Clone, Debug, PartialEq)]
pub struct PhantomSettings {
    /// Number of voxels along x, y, z.
    pub dims: [u32; 3],
    /// Distance between voxels along x, y, z, in world units.
    pub spacing: [f64; 3],
    /// Standard deviation of the blur in multiples of the smallest spacing; positive. The Marschner-Lobb signal has none.
    pub blur: f64,
    /// Thickness of each slab of the slab pair in multiples of the smallest spacing; positive, of use from 1.5 to 10.
    pub thickness: f64,
    /// Rotation of the grid against the scene about the world's x, then y, then z axis, in degrees, right-handed; about
    /// the middle of the volume, which stays where it is.
    pub rotation: [f64; 3],
    /// Shift of the scene along the world's axes, in multiples of the smallest spacing.
    pub offset: [f64; 3],
    /// Standard deviation of the noise as a share of the phantom's largest step; not negative.
    pub noise: f64,
    /// What that noise does to a value.
    pub noise_kind: NoiseKind,
    /// Seed of the noise.
    pub seed: u64,
    /// Type of the stored numbers.
    pub scalar_type: ScalarType,
    /// What a float type's values, noise included, are multiplied by; not 0, negative to turn high into low.
    pub value_scale: f64,
    /// What is added to a float type's values after that.
    pub value_offset: f64,
    /// Which integers stand for which values, or `None` for [`Quantization::of`] the type.
    pub quantization: Option<Quantization>,
}

impl Default for PhantomSettings {
    fn default() -> Self {
        Self {
            dims: [64; 3],
            spacing: [1.0; 3],
            blur: 1.5,
            thickness: 4.0,
            rotation: [0.0; 3],
            offset: [0.0; 3],
            noise: 0.0,
            noise_kind: NoiseKind::Gaussian,
            seed: 0,
            scalar_type: ScalarType::F32,
            value_scale: 1.0,
            value_offset: 0.0,
            quantization: None,
        }
    }
}

impl PhantomSettings {
    /// The grid: its middle where that of an axis-aligned grid at the world's origin is, its axes turned by the rotation.
    #[must_use]
    pub fn geometry(&self) -> GridGeometry {
        let axis_aligned = GridGeometry::axis_aligned(self.dims, self.spacing);
        if self.rotation == [0.0; 3] {
            return axis_aligned;
        }
        let world_from_axes = rotation::from_degrees(self.rotation);
        let middle = self.middle();
        GridGeometry {
            origin: (middle - world_from_axes * middle).to_array(),
            direction: world_from_axes.to_cols_array_2d(),
            ..axis_aligned
        }
    }

    /// The middle of the volume in the world.
    pub(super) fn middle(&self) -> DVec3 {
        0.5 * (self.extent() - DVec3::from_array(self.spacing))
    }

    /// Voxels times spacing.
    pub(super) fn extent(&self) -> DVec3 {
        DVec3::from_array(self.dims.map(f64::from)) * DVec3::from_array(self.spacing)
    }

    /// Checks that a phantom can be made.
    ///
    /// # Errors
    /// [`Error::Pack`] for an unusable grid; [`Error::Parameter`] for a blur or thickness that is not positive, a noise
    /// that is negative, a rotation or offset that is not finite, and values that the type cannot hold.
    pub fn validate(&self) -> Result<()> {
        let fail = |message: String| Err(Error::Parameter(message));
        if self.rotation.iter().any(|angle| !(angle.is_finite() && angle.abs() <= 1e6)) {
            return fail(format!("a rotation of {:?}: give three angles in degrees", self.rotation));
        }
        self.geometry().validate()?;
        if self.offset.iter().any(|shift| !(shift.is_finite() && shift.abs() <= 1e6)) {
            return fail(format!("an offset of {:?}: give three shifts in voxels, none above a million", self.offset));
        }
        if !(self.blur.is_finite() && self.blur > 0.0) {
            return fail(format!("a blur of {} voxels: give a positive one, for a sharp edge 0.01", self.blur));
        }
        if !(self.thickness.is_finite() && self.thickness > 0.0) {
            return fail(format!("a thickness of {} voxels: give a positive one, such as 4", self.thickness));
        }
        if !(self.noise.is_finite() && self.noise >= 0.0) {
            return fail(format!("a noise of {}: give a share of the step, 0 for none", self.noise));
        }
        if let Some(quantization) = self.quantization {
            quantization.validate(self.scalar_type)?;
        }
        self.validate_value_mapping()
    }

    fn validate_value_mapping(&self) -> Result<()> {
        let fail = |message: String| Err(Error::Parameter(message));
        let Self { value_scale: scale, value_offset: offset, scalar_type, .. } = *self;
        if !(scale.is_finite() && scale != 0.0 && offset.is_finite()) {
            return fail(format!("a value scale of {scale} and offset of {offset}: give finite ones, the scale not 0"));
        }
        let (name, least, most) = match scalar_type {
            ScalarType::F32 => ("f32", f64::from(f32::MIN_POSITIVE), f64::from(f32::MAX)),
            ScalarType::F64 => ("f64", f64::MIN_POSITIVE, f64::MAX),
            _ if scale == 1.0 && offset == 0.0 => return Ok(()),
            _ => {
                return fail(format!(
                    "a value scale or offset is for f32 and f64; {} has its own range of stored numbers",
                    scalar_type.name()
                ));
            }
        };
        // Plateaus lie between 0 and 1; noise and what the derivatives multiply the step by get room on top.
        if !(scale.abs() >= 1e6 * least && scale.abs() <= 1e-6 * most && offset.abs() <= 1e-6 * most) {
            return fail(format!("a value scale of {scale} and offset of {offset} leave the range of {name}"));
        }
        Ok(())
    }
}
