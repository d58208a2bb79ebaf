//! Which cells can show something: a bit for each cell of a macrocell, worked out when the first ray comes by.
//!
//! Ranges over whole macrocells ([`crate::classify::macrocells`]) say where nothing can be drawn; in what is left four to five
//! of ten cells along rays show nothing all the same, in the volumes that this was measured on.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use std::sync::atomic::{AtomicU64, Ordering};

use fearless_simd::{Bytes, Select, Simd, SimdBase, SimdFloat, SimdInt, SimdMask, f32x16, i32x16, mask32x16, u32x16};

use super::corners::{gradient_bins, have_hit, normals};
use super::lanes::{LANES, splat};
use super::sampling::Sampler;
use crate::classify::macrocells::MACROCELL;
use crate::classify::opacity::{GRADIENT_BINS, VALUE_BINS};

/// Voxels along a side of a macrocell, those on both of its faces.
const SIDE: usize = MACROCELL as usize + 1;
/// All of them, x fastest, and some more that fill the last vector.
const VOXELS: usize = 128;
/// Voxels up to the lowest one of the last cell, in whole vectors.
const LOWEST: usize = 96;

/// Not known yet.
const UNKNOWN: u64 = 0;
/// No cell: the mask of the last one alone, which is never stored as such.
const NONE: u64 = 1 << 63;

/// The cells of one volume that one transfer function shows, as far as rays have come by.
pub(super) struct ActiveCells {
    /// Macrocells along x and y.
    dims: [usize; 2],
    masks: Vec<AtomicU64>,
}

impl ActiveCells {
    /// Those of a volume of so many macrocells, of which nothing is known yet.
    pub(super) fn new([nx, ny, nz]: [usize; 3]) -> Self {
        let masks = std::iter::repeat_with(|| AtomicU64::new(UNKNOWN)).take(nx * ny * nz).collect();
        Self { dims: [nx, ny], masks }
    }

    /// Forgets all of them, in the memory that is there.
    pub(super) fn forget(&mut self) {
        self.masks.iter_mut().for_each(|mask| *mask.get_mut() = UNKNOWN);
    }

    /// A bit for each cell of a macrocell that can show something, x fastest.
    #[inline(always)]
    pub(super) fn mask<S: Simd>(&self, simd: S, sampler: &Sampler<'_>, macrocell: usize) -> u64 {
        match self.masks[macrocell].load(Ordering::Relaxed) {
            UNKNOWN => self.work_out(simd, sampler, macrocell),
            NONE => 0,
            mask => mask,
        }
    }

    /// Whichever thread comes first: all find the same.
    #[cold]
    #[inline(never)]
    fn work_out<S: Simd>(&self, simd: S, sampler: &Sampler<'_>, macrocell: usize) -> u64 {
        let [nx, ny] = self.dims;
        let first =
            [macrocell % nx, macrocell / nx % ny, macrocell / (nx * ny)].map(|index| index * MACROCELL as usize);
        let mut mask = simd.vectorize(
            #[inline(always)]
            || mask(simd, sampler, first),
        );
        if mask == NONE {
            // One more does no harm.
            mask |= 1;
        }
        self.masks[macrocell].store(if mask == 0 { NONE } else { mask }, Ordering::Relaxed);
        mask
    }
}

/// What matters of a macrocell's voxels.
struct Voxels {
    values: [f32; VOXELS],
    /// The first and the last bin of value that has an opacity with the voxel's gradient magnitude: none without a boundary.
    lit: [[f32; VOXELS]; 2],
    distances: [f32; VOXELS],
    /// By how much a plane's distance grows from a voxel to the middle of a cell behind it.
    growths: [[f32; VOXELS]; 3],
    /// By how much at most it differs within a cell from that in its middle, and half a step beyond.
    ranges: [f32; VOXELS],
}

#[inline(always)]
fn mask<S: Simd>(simd: S, sampler: &Sampler<'_>, first: [usize; 3]) -> u64 {
    let voxels = read(simd, sampler, first);
    let mut bits = 0_u128;
    for start in (0..LOWEST).step_by(LANES) {
        bits |= u128::from(active(simd, &voxels, start, 1.001 * sampler.roles.largest_d_c()).to_bitmask()) << start;
    }
    let mut mask = 0;
    for row in 0..16 {
        let cells = (bits >> (SIDE * (row % 4) + SIDE * SIDE * (row / 4))) as u64 & 15;
        mask |= cells << (4 * row);
    }
    mask
}

/// Reads a macrocell's voxels; beyond the volume's faces those on them once more.
#[inline(always)]
fn read<S: Simd>(simd: S, sampler: &Sampler<'_>, first: [usize; 3]) -> Voxels {
    let frame = sampler.frame;
    let [width, height, depth] = [frame.dims[0] as usize, frame.dims[1] as usize, frame.dims[2] as usize];
    let mut words = [[0_u32; VOXELS]; 2];
    for row in 0..SIDE * SIDE {
        let (y, z) = ((first[1] + row % SIDE).min(height - 1), (first[2] + row / SIDE).min(depth - 1));
        let texels = &sampler.texels()[(z * height + y) * width..][..width];
        for x in 0..SIDE {
            let [value, distance, gradient, normal] = texels[(first[0] + x).min(width - 1)];
            words[0][row * SIDE + x] = u32::from(value) | u32::from(distance) << 16;
            words[1][row * SIDE + x] = u32::from(gradient) | u32::from(normal) << 16;
        }
    }
    let none = [0.0; VOXELS];
    let mut voxels = Voxels { values: none, lit: [none; 2], distances: none, growths: [none; 3], ranges: none };
    for start in (0..VOXELS).step_by(LANES) {
        let all = start..start + LANES;
        let low = u32x16::from_slice(simd, &words[0][all.clone()]);
        let high = u32x16::from_slice(simd, &words[1][all.clone()]);
        let (stored, gradients) = (low.bitcast::<i32x16<S>>() >> 16, high & 0xffff);
        let bins = gradient_bins(simd, gradients);
        let bins = have_hit(stored, gradients).select(bins, u32x16::splat(simd, GRADIENT_BINS as u32));
        let lit = sampler.roles.lit(simd, bins);
        (low & 0xffff).to_float::<f32x16<S>>().store_slice(&mut voxels.values[all.clone()]);
        (lit & 0xffff).to_float::<f32x16<S>>().store_slice(&mut voxels.lit[0][all.clone()]);
        (lit >> 16).to_float::<f32x16<S>>().store_slice(&mut voxels.lit[1][all.clone()]);
        (stored.to_float::<f32x16<S>>() * frame.distance_scale).store_slice(&mut voxels.distances[all.clone()]);
        let normal = normals(simd, high >> 16);
        let mut range = splat(simd, frame.half_step);
        for axis in 0..3 {
            let growth = normal[axis] * (0.5 * frame.spacing[axis]);
            growth.store_slice(&mut voxels.growths[axis][all.clone()]);
            range += growth.abs();
        }
        range.store_slice(&mut voxels.ranges[all]);
    }
    voxels
}

/// Whether the cells show something whose lowest voxels are those from `start`; what lies `nearest` or farther from its boundary is
/// not drawn.
#[inline(always)]
fn active<S: Simd>(simd: S, voxels: &Voxels, start: usize, nearest: f32) -> mask32x16<S> {
    let (mut low, mut high) = (splat(simd, f32::INFINITY), splat(simd, 0.0));
    for corner in 0..8 {
        let value = at_corner(simd, &voxels.values, start, corner);
        (low, high) = (low.min(value), high.max(value));
    }
    // As `value_bins`.
    let per_value = VALUE_BINS as f32 / 65536.0;
    let last = splat(simd, VALUE_BINS as f32 - 1.0);
    let low = ((low - 0.5) * per_value).floor().max(splat(simd, 0.0));
    let high = ((high + 0.5) * per_value).floor().min(last);
    let mut are_active = mask32x16::splat(simd, false);
    for corner in 0..8 {
        let mut middle = at_corner(simd, &voxels.distances, start, corner);
        for axis in 0..3 {
            let growth = at_corner(simd, &voxels.growths[axis], start, corner);
            middle = if corner >> axis & 1 == 1 { middle - growth } else { middle + growth };
        }
        let is_near = (middle.abs() - at_corner(simd, &voxels.ranges, start, corner)).simd_lt(nearest);
        let first = at_corner(simd, &voxels.lit[0], start, corner);
        are_active |= is_near & first.simd_le(high) & at_corner(simd, &voxels.lit[1], start, corner).simd_ge(low);
    }
    are_active
}

/// Numbers of the voxels in a corner of cells.
#[inline(always)]
fn at_corner<S: Simd>(simd: S, numbers: &[f32; VOXELS], start: usize, corner: usize) -> f32x16<S> {
    let first = start + (corner & 1) + SIDE * (corner >> 1 & 1) + SIDE * SIDE * (corner >> 2);
    f32x16::from_slice(simd, &numbers[first..first + LANES])
}

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;
    use glam::{UVec3, Vec3};
    use proptest::prelude::*;
    use voxrole_pack::DistanceQuantization;
    use voxrole_preprocess::simd;

    use super::super::{RayMarcher, naive};
    use super::*;
    use crate::ViewState;
    use crate::state::Integration;

    /// The masks of all macrocells.
    fn masks(marcher: &RayMarcher<'_>) -> Vec<u64> {
        let (sampler, macrocells) = (marcher.sampler(), marcher.tables.macrocells());
        let cells = ActiveCells::new(macrocells);
        let mask = |macrocell| dispatch!(simd::level(), simd => cells.mask(simd, &sampler, macrocell));
        let masks: Vec<u64> = (0..macrocells.iter().product()).map(mask).collect();
        // When they are known it is the same.
        assert_eq!(masks, (0..masks.len()).map(mask).collect::<Vec<_>>());
        masks
    }

    #[test]
    fn cells_around_a_voxel_are_active_alone() {
        let mut volume = naive::tests::volume([9; 3], 0);
        volume.texels.fill([40_000, DistanceQuantization::MASKED as u16, 0, 0]);
        let mut state = ViewState::default();
        state.transfer_function.regions = vec!["0:1,0:1,FF8000,0.7".parse().expect("a region")];
        state.transfer_function.emphasis = "linear,1,0.1".parse().expect("an emphasis");
        let draw = |voxel: [usize; 3]| {
            let mut volume = volume.clone();
            // At a distance of 0, with a normal along z.
            volume.texels[(voxel[2] * 9 + voxel[1]) * 9 + voxel[0]] = [40_000, 0, 40_000, 0];
            masks(&RayMarcher::new(&volume, &state, [1, 1]).expect("a picture"))
        };
        let bit = |x: u32, y: u32, z: u32| 1_u64 << (x + 4 * y + 16 * z);
        let both = |of: fn(u32, u32) -> [u32; 3]| -> u64 {
            (0..4).map(|pair| of(pair & 1, pair >> 1)).map(|[x, y, z]| bit(x, y, z)).sum()
        };
        let around = both(|x, y| [1 + x, 1 + y, 1]) | both(|x, y| [1 + x, 1 + y, 2]);
        assert_eq!(draw([2, 2, 2]), [around, 0, 0, 0, 0, 0, 0, 0]);
        // On an edge of four macrocells; and the last cell alone, which is kept as two.
        let [first, second] = [bit(3, 3, 1) | bit(3, 3, 2), bit(0, 3, 1) | bit(0, 3, 2)];
        let [third, fourth] = [bit(3, 0, 1) | bit(3, 0, 2), bit(0, 0, 1) | bit(0, 0, 2)];
        assert_eq!(draw([4, 4, 2]), [first, second, third, fourth, 0, 0, 0, 0]);
        assert_eq!(draw([8, 8, 8]), [0, 0, 0, 0, 0, 0, 0, NONE | 1]);
        volume.texels.fill([40_000, 0, 0, 0]);
        state.transfer_function.regions.clear();
        assert_eq!(masks(&RayMarcher::new(&volume, &state, [1, 1]).expect("a picture")), [0; 8]);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 32, ..ProptestConfig::default() })]
        #[test]
        fn cells_that_are_not_active_show_nothing(
            dims in prop::array::uniform3(1_u32..8),
            seed in any::<u64>(),
            (low, width) in (0.0_f32..0.9, 0.02_f32..0.3),
            d_c in 0.1_f32..1.0,
            is_integrated in any::<bool>(),
            (azimuth, height) in (0.0_f32..7.0, -1.0_f32..1.0),
        ) {
            let volume = naive::tests::volume(dims, seed);
            let mut state = ViewState::default();
            let region = format!("{low}:{},{low}:{},FF8000,0.7", low + width, low + width);
            state.transfer_function.regions = vec![region.parse().expect("a region")];
            state.transfer_function.emphasis = format!("linear,1,{d_c}").parse().expect("an emphasis");
            if !is_integrated {
                state.render_settings.integration = Integration::PostClassified;
            }
            let level = (1.0 - height * height).sqrt();
            let direction = Vec3::new(level * azimuth.cos(), level * azimuth.sin(), height);
            let marcher = RayMarcher::new(&volume, &state, [1, 1]).expect("a picture");
            let (macrocells, masks) = (marcher.tables.macrocells(), masks(&marcher));
            let last = UVec3::from_array(dims.map(|dim| dim.saturating_sub(2)));
            for cell in (0..512).map(|cell| UVec3::new(cell % 8, cell / 8 % 8, cell / 64)).filter(|cell| cell.cmple(last).all()) {
                let [x, y, z] = (cell / MACROCELL).as_usizevec3().to_array();
                let macrocell = (z * macrocells[1] + y) * macrocells[0] + x;
                let bit = (cell % MACROCELL).dot(UVec3::new(1, 4, 16));
                if masks[macrocell] >> bit & 1 == 1 {
                    continue;
                }
                for place in 0..27 {
                    let fraction = Vec3::new((place % 3) as f32, (place / 3 % 3) as f32, (place / 9) as f32) * 0.5;
                    let shown = naive::sample_role(&marcher, cell, fraction, direction, marcher.frame.half_step);
                    prop_assert_eq!(shown.opacity, 0.0, "{} {}", cell, fraction);
                }
            }
        }
    }
}
