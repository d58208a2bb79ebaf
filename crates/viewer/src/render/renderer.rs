//! One renderer for the window and the picture file.

use std::ops::Range;

use wgpu::{BindGroup, CommandEncoderDescriptor};

use super::gpu::Gpu;
use super::lookup_textures::LookupTextures;
use super::ray_march::RayMarch;
use super::slicing::SliceBlending;
use super::target::Target;
use super::uniforms::Uniforms;
use super::volume_textures::VolumeTextures;
use crate::Result;
use crate::classify::EmphasisTable;
use crate::frame::Frame;
use crate::state::{TransferFunction, ViewState};
use crate::volume::{VolumeDescription, VolumeTexels};

/// A volume on a device, ready to be drawn.
pub struct Renderer {
    gpu: Gpu,
    volume: VolumeDescription,
    /// αd of the last picture, which may be drawn in many parts.
    emphases: Option<(TransferFunction, EmphasisTable)>,
    volume_textures: VolumeTextures,
    lookup_textures: LookupTextures,
    ray_march: RayMarch,
    /// Once slices are asked for.
    slice_blending: Option<SliceBlending>,
    bind_group: BindGroup,
}

impl Renderer {
    /// Uploads a volume and compiles the shaders. The texels are no longer needed afterwards.
    ///
    /// # Errors
    /// [`crate::Error::VolumeTooLarge`] when the volume does not fit the device, [`crate::Error::Device`] when the
    /// device refuses the shaders.
    pub fn new(gpu: &Gpu, volume: &VolumeTexels) -> Result<Self> {
        let volume_textures = VolumeTextures::new(gpu, volume)?;
        gpu.checked("preparing to draw", || {
            let lookup_textures = LookupTextures::new(gpu, volume);
            let ray_march = RayMarch::new(gpu);
            let bind_group = ray_march.bind(gpu, volume_textures.view(), &lookup_textures);
            let volume = volume.description.clone();
            let (emphases, slice_blending) = (None, None);
            Self {
                gpu: gpu.clone(),
                volume,
                emphases,
                volume_textures,
                lookup_textures,
                ray_march,
                slice_blending,
                bind_group,
            }
        })
    }

    /// The device that is drawn on.
    #[must_use]
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The level of detail that is drawn.
    #[must_use]
    pub fn level(&self) -> usize {
        self.volume.level
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
    /// draw a slow picture in parts. Returns before the device has finished.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when the device refuses what slices need; rays need nothing more.
    ///
    /// # Panics
    /// When `rows` reach beyond the target.
    pub fn draw_rows(&mut self, state: &ViewState, target: &Target, rows: Range<u32>) -> Result<()> {
        let gpu = &self.gpu;
        let kept = self.emphases.take().filter(|(of, _)| *of == state.transfer_function);
        let (_, emphases) = self.emphases.insert(
            kept.unwrap_or_else(|| (state.transfer_function.clone(), EmphasisTable::new(&state.transfer_function))),
        );
        let frame = Frame::new(state, &self.volume, emphases, target.size());
        if self.lookup_textures.update(gpu, state, &self.volume, emphases, &frame) {
            self.bind_group = self.ray_march.bind(gpu, self.volume_textures.view(), &self.lookup_textures);
        }
        self.ray_march.set_uniforms(gpu, &Uniforms::from(&frame));
        if let Some(slicing) = &frame.slicing {
            let slice_blending = match self.slice_blending.take() {
                Some(slice_blending) => slice_blending,
                None => SliceBlending::new(gpu, self.ray_march.layout())?,
            };
            let slice_blending = self.slice_blending.insert(slice_blending);
            return slice_blending.draw(gpu, &self.bind_group, (&frame, slicing), target, rows);
        }
        let mut encoder = gpu.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("picture") });
        self.ray_march.record(&mut encoder, &self.bind_group, target, rows);
        gpu.queue.submit([encoder.finish()]);
        Ok(())
    }
}
