//! What is drawn by value, values and normals, in arrays of their own: a sample touches fewer lines of the caches, and many need
//! no normal.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use fearless_simd::{Bytes, Simd, SimdInt, f32x16, i32x16, u32x16};
use rayon::prelude::*;
use voxrole_pack::error::vec_with_capacity;
use voxrole_pack::quantization::NO_NORMAL;

use super::corners::{Places, normals};
use super::gathers::{Firsts, ask_for, halves};
use super::lanes::{Directions, splat, unit_or_zero};
use super::sampling::Sampler;
use crate::Result;
use crate::volume::VolumeTexels;

/// Texels, at least, that a thread takes.
const PARALLEL: usize = 1 << 16;

/// One number for every voxel, x fastest, and one more, so that every voxel has one behind it.
pub(super) struct Planes {
    /// As stored.
    values: Vec<u16>,
    /// As stored, and [`NO_NORMAL`] where no boundary is near.
    normals: Vec<u16>,
}

impl Planes {
    /// Those of a volume.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when memory does not suffice.
    pub(super) fn new(volume: &VolumeTexels) -> Result<Self> {
        let texels = volume.texels.par_iter().with_min_len(PARALLEL);
        let room = volume.texels.len() + 1;
        let mut values = vec_with_capacity(room, "the volume's values")?;
        let mut normals = vec_with_capacity(room, "the volume's normals")?;
        texels.clone().map(|texel| texel[0]).collect_into_vec(&mut values);
        let normal = |texel: &[u16; 4]| if VolumeTexels::has_hit(*texel) { texel[3] } else { NO_NORMAL };
        texels.map(normal).collect_into_vec(&mut normals);
        values.push(0);
        normals.push(NO_NORMAL);
        Ok(Self { values, normals })
    }

    /// Asks for the memory in which values lie.
    #[inline(always)]
    pub(super) fn ask_for_values(&self, firsts: &Firsts) {
        ask_for(&self.values, firsts);
    }

    /// Asks for the memory in which normals lie.
    #[inline(always)]
    pub(super) fn ask_for_normals(&self, firsts: &Firsts) {
        ask_for(&self.normals, firsts);
    }

    /// Interpolated values, 0 to 65535, in cells whose lowest voxels lie at `firsts`.
    #[inline(always)]
    pub(super) fn value<S: Simd>(
        &self,
        simd: S,
        sampler: &Sampler<'_>,
        firsts: &Firsts,
        [x, y, z]: Directions<S>,
    ) -> f32x16<S> {
        let mut rows = [x; 4];
        for row in 0..4 {
            let [low, high] = pair(simd, &self.values, firsts, sampler.offsets[row]);
            let low = low.bitcast::<i32x16<S>>().to_float::<f32x16<S>>();
            rows[row] = low + x * (high.bitcast::<i32x16<S>>().to_float::<f32x16<S>>() - low);
        }
        let [near, far] = [rows[0] + y * (rows[1] - rows[0]), rows[2] + y * (rows[3] - rows[2])];
        near + z * (far - near)
    }

    /// Direction of the mean of the normals that there are: where no boundary is near, light has nothing to fall on.
    #[inline(always)]
    pub(super) fn normal<S: Simd>(&self, simd: S, sampler: &Sampler<'_>, places: &Places<S>) -> Directions<S> {
        let firsts = sampler.firsts(places);
        let [x, y, z] = places.fractions;
        let sides = [[1.0 - x, x], [1.0 - y, y], [1.0 - z, z]];
        let mut sum = [splat(simd, 0.0); 3];
        for row in 0..4 {
            let stored = pair(simd, &self.normals, &firsts, sampler.offsets[row]);
            let weight = sides[1][row & 1] * sides[2][row >> 1];
            for side in 0..2 {
                let (weight, own) = (sides[0][side] * weight, normals(simd, stored[side]));
                for axis in 0..3 {
                    sum[axis] += weight * own[axis];
                }
            }
        }
        unit_or_zero(simd, &sum, 1e-8)
    }
}

/// The numbers of the two voxels along x.
#[inline(always)]
fn pair<S: Simd>(simd: S, plane: &[u16], firsts: &Firsts, offset: usize) -> [u32x16<S>; 2] {
    let both = halves(simd, plane, firsts, offset);
    [both & 0xffff, both >> 16]
}

#[cfg(test)]
mod tests {
    use fearless_simd::{SimdBase, dispatch};
    use glam::Vec3;
    use proptest::prelude::*;
    use voxrole_pack::quantization::decode_normal;
    use voxrole_preprocess::simd;

    use super::super::lanes::LANES;
    use super::super::{RayMarcher, naive};
    use super::*;
    use crate::ViewState;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]
        #[test]
        fn values_and_normals_are_the_means_of_eight_voxels(
            dims in prop::array::uniform3(1_u32..5),
            seed in any::<u64>(),
            shares in prop::array::uniform16(prop::array::uniform3(0.0_f32..=1.0)),
        ) {
            let volume = naive::tests::volume(dims, seed);
            let planes = Planes::new(&volume).expect("memory");
            let marcher = RayMarcher::new(&volume, &ViewState::default(), [1, 1]).expect("a picture");
            let (sampler, naive) = (marcher.sampler(), naive::Naive::new(&marcher));
            let positions = [0, 1, 2].map(|axis| {
                shares.map(|share| share[axis] * (dims[axis] - 1) as f32 * marcher.frame().spacing[axis])
            });
            let found: [[f32; LANES]; 4] = dispatch!(simd::level(), simd => {
                let [x, y, z] = &positions;
                let positions = [x, y, z].map(|axis| f32x16::from_slice(simd, axis));
                let [cells, fractions] = sampler.cells(simd, &positions);
                let places = sampler.places(&cells, fractions);
                let [u, v, w] = planes.normal(simd, &sampler, &places);
                let value = planes.value(simd, &sampler, &sampler.firsts(&places), fractions);
                [value, u, v, w].map(Into::into)
            });
            for lane in 0..LANES {
                let place = Vec3::from_array(positions.map(|axis| axis[lane]));
                let (mut value, mut normal) = (0.0, Vec3::ZERO);
                for (weight, texel) in naive.weighted_texels(place) {
                    value += weight * f32::from(texel[0]);
                    if VolumeTexels::has_hit(texel) {
                        normal += weight * decode_normal(texel[3]).unwrap_or(Vec3::ZERO);
                    }
                }
                prop_assert!((found[0][lane] - value).abs() < 0.05, "{} is not {value}", found[0][lane]);
                let found = Vec3::new(found[1][lane], found[2][lane], found[3][lane]);
                // What is left of normals that all but cancel out may point anywhere.
                let is_right = normal.length() < 1e-3 || (found - normal.normalize()).length() < 1e-3;
                prop_assert!(is_right, "{found} is not along {normal}");
            }
        }
    }
}
