//! A packed file's four rendering layers, voxel by voxel, as the ray marchers read them.

use glam::{DMat3, Mat3};
use rayon::prelude::*;
use voxrole_pack::error::vec_with_capacity;
use voxrole_pack::{
    DistanceQuantization, GridGeometry, HitGradientQuantization, LayerKind, Reader, Scalars, WorldFrame, with_scalars,
};

use crate::Result;

/// What a volume's texels mean.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeDescription {
    /// Number of voxels along x, y, z; none is 0.
    pub dims: [u32; 3],
    /// Distance between neighbouring voxels along each axis, in world units.
    pub spacing: [f64; 3],
    /// The rotation, mirrored or not, from grid axes to world axes.
    pub world_from_axes: DMat3,
    /// Unit of the world's lengths, or empty.
    pub unit: String,
    /// What the world axes mean.
    pub frame: WorldFrame,
    /// Largest distance stored, in world units.
    pub d_max: f32,
    /// Physical values of the stored 0 and 65535.
    pub value_range: [f64; 2],
    /// How gradient magnitudes at the hit are stored.
    pub hit_gradient: HitGradientQuantization,
}

impl VolumeDescription {
    /// Takes over a grid, whose origin does not matter to a picture.
    #[must_use]
    pub fn new(
        geometry: &GridGeometry,
        d_max: f32,
        value_range: [f64; 2],
        hit_gradient: HitGradientQuantization,
    ) -> Self {
        Self {
            dims: geometry.dims,
            spacing: geometry.spacing,
            world_from_axes: geometry.world_from_axes(),
            unit: geometry.unit.clone(),
            frame: geometry.frame,
            d_max,
            value_range,
            hit_gradient,
        }
    }

    /// `L_min`, the smallest spacing, in world units.
    #[must_use]
    pub fn smallest_spacing(&self) -> f64 {
        self.spacing[0].min(self.spacing[1]).min(self.spacing[2])
    }

    /// `d_max` in multiples of `L_min`.
    #[must_use]
    pub fn d_max_in_spacings(&self) -> f32 {
        (f64::from(self.d_max) / self.smallest_spacing()) as f32
    }

    /// The spacing in multiples of `L_min`.
    #[must_use]
    pub fn relative_spacing(&self) -> [f32; 3] {
        self.spacing.map(|spacing| (spacing / self.smallest_spacing()) as f32)
    }

    /// The inverse of [`Self::world_from_axes`], single precision.
    #[must_use]
    pub fn axes_from_world(&self) -> Mat3 {
        self.world_from_axes.transpose().as_mat3()
    }
}

/// A volume as the GPU holds it: four 16-bit channels a voxel.
///
/// 0: value as a share of the value range, 65535 for its end, 0 for NaN; 1: distance in 16 bits
/// ([`DistanceQuantization`], the bits of an i16); 2: gradient magnitude at the hit in 16 bits, 0 for none; 3: normal as
/// stored ([`voxrole_pack::quantization::encode_normal`]).
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeTexels {
    /// What they mean.
    pub description: VolumeDescription,
    /// One for every voxel, x fastest.
    pub texels: Vec<[u16; 4]>,
}

impl VolumeTexels {
    /// Reads the layers value, distance, hit gradient and normal.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when a layer is missing or damaged, or memory does not suffice.
    pub fn read(reader: &Reader) -> Result<Self> {
        let geometry = &reader.header().geometry;
        let distance_quantization = reader.distance_quantization()?;
        let hit_gradient = reader.hit_gradient_quantization()?;

        let mut texels = vec_with_capacity(geometry.voxel_count(), "the volume's texels")?;
        texels.resize(geometry.voxel_count(), [0; 4]);
        // One layer after another, so that only one is unpacked at a time.
        let value_range = {
            let (values, slope, intercept) = reader.read_value()?;
            fill_values(&mut texels, &values, slope, intercept)
        };
        let distance = reader.read_distance(0)?;
        fill(&mut texels, 1, &distance, |stored| distance_bits(stored, distance_quantization.steps));
        drop(distance);
        let magnitudes = reader.read_hit_gradient(0)?;
        fill(&mut texels, 2, &magnitudes, |stored| hit_gradient_bits(stored, hit_gradient.steps));
        drop(magnitudes);
        let normals: Vec<u16> = reader.read_layer(LayerKind::Normal)?;
        fill(&mut texels, 3, &normals, |stored| stored);
        let hit_gradient = HitGradientQuantization { steps: HitGradientQuantization::MOST_STEPS, ..hit_gradient };
        let description = VolumeDescription::new(geometry, distance_quantization.d_max, value_range, hit_gradient);
        Ok(Self { description, texels })
    }

    /// Whether a texel has a boundary: a distance and a gradient magnitude at the hit.
    #[must_use]
    pub fn has_hit(texel: [u16; 4]) -> bool {
        texel[1] as i16 > DistanceQuantization::MASKED && texel[2] != 0
    }
}

/// A stored distance in 16 bits, whatever precision the file has.
fn distance_bits(stored: i16, steps: u16) -> u16 {
    if stored <= DistanceQuantization::MASKED || steps == DistanceQuantization::MOST_STEPS {
        return stored as u16;
    }
    let scale = f32::from(DistanceQuantization::MOST_STEPS) / f32::from(steps);
    (f32::from(stored) * scale).round() as i16 as u16
}

/// A stored gradient magnitude at the hit in 16 bits, whatever precision the file has.
fn hit_gradient_bits(stored: u16, steps: u16) -> u16 {
    if stored == 0 || steps == HitGradientQuantization::MOST_STEPS {
        return stored;
    }
    let scale = f32::from(HitGradientQuantization::MOST_STEPS) / f32::from(steps);
    1 + (f32::from(stored - 1) * scale).round() as u16
}

fn fill<T: Copy + Sync>(texels: &mut [[u16; 4]], channel: usize, stored: &[T], bits: impl Fn(T) -> u16 + Sync) {
    texels.par_iter_mut().zip(stored).for_each(|(texel, &stored)| texel[channel] = bits(stored));
}

/// Fills channel 0 and returns the range of physical values that 0 and 65535 stand for.
fn fill_values(texels: &mut [[u16; 4]], values: &Scalars, slope: f64, intercept: f64) -> [f64; 2] {
    let physical = |stored: f64| slope.mul_add(stored, intercept);
    // A volume without any finite value has no boundary either: any range will do.
    let [first, second] = values.finite_range().unwrap_or([0.0, 0.0]).map(physical);
    let [low, high] = [first.min(second), first.max(second)];
    let scale = if high > low { 65535.0 / (high - low) } else { 0.0 };
    // NaN becomes 0 in the conversion.
    let share = |stored: f64| ((physical(stored) - low) * scale).round() as u16;
    with_scalars!(values, values => fill(texels, 0, values, |stored| share(voxrole_pack::scalar::Scalar::to_f64(stored))));
    [low, high]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(scalars: &Scalars, slope: f64, intercept: f64) -> (Vec<u16>, [f64; 2]) {
        let mut texels = vec![[0; 4]; scalars.len()];
        let range = fill_values(&mut texels, scalars, slope, intercept);
        (texels.iter().map(|texel| texel[0]).collect(), range)
    }

    #[test]
    fn eight_bits_are_kept_exactly() {
        let (stored, range) = values(&Scalars::U8((0..=255).collect()), 1.0, 0.0);
        assert_eq!(range, [0.0, 255.0]);
        assert!(stored.iter().enumerate().all(|(value, &stored)| usize::from(stored) == value * 257));
    }

    #[test]
    fn a_negative_slope_turns_the_range_round() {
        let (stored, range) = values(&Scalars::I16(vec![-100, 0, 100]), -2.0, 10.0);
        assert_eq!((stored, range), (vec![65535, 32768, 0], [-190.0, 210.0]));
    }

    #[test]
    fn nan_infinity_and_flat_volumes_are_drawn_as_nothing_special() {
        let (stored, range) = values(&Scalars::F32(vec![f32::NAN, 1.0, f32::INFINITY, 3.0]), 1.0, 0.0);
        assert_eq!((stored, range), (vec![0, 0, 65535, 65535], [1.0, 3.0]));
        assert_eq!(values(&Scalars::F64(vec![5.0; 2]), 1.0, 0.0), (vec![0, 0], [5.0, 5.0]));
        assert_eq!(values(&Scalars::F32(vec![f32::NAN]), 1.0, 0.0), (vec![0], [0.0, 0.0]));
    }
}
