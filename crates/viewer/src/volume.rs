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
    /// World position of voxel (0, 0, 0).
    pub origin: [f64; 3],
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
    /// The level of detail that the texels are of: they are every `2^level`-th voxel along each axis. Everything else here is of
    /// the finest level.
    pub level: usize,
}

impl VolumeDescription {
    /// Takes over a grid.
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
            origin: geometry.origin,
            world_from_axes: geometry.world_from_axes(),
            unit: geometry.unit.clone(),
            frame: geometry.frame,
            d_max,
            value_range,
            hit_gradient,
            level: 0,
        }
    }

    /// What a file says of its volume on a level of detail.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when there is no such level, or no layer of distances or magnitudes.
    pub fn of(reader: &Reader, level: usize) -> Result<Self> {
        reader.geometry(level)?;
        let header = reader.header();
        let d_max = reader.distance_quantization()?.d_max;
        let magnitudes = reader.hit_gradient_quantization()?;
        let hit_gradient = HitGradientQuantization { steps: HitGradientQuantization::MOST_STEPS, ..magnitudes };
        let description = Self::new(&header.geometry, d_max, header.statistics.value_range, hit_gradient);
        Ok(Self { level, ..description })
    }

    /// Texels along x, y, z.
    #[must_use]
    pub fn texel_dims(&self) -> [u32; 3] {
        self.dims.map(|dim| dim.div_ceil(1 << self.level))
    }

    /// The distance between texels in multiples of `L_min`.
    #[must_use]
    pub fn texel_spacing(&self) -> [f32; 3] {
        self.relative_spacing().map(|spacing| spacing * (1_u32 << self.level) as f32)
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
    /// Reads the layers value, distance, hit gradient and normal on the finest level.
    ///
    /// # Errors
    /// As [`Self::read_level`].
    pub fn read(reader: &Reader) -> Result<Self> {
        Self::read_level(reader, 0)
    }

    /// Reads the layers value, distance, hit gradient and normal on a level of detail.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when there is no such level, a layer is missing or damaged, or memory does not suffice.
    pub fn read_level(reader: &Reader, level: usize) -> Result<Self> {
        let voxels = reader.geometry(level)?.voxel_count();
        let description = VolumeDescription::of(reader, level)?;
        let mut texels = vec_with_capacity(voxels, "the volume's texels")?;
        texels.resize(voxels, [0; 4]);
        // One layer after another, so that only one is unpacked at a time.
        let (values, slope, intercept) = reader.read_value_level(level)?;
        fill_values(&mut texels, &values, slope, intercept, description.value_range);
        drop(values);
        let (distance, steps) = (reader.read_distance(level)?, reader.distance_quantization()?.steps);
        fill(&mut texels, 1, &distance, |stored| distance_bits(stored, steps));
        drop(distance);
        let (magnitudes, steps) = (reader.read_hit_gradient(level)?, reader.hit_gradient_quantization()?.steps);
        fill(&mut texels, 2, &magnitudes, |stored| hit_gradient_bits(stored, steps));
        drop(magnitudes);
        let normals: Vec<u16> = reader.read_level(LayerKind::Normal, level)?;
        fill(&mut texels, 3, &normals, |stored| stored);
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

/// Fills channel 0; 0 and 65535 stand for the ends of the range.
fn fill_values(texels: &mut [[u16; 4]], values: &Scalars, slope: f64, intercept: f64, [low, high]: [f64; 2]) {
    let physical = |stored: f64| slope.mul_add(stored, intercept);
    let scale = if high > low { 65535.0 / (high - low) } else { 0.0 };
    // NaN becomes 0 in the conversion.
    let share = |stored: f64| ((physical(stored) - low) * scale).round() as u16;
    with_scalars!(values, values => fill(texels, 0, values, |stored| share(voxrole_pack::scalar::Scalar::to_f64(stored))));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(scalars: &Scalars, slope: f64, intercept: f64, range: [f64; 2]) -> Vec<u16> {
        let mut texels = vec![[0; 4]; scalars.len()];
        fill_values(&mut texels, scalars, slope, intercept, range);
        texels.iter().map(|texel| texel[0]).collect()
    }

    #[test]
    fn eight_bits_are_kept_exactly() {
        let stored = values(&Scalars::U8((0..=255).collect()), 1.0, 0.0, [0.0, 255.0]);
        assert!(stored.iter().enumerate().all(|(value, &stored)| usize::from(stored) == value * 257));
    }

    #[test]
    fn a_negative_slope_turns_the_range_round() {
        let stored = values(&Scalars::I16(vec![-100, 0, 100]), -2.0, 10.0, [-190.0, 210.0]);
        assert_eq!(stored, [65535, 32768, 0]);
    }

    #[test]
    fn nan_infinity_and_flat_volumes_are_drawn_as_nothing_special() {
        let stored = values(&Scalars::F32(vec![f32::NAN, 1.0, f32::INFINITY, 3.0]), 1.0, 0.0, [1.0, 3.0]);
        assert_eq!(stored, [0, 0, 65535, 65535]);
        assert_eq!(values(&Scalars::F64(vec![5.0; 2]), 1.0, 0.0, [5.0, 5.0]), [0, 0]);
        assert_eq!(values(&Scalars::F32(vec![f32::NAN]), 1.0, 0.0, [0.0, 0.0]), [0]);
    }

    #[test]
    fn every_precision_is_widened_to_the_ends() {
        for steps in [126, 2046, DistanceQuantization::MOST_STEPS] {
            assert_eq!(
                [steps as i16, 0, -(steps as i16)].map(|stored| distance_bits(stored, steps) as i16),
                [32766, 0, -32766]
            );
        }
        assert_eq!(distance_bits(DistanceQuantization::MASKED, 126) as i16, DistanceQuantization::MASKED);
        for steps in [254, 4094, HitGradientQuantization::MOST_STEPS] {
            assert_eq!([0, 1, steps + 1].map(|stored| hit_gradient_bits(stored, steps)), [0, 1, 65535]);
        }
    }
}
