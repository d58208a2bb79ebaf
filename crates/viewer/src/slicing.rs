//! Slices through a volume, and where along a ray its samples lie.
//!
//! Space between two neighbouring planes halfway between slices is a slab; a slice stands for the part of each ray that
//! lies in its slab, so that its step is the slab's thickness over the cosine of the ray's angle to it. A ray's first
//! and last slice stand for all that is left up to where the ray enters and leaves: nothing is counted twice, and
//! nothing is left out where a ray meets any slice at all. What of a volume lies between two slices, as a corner of it
//! may, is not seen.

use glam::Vec3;

use crate::frame::{Frame, Interval, PixelRays, Ray};
use crate::reference::FACE_DEPTH;
use crate::state::Technique;

/// How far outside of what is drawn a slice still counts for a ray, in slabs, and at most [`NEAR`]: rounding must not
/// decide over slices that lie on a volume's very face.
pub(crate) const SLACK: f32 = 1.0 / 32.0;
/// Slices nearer than this to an eye within the volume are not seen, in multiples of `L_min`.
pub(crate) const NEAR: f32 = 0.01;
/// Rays that meet slices at a smaller cosine than one over this are integrated as if it was that one.
const MOST_STRETCH: f32 = 16.0;

/// Parallel slices at equal distances. Slab k reaches from number k to number k + 1, and its slice is at k + 1/2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slicing {
    /// By how much numbers grow along each axis: the slices' normal, over the distance between two of them.
    pub growth: Vec3,
    /// The number of the place at the origin, negated.
    pub offset: f32,
    /// At least half of what a slice stands for along any ray.
    pub longest_half_step: f32,
}

impl Slicing {
    /// The slices of a technique, `step` apart or, for [`Technique::Stacks`], a whole fraction of the voxels' distance
    /// that is no larger; `None` for rays.
    #[must_use]
    pub fn new(
        technique: Technique,
        rays: &PixelRays,
        [box_low, box_high]: [Vec3; 2],
        spacing: Vec3,
        step: f32,
    ) -> Option<Self> {
        let widest = (rays.direction_right.length_squared() + rays.direction_up.length_squared()).sqrt();
        let (normal, distance, offset, angle) = match technique {
            Technique::Rays => return None,
            Technique::Slices => {
                let normal = rays.direction.normalize_or(Vec3::Z);
                // One of them goes through the middle, however thin the volume is.
                (normal, step, normal.dot(0.5 * (box_low + box_high)) / step - 0.5, 0.0)
            }
            Technique::Stacks => {
                let axis = [Vec3::X, Vec3::Y, Vec3::Z][rays.direction.abs().max_position()];
                let between = spacing.dot(axis);
                // Rounding must not make one more of a whole number.
                let parts = (between / step - 1e-3).ceil().max(1.0);
                // No axis is farther from the nearest one than a cube's diagonal.
                (axis, between / parts, -0.5, 2.0_f32.sqrt().atan())
            }
        };
        // Whatever the camera's angles: what leaps depends on this.
        let cosine = (angle + widest.atan()).cos();
        let stretch = if cosine * MOST_STRETCH > 1.0 { (16.0 / cosine - 1e-3).ceil() / 16.0 } else { MOST_STRETCH };
        Some(Self { growth: normal / distance, offset, longest_half_step: stretch * distance })
    }

    /// The number at a place.
    #[must_use]
    #[inline(always)]
    pub fn number(&self, place: Vec3) -> f32 {
        self.growth.dot(place) - self.offset
    }
}

/// Where the samples of a ray lie.
#[derive(Clone, Copy, Debug)]
pub struct Samples {
    interval: [f32; 2],
    /// Where the first step begins: at the entry, or with the first slice's slab.
    start: f32,
    step: f32,
    /// Where in its step a sample lies.
    share: f32,
    half_step: f32,
    /// For slices how many follow the first one; negative for none.
    last: Option<f32>,
    /// For rays how many steps end before something opaque: the one that it cuts short counts for its share alone.
    whole: f32,
}

/// One of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Where along the ray it lies.
    pub along: f32,
    /// How much of the ray it stands for.
    pub step: f32,
    /// Half of that where opacity is integrated along it; 0 where its middle counts for all of it.
    pub half_step: f32,
}

impl Sample {
    /// The share of it that lies on the face of a cut through which its ray enters so far along.
    #[must_use]
    #[inline(always)]
    pub fn share_of_face(&self, entry: f32) -> f32 {
        ((entry + FACE_DEPTH - self.along) / self.step + 0.5).clamp(0.0, 1.0)
    }
}

impl Samples {
    /// Of the part of a ray that is drawn; `share` says where in a step the samples of [`Technique::Rays`] lie. The ray
    /// ends at `opaque` at the latest, which is infinite for none.
    #[must_use]
    #[inline(always)]
    pub fn new(frame: &Frame, ray: &Ray, interval: &Interval, share: f32, opaque: f32) -> Self {
        let (step, half_step, entry) = (frame.step, frame.half_step, interval.entry);
        let ends = [entry, interval.exit.min(opaque)];
        let whole = if opaque < interval.exit {
            // Samples lie in the middles of steps, the first one so far into the ray's first step.
            ((opaque - entry) / step - share + 0.5).floor().max(0.0)
        } else {
            f32::INFINITY
        };
        match &frame.slicing {
            None => Self { interval: ends, start: entry, step, share, half_step, last: None, whole },
            Some(slicing) => Self::on_slices(slicing, ray, ends, half_step),
        }
    }

    #[inline(always)]
    fn on_slices(slicing: &Slicing, ray: &Ray, interval: [f32; 2], half_step: f32) -> Self {
        let along = slicing.growth.dot(ray.direction);
        // Counted in the ray's direction.
        let (origin, per_length) = (slicing.number(ray.origin) * 1.0_f32.copysign(along), along.abs());
        let slack = SLACK.min(NEAR * per_length);
        // A ray that starts within the volume sees no slice that its eye lies in.
        let before = if interval[0] > 0.0 { slack } else { -NEAR * slicing.growth.length() };
        let [first, last] = [
            (origin + interval[0] * per_length - 0.5 - before).ceil(),
            (origin + interval[1] * per_length - 0.5 + slack).floor(),
        ];
        let last = if interval[1] > interval[0] { last - first } else { -1.0 };
        let step = per_length.recip();
        Self {
            interval,
            start: (first - origin) * step,
            step,
            share: 0.5,
            half_step,
            last: Some(last),
            whole: f32::INFINITY,
        }
    }

    /// The sample with a number, counted from 0; `None` behind the last one.
    #[must_use]
    #[inline(always)]
    pub fn at(&self, count: f32) -> Option<Sample> {
        let [entry, exit] = self.interval;
        let Some(last) = self.last else {
            if count >= self.whole {
                return self.cut_short(count);
            }
            let along = self.start + (count + self.share) * self.step;
            return (along < exit).then_some(Sample { along, step: self.step, half_step: self.half_step });
        };
        if count > last {
            return None;
        }
        let begin = if count == 0.0 { entry } else { self.start + count * self.step };
        let end = if count == last { exit } else { self.start + (count + 1.0) * self.step };
        let step = end - begin;
        Some(Sample { along: 0.5 * (begin + end), step, half_step: self.half_step.min(0.5 * step) })
    }

    /// The ends of what opacity is integrated along at a sample with a number, where it is. Of [`Technique::Rays`] one begins where
    /// the one before ends, without a rounding between.
    #[must_use]
    #[inline(always)]
    pub fn ends(&self, count: f32, sample: &Sample) -> Option<[f32; 2]> {
        if sample.half_step <= 0.0 {
            return None;
        }
        if self.last.is_none() && count < self.whole {
            return Some([count, count + 1.0].map(|count| self.start + (count + (self.share - 0.5)) * self.step));
        }
        Some([sample.along - sample.half_step, sample.along + sample.half_step])
    }

    /// The step that ends at something opaque.
    fn cut_short(&self, count: f32) -> Option<Sample> {
        let [entry, exit] = self.interval;
        let start = entry.max(entry + (self.whole + self.share - 0.5) * self.step);
        let step = exit - start;
        let sample = Sample { along: start + 0.5 * step, step, half_step: self.half_step.min(0.5 * step) };
        (count == self.whole && step > 0.0).then_some(sample)
    }

    /// How many there are.
    #[must_use]
    pub fn count(&self) -> u64 {
        let [entry, exit] = self.interval;
        if self.whole.is_finite() {
            return self.whole as u64 + u64::from(self.cut_short(self.whole).is_some());
        }
        let count = self.last.map_or((exit - entry) / self.step + (1.0 - self.share), |last| last + 1.0);
        count.max(0.0) as u64
    }

    /// The share of a sample that lies on the face of a cut: all of the first one, so that a face shows at any step.
    #[must_use]
    #[inline(always)]
    pub fn share_of_face(&self, count: f32, sample: &Sample) -> f32 {
        if count == 0.0 { 1.0 } else { sample.share_of_face(self.interval[0]) }
    }

    /// The number of a sample that follows `count`, and that no sample precedes that lies beyond a place along the ray.
    #[must_use]
    #[inline(always)]
    pub fn beyond(&self, place: f32, count: f32) -> f32 {
        ((place - self.start) / self.step).floor().max(count + 1.0)
    }
}

#[cfg(test)]
mod tests {
    use voxrole_pack::{GridGeometry, HitGradientQuantization, Precision};

    use super::*;
    use crate::ViewState;
    use crate::classify::EmphasisTable;
    use crate::state::{Camera, CameraPreset, Projection};
    use crate::volume::VolumeDescription;

    fn frame(technique: Technique, camera: Camera, dims: [u32; 3], step: f32) -> Frame {
        let geometry = GridGeometry::axis_aligned(dims, [1.0, 2.0, 3.0]);
        let hit_gradient = HitGradientQuantization::new(0.0, 1.0, Precision::default());
        let volume = VolumeDescription::new(&geometry, 15.0, [0.0, 1.0], hit_gradient);
        let mut state = ViewState { camera, ..ViewState::default() };
        state.render_settings.technique = technique;
        state.render_settings.step = step;
        state.clipping.planes = vec!["40,10,0.3".parse().expect("a plane")];
        Frame::new(&state, &volume, &EmphasisTable::new(&state.transfer_function), [32, 24])
    }

    fn samples_of(samples: &Samples) -> Vec<Sample> {
        (0..).map_while(|count| samples.at(count as f32)).collect()
    }

    #[test]
    fn slices_stand_for_all_of_a_ray_that_meets_any() {
        for technique in [Technique::Slices, Technique::Stacks] {
            for (zoom, projection) in
                [(1.0, Projection::Perspective), (8.0, Projection::Perspective), (1.0, Projection::Orthographic)]
            {
                for (azimuth, elevation) in [(0.0, 0.0), (30.0, 20.0), (170.0, -60.0)] {
                    let camera = Camera { azimuth, elevation, zoom, projection, ..Camera::default() };
                    let frame = frame(technique, camera, [20, 12, 9], 0.3);
                    let mut met = 0;
                    for pixel in 0..32 * 24 {
                        let ray = frame.ray(pixel % 32, pixel / 32);
                        let interval = frame.interval(&ray);
                        let samples = Samples::new(&frame, &ray, &interval, 0.5, f32::INFINITY);
                        let found = samples_of(&samples);
                        assert_eq!(found.len() as u64, samples.count());
                        let Some(first) = found.first() else { continue };
                        met += 1;
                        // Without a gap from one to the next.
                        let mut end = interval.entry;
                        for sample in &found {
                            assert!((sample.along - 0.5 * sample.step - end).abs() < 1e-3, "{sample:?} after {end}");
                            assert!(sample.half_step <= 0.5 * sample.step && sample.step > 0.0);
                            end = sample.along + 0.5 * sample.step;
                        }
                        assert!((end - interval.exit).abs() < 1e-3 && first.along >= interval.entry);
                    }
                    assert!(met > 40, "{technique:?} {camera}: {met} rays");
                }
            }
        }
    }

    #[test]
    fn what_is_integrated_along_a_ray_begins_where_the_step_before_ends() {
        let frame = frame(Technique::Rays, Camera::default(), [20, 12, 9], 0.3);
        let (ray, share) = (frame.ray(16, 12), 0.7);
        let interval = frame.interval(&ray);
        for opaque in [f32::INFINITY, 0.5 * (interval.entry + interval.exit)] {
            let samples = Samples::new(&frame, &ray, &interval, share, opaque);
            let found = samples_of(&samples);
            let mut end = None;
            for (count, sample) in found.iter().enumerate() {
                let ends = samples.ends(count as f32, sample).expect("is integrated");
                let is_cut_short = opaque.is_finite() && count + 1 == found.len();
                assert!(is_cut_short || end.is_none_or(|end| end == ends[0]), "{ends:?} after {end:?}");
                let middle = 0.5 * (ends[0] + ends[1]);
                assert!((middle - sample.along).abs() < 1e-4 && (ends[1] - ends[0] - sample.step).abs() < 1e-4);
                end = Some(ends[1]);
            }
            assert!(found.len() > 10);
        }
    }

    #[test]
    fn stacks_hold_the_voxels_planes() {
        // 3 voxel spacings along z, in steps of at most 1.25: two planes between.
        let frame = frame(Technique::Stacks, Camera::from_preset(CameraPreset::Top), [20, 12, 9], 1.25);
        let slicing = frame.slicing.expect("slices");
        assert_eq!(slicing.growth, Vec3::Z);
        for plane in 0..9 {
            let number = slicing.number(Vec3::new(3.0, 5.0, 3.0 * plane as f32));
            assert_eq!(number - number.floor(), 0.5);
        }
    }

    #[test]
    fn a_slice_goes_through_a_volume_of_one_voxel_s_thickness() {
        for technique in [Technique::Slices, Technique::Stacks] {
            let camera = Camera { projection: Projection::Orthographic, ..Camera::from_preset(CameraPreset::Top) };
            let frame = frame(technique, camera, [20, 12, 1], 16.0);
            let ray = frame.ray(16, 12);
            let samples = samples_of(&Samples::new(&frame, &ray, &frame.interval(&ray), 0.5, f32::INFINITY));
            assert_eq!(samples.len(), 1, "{samples:?}");
            assert!((samples[0].step - 3.0).abs() < 1e-3, "{samples:?}");
        }
    }

    #[test]
    fn steps_are_counted_to_the_end_however_long_a_volume_is() {
        let geometry = GridGeometry::axis_aligned([2, 2, 3000], [1.0, 1.0, 1000.0]);
        let hit_gradient = HitGradientQuantization::new(0.0, 1.0, Precision::default());
        let volume = VolumeDescription::new(&geometry, 15.0, [0.0, 1.0], hit_gradient);
        for technique in Technique::ALL {
            let camera = Camera { projection: Projection::Orthographic, ..Camera::from_preset(CameraPreset::Top) };
            let mut state = ViewState { camera, ..ViewState::default() };
            (state.render_settings.technique, state.render_settings.step) = (technique, 1.0 / 64.0);
            let frame = Frame::new(&state, &volume, &EmphasisTable::new(&state.transfer_function), [1, 1]);
            let ray = frame.ray(0, 0);
            let samples = Samples::new(&frame, &ray, &frame.interval(&ray), 0.5, f32::INFINITY);
            let last = samples.count() as f32;
            assert!(last > 1e5 && last < 8_388_608.0, "{technique:?}: {last} samples");
            assert!(samples.at(last - 1.0).is_some() && samples.at(last + 1.0).is_none());
        }
    }

    #[test]
    fn what_leaps_does_not_depend_on_the_camera_s_angles() {
        for technique in Technique::ALL {
            let reach = |azimuth| frame(technique, Camera { azimuth, ..Camera::default() }, [20, 12, 9], 0.25).reach;
            assert!((0..90).all(|angle| reach(angle as f32 * 4.1) == reach(0.0)), "{technique:?}");
        }
    }
}
