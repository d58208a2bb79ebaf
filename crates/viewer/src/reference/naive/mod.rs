//! The naive twin of the ray marcher: one ray and one sample after another, nothing leapt over, corner by corner.

pub(crate) mod cells;
pub(crate) mod samples;

use glam::{UVec3, Vec3, Vec4};
use voxrole_pack::quantization::decode_normal;

use super::RayMarcher;
use super::by_value::ByValue;
use super::occlusion::Darkening;
use super::sampling::RoleSample;
use super::shading::Lighting;
use crate::classify::preintegration::{LEVEL, LEVELS, PreintegrationTable, SHORTEST, STRETCHES};
use crate::classify::{EmphasisTable, correct_opacity};
use crate::frame::{Frame, Interval, Ray};
use crate::scene::OpaquePixel;
use crate::slicing::share_of_face;
use crate::{LightPicture, PixelLight, VolumeTexels};

use cells::CellRay;
use samples::{Sample, Samples};

/// The light of every pixel, and how many samples there are along all rays.
pub(super) fn light(marcher: &RayMarcher<'_>) -> (LightPicture, u64) {
    let naive = Naive::new(marcher);
    let [width, height] = naive.frame.image_size;
    let opaque = marcher.opaque();
    let mut all = 0;
    let pixels = (0..width * height).map(|pixel| {
        let opaque = opaque.get(pixel as usize).unwrap_or(&OpaquePixel::NONE);
        naive.follow(pixel % width, pixel / width, opaque, &mut all)
    });
    (LightPicture { width, height, pixels: pixels.collect() }, all)
}

/// What is found at a place in index coordinates, over half a step along a ray to either side, by the rule of
/// [`super::sampling`].
pub(super) fn sample_role(
    marcher: &RayMarcher<'_>,
    cell: UVec3,
    fraction: Vec3,
    direction: Vec3,
    half: f32,
) -> RoleSample {
    Naive::new(marcher).role(cell, fraction, direction, half)
}

pub(super) struct Naive<'a> {
    marcher: &'a RayMarcher<'a>,
    frame: &'a Frame,
    emphases: &'a EmphasisTable,
    integrals: PreintegrationTable,
}

impl<'a> Naive<'a> {
    pub(super) fn new(marcher: &'a RayMarcher<'a>) -> Self {
        let emphases = marcher.tables.emphases();
        Self { marcher, frame: &marcher.frame, emphases, integrals: PreintegrationTable::new(emphases) }
    }

    /// The voxels around a place in the frame's space, and their weights.
    pub(super) fn weighted_texels(&self, position: Vec3) -> impl Iterator<Item = (f32, [u16; 4])> {
        let (cell, fraction) = self.place(position);
        self.corners(cell, fraction).map(|(weight, _, texel)| (weight, texel))
    }

    fn follow(&self, x: u32, y: u32, opaque: &OpaquePixel, all: &mut u64) -> PixelLight {
        let frame = self.frame;
        let ray = frame.ray(x, y);
        let interval @ Interval { entry, exit, cut } = frame.interval(&ray);
        let mut light = Light { marcher: self.marcher, ray, cut, sum: Vec4::ZERO, depth: f32::NAN };
        let samples = Samples::new(frame, &ray, &interval, frame.first_sample(x, y), opaque.along);
        if !frame.goes_by_cells {
            *all += samples.count();
            for count in 0.. {
                let Some(sample) = samples.at(count as f32) else { break };
                let face = samples.share_of_face(count as f32, &sample);
                light.add(&self.step(&ray, &sample), sample.along, sample.step, face);
            }
            return light.before(opaque);
        }
        let mut exit = exit.min(opaque.along);
        if frame.slicing.is_some() && samples.count() == 0 {
            exit = entry;
        }
        let cells = CellRay::new(frame, &ray);
        *all += cells.count([entry, exit]);
        let (mut along, mut cell) = (entry, cells.cell(entry));
        while along < exit {
            let exits = cells.exits(cell);
            let end = exits.min_element().min(exit);
            let count = ((end - along) / (2.0 * frame.half_step)).ceil();
            let step = (end - along) / count;
            for piece in 0..count as u32 {
                let middle = along + (piece as f32 + 0.5) * step;
                let fraction = cells.fraction(cell, middle);
                let role = self.role(cell.as_uvec3(), fraction, ray.direction, 0.5 * step);
                light.add(&role, middle, step, share_of_face(middle, step, entry));
            }
            (along, cell) = (end, cells.next(cell, exits));
        }
        light.before(opaque)
    }

    /// A sample at equal distances.
    fn step(&self, ray: &Ray, sample: &Sample) -> RoleSample {
        let place = |along: f32| self.place(ray.origin + along * ray.direction);
        let (cell, fraction) = place(sample.along);
        let table = match self.marcher.by_value() {
            None => return self.role(cell, fraction, ray.direction, 0.0),
            Some(ByValue::Stored) => {
                let mean = |channel: usize| self.mean(cell, fraction, |texel| f32::from(texel[channel])) / 65535.0;
                return RoleSample { opacity: mean(0), color: Vec3::splat(mean(2)), normal: Vec3::ZERO };
            }
            Some(ByValue::Curve(table, _)) => table,
        };
        let value = |along: f32| {
            let (cell, fraction) = place(along);
            self.mean(cell, fraction, |texel| f32::from(texel[0]))
        };
        let half = if self.frame.half_step > 0.0 { sample.half_step } else { 0.0 };
        let light = table.look_up(value(sample.along - half), value(sample.along + half));
        let mut normal = Vec3::ZERO;
        for (weight, _, texel) in self.corners(cell, fraction) {
            if VolumeTexels::has_hit(texel) {
                normal += weight * decode_normal(texel[3]).unwrap_or(Vec3::ZERO);
            }
        }
        RoleSample { opacity: light.w, color: light.truncate(), normal: unit_or_zero(normal) }
    }

    /// The cell of a place in the frame's space, by its lowest voxel, and where in it the place lies.
    fn place(&self, position: Vec3) -> (UVec3, Vec3) {
        let last = Vec3::from_array(self.frame.dims.map(|dim| (dim - 1) as f32));
        let index = (position * self.frame.spacing.recip()).clamp(Vec3::ZERO, last);
        let base = index.floor().min((last - 1.0).max(Vec3::ZERO));
        (base.as_uvec3(), index - base)
    }

    /// The corners of a cell: weight, place in it, texel.
    fn corners(&self, cell: UVec3, fraction: Vec3) -> impl Iterator<Item = (f32, Vec3, [u16; 4])> {
        let dims = UVec3::from_array(self.frame.dims);
        (0..8).map(move |corner| {
            let at = UVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
            let [x, y, z] = (cell + at).min(dims - 1).as_usizevec3().to_array();
            let texel = self.marcher.volume.texels[(z * dims.y as usize + y) * dims.x as usize + x];
            let at = at.as_vec3();
            ((at * fraction + (1.0 - at) * (1.0 - fraction)).element_product(), at, texel)
        })
    }

    fn mean(&self, cell: UVec3, fraction: Vec3, of: impl Fn([u16; 4]) -> f32) -> f32 {
        self.corners(cell, fraction).map(|(weight, _, texel)| weight * of(texel)).sum()
    }

    fn role(&self, cell: UVec3, fraction: Vec3, direction: Vec3, half_step: f32) -> RoleSample {
        let frame = self.frame;
        let value = self.mean(cell, fraction, |texel| f32::from(texel[0]));
        let (mut opacity, mut color, mut normal) = (0.0, Vec3::ZERO, Vec3::ZERO);
        for (weight, at, texel) in self.corners(cell, fraction).filter(|(_, _, texel)| VolumeTexels::has_hit(*texel)) {
            let ([red, green, blue, by_role], emphasis) = self.marcher.tables.opacity().look_up(value, texel[2]);
            let own = decode_normal(texel[3]).unwrap_or(Vec3::ZERO);
            let stored = f32::from(texel[1] as i16) * frame.distance_scale;
            let distance = stored + own.dot((fraction - at) * frame.spacing);
            let by_both = if frame.half_step > 0.0 {
                let half = (own.dot(direction).abs() * half_step).max(0.5 * SHORTEST);
                let integral = |distance| self.integral(emphasis, by_role, distance);
                1.0 - ((integral(distance - half) - integral(distance + half)) / (2.0 * half)).exp()
            } else {
                by_role * self.emphases.look_up(emphasis, distance)
            };
            let share = weight * by_both;
            opacity += share;
            color += share * Vec3::new(red, green, blue);
            normal += share * own;
        }
        if opacity <= 0.0 {
            return RoleSample::default();
        }
        RoleSample { opacity: opacity.min(1.0), color: color / opacity, normal: unit_or_zero(normal / opacity) }
    }

    /// The integral of the optical depth from 0 to a distance.
    fn integral(&self, emphasis: usize, by_role: f32, distance: f32) -> f32 {
        let row = 2 * emphasis + usize::from(distance < 0.0);
        let place = (distance.abs() * STRETCHES as f32 / self.emphases.d_c(row)).min(STRETCHES as f32);
        let level = (LEVELS - 1) as f32 * (1.0 - (1.0 - by_role).sqrt());
        let lower = (level as usize).min(LEVELS - 2);
        let at = |level: usize| {
            let numbers = &self.integrals.numbers()[(row * LEVELS + level) * LEVEL..][..LEVEL];
            let stretch = place as usize;
            numbers[stretch] + (place - stretch as f32) * (numbers[stretch + 1] - numbers[stretch])
        };
        (at(lower) + (level - lower as f32) * (at(lower + 1) - at(lower))).copysign(distance)
    }
}

/// What a ray has gathered.
struct Light<'a> {
    marcher: &'a RayMarcher<'a>,
    ray: Ray,
    cut: Vec3,
    sum: Vec4,
    depth: f32,
}

impl Light<'_> {
    fn add(&mut self, role: &RoleSample, along: f32, step: f32, face: f32) {
        let frame = &self.marcher.frame;
        if role.opacity <= 0.0 || self.sum.w > frame.termination_opacity {
            return;
        }
        let lighting = Lighting::new(-self.ray.direction, frame.light, &frame.shading);
        let darkening = self.marcher.tables.occlusion().map(|occlusion| Darkening::new(occlusion, frame, &self.ray));
        let own = darkening.map_or(1.0, |darkening| darkening.light_at(along)) * role.color;
        let mut color = lighting.shade(own, role.normal);
        if self.cut != Vec3::ZERO {
            color = color.lerp(lighting.shade(own, self.cut), face);
        }
        self.sum += (1.0 - self.sum.w) * correct_opacity(role.opacity, step) * color.extend(1.0);
        if self.depth.is_nan() && self.sum.w >= 0.5 {
            self.depth = along;
        }
    }

    fn before(mut self, opaque: &OpaquePixel) -> PixelLight {
        if opaque.is_some() {
            self.sum += (1.0 - self.sum.w) * opaque.color.extend(1.0);
            self.depth = if self.depth.is_nan() { opaque.along } else { self.depth };
        }
        PixelLight { light: self.sum, depth: self.depth }
    }
}

fn unit_or_zero(vector: Vec3) -> Vec3 {
    if vector.length_squared() > 1e-8 { vector.normalize() } else { Vec3::ZERO }
}

#[cfg(test)]
pub(super) mod tests {
    use fearless_simd::Level;
    use proptest::prelude::*;
    use voxrole_pack::{DistanceQuantization, GridGeometry, HitGradientQuantization, Precision};

    use super::*;
    use crate::ViewState;
    use crate::Watch;
    use crate::state::{Camera, Classification, Integration, Projection, Region, Technique};
    use crate::volume::VolumeDescription;

    /// Voxels that have nothing to do with those beside them.
    pub(in crate::reference) fn volume(dims: [u32; 3], seed: u64) -> VolumeTexels {
        let geometry = GridGeometry::axis_aligned(dims, [1.0, 1.5, 2.0]);
        let hit_gradient = HitGradientQuantization::new(0.0, 1.0, Precision::default());
        let description = VolumeDescription::new(&geometry, 4.0, [0.0, 1.0], hit_gradient);
        let mut state = seed;
        let mut next = || {
            // Knuth's generator, of which the upper bits are good.
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as u16
        };
        let texels = (0..dims.iter().product()).map(|_| {
            let (value, distance, gradient, normal) = (next(), next(), next(), next());
            match next() % 8 {
                0 => [value, DistanceQuantization::MASKED as u16, gradient, normal],
                1 => [value, distance, 0, normal],
                // All within a few spacings.
                _ => [value, ((distance as i16) / 2) as u16, gradient.max(1), normal],
            }
        });
        VolumeTexels { description, texels: texels.collect() }
    }

    fn technique() -> impl Strategy<Value = (Technique, Integration, Classification)> {
        let techniques = prop::sample::select(Technique::ALL.to_vec());
        let integrations = [Integration::PostClassified, Integration::Preintegrated, Integration::FrontToBack];
        let classifications = [Classification::Roles, Classification::Value, Classification::Stored];
        (techniques, prop::sample::select(integrations.to_vec()), prop::sample::select(classifications.to_vec()))
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]
        #[test]
        fn rays_side_by_side_gather_what_each_would(
            (technique, integration, classification) in technique(),
            dims in prop::array::uniform3(1_u32..9),
            seed in any::<u64>(),
            (azimuth, elevation, zoom) in (0_u32..24, 0_u32..13, 0.7_f32..3.0),
            (is_parallel, jitter, cuts, has_box, darkens) in any::<(bool, bool, bool, bool, bool)>(),
            (step, opacity) in (prop::sample::select(vec![0.06_f32, 0.3, 1.0, 2.7]), 0.1_f32..1.0),
            curve in prop::sample::select(vec![
                "0.1,FF0000,0;0.5,00FF00,0.6;0.9,0000FF,0.1",
                "0.3,FF0000,0;0.32,00FF00,0.4;0.34,00FF00,0;0.6,FF0000,0;0.61,0000FF,0.9;0.63,0000FF,0",
            ]),
        ) {
            let volume = volume(dims, seed);
            // Multiples of 15 degrees: along axes and diagonals too.
            let (azimuth, elevation) = (15.0 * azimuth as f32, 15.0 * elevation as f32 - 90.0);
            let projection = if is_parallel { Projection::Orthographic } else { Projection::Perspective };
            let camera = Camera { azimuth, elevation, zoom, projection, ..Camera::default() };
            let mut state = ViewState { camera, ..ViewState::default() };
            let region = |text: String| -> Region { text.parse().expect("a region") };
            let own = Some("linear,0.5,2".parse().expect("an emphasis"));
            state.transfer_function.regions = vec![
                region(format!("0:0.8,0.1:0.7,FF8000,{opacity},0.5")),
                Region { emphasis: own, ..region("0.3:1,0.2:1,0080FF,0.4,0.5".to_owned()) },
            ];
            state.transfer_function.curve = curve.parse().expect("a curve");
            state.transfer_function.classification = classification;
            let settings = &mut state.render_settings;
            (settings.technique, settings.integration, settings.step, settings.jitter) = (technique, integration, step, jitter);
            settings.shading.occlusion = if darkens { 0.7 } else { 0.0 };
            state.scene.bounding_box = has_box;
            if cuts {
                state.clipping.planes = vec!["40,10,0.1".parse().expect("a plane"), "200,-30,0.4".parse().expect("a plane")];
            }
            let marcher = RayMarcher::new(&volume, &state, [19, 21]).expect("a picture");
            let ((found, counts), (expected, all)) = (marcher.light(), light(&marcher));
            prop_assert_eq!(counts.all, all);
            // On every processor.
            let (plain, _) = marcher.light_at_level(Level::baseline(), &Watch::default());
            let bits = |picture: &LightPicture| -> Vec<_> {
                picture.pixels.iter().map(|pixel| (pixel.light.to_array().map(f32::to_bits), pixel.depth.to_bits())).collect()
            };
            prop_assert_eq!(bits(&found), bits(&plain));
            let (mut sum, mut moved) = (0.0, 0);
            for (pixel, (found, expected)) in found.pixels.iter().zip(&expected.pixels).enumerate() {
                let off = (found.light - expected.light).abs().max_element();
                // A value on a bin's end may be in either bin.
                prop_assert!(off < 0.01, "{pixel}: {} is not {}", found.light, expected.light);
                sum += off;
                // Half of the light may just lie behind the next sample.
                let is_same = (found.depth - expected.depth).abs() < 1e-3 || found.depth.is_nan() && expected.depth.is_nan();
                moved += u32::from(!is_same);
            }
            prop_assert!(moved <= 2, "{moved}");
            prop_assert!(sum / (found.pixels.len() as f32) < 3e-4, "{sum}");
        }
    }

    /// All that roles light of random voxels, from cell to cell.
    fn state(camera: Camera) -> ViewState {
        let mut state = ViewState { camera, ..ViewState::default() };
        state.transfer_function.regions = vec!["0:0.8,0.1:0.7,FF8000,0.5".parse().expect("a region")];
        state
    }

    #[test]
    fn rays_that_all_but_follow_a_plane_come_to_an_end() {
        let volume = volume([7; 3], 1);
        for leaps in [true, false] {
            let drawn = [0.0, 1e-25, -1e-25].map(|azimuth| {
                let mut state = state(Camera { azimuth, elevation: 0.0, ..Camera::default() });
                state.render_settings.leaps = leaps;
                // Through the middle of an odd number of pixels.
                RayMarcher::new(&volume, &state, [15, 15]).expect("a picture").light().0
            });
            for picture in &drawn[1..] {
                for (found, expected) in picture.pixels.iter().zip(&drawn[0].pixels) {
                    assert!((found.light - expected.light).abs().max_element() < 1e-4, "{found:?} is not {expected:?}");
                }
            }
        }
    }

    #[test]
    fn rays_from_far_away_come_to_an_end() {
        let mut volume = volume([16, 16, 8192], 2);
        // With much to leap over.
        for (index, texel) in volume.texels.iter_mut().enumerate().filter(|(index, _)| index / 256 % 64 > 8) {
            *texel = [0, DistanceQuantization::MASKED as u16, 0, index as u16];
        }
        let ([field_of_view, _], [zoom, _]) = (Camera::FIELD_OF_VIEW_RANGE, Camera::ZOOM_RANGE);
        for (azimuth, elevation) in [(30.0, 80.0), (200.0, -5.0), (0.0, 90.0), (17.0, -89.0)] {
            let state = state(Camera { azimuth, elevation, zoom, field_of_view, ..Camera::default() });
            let (_, counts) = RayMarcher::new(&volume, &state, [255, 255]).expect("a picture").light();
            assert!(counts.all > 0, "{counts:?}");
        }
    }
}
