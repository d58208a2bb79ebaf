//! The CPU ray marcher: the oracle of the GPU one, and what draws where there is no GPU.
//!
//! It follows the shaders chunk by chunk in single precision: [`sampling`] is `sampling.wgsl`, [`shading`] is
//! `shading.wgsl`, and the loop below is `compositing.wgsl`. Pictures of the two differ by rounding alone.

pub mod cell;
mod corners;
mod lanes;
mod occlusion;
pub mod roles;
pub mod sampling;
pub mod shading;
mod value;

use std::sync::Arc;

use fearless_simd::{Simd, dispatch};
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use voxrole_preprocess::simd;

use crate::cells::CellRay;
use crate::classify::macrocells::LeapingRay;
use crate::classify::{LookupTables, MacrocellRanges, MacrocellSamples, correct_opacity};
use crate::frame::{Frame, Interval, Ray};
use crate::scene::lines::lines;
use crate::scene::rasterizer::rasterize;
use crate::scene::{OpaquePixel, Surfaces};
use crate::slicing::{Sample, Samples};
use crate::state::{Camera, Classification, ViewState};
use crate::volume::{VolumeDescription, VolumeTexels};
use crate::{Error, LightPicture, Picture, PixelLight, Result, Watch};

use cell::Cell;
use occlusion::Darkening;
use roles::Roles;
use sampling::{RoleSample, Sampler};
use shading::Lighting;
use value::{ByValue, ValueSampler};

/// Most pixels along a side of a picture: what GPUs take too.
pub const MAX_IMAGE_SIDE: u32 = 16384;

/// Pixels along a side of a tile.
const TILE: usize = 16;

/// What lies this close behind a plane that cuts, in multiples of `L_min`, is lit as the plane is.
pub(crate) const FACE_DEPTH: f32 = 0.5;

/// Draws one state of one volume.
pub struct RayMarcher<'a> {
    volume: &'a VolumeTexels,
    state: ViewState,
    tables: LookupTables,
    roles: Roles,
    frame: Frame,
    surfaces: Arc<Surfaces>,
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
        check_size(image_size)?;
        Self::with_surfaces(volume, state, image_size, Arc::new(Surfaces::of(state, volume)?))
    }

    /// The same with the surfaces of the state's scene, where they are there already.
    ///
    /// # Errors
    /// [`Error::PictureSize`] as [`Self::new`].
    pub fn with_surfaces(
        volume: &'a VolumeTexels,
        state: &ViewState,
        image_size: [u32; 2],
        surfaces: Arc<Surfaces>,
    ) -> Result<Self> {
        check_size(image_size)?;
        let mut tables = LookupTables::new(&volume.description, MacrocellRanges::new(volume));
        let frame = update(&mut tables, volume, state, image_size);
        let roles = Roles::new(tables.opacity(), &state.transfer_function);
        Ok(Self { volume, state: state.clone(), tables, roles, frame, surfaces })
    }

    /// Draws another state from now on, with the surfaces of its scene, in `image_size` pixels; what is the same is not made
    /// anew.
    ///
    /// # Errors
    /// [`Error::PictureSize`] as [`Self::new`].
    pub fn look_at(&mut self, state: &ViewState, image_size: [u32; 2], surfaces: Arc<Surfaces>) -> Result<()> {
        check_size(image_size)?;
        self.frame = update(&mut self.tables, self.volume, state, image_size);
        if self.state.transfer_function != state.transfer_function {
            self.roles = Roles::new(self.tables.opacity(), &state.transfer_function);
        }
        self.state = state.clone();
        self.surfaces = surfaces;
        Ok(())
    }

    /// Moves the camera; everything else stays.
    pub fn look_from(&mut self, camera: &Camera) {
        self.state.camera = *camera;
        (self.frame, _) = self.tables.update(&self.state, self.frame.image_size);
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

    /// Draws the picture, bands of rows in parallel.
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
        self.watched_light(&Watch::default())
    }

    /// The light of every pixel, or of some of them alone where the picture is given up meanwhile.
    #[must_use]
    pub fn watched_light(&self, watch: &Watch) -> (LightPicture, SampleCounts) {
        let [width, height] = self.frame.image_size;
        let mut pixels = vec![PixelLight::NONE; width as usize * height as usize];
        let opaque = self.opaque();
        let bands = pixels.par_chunks_mut(TILE * width as usize).enumerate().map(|(band, pixels)| {
            let opaque = opaque.get(band * TILE * width as usize..).unwrap_or_default();
            dispatch!(simd::level(), simd => march_band(simd, self, (band * TILE) as u32, pixels, opaque, watch))
        });
        let counts = bands.reduce(SampleCounts::default, SampleCounts::plus);
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
        dispatch!(simd::level(), simd => {
            let (mut cell, (base, fraction)) = (Cell::none(simd), place);
            let is_active = cell.enter(simd, &sampler, base, Vec3::ZERO);
            if is_active { cell.sample(simd, &sampler, [fraction], 0.0)[0] } else { RoleSample::default() }
        })
    }

    /// What decides where roles do not.
    #[inline(always)]
    fn by_value(&self) -> Option<ByValue<'_>> {
        match self.frame.classification {
            Classification::Roles => None,
            Classification::Stored => Some(ByValue::Stored),
            Classification::Value => self.tables.values().map(ByValue::Curve),
        }
    }

    fn sampler(&self) -> Sampler<'_> {
        Sampler::new(self.volume, &self.roles, &self.frame)
    }

    /// Light along a ray, front to back, with samples at equal distances, the first one so far into the first step; the ray
    /// ends at what is opaque.
    #[inline(always)]
    fn march_steps<S: Simd>(
        &self,
        simd: S,
        ray: &Ray,
        first: f32,
        opaque: &OpaquePixel,
        counts: &mut SampleCounts,
    ) -> PixelLight {
        let frame = &self.frame;
        let sampler = self.sampler();
        let occupancy = self.tables.occupancy();
        let mut by_value = self.by_value().map(|by_value| ValueSampler::new(simd, by_value));
        let mut cell = Cell::none(simd);
        let leaping = LeapingRay::new(frame, ray);
        let interval @ Interval { cut, .. } = frame.interval(ray);
        let samples = Samples::new(frame, ray, &interval, first, opaque.along);
        counts.all += samples.count();
        let mut light = RayLight::new(self, ray, cut);
        let mut count = 0.0;
        while let Some(sample) = samples.at(count) {
            if light.is_opaque() {
                break;
            }
            let place = sampler.place(ray.origin + sample.along * ray.direction);
            let empty = occupancy.map_or(0, |occupancy| occupancy.distance(place.0));
            if empty > 0 {
                // To the first sample beyond all that is known to be empty.
                count = samples.beyond(leaping.leaves(place.0, empty), count);
                continue;
            }
            counts.taken += 1;
            let role = match &mut by_value {
                Some(by_value) => by_value.sample(simd, &sampler, place, ray, samples.ends(count, &sample)),
                None if !cell.enter(simd, &sampler, place.0, ray.direction) => RoleSample::default(),
                None => cell.sample(simd, &sampler, [place.1], sample.half_step)[0],
            };
            if role.opacity > 0.0 {
                // A face that was cut is lit as such, to a depth that does not depend on the step.
                let face = if cut == Vec3::ZERO { 0.0 } else { samples.share_of_face(count, &sample) };
                light.add(&role, &sample, face);
            }
            // Not a running sum, whose rounding errors would add up.
            count += 1.0;
        }
        light.before(opaque)
    }

    /// Light along a ray, front to back, from cell to cell: what lies in each is cut into equal pieces, so that the voxels
    /// that decide are the same along all of a piece, and nothing of the ray is left out.
    #[inline(always)]
    fn march_cells<S: Simd>(&self, simd: S, ray: &Ray, opaque: &OpaquePixel, counts: &mut SampleCounts) -> PixelLight {
        let frame = &self.frame;
        let sampler = self.sampler();
        let occupancy = self.tables.occupancy();
        let mut cell = Cell::none(simd);
        let interval @ Interval { entry, exit, cut } = frame.interval(ray);
        let mut exit = exit.min(opaque.along);
        // Slices together stand for all of a ray that meets any.
        if frame.slicing.is_some() && Samples::new(frame, ray, &interval, 0.5, opaque.along).count() == 0 {
            exit = entry;
        }
        let cells = CellRay::new(frame, ray);
        counts.all += cells.count([entry, exit]);
        let mut light = RayLight::new(self, ray, cut);
        let (mut along, mut place) = (entry, cells.cell(entry));
        while along < exit && !light.is_opaque() {
            let base = place.as_uvec3();
            let empty = occupancy.map_or(0, |occupancy| occupancy.distance(base));
            if empty > 0 {
                along = cells.leaves(place, empty);
                place = cells.cell(along);
                continue;
            }
            counts.taken += 1;
            let exits = cells.exits(place);
            let end = exits.min_element().min(exit);
            if cell.enter(simd, &sampler, base, ray.direction) {
                let count = ((end - along) / (2.0 * frame.half_step)).ceil();
                let step = (end - along) / count;
                let middle = |piece: f32| along + (piece + 0.5) * step;
                let fraction = |piece| cells.fraction(place, middle(piece));
                let mut piece = 0.0;
                while piece < count && !light.is_opaque() {
                    let mut roles = [RoleSample::default(); 2];
                    if piece + 1.0 < count {
                        roles = cell.sample(simd, &sampler, [fraction(piece), fraction(piece + 1.0)], 0.5 * step);
                    } else {
                        [roles[0]] = cell.sample(simd, &sampler, [fraction(piece)], 0.5 * step);
                    }
                    for role in &roles {
                        if role.opacity > 0.0 && !light.is_opaque() {
                            let sample = Sample { along: middle(piece), step, half_step: 0.5 * step };
                            light.add(role, &sample, if cut == Vec3::ZERO { 0.0 } else { sample.share_of_face(entry) });
                        }
                        piece += 1.0;
                    }
                }
            }
            (along, place) = (end, cells.next(place, exits));
        }
        light.before(opaque)
    }
}

/// What a ray has gathered.
struct RayLight<'a> {
    frame: &'a Frame,
    lighting: Lighting,
    darkening: Option<Darkening<'a>>,
    /// Normal of the plane that the ray entered through, 0 where that does not cut.
    cut: Vec3,
    sum: Vec4,
    depth: f32,
}

impl<'a> RayLight<'a> {
    #[inline(always)]
    fn new(marcher: &'a RayMarcher<'_>, ray: &Ray, cut: Vec3) -> Self {
        let frame = &marcher.frame;
        let lighting = Lighting::new(-ray.direction, frame.light, &frame.shading);
        let darkening = marcher.tables.occlusion().map(|occlusion| Darkening::new(occlusion, frame, ray));
        Self { frame, lighting, darkening, cut, sum: Vec4::ZERO, depth: f32::NAN }
    }

    /// Whether nothing behind would be seen.
    #[inline(always)]
    fn is_opaque(&self) -> bool {
        self.sum.w > self.frame.termination_opacity
    }

    /// Adds a sample, of which a share lies on the face of a cut.
    #[inline(always)]
    fn add(&mut self, role: &RoleSample, sample: &Sample, face: f32) {
        let opacity = correct_opacity(role.opacity, sample.step);
        let own = self.darkening.as_ref().map_or(role.color, |darkening| darkening.light_at(sample.along) * role.color);
        let color = self.lighting.shade(own, role.normal);
        let color = if face > 0.0 { color.lerp(self.lighting.shade(own, self.cut), face) } else { color };
        self.sum += (1.0 - self.sum.w) * opacity * color.extend(1.0);
        if self.depth.is_nan() && self.sum.w >= 0.5 {
            self.depth = sample.along;
        }
    }

    /// All of it, with what is opaque behind.
    #[inline(always)]
    fn before(mut self, opaque: &OpaquePixel) -> PixelLight {
        if opaque.is_some() {
            self.sum += (1.0 - self.sum.w) * opaque.color.extend(1.0);
            self.depth = if self.depth.is_nan() { opaque.along } else { self.depth };
        }
        PixelLight { light: self.sum, depth: self.depth }
    }
}

fn check_size([width, height]: [u32; 2]) -> Result<()> {
    let is_drawn = [width, height].iter().all(|side| (1..=MAX_IMAGE_SIDE).contains(side));
    if is_drawn { Ok(()) } else { Err(Error::PictureSize { width, height, limit: MAX_IMAGE_SIDE }) }
}

/// Brings the tables of a volume up to date with a state.
fn update(tables: &mut LookupTables, volume: &VolumeTexels, state: &ViewState, image_size: [u32; 2]) -> Frame {
    if state.render_settings.shading.occlusion <= 0.0 {
        tables.drop_samples();
    } else if !tables.has_samples() {
        tables.set_samples(MacrocellSamples::new(volume));
    }
    tables.update(state, image_size).0
}

/// Rows of pixels, tile by tile: rays beside each other read the same voxels.
#[inline(always)]
fn march_band<S: Simd>(
    simd: S,
    marcher: &RayMarcher<'_>,
    first_row: u32,
    pixels: &mut [PixelLight],
    opaque: &[OpaquePixel],
    watch: &Watch,
) -> SampleCounts {
    let frame = &marcher.frame;
    let width = frame.image_size[0] as usize;
    let mut counts = SampleCounts::default();
    for first in (0..width).step_by(TILE) {
        if watch.is_given_up() {
            return counts;
        }
        for (row, pixels) in pixels.chunks_exact_mut(width).enumerate() {
            let y = first_row + row as u32;
            for (x, pixel) in pixels.iter_mut().enumerate().skip(first).take(TILE) {
                let ray = frame.ray(x as u32, y);
                let opaque = opaque.get(row * width + x).unwrap_or(&OpaquePixel::NONE);
                *pixel = if frame.goes_by_cells {
                    marcher.march_cells(simd, &ray, opaque, &mut counts)
                } else {
                    let first = frame.first_sample(x as u32, y);
                    marcher.march_steps(simd, &ray, first, opaque, &mut counts)
                };
            }
        }
    }
    watch.add_rows((pixels.len() / width) as u32);
    counts
}
