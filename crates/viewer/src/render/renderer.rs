//! One renderer for the window and the picture file.

use std::ops::Range;
use std::sync::Arc;

use wgpu::{BindGroup, TextureView};

use super::bindings::Bindings;
use super::brick_atlas::BrickAtlas;
use super::brick_march::{BrickMarch, MOST_OF_STEP};
use super::device_memory::DeviceMemory;
use super::geometry::Geometry;
use super::gpu::Gpu;
use super::lookup_textures::LookupTextures;
use super::ray_march::RayMarch;
use super::slicing::SliceBlending;
use super::target::Target;
use super::uniforms::Uniforms;
use super::volume_textures::{VolumeTextures, WholeVolume, too_large};
use crate::classify::MacrocellRanges;
use crate::reference::SampleCounts;
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
    /// Seconds of the longest pass over the rows that were drawn last.
    longest: f64,
}

/// What of the volume is there, and how it is drawn.
enum Passes {
    Whole(Box<(WholeVolume, RayMarch)>),
    Bricks(Box<(BrickAtlas, BrickMarch)>),
}

impl Passes {
    /// What a shader reads of the volume.
    fn views(&self) -> [TextureView; 4] {
        match self {
            Self::Whole(whole) => whole.0.views(),
            Self::Bricks(bricks) => bricks.0.views(),
        }
    }
}

impl Renderer {
    /// Uploads a volume and compiles the shaders. A volume that takes more of the device's memory than it may, or than
    /// the device has, and one that is in a file, stays where it is, and bricks of it are uploaded when they are
    /// to be seen; others are no longer needed afterwards.
    ///
    /// # Errors
    /// [`crate::Error::VolumeTooLarge`] when not even a few bricks fit the device, [`crate::Error::Device`] when the
    /// device refuses the shaders, [`crate::Error::Normals`] when normals are to be compressed and the device has no such
    /// textures or no room for all of the volume; as [`MacrocellRanges::of`].
    pub fn new(gpu: &Gpu, volume: impl Into<TexelSource>, memory: impl Into<DeviceMemory>) -> Result<Self> {
        let (volume, memory) = (&volume.into(), memory.into());
        let volume_textures = VolumeTextures::new(gpu, volume, memory)?;
        let ranges = MacrocellRanges::of(volume)?;
        gpu.checked("preparing to draw", || {
            let lookup_textures = LookupTextures::new(gpu, volume, ranges);
            let bindings = Bindings::new(gpu, memory.normals);
            let passes = match volume_textures {
                VolumeTextures::Whole(volume) => Passes::Whole(Box::new((volume, RayMarch::new(gpu, &bindings)))),
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
                longest: 0.0,
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

    /// What the volume takes of the device's memory, apart from what is made of it.
    #[must_use]
    pub fn volume_bytes(&self) -> u64 {
        match &self.passes {
            Passes::Whole(whole) => whole.0.bytes(),
            Passes::Bricks(bricks) => bricks.0.bytes(),
        }
    }

    /// Counts the samples of pictures from now on: those of rays through a volume that is there as a whole.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when the device refuses the shaders.
    pub fn count_samples(&mut self) -> Result<()> {
        let Self { gpu, passes, bindings, .. } = self;
        match passes {
            Passes::Whole(whole) => gpu.checked("preparing to count", || whole.1.count_samples(gpu, bindings)),
            Passes::Bricks(_) => Ok(()),
        }
    }

    /// How many samples the last picture took, where they are counted: the CPU's numbers, but for rays on which the two round
    /// differently.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when the device is lost.
    pub fn samples(&self) -> Result<Option<SampleCounts>> {
        match &self.passes {
            Passes::Whole(whole) => whole.1.samples(&self.gpu),
            Passes::Bricks(_) => Ok(None),
        }
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
            Passes::Bricks(_) => Some(self.longest),
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
    /// [`crate::Error::VolumeTooLarge`] when there is no room for the bricks of a step by value, or of a slice in a pixel, [`crate::Error::Pack`] when a
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
            Passes::Whole(whole) => {
                let (_, march) = &mut **whole;
                let Some(slicing) = &frame.slicing else {
                    return march.draw_rows(gpu, &self.bind_group, target, rows);
                };
                march.forget_samples();
                let slice_blending = made(&mut self.slice_blending, gpu, &self.bindings, false)?;
                slice_blending.draw(gpu, &self.bind_group, (&frame, slicing), target, rows)
            }
            Passes::Bricks(bricks)
                if is_by_value && frame.slicing.is_none() && bricks.0.room() < MOST_OF_STEP.min(bricks.0.count()) =>
            {
                let (found, needed) = (bricks.0.room(), MOST_OF_STEP);
                Err(too_large(
                    gpu,
                    format!("there is room for {found} bricks of it, and steps by value need {needed} at once"),
                ))
            }
            Passes::Bricks(bricks) => {
                let (atlas, march) = &mut **bricks;
                let occupancy = self.lookup_textures.occupancy();
                if changes.occupancy {
                    atlas.fill(gpu, occupancy, &frame, watch)?;
                }
                let Some(slicing) = &frame.slicing else {
                    march.draw_rows(
                        gpu,
                        (&self.bindings, &self.bind_group),
                        &uniforms,
                        atlas,
                        target,
                        (rows, watch),
                    )?;
                    self.longest = march.longest();
                    return Ok(());
                };
                // What a step by value needs at its ends need not be drawable.
                let drawable = atlas.drawable(occupancy.filter(|_| frame.classification == Classification::Roles));
                let slice_blending = made(&mut self.slice_blending, gpu, &self.bindings, true)?;
                let bricks = (atlas, drawable.as_slice());
                slice_blending.draw_bricks(gpu, &self.bind_group, (&frame, slicing), bricks, target, (rows, watch))?;
                self.longest = slice_blending.longest();
                Ok(())
            }
        }
    }
}

/// The passes for slices, which are made when they are asked for.
fn made<'a>(
    slice_blending: &'a mut Option<SliceBlending>,
    gpu: &Gpu,
    bindings: &Bindings,
    has_bricks: bool,
) -> Result<&'a mut SliceBlending> {
    Ok(match slice_blending.take() {
        Some(there) => slice_blending.insert(there),
        None => slice_blending.insert(SliceBlending::new(gpu, bindings, has_bricks)?),
    })
}
