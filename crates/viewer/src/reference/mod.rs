//! The CPU ray marcher: the oracle of the GPU one, and what draws where there is no GPU.
//!
//! It follows the shaders chunk by chunk in single precision: `by_role` is `sampling.wgsl`, by the rule of [`sampling`],
//! [`shading`] is `shading.wgsl`, and `rays` and `tile` are `compositing.wgsl`. Pictures of the two differ by rounding alone.
//! What a shader does for one sample is done for sixteen here, in the lanes of vectors: samples of a tile's rays wait until
//! there are many.

mod active_cells;
mod batch;
mod by_role;
mod by_value;
mod corners;
mod gathers;
mod lanes;
#[cfg(test)]
pub(crate) mod naive;
mod occlusion;
mod planes;
mod rays;
pub mod roles;
pub mod sampling;
pub mod shading;
mod steps;
mod tile;

use std::sync::Arc;

use fearless_simd::{Level, Simd, dispatch, f32x16};
use glam::Vec3;
use rayon::prelude::*;
use voxrole_preprocess::simd;

use crate::classify::{LookupTables, MacrocellRanges, MacrocellSamples};
use crate::frame::Frame;
use crate::scene::lines::lines;
use crate::scene::rasterizer::rasterize;
use crate::scene::{OpaquePixel, Surfaces};
use crate::state::{Camera, Classification, ViewState};
use crate::volume::{VolumeDescription, VolumeTexels};
use crate::{Error, LightPicture, Picture, PixelLight, Result, Watch};

use active_cells::ActiveCells;
use by_value::ByValue;
use lanes::{splat, splat_vector};
use planes::Planes;
use roles::Roles;
use sampling::{RoleSample, Sampler};
use tile::{TILE, Tiles};

/// Most pixels along a side of a picture: what GPUs take too.
pub const MAX_IMAGE_SIDE: u32 = 16384;

/// What lies this close behind a plane that cuts, in multiples of `L_min`, is lit as the plane is.
pub(crate) const FACE_DEPTH: f32 = 0.5;

/// Draws one state of one volume.
pub struct RayMarcher<'a> {
    volume: &'a VolumeTexels,
    state: ViewState,
    tables: LookupTables,
    roles: Roles,
    /// Where roles decide and rays may leap: of these roles and the frame's half step, as far as rays have come by.
    active: Option<ActiveCells>,
    /// Where values decide.
    planes: Option<Planes>,
    frame: Frame,
    surfaces: Arc<Surfaces>,
}

/// How many samples a picture took. Where rays go from cell to cell, a cell is one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SampleCounts {
    /// Places at which the volume was sampled; on the CPU some of them behind where their ray turned out to end.
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
    /// [`Error::PictureSize`] when a side is 0 or longer than [`MAX_IMAGE_SIDE`]; [`Error::Pack`] when memory does not suffice; as
    /// [`Surfaces::new`].
    pub fn new(volume: &'a VolumeTexels, state: &ViewState, image_size: [u32; 2]) -> Result<Self> {
        check_size(image_size)?;
        Self::with_surfaces(volume, state, image_size, Arc::new(Surfaces::of(state, volume)?))
    }

    /// The same with the surfaces of the state's scene, where they are there already.
    ///
    /// # Errors
    /// [`Error::PictureSize`] and [`Error::Pack`] as [`Self::new`].
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
        let mut marcher =
            Self { volume, state: state.clone(), tables, roles, active: None, planes: None, frame, surfaces };
        marcher.renew_active(true);
        marcher.renew_planes(&frame)?;
        Ok(marcher)
    }

    /// Draws another state from now on, with the surfaces of its scene, in `image_size` pixels; what is the same is not made
    /// anew.
    ///
    /// # Errors
    /// [`Error::PictureSize`] and [`Error::Pack`] as [`Self::new`].
    pub fn look_at(&mut self, state: &ViewState, image_size: [u32; 2], surfaces: Arc<Surfaces>) -> Result<()> {
        check_size(image_size)?;
        let frame = update(&mut self.tables, self.volume, state, image_size);
        let are_others = self.state.transfer_function != state.transfer_function;
        if are_others {
            self.roles = Roles::new(self.tables.opacity(), &state.transfer_function);
        }
        let is_outdated = are_others || frame.half_step != self.frame.half_step;
        self.renew_planes(&frame)?;
        self.frame = frame;
        self.renew_active(is_outdated);
        self.state = state.clone();
        self.surfaces = surfaces;
        Ok(())
    }

    /// Moves the camera; everything else stays.
    pub fn look_from(&mut self, camera: &Camera) {
        self.state.camera = *camera;
        (self.frame, _) = self.tables.update(&self.state, self.frame.image_size);
    }

    fn renew_active(&mut self, is_outdated: bool) {
        let is_asked = self.frame.classification == Classification::Roles && self.tables.occupancy().is_some();
        match &mut self.active {
            Some(active) if is_asked && is_outdated => active.forget(),
            Some(_) if is_asked => {}
            active => *active = is_asked.then(|| ActiveCells::new(self.tables.macrocells())),
        }
    }

    fn renew_planes(&mut self, frame: &Frame) -> Result<()> {
        if frame.classification != Classification::Value {
            self.planes = None;
        } else if self.planes.is_none() {
            self.planes = Some(Planes::new(self.volume)?);
        }
        Ok(())
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
        self.light_at_level(simd::level(), watch)
    }

    /// The same with some of the processor's instructions: the bits are the same with all.
    fn light_at_level(&self, level: Level, watch: &Watch) -> (LightPicture, SampleCounts) {
        let [width, height] = self.frame.image_size;
        let count = width as usize * height as usize;
        // One thread alone would take a thirtieth of a fast picture's time.
        let mut pixels: Vec<_> = (0..count).into_par_iter().map(|_| PixelLight::NONE).collect();
        let opaque = self.opaque();
        let bands = pixels.par_chunks_mut(TILE * width as usize).enumerate().map(|(band, pixels)| {
            let opaque = opaque.get(band * TILE * width as usize..).unwrap_or_default();
            dispatch!(level, simd => march_band(simd, self, band * TILE, pixels, opaque, watch))
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
        let position = index * self.frame.spacing;
        dispatch!(simd::level(), simd => {
            let [cells, fractions] = sampler.cells(simd, &splat_vector(simd, position));
            let places = sampler.places(&cells, fractions);
            let found = by_role::sample(simd, &sampler, &places, &[splat(simd, 0.0); 3], None);
            let vector = |lanes: [f32x16<_>; 3]| Vec3::from_array(lanes.map(|axis| axis[0]));
            RoleSample { opacity: found.opacity[0], color: vector(found.color), normal: vector(found.normal) }
        })
    }

    /// What decides where roles do not.
    #[inline(always)]
    fn by_value(&self) -> Option<ByValue<'_>> {
        match self.frame.classification {
            Classification::Roles => None,
            Classification::Stored => Some(ByValue::Stored),
            Classification::Value => {
                self.tables.values().zip(self.planes.as_ref()).map(|(table, planes)| ByValue::Curve(table, planes))
            }
        }
    }

    fn sampler(&self) -> Sampler<'_> {
        Sampler::new(self.volume, &self.roles, &self.frame)
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

/// Rows of pixels, of a tile's height.
#[inline(always)]
fn march_band<S: Simd>(
    simd: S,
    marcher: &RayMarcher<'_>,
    first_row: usize,
    pixels: &mut [PixelLight],
    opaque: &[OpaquePixel],
    watch: &Watch,
) -> SampleCounts {
    let width = marcher.frame.image_size[0] as usize;
    let mut counts = SampleCounts::default();
    let mut tiles = Tiles::new(marcher);
    for first in (0..width).step_by(TILE) {
        if watch.is_given_up() {
            return counts;
        }
        counts = counts.plus(tiles.draw(simd, [first, first_row], pixels, opaque));
    }
    watch.add_rows((pixels.len() / width) as u32);
    counts
}
