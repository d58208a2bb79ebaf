//! Where the samples of a ray lie.

use crate::frame::{Frame, Interval, Ray};
use crate::slicing::{NEAR, SLACK, Slicing, share_of_face};

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

impl Samples {
    /// Of the part of a ray that is drawn; `share` says where in a step the samples of [`Technique::Rays`] lie. The ray
    /// ends at `opaque` at the latest, which is infinite for none.
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

    /// The share of a sample that lies on the face of a cut: all of the first one, so that a face shows at any step.
    pub fn share_of_face(&self, count: f32, sample: &Sample) -> f32 {
        if count == 0.0 { 1.0 } else { share_of_face(sample.along, sample.step, self.interval[0]) }
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
    pub fn count(&self) -> u64 {
        let [entry, exit] = self.interval;
        if self.whole.is_finite() {
            return self.whole as u64 + u64::from(self.cut_short(self.whole).is_some());
        }
        let count = self.last.map_or((exit - entry) / self.step + (1.0 - self.share), |last| last + 1.0);
        count.max(0.0) as u64
    }
}

#[cfg(test)]
mod tests {
    use voxrole_pack::{GridGeometry, HitGradientQuantization, Precision};

    use super::*;
    use crate::ViewState;
    use crate::classify::EmphasisTable;
    use crate::slicing::tests::frame;
    use crate::state::{Camera, CameraPreset, Projection, Technique};
    use crate::volume::VolumeDescription;

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
}
