//! How little light comes to a place because of what is drawn around it, macrocell by macrocell, without any gradient.
//!
//! What a macrocell stops of a ray across it is estimated by the opacity of a few of its voxels. Means of that over two
//! neighbourhoods, a narrow one and a wide one, are added up: near what is drawn counts more than far, as it does for
//! light, which comes the worse the more of the directions around are blocked.
//!
//! After Díaz, Vázquez, Navazo and Duguet, Real-time ambient occlusion and halos with summed area tables, 2010, who take
//! means over boxes of several sizes, and Hernell, Ljung and Ynnerman, Local ambient occlusion in direct volume
//! rendering, 2010, for light of a neighbourhood alone, which leaves nothing wholly dark. Here boxes are blurs to
//! Gaussians, on macrocells in place of voxels.

use glam::{Vec3, Vec4};
use rayon::prelude::*;
use voxrole_pack::DistanceQuantization;

use super::box_blur::blur;
use super::correct_opacity;
use super::macrocells::{MACROCELL, Occupancy, macrocells};
use super::{EmphasisTable, OpacityTable, ValueTable};
use crate::volume::{VolumeDescription, VolumeTexels};

/// Standard deviation of the narrow neighbourhood, in multiples of `L_min`.
const NARROW: f32 = 6.0;
/// By how much the wide one is wider still: standard deviations add up as squares do.
const WIDER: f32 = 17.0;
/// Sum of the means up to which nothing is dark: that near a face that stands free.
const FREE: f32 = 0.15;
/// Sum of the means from which on nothing becomes darker.
const DENSE: f32 = 0.5;
/// How far before a sample, towards the viewer, its light is looked up, in multiples of `L_min`: what lies behind a face
/// keeps no light from it, and hollows are told from bulges.
pub const TOWARDS_VIEWER: f32 = 10.0;

/// How many macrocells beyond the volume light comes from everywhere: there is nothing that keeps it.
pub const FADE: f32 = 3.0;

/// Opacities for which it is worked out what a macrocell of it stops: a power is slow.
const OPACITIES: usize = 256;

/// Value, distance and gradient magnitude of a voxel, as stored; without a boundary its distance says so.
pub(super) type Sample = [u16; 3];

/// What of a texel stands for its macrocell.
pub(super) fn sample_of(texel @ [value, distance, gradient, _]: [u16; 4]) -> Sample {
    [value, if VolumeTexels::has_hit(texel) { distance } else { DistanceQuantization::MASKED as u16 }, gradient]
}

/// Four voxels of every macrocell, which stand for it whatever is drawn of them: a sixteenth of the volume.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MacrocellSamples {
    pub(super) dims: [usize; 3],
    /// x fastest.
    pub(super) samples: Vec<[Sample; 4]>,
}

impl MacrocellSamples {
    /// Every second corner of the cube in the macrocell's middle that is half as large.
    const PLACES: [[usize; 3]; 4] = [[1, 1, 1], [3, 3, 1], [3, 1, 3], [1, 3, 3]];

    /// Gathers them, on every thread.
    #[must_use]
    pub fn new(volume: &VolumeTexels) -> Self {
        let voxels = volume.description.texel_dims().map(|dim| dim as usize);
        let dims @ [nx, ny, nz] = macrocells(voxels);
        let mut samples = vec![[[0; 3]; 4]; nx * ny * nz];
        samples.par_chunks_mut(nx).enumerate().for_each(|(row, samples)| {
            for (x, samples) in samples.iter_mut().enumerate() {
                *samples = Self::places([x, row % ny, row / ny], voxels)
                    .map(|[x, y, z]| sample_of(volume.texels[(z * voxels[1] + y) * voxels[0] + x]));
            }
        });
        Self { dims, samples }
    }

    /// The voxels that stand for a macrocell, of so many voxels.
    pub(super) fn places(macrocell: [usize; 3], voxels: [usize; 3]) -> [[usize; 3]; 4] {
        let along = |place: [usize; 3], axis: usize| macrocell[axis] * MACROCELL as usize + place[axis];
        Self::PLACES.map(|place| [0, 1, 2].map(|axis: usize| along(place, axis).min(voxels[axis] - 1)))
    }
}

/// What of a volume keeps light from anywhere.
#[derive(Clone, Copy, Debug)]
pub struct Drawn<'a> {
    /// The volume.
    pub volume: &'a VolumeDescription,
    /// What they cut away does not: those of [`crate::frame::Frame::cutting_planes`].
    pub planes: &'a [Vec4],
    /// Nor does what is known to be empty, where something is.
    pub occupancy: Option<&'a Occupancy>,
}

/// How little light comes where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Occlusion {
    dims: [usize; 3],
    /// Of every macrocell's middle, in shares of 255; x fastest.
    shares: Vec<u8>,
}

impl Occlusion {
    /// Where regions and curve decide by the voxels' roles.
    #[must_use]
    pub fn of_roles(
        samples: &MacrocellSamples,
        drawn: Drawn<'_>,
        table: &OpacityTable,
        emphases: &EmphasisTable,
    ) -> Self {
        let most = f32::from(DistanceQuantization::MOST_STEPS);
        let distance_scale = drawn.volume.d_max_in_spacings() / most;
        // Stored distances from this on have no opacity; what has none at all is stored as a longer one.
        let reach = (emphases.largest_d_c() / distance_scale).ceil().min(most + 1.0) as u16;
        Self::new(samples, drawn, |[value, bits, gradient]| {
            let stored = bits as i16;
            let (opacity, emphasis) = table.opacity_of(value, gradient);
            // No branches: what is next to what is drawn is often not, and nothing foretells it.
            let opacity = f32::from(opacity) * f32::from(u8::from(stored.unsigned_abs() < reach));
            opacity * emphases.look_up(emphasis, f32::from(stored) * distance_scale)
        })
    }

    /// Where value alone decides.
    #[must_use]
    pub fn of_values(samples: &MacrocellSamples, drawn: Drawn<'_>, values: &ValueTable) -> Self {
        Self::new(samples, drawn, |[value, ..]| 65535.0 * values.look_up(f32::from(value), f32::from(value)).w)
    }

    /// Where opacity is stored.
    #[must_use]
    pub fn of_stored(samples: &MacrocellSamples, drawn: Drawn<'_>) -> Self {
        Self::new(samples, drawn, |[opacity, ..]| f32::from(opacity))
    }

    /// `opacity` for a path of `L_min`, as a share of 65535.
    fn new(samples: &MacrocellSamples, drawn: Drawn<'_>, opacity: impl Fn(Sample) -> f32 + Sync) -> Self {
        let Drawn { volume, planes, occupancy } = drawn;
        let dims @ [nx, ny, _] = samples.dims;
        let sides = Vec3::from_array(volume.texel_spacing()) * MACROCELL as f32;
        let across = sides.element_product().cbrt();
        let is_cut = |index: usize| {
            let place = [index % nx, index / nx % ny, index / (nx * ny)].map(|place| place as f32 + 0.5);
            planes.iter().any(|plane| plane.truncate().dot(Vec3::from_array(place) * sides) > plane.w)
        };
        let stopped_across: Vec<f32> =
            (0..=OPACITIES).map(|place| 65535.0 * correct_opacity(place as f32 / OPACITIES as f32, across)).collect();
        let stopped = |(index, samples): (usize, &[Sample; 4])| {
            // Most macrocells are.
            if occupancy.is_some_and(|occupancy| occupancy.distances()[index] > 0) {
                return 0;
            }
            let sum: f32 = samples.iter().map(|&sample| opacity(sample)).sum();
            if sum == 0.0 || (!planes.is_empty() && is_cut(index)) {
                return 0;
            }
            let place = sum * (OPACITIES as f32 / (4.0 * 65535.0));
            let low = (place as u32 as usize).min(OPACITIES - 1);
            (mix(stopped_across[low], stopped_across[low + 1], place - low as f32) + 0.5) as u16
        };
        let shares = samples.samples.par_iter().enumerate().with_min_len(1024).map(stopped).collect();
        let in_macrocells = |length: f32| (Vec3::splat(length) / sides).to_array();
        let narrow = blur(dims, shares, in_macrocells(NARROW));
        let wide = blur(dims, narrow.clone(), in_macrocells(WIDER));
        let shares = narrow.par_iter().zip(&wide).with_min_len(1024).map(|(&narrow, &wide)| {
            let sum = (f32::from(narrow) + f32::from(wide)) / 65535.0;
            (((sum - FREE) / (DENSE - FREE)).clamp(0.0, 1.0) * 255.0 + 0.5) as u8
        });
        Self { dims, shares: shares.collect() }
    }

    /// Macrocells along x, y, z.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// That of every macrocell's middle, in shares of 255, x fastest.
    #[must_use]
    pub fn shares(&self) -> &[u8] {
        &self.shares
    }

    /// That at a place in multiples of macrocells' sides, 0 to 1: linear between macrocells' middles, and falling to 0
    /// within [`FADE`] macrocells beyond the outermost ones.
    #[must_use]
    #[inline]
    pub fn at(&self, place: Vec3) -> f32 {
        let [nx, ny, nz] = self.dims;
        let last = Vec3::new((nx - 1) as f32, (ny - 1) as f32, (nz - 1) as f32);
        let (wanted, place) = (place - 0.5, (place - 0.5).clamp(Vec3::ZERO, last));
        let [beyond_x, beyond_y, beyond_z] = (wanted - place).abs().to_array();
        let left = 1.0 - beyond_x.max(beyond_y).max(beyond_z) / FADE;
        if left <= 0.0 {
            return 0.0;
        }
        let low = place.floor();
        let fraction = place - low;
        let [x0, y0, z0] = low.as_usizevec3().to_array();
        let [x1, y1, z1] = [(x0 + 1).min(nx - 1), (y0 + 1).min(ny - 1), (z0 + 1).min(nz - 1)];
        let share = |x: usize, y: usize, z: usize| f32::from(self.shares[(z * ny + y) * nx + x]);
        let along_x = |y: usize, z: usize| mix(share(x0, y, z), share(x1, y, z), fraction.x);
        let along_y = |z: usize| mix(along_x(y0, z), along_x(y1, z), fraction.y);
        left * mix(along_y(z0), along_y(z1), fraction.z) / 255.0
    }
}

#[inline(always)]
fn mix(low: f32, high: f32, share: f32) -> f32 {
    low + share * (high - low)
}

#[cfg(test)]
mod tests {
    use rayon::ThreadPoolBuilder;
    use voxrole_pack::{GridGeometry, HitGradientQuantization, Precision};

    use super::*;
    use crate::ViewState;
    use crate::classify::MacrocellRanges;
    use crate::frame::Frame;
    use crate::state::TransferFunction;

    /// Two spherical boundaries that touch, on a grid whose macrocells are not all whole.
    fn volume() -> VolumeTexels {
        let dims = [70, 45, 38];
        let hit_gradient = HitGradientQuantization::new(0.0, 1.0, Precision::default());
        let geometry = GridGeometry::axis_aligned(dims, [1.0, 1.0, 1.5]);
        let description = VolumeDescription::new(&geometry, 15.0, [0.0, 1.0], hit_gradient);
        let texels = (0..dims.iter().product::<u32>()).map(|index| {
            let [width, height, _] = dims;
            let place = [index % width, index / width % height, index / (width * height)];
            let place = Vec3::from_array(place.map(|place| place as f32)) * Vec3::new(1.0, 1.0, 1.5);
            let spheres = [(Vec3::new(22.0, 21.0, 27.0), 15.0), (Vec3::new(48.0, 22.0, 30.0), 11.0)];
            let distances = spheres.map(|(middle, radius)| radius - place.distance(middle));
            let distance = distances[0].max(distances[1]);
            if distance.abs() >= 15.0 {
                return [0, i16::MIN as u16, 0, 0];
            }
            [30_000, (distance / 15.0 * 32766.0) as i16 as u16, 40_000, 0]
        });
        VolumeTexels { description, texels: texels.collect() }
    }

    fn transfer_function() -> TransferFunction {
        TransferFunction { regions: vec!["0:1,0.3:0.9,FFFFFF,0.8".parse().expect("a region")], ..Default::default() }
    }

    fn of_roles(volume: &VolumeTexels, transfer_function: &TransferFunction) -> Occlusion {
        let VolumeDescription { value_range, hit_gradient, .. } = volume.description;
        let table = OpacityTable::new(transfer_function, value_range, hit_gradient);
        let (samples, emphases) = (MacrocellSamples::new(volume), EmphasisTable::new(transfer_function));
        let drawn = Drawn { volume: &volume.description, planes: &[], occupancy: None };
        let occlusion = Occlusion::of_roles(&samples, drawn, &table, &emphases);
        // What is left out as empty changes nothing.
        let state = ViewState { transfer_function: transfer_function.clone(), ..ViewState::default() };
        let frame = Frame::new(&state, &volume.description, &emphases, [16, 16]);
        let occupancy = Occupancy::new(&MacrocellRanges::new(volume), &table, &frame);
        let empty = occupancy.distances().iter().filter(|distance| **distance > 0).count();
        assert!(empty > occupancy.distances().len() / 10, "{empty}");
        assert_eq!(
            Occlusion::of_roles(&samples, Drawn { occupancy: Some(&occupancy), ..drawn }, &table, &emphases),
            occlusion
        );
        occlusion
    }

    /// With all voxels of every macrocell.
    fn naive(volume: &VolumeTexels, transfer_function: &TransferFunction) -> Vec<f32> {
        let description = &volume.description;
        let table = OpacityTable::new(transfer_function, description.value_range, description.hit_gradient);
        let emphases = EmphasisTable::new(transfer_function);
        let voxels = description.texel_dims().map(|dim| dim as usize);
        let dims @ [nx, ny, nz] = macrocells(voxels);
        let sides = Vec3::from_array(description.texel_spacing()) * 4.0;
        let opacity = |[x, y, z]: [usize; 3]| {
            let texel = volume.texels[(z * voxels[1] + y) * voxels[0] + x];
            let (entry, emphasis) = table.look_up(f32::from(texel[0]), texel[2].max(1));
            let distance = f32::from(texel[1] as i16) * description.d_max_in_spacings() / 32766.0;
            if VolumeTexels::has_hit(texel) { entry[3] * emphases.look_up(emphasis, distance) } else { 0.0 }
        };
        let stopped = (0..nx * ny * nz).map(|macrocell| {
            let first = [macrocell % nx, macrocell / nx % ny, macrocell / (nx * ny)];
            let ends = |axis: usize| first[axis] * 4..=(first[axis] * 4 + 4).min(voxels[axis] - 1);
            let mut opacities = Vec::new();
            for (z, y) in ends(2).flat_map(|z| ends(1).map(move |y| (z, y))) {
                opacities.extend(ends(0).map(|x| opacity([x, y, z])));
            }
            let mean = opacities.iter().sum::<f32>() / opacities.len() as f32;
            (correct_opacity(mean, sides.element_product().cbrt()) * 65535.0).round() as u16
        });
        let narrow = blur(dims, stopped.collect(), (Vec3::splat(NARROW) / sides).to_array());
        let wide = blur(dims, narrow.clone(), (Vec3::splat(WIDER) / sides).to_array());
        let share = |(&narrow, &wide): (&u16, &u16)| {
            let sum = (f32::from(narrow) + f32::from(wide)) / 65535.0;
            ((sum - FREE) / (DENSE - FREE)).clamp(0.0, 1.0) * 255.0
        };
        narrow.iter().zip(&wide).map(share).collect()
    }

    #[test]
    fn few_voxels_come_close_to_all() {
        let (volume, transfer_function) = (volume(), transfer_function());
        let occlusion = of_roles(&volume, &transfer_function);
        let exact = naive(&volume, &transfer_function);
        let off = |(&share, exact): (&u8, &f32)| (f32::from(share) - exact).powi(2);
        let squares: f32 = occlusion.shares().iter().zip(&exact).map(off).sum();
        let rms = (squares / exact.len() as f32).sqrt();
        let darkest = exact.iter().fold(0_f32, |a, &b| a.max(b));
        println!("{rms}/255 off of up to {darkest}/255");
        assert!(darkest > 100.0 && rms < 12.0, "{rms}/255 off of up to {darkest}/255");
    }

    #[test]
    fn every_number_of_threads_gives_the_same_bits() {
        let (volume, transfer_function) = (volume(), transfer_function());
        let on_threads = |threads: usize| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| of_roles(&volume, &transfer_function))
        };
        let one = on_threads(1);
        assert!(one.shares().iter().any(|&share| share > 0));
        assert!(one == on_threads(2) && one == on_threads(7));
    }

    #[test]
    fn places_between_and_beyond_are_interpolated() {
        let occlusion = Occlusion { dims: [2, 1, 2], shares: vec![0, 51, 102, 255] };
        for (place, expected) in [
            ([0.5, 0.5, 0.5], 0.0),
            ([1.0, 0.5, 0.5], 0.1),
            ([0.5, 2.0, 1.0], 0.1),
            ([1.0, -0.7, 1.0], 0.24),
            ([1.5, 0.5, 3.0], 0.5),
            ([7.0, 0.0, 7.0], 0.0),
        ] {
            let found = occlusion.at(Vec3::from_array(place));
            assert!((found - expected).abs() < 1e-6, "{place:?}: {found} is not {expected}");
        }
    }
}
