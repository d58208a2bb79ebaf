//! What is drawn into: a texture off the screen, shown by the window or read back for a file.

use std::sync::mpsc;

use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, COPY_BYTES_PER_ROW_ALIGNMENT, CommandEncoderDescriptor, Extent3d, MapMode,
    PollType, TexelCopyBufferInfo, TexelCopyBufferLayout, Texture, TextureDescriptor, TextureDimension, TextureFormat,
    TextureUsages, TextureView, TextureViewDescriptor,
};

use super::gpu::Gpu;
use crate::{Error, Picture, Result};

/// A texture to draw into.
#[derive(Debug)]
pub struct Target {
    texture: Texture,
    view: TextureView,
}

impl Target {
    /// Display values, 8 bits a channel, as egui shows them without conversion.
    pub const FORMAT: TextureFormat = TextureFormat::Rgba8Unorm;

    /// A target of `width` times `height` pixels.
    ///
    /// # Errors
    /// [`Error::PictureSize`] when a side is 0 or longer than the device's textures, [`Error::Device`] when its memory
    /// does not suffice.
    pub fn new(gpu: &Gpu, [width, height]: [u32; 2]) -> Result<Self> {
        let limit = gpu.device.limits().max_texture_dimension_2d;
        if [width, height].iter().any(|side| !(1..=limit).contains(side)) {
            return Err(Error::PictureSize { width, height, limit });
        }
        let texture = gpu.checked("making room for the picture", || {
            gpu.device.create_texture(&TextureDescriptor {
                label: Some("picture"),
                size: Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format: Self::FORMAT,
                usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_SRC,
                view_formats: &[],
            })
        })?;
        let view = texture.create_view(&TextureViewDescriptor::default());
        Ok(Self { texture, view })
    }

    /// Width and height in pixels.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        [self.texture.width(), self.texture.height()]
    }

    /// What is drawn into, and what a window shows.
    #[must_use]
    pub fn view(&self) -> &TextureView {
        &self.view
    }

    /// Waits for what was drawn and copies it into memory.
    ///
    /// # Errors
    /// [`Error::Device`] when the device is lost or its memory does not suffice.
    pub fn read_back(&self, gpu: &Gpu) -> Result<Picture> {
        let [width, height] = self.size();
        let rgba = read_back(gpu, &self.texture, height, "reading the picture back")?;
        Ok(Picture { width, height, rgba })
    }
}

/// Waits for what was drawn into a texture and copies its first rows into memory.
///
/// # Errors
/// [`Error::Device`] when the device is lost or its memory does not suffice.
pub(super) fn read_back(gpu: &Gpu, texture: &Texture, rows: u32, action: &'static str) -> Result<Vec<u8>> {
    // Of a format without blocks.
    let texel_bytes = texture.format().block_copy_size(None).unwrap_or(0);
    let row_bytes = texture.width() * texel_bytes;
    let padded_row_bytes = row_bytes.next_multiple_of(COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = gpu.checked(action, || copy_to_buffer(gpu, texture, rows, padded_row_bytes))?;

    let (sender, receiver) = mpsc::channel();
    // A device that is lost complains of this first.
    gpu.checked(action, || {
        buffer.map_async(MapMode::Read, .., move |mapped| {
            // A receiver that is gone has already reported why.
            let _ = sender.send(mapped);
        });
    })?;
    gpu.device.poll(PollType::wait_indefinitely()).map_err(|error| gpu.error(action, &error))?;
    receiver.recv().map_err(|error| gpu.error(action, &error))?.map_err(|error| gpu.error(action, &error))?;
    let mapped = buffer.get_mapped_range(..).map_err(|error| gpu.error(action, &error))?;
    let mut bytes = Vec::with_capacity(row_bytes as usize * rows as usize);
    for row in mapped.chunks_exact(padded_row_bytes as usize) {
        bytes.extend_from_slice(&row[..row_bytes as usize]);
    }
    Ok(bytes)
}

fn copy_to_buffer(gpu: &Gpu, texture: &Texture, rows: u32, padded_row_bytes: u32) -> Buffer {
    let buffer = gpu.device.create_buffer(&BufferDescriptor {
        label: Some("picture in memory"),
        size: u64::from(padded_row_bytes) * u64::from(rows),
        usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("read back") });
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        TexelCopyBufferInfo {
            buffer: &buffer,
            layout: TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(padded_row_bytes),
                rows_per_image: Some(rows),
            },
        },
        Extent3d { height: rows, ..texture.size() },
    );
    gpu.queue.submit([encoder.finish()]);
    buffer
}
