//! The CPU ray marcher: the oracle of the GPU one, and what draws where there is no GPU.
//!
//! It follows the shaders chunk by chunk in single precision: [`sampling`] is `sampling.wgsl`, [`shading`] is
//! `shading.wgsl`, and the loop below is `compositing.wgsl`. Pictures of the two differ by rounding alone.

pub mod roles;
pub mod sampling;
pub mod shading;
pub mod value;

use glam::{Vec3, Vec4};
use multiversion::multiversion;
use rayon::prelude::*;

use crate::classify::macrocells::LeapingRay;
use crate::classify::{MacrocellRanges, Occupancy, OpacityTable, ValueTable, correct_opacity};
use crate::frame::{Frame, Interval, Ray};
use crate::scene::lines::lines;
use crate::scene::rasterizer::rasterize;
use crate::scene::{OpaquePixel, Surfaces};
use crate::slicing::Samples;
use crate::state::{Camera, Classification, ViewState};
use crate::volume::{VolumeDescription, VolumeTexels};
use crate::{Error, LightPicture, Picture, PixelLight, Result};

use roles::Roles;
use sampling::{Cell, RoleSample, Sampler};
use shading::shade;
use value::ByValue;

/// Most pixels along a side of a picture: what GPUs take too.
pub const MAX_IMAGE_SIDE: u32 = 16384;

/// What lies this close behind a plane that cuts, in multiples of `L_min`, is lit as the plane is.
pub(crate) const FACE_DEPTH: f32 = 0.5;

/// Draws one state of one volume.
pub struct RayMarcher<'a> {
    volume: &'a VolumeTexels,
    state: ViewState,
    roles: Roles,
    /// What decides where roles do not.
    by_value: Option<ByValue>,
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
        let by_value = match frame.classification {
            Classification::Roles => None,
            Classification::Stored => Some(ByValue::Stored),
            Classification::Value => Some(ByValue::Curve(ValueTable::of(state, description, &frame))),
        };
        let occupancy = occupancy(volume, state, &table, by_value.as_ref(), &frame);
        let surfaces = Surfaces::of(state, volume)?;
        Ok(Self { volume, state: state.clone(), roles, by_value, frame, occupancy, surfaces })
    }

    /// Moves the camera; everything else stays.
    pub fn look_from(&mut self, camera: &Camera) {
        self.state.camera = *camera;
        let (description, reach) = (&self.volume.description, self.frame.reach);
        self.frame = Frame::new(&self.state, description, self.roles.emphases(), self.frame.image_size);
        // Slices stand for longer ways where the angle of view is wider.
        if self.frame.reach != reach {
            let transfer_function = &self.state.transfer_function;
            let table = OpacityTable::new(transfer_function, description.value_range, description.hit_gradient);
            self.occupancy = occupancy(self.volume, &self.state, &table, self.by_value.as_ref(), &self.frame);
        }
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
        sampler.sample(place, Vec3::ZERO, 0.0, &mut Cell::default())
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
        let interval @ Interval { cut, .. } = frame.interval(ray);
        let samples = Samples::new(frame, ray, &interval, first, opaque.along);
        counts.all += samples.count();
        let (mut sum, mut depth) = (Vec4::ZERO, f32::NAN);
        let mut count = 0.0;
        while let Some(sample) = samples.at(count) {
            if sum.w > frame.termination_opacity {
                break;
            }
            let position = ray.origin + sample.along * ray.direction;
            let place = sampler.place(position);
            let empty = self.occupancy.as_ref().map_or(0, |occupancy| occupancy.distance(place.0));
            if empty > 0 {
                // To the first sample beyond all that is known to be empty.
                count = samples.beyond(leaping.leaves(place.0, empty), count);
                continue;
            }
            counts.taken += 1;
            let role = match &self.by_value {
                None => sampler.sample(place, ray.direction, sample.half_step, &mut cell),
                Some(by_value) => sampler.sample_value(by_value, position, ray.direction, sample.half_step),
            };
            if role.opacity > 0.0 {
                let opacity = correct_opacity(role.opacity, sample.step);
                // A face that was cut is lit as such, to a depth that does not depend on the step.
                let lit_by = |normal| shade(role.color, normal, -ray.direction, frame.light, &frame.shading);
                let face = if cut == Vec3::ZERO { 0.0 } else { samples.share_of_face(count, &sample) };
                let color = match face {
                    0.0 => lit_by(role.normal),
                    1.0 => lit_by(cut),
                    _ => lit_by(role.normal).lerp(lit_by(cut), face),
                };
                sum += (1.0 - sum.w) * opacity * color.extend(1.0);
                if depth.is_nan() && sum.w >= 0.5 {
                    depth = sample.along;
                }
            }
            // Not a running sum, whose rounding errors would add up.
            count += 1.0;
        }
        if opaque.is_some() {
            sum += (1.0 - sum.w) * opaque.color.extend(1.0);
            depth = if depth.is_nan() { opaque.along } else { depth };
        }
        PixelLight { light: sum, depth }
    }
}

/// Where something can be drawn; `None` where rays are not to leap.
fn occupancy(
    volume: &VolumeTexels,
    state: &ViewState,
    table: &OpacityTable,
    by_value: Option<&ByValue>,
    frame: &Frame,
) -> Option<Occupancy> {
    if !state.render_settings.leaps {
        return None;
    }
    let ranges = MacrocellRanges::new(volume);
    Some(match by_value {
        None => Occupancy::new(&ranges, table, frame),
        Some(ByValue::Curve(values)) => Occupancy::of_values(&ranges, |range| values.any(range), frame),
        Some(ByValue::Stored) => Occupancy::of_values(&ranges, |[_, high]| high > 0, frame),
    })
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
