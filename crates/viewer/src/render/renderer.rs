//! One renderer for the window and the picture file.

use std::ops::Range;
use std::sync::Arc;

use wgpu::{BindGroup, TextureView};

use super::bindings::Bindings;
use super::brick_atlas::BrickAtlas;
use super::brick_march::{BrickMarch, MOST_OF_STEP};
use super::geometry::Geometry;
use super::gpu::Gpu;
use super::lookup_textures::LookupTextures;
use super::ray_march::RayMarch;
use super::slicing::SliceBlending;
use super::target::Target;
use super::uniforms::Uniforms;
use super::volume_textures::{VolumeTextures, too_large};
use crate::classify::MacrocellRanges;
use crate::scene::Surfaces;
use crate::state::{Classification, Scene, ViewState};
use crate::streaming::TexelSource;
use crate::volume::VolumeDescription;
use crate::{Result, Watch};

/// A volume on a device, ready to be drawn.
pub struct Renderer {
    gpu: Gpu,
    volume: VolumeDescription,
    lookup_textures: LookupTextures,
    bindings: Bindings,
    /// Once slices are asked for.
    slice_blending: Option<SliceBlending>,
    bind_group: BindGroup,
    passes: Passes,
    geometry: Geometry,
    /// Which of its textures are bound.
    bound_geometry: u64,
}

/// What of the volume is there, and how it is drawn.
enum Passes {
    Whole([TextureView; 2], RayMarch),
    Bricks(Box<(BrickAtlas, BrickMarch)>),
}

impl Passes {
    /// What a shader reads of the volume.
    fn views(&self) -> [TextureView; 2] {
        match self {
            Self::Whole(views, _) => views.clone(),
            Self::Bricks(bricks) => bricks.0.views(),
        }
    }
}

impl Renderer {
    /// Uploads a volume and compiles the shaders. A volume that takes more of the device's memory than `budget` bytes,
    /// or than the device has, and one that is in a file, stays where it is, and bricks of it are uploaded when they are
    /// to be seen; others are no longer needed afterwards.
    ///
    /// # Errors
    /// [`crate::Error::VolumeTooLarge`] when not even a few bricks fit the device, [`crate::Error::Device`] when the
    /// device refuses the shaders; as [`MacrocellRanges::of`].
    pub fn new(gpu: &Gpu, volume: impl Into<TexelSource>, budget: Option<u64>) -> Result<Self> {
        let volume = &volume.into();
        let volume_textures = VolumeTextures::new(gpu, volume, budget)?;
        let ranges = MacrocellRanges::of(volume)?;
        gpu.checked("preparing to draw", || {
            let lookup_textures = LookupTextures::new(gpu, volume, ranges);
            let bindings = Bindings::new(gpu);
            let passes = match volume_textures {
                VolumeTextures::Whole(views) => Passes::Whole(views, RayMarch::new(gpu, &bindings)),
                VolumeTextures::Bricks(atlas) => Passes::Bricks(Box::new((atlas, BrickMarch::new(gpu, &bindings)))),
            };
            let geometry = Geometry::new(gpu, bindings.uniforms());
            let (opaque, bound_geometry) = geometry.views(&ViewState::default(), [1, 1]);
            let bind_group = bindings.bind(gpu, passes.views(), &lookup_textures, opaque);
            let volume = volume.description().clone();
            let (gpu, slice_blending) = (gpu.clone(), None);
            Self {
                gpu,
                volume,
                lookup_textures,
                bindings,
                slice_blending,
                bind_group,
                passes,
                geometry,
                bound_geometry,
            }
        })
    }

    /// The device that is drawn on.
    #[must_use]
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// What is drawn.
    #[must_use]
    pub fn volume(&self) -> &VolumeDescription {
        &self.volume
    }

    /// The level of detail that is drawn.
    #[must_use]
    pub fn level(&self) -> usize {
        self.volume.level
    }

    /// Uploads the surfaces of a scene, and makes room for pictures of a size. What is not prepared is not drawn:
    /// pictures of another size and states with another scene have none.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when the device's memory does not suffice.
    pub fn prepare_scene(&mut self, scene: &Scene, surfaces: &Arc<Surfaces>, size: [u32; 2]) -> Result<()> {
        self.geometry.prepare(&self.gpu, scene, surfaces, size)
    }

    /// How many bricks were brought to the device so far, where there is no room for all of the volume.
    #[must_use]
    pub fn bricks_uploaded(&self) -> Option<u64> {
        match &self.passes {
            Passes::Whole(..) => None,
            Passes::Bricks(bricks) => Some(bricks.0.uploads()),
        }
    }

    /// Seconds for which the device worked without a break on the rows that were drawn last, where it gives back how far
    /// it came in between because bricks are brought to it.
    #[must_use]
    pub fn longest_pass(&self) -> Option<f64> {
        match &self.passes {
            Passes::Whole(..) => None,
            Passes::Bricks(bricks) => Some(bricks.1.longest()),
        }
    }

    /// Draws the volume over the whole target. Returns before the device has finished.
    ///
    /// # Errors
    /// As [`Self::draw_rows`].
    pub fn draw(&mut self, state: &ViewState, target: &Target) -> Result<()> {
        let [_, height] = target.size();
        self.draw_rows(state, target, 0..height)
    }

    /// Draws some rows of the target, counted from the top, and leaves the others as they are, so that a window can
    /// draw a slow picture in parts. May return before the device has finished.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when the device refuses what slices need or is lost while bricks are brought to it,
    /// [`crate::Error::VolumeTooLarge`] for slices of a volume that comes brick by brick, [`crate::Error::Pack`] when a
    /// brick of a file is damaged, [`crate::Error::TooMuchMemory`] when memory does not suffice for its occlusion.
    ///
    /// # Panics
    /// When `rows` reach beyond the target.
    pub fn draw_rows(&mut self, state: &ViewState, target: &Target, rows: Range<u32>) -> Result<()> {
        self.draw_watched_rows(state, target, rows, &Watch::default())
    }

    /// The same; where the picture is given up while bricks are brought, some of the rows are left as they are.
    ///
    /// # Errors
    /// As [`Self::draw_rows`].
    ///
    /// # Panics
    /// As [`Self::draw_rows`].
    pub fn draw_watched_rows(
        &mut self,
        state: &ViewState,
        target: &Target,
        rows: Range<u32>,
        watch: &Watch,
    ) -> Result<()> {
        let [_, height] = target.size();
        assert!(rows.start <= rows.end && rows.end <= height, "rows {rows:?} reach beyond {height}");
        let gpu = &self.gpu;
        let (frame, changes) = self.lookup_textures.update(gpu, state, target.size())?;
        let (opaque, geometry) = self.geometry.views(state, target.size());
        if changes.textures || geometry != self.bound_geometry {
            self.bind_group = self.bindings.bind(gpu, self.passes.views(), &self.lookup_textures, opaque);
            self.bound_geometry = geometry;
        }
        let uniforms = Uniforms::from(&frame);
        self.bindings.set_uniforms(gpu, &uniforms);
        self.geometry.draw(gpu, state, &self.volume, &frame);
        let is_by_value = frame.classification == Classification::Value;
        match &mut self.passes {
            Passes::Whole(_, march) => {
                let Some(slicing) = &frame.slicing else {
                    march.draw_rows(gpu, &self.bind_group, target, rows);
                    return Ok(());
                };
                let slice_blending = match self.slice_blending.take() {
                    Some(slice_blending) => slice_blending,
                    None => SliceBlending::new(gpu, &self.bindings)?,
                };
                let slice_blending = self.slice_blending.insert(slice_blending);
                slice_blending.draw(gpu, &self.bind_group, (&frame, slicing), target, rows)
            }
            Passes::Bricks(_) if frame.slicing.is_some() => {
                Err(too_large(gpu, "slices need all of it there; draw it with rays".into()))
            }
            Passes::Bricks(bricks) if is_by_value && bricks.0.room() < MOST_OF_STEP => {
                let (found, needed) = (bricks.0.room(), MOST_OF_STEP);
                Err(too_large(
                    gpu,
                    format!("there is room for {found} bricks of it, and steps by value need {needed} at once"),
                ))
            }
            Passes::Bricks(bricks) => {
                let (atlas, march) = &mut **bricks;
                if changes.occupancy {
                    atlas.fill(gpu, self.lookup_textures.occupancy(), &frame)?;
                }
                march.draw_rows(gpu, (&self.bindings, &self.bind_group), &uniforms, atlas, target, (rows, watch))
            }
        }
    }
}
