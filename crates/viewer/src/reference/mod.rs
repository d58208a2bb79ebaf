//! The CPU ray marcher: the oracle of the GPU one, and what draws where there is no GPU.
//!
//! It follows the shaders chunk by chunk in single precision: [`sampling`] is `sampling.wgsl`, [`shading`] is
//! `shading.wgsl`, and the loop below is `compositing.wgsl`. Pictures of the two differ by rounding alone.

pub mod roles;
pub mod sampling;
pub mod shading;

use glam::{Vec3, Vec4};
use multiversion::multiversion;
use rayon::prelude::*;

use crate::classify::macrocells::LeapingRay;
use crate::classify::{MacrocellRanges, Occupancy, OpacityTable, correct_opacity};
use crate::frame::{Frame, Interval, Ray};
use crate::scene::lines::lines;
use crate::scene::rasterizer::rasterize;
use crate::scene::{OpaquePixel, Surfaces};
use crate::state::{Camera, ViewState};
use crate::volume::{VolumeDescription, VolumeTexels};
use crate::{Error, LightPicture, Picture, PixelLight, Result};

use roles::Roles;
use sampling::{Cell, RoleSample, Sampler};
use shading::shade;

/// Most pixels along a side of a picture: what GPUs take too.
pub const MAX_IMAGE_SIDE: u32 = 16384;

/// What lies this close behind a plane that cuts, in multiples of `L_min`, is lit as the plane is.
pub(crate) const FACE_DEPTH: f32 = 0.5;

/// Draws one state of one volume.
pub struct RayMarcher<'a> {
    volume: &'a VolumeTexels,
    state: ViewState,
    roles: Roles,
    frame: Frame,
    /// Where something can be drawn; `None` where rays do not leap.
    occupancy: Option<Occupancy>,
    surfaces: Surfaces,
}

/// How many samples a picture took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SampleCounts {
    /// Places at which the volume was sampled.
    pub taken: u64,
    /// Places along all rays: what a picture takes whose rays neither leap nor end early.
    pub all: u64,
}

impl SampleCounts {
    /// The share of the samples that was saved, 0 to 1.
    #[must_use]
    pub fn saved(&self) -> f64 {
        if self.all > 0 { 1.0 - self.taken as f64 / self.all as f64 } else { 0.0 }
    }

    /// Of both.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self { taken: self.taken + other.taken, all: self.all + other.all }
    }
}

impl<'a> RayMarcher<'a> {
    /// Makes ready for a picture of `image_size` pixels.
    ///
    /// # Errors
    /// [`Error::PictureSize`] when a side is 0 or longer than [`MAX_IMAGE_SIDE`]; as [`Surfaces::new`].
    pub fn new(volume: &'a VolumeTexels, state: &ViewState, image_size: [u32; 2]) -> Result<Self> {
        let [width, height] = image_size;
        if image_size.iter().any(|side| !(1..=MAX_IMAGE_SIDE).contains(side)) {
            return Err(Error::PictureSize { width, height, limit: MAX_IMAGE_SIDE });
        }
        let description = &volume.description;
        let table = OpacityTable::new(&state.transfer_function, description.value_range, description.hit_gradient);
        let roles = Roles::new(&table, &state.transfer_function);
        let frame = Frame::new(state, description, roles.emphases(), image_size);
        let leaps = state.render_settings.leaps;
        let occupancy = leaps.then(|| Occupancy::new(&MacrocellRanges::new(volume), &table, &frame));
        let surfaces = Surfaces::new(&state.scene, description, |voxel| volume.texels[voxel][0])?;
        Ok(Self { volume, state: state.clone(), roles, frame, occupancy, surfaces })
    }

    /// Moves the camera; everything else stays.
    pub fn look_from(&mut self, camera: &Camera) {
        self.state.camera = *camera;
        self.frame = Frame::new(&self.state, &self.volume.description, self.roles.emphases(), self.frame.image_size);
    }

    /// What camera, settings and volume come to.
    #[must_use]
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// What is drawn.
    #[must_use]
    pub fn state(&self) -> &ViewState {
        &self.state
    }

    /// The volume that is drawn.
    #[must_use]
    pub fn volume(&self) -> &VolumeDescription {
        &self.volume.description
    }

    /// Draws the picture, rows in parallel.
    #[must_use]
    pub fn draw(&self) -> Picture {
        self.draw_and_count().0
    }

    /// Draws the picture, and counts the samples that it takes.
    #[must_use]
    pub fn draw_and_count(&self) -> (Picture, SampleCounts) {
        let (light, counts) = self.light();
        (light.picture(Some(self.frame.background)), counts)
    }

    /// The light of every pixel.
    #[must_use]
    pub fn light(&self) -> (LightPicture, SampleCounts) {
        let [width, height] = self.frame.image_size;
        let mut pixels = vec![PixelLight::NONE; width as usize * height as usize];
        let opaque = self.opaque();
        let rows = pixels.par_chunks_exact_mut(width as usize).enumerate().map(|(y, row)| {
            let opaque = opaque.get(y * width as usize..).unwrap_or_default();
            march_row(self, y as u32, row, opaque)
        });
        let counts = rows.reduce(SampleCounts::default, SampleCounts::plus);
        (LightPicture { width, height, pixels }, counts)
    }

    /// What every pixel shows of opaque geometry, the top row first; empty where there is none.
    #[must_use]
    pub fn opaque(&self) -> Vec<OpaquePixel> {
        if self.state.scene.is_empty() {
            return Vec::new();
        }
        let lines = lines(&self.state, &self.volume.description, &self.frame);
        rasterize(&[&self.surfaces.triangles, &lines], &self.frame)
    }

    /// `α = αu · αd` for a path of `L_min` at a place in index coordinates, voxel centres on integers.
    #[must_use]
    pub fn opacity_at(&self, index: Vec3) -> f32 {
        self.sample_at(index).opacity
    }

    /// Opacity, colour and normal at a place in index coordinates.
    #[must_use]
    pub fn sample_at(&self, index: Vec3) -> RoleSample {
        let sampler = self.sampler();
        let place = sampler.place(index * self.frame.spacing);
        sampler.sample(place, Vec3::ZERO, &mut Cell::default())
    }

    fn sampler(&self) -> Sampler<'_> {
        Sampler::new(self.volume, &self.roles, &self.frame)
    }

    /// Light along a ray, front to back, with the first sample so far into the first step; the ray ends at what is
    /// opaque.
    #[inline(always)]
    fn march(&self, ray: &Ray, first: f32, opaque: &OpaquePixel, counts: &mut SampleCounts) -> PixelLight {
        let frame = &self.frame;
        let sampler = self.sampler();
        let mut cell = Cell::default();
        let leaping = LeapingRay::new(frame, ray);
        let Interval { entry, exit, cut } = frame.interval(ray);
        counts.all += ((exit.min(opaque.along) - entry) / frame.step + (1.0 - first)).max(0.0) as u64;
        let (mut sum, mut depth) = (Vec4::ZERO, f32::NAN);
        // How many steps end before what is opaque: the one that it cuts short counts for its share alone.
        let steps =
            if opaque.along < exit { steps_before(opaque.along - entry, first, frame.step) } else { f32::INFINITY };
        let mut along = entry + first * frame.step;
        let mut count = 0.0;
        while along < exit && count < steps && sum.w <= frame.termination_opacity {
            let place = sampler.place(ray.origin + along * ray.direction);
            let empty = self.occupancy.as_ref().map_or(0, |occupancy| occupancy.distance(place.0));
            if empty > 0 {
                // To the first sample beyond all that is known to be empty.
                let beyond = ((leaping.leaves(place.0, empty) - entry) / frame.step).floor();
                count = beyond.max(count + 1.0);
                along = entry + (count + first) * frame.step;
                continue;
            }
            counts.taken += 1;
            let sample = sampler.sample(place, ray.direction, &mut cell);
            if sample.opacity > 0.0 {
                // A face that was cut is lit as such, to a depth that does not depend on the step.
                let is_on_face = count == 0.0 || along - entry <= FACE_DEPTH;
                let normal = if is_on_face && cut != Vec3::ZERO { cut } else { sample.normal };
                let opacity = correct_opacity(sample.opacity, frame.step);
                sum += (1.0 - sum.w) * opacity * self.lit(&sample, normal, ray);
                if depth.is_nan() && sum.w >= 0.5 {
                    depth = along;
                }
            }
            // Not a running sum, whose rounding errors would add up.
            count += 1.0;
            along = entry + (count + first) * frame.step;
        }
        if steps.is_finite() && sum.w <= frame.termination_opacity {
            let start = entry.max(entry + (steps + first - 0.5) * frame.step);
            sum += (1.0 - sum.w)
                * self.cut_short(
                    ray,
                    [start, opaque.along],
                    if start - entry <= FACE_DEPTH { cut } else { Vec3::ZERO },
                );
            if depth.is_nan() && sum.w >= 0.5 {
                depth = 0.5 * (start + opaque.along);
            }
        }
        if opaque.is_some() {
            sum += (1.0 - sum.w) * opaque.color.extend(1.0);
            depth = if depth.is_nan() { opaque.along } else { depth };
        }
        PixelLight { light: sum, depth }
    }

    /// A sample's colour in the light, and 1.
    #[inline(always)]
    fn lit(&self, sample: &RoleSample, normal: Vec3, ray: &Ray) -> Vec4 {
        shade(sample.color, normal, -ray.direction, self.frame.light, &self.frame.shading).extend(1.0)
    }

    /// What the part of a step adds that lies before something opaque, on a face that was cut where `cut` is not 0.
    fn cut_short(&self, ray: &Ray, [start, end]: [f32; 2], cut: Vec3) -> Vec4 {
        let length = end - start;
        if length <= 0.0 {
            return Vec4::ZERO;
        }
        let half_step = if self.frame.half_step > 0.0 { 0.5 * length } else { 0.0 };
        let frame = Frame { half_step, ..self.frame };
        let sampler = Sampler::new(self.volume, &self.roles, &frame);
        let place = sampler.place(ray.origin + (start + 0.5 * length) * ray.direction);
        let sample = sampler.sample(place, ray.direction, &mut Cell::default());
        if sample.opacity > 0.0 {
            let normal = if cut == Vec3::ZERO { sample.normal } else { cut };
            correct_opacity(sample.opacity, length) * self.lit(&sample, normal, ray)
        } else {
            Vec4::ZERO
        }
    }
}

/// How many of a ray's steps end within a length: they are those around the samples, the first of which lies at
/// `first · step`.
fn steps_before(length: f32, first: f32, step: f32) -> f32 {
    (length / step - first + 0.5).floor().max(0.0)
}

/// A row of pixels, with the processor's own instructions; the bits are the same with any.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2"))]
fn march_row(marcher: &RayMarcher<'_>, y: u32, row: &mut [PixelLight], opaque: &[OpaquePixel]) -> SampleCounts {
    let mut counts = SampleCounts::default();
    for (x, pixel) in row.iter_mut().enumerate() {
        let (ray, first) = (marcher.frame.ray(x as u32, y), marcher.frame.first_sample(x as u32, y));
        let opaque = opaque.get(x).unwrap_or(&OpaquePixel::NONE);
        *pixel = marcher.march(&ray, first, opaque, &mut counts);
    }
    counts
}
