//! One renderer for the window and the picture file.

use std::ops::Range;
use std::sync::Arc;

use wgpu::{BindGroup, CommandEncoderDescriptor};

use super::geometry::Geometry;
use super::gpu::Gpu;
use super::lookup_textures::LookupTextures;
use super::ray_march::{self, RayMarch};
use super::target::Target;
use super::uniforms::Uniforms;
use super::volume_textures::VolumeTextures;
use crate::Result;
use crate::classify::EmphasisTable;
use crate::frame::Frame;
use crate::scene::Surfaces;
use crate::state::{Scene, TransferFunction, ViewState};
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
    bind_group: BindGroup,
    geometry: Geometry,
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
            let uniforms = ray_march::uniforms(gpu);
            let geometry = Geometry::new(gpu, &uniforms);
            let ray_march = RayMarch::new(gpu, uniforms, geometry.layout());
            let bind_group = ray_march.bind(gpu, volume_textures.view(), &lookup_textures);
            let volume = volume.description.clone();
            Self {
                gpu: gpu.clone(),
                volume,
                emphases: None,
                volume_textures,
                lookup_textures,
                ray_march,
                bind_group,
                geometry,
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

    /// Uploads the surfaces of a scene, and makes room for pictures of a size. What is not prepared is not drawn: pictures of another
    /// size and states with another scene have none.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when the device's memory does not suffice.
    pub fn prepare_scene(&mut self, scene: &Scene, surfaces: &Arc<Surfaces>, size: [u32; 2]) -> Result<()> {
        self.geometry.prepare(&self.gpu, scene, surfaces, size)
    }

    /// Draws the volume over the whole target. Returns before the device has finished.
    pub fn draw(&mut self, state: &ViewState, target: &Target) {
        let [_, height] = target.size();
        self.draw_rows(state, target, 0..height);
    }

    /// Draws some rows of the target, counted from the top, and leaves the others as they are, so that a window can
    /// draw a slow picture in parts. Returns before the device has finished.
    ///
    /// # Panics
    /// When `rows` reach beyond the target.
    pub fn draw_rows(&mut self, state: &ViewState, target: &Target, rows: Range<u32>) {
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
        let mut encoder = gpu.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("picture") });
        let opaque = self.geometry.record(gpu, &mut encoder, state, &self.volume, &frame);
        self.ray_march.record(&mut encoder, [&self.bind_group, opaque], target, rows);
        gpu.queue.submit([encoder.finish()]);
    }
}
