//! A packed file's four rendering layers, voxel by voxel, as the ray marchers read them.

use glam::{DMat3, Mat3};
use rayon::prelude::*;
use voxrole_pack::brick::BRICK_EDGE;
use voxrole_pack::error::vec_with_capacity;
use voxrole_pack::{DistanceQuantization, GridGeometry, HitGradientQuantization, Reader, WorldFrame};

use crate::Result;
use crate::streaming::TexelBrick;

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
        let [width, height, _] = description.texel_dims().map(|dim| dim as usize);
        let grid = reader.grid(level)?;
        let bricks_of_slab = width.div_ceil(BRICK_EDGE) * height.div_ceil(BRICK_EDGE);
        // So that little more than the texels themselves is in memory at a time.
        for (index, slab) in texels.chunks_mut(width * height * BRICK_EDGE).enumerate() {
            let bricks = index * bricks_of_slab..(index + 1) * bricks_of_slab;
            let read = |brick| TexelBrick::read(reader, &description, brick);
            let unpacked: Vec<_> = bricks.clone().into_par_iter().with_max_len(1).map(read).collect::<Result<_>>()?;
            slab.par_chunks_mut(width * height).enumerate().for_each(|(slice, texels)| {
                for (brick, unpacked) in bricks.clone().zip(&unpacked) {
                    let ([x, y, _], [columns, rows, _]) = (grid.voxel_ranges(brick), unpacked.dims());
                    let range = [0..columns, 0..rows, slice..slice + 1];
                    unpacked.copy_to(range, texels, [width, height], [x.start, y.start, 0]);
                }
            });
        }
        Ok(Self { description, texels })
    }

    /// Whether a texel has a boundary: a distance and a gradient magnitude at the hit.
    #[must_use]
    pub fn has_hit(texel: [u16; 4]) -> bool {
        texel[1] as i16 > DistanceQuantization::MASKED && texel[2] != 0
    }
}
