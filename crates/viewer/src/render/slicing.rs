//! The passes that draw a volume as slices: all slices into a texture of light, blended back to front, then that over
//! the background.

use std::ops::Range;

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindingResource,
    BlendState, Buffer, BufferDescriptor, BufferUsages, Color, CommandEncoderDescriptor, Extent3d, Features, LoadOp,
    RenderPassColorAttachment, RenderPassDescriptor, RenderPipeline, TextureDescriptor, TextureDimension,
    TextureFormat, TextureUsages, TextureView, TextureViewDescriptor, TextureViewDimension, VertexBufferLayout,
    VertexStepMode, vertex_attr_array,
};

use super::bindings::{Bindings, Pass, attachment, draw_rows, entry, float_texture};
use super::gpu::Gpu;
use super::proxy_geometry::{ProxyGeometry, SliceVertex};
use super::target::Target;
use crate::Result;
use crate::frame::Frame;
use crate::slicing::Slicing;

/// Corners of triangles that are drawn at once: those of some ten thousand slices.
const MOST_VERTICES: usize = 1 << 17;
/// Room for the triangles of the last slice that fits.
const MOST_VERTICES_OF_SLICE: usize = 3 * 32;

/// Pipelines, vertices, and what light is gathered in.
pub struct SliceBlending {
    format: TextureFormat,
    slices: RenderPipeline,
    over_background: RenderPipeline,
    light_layout: BindGroupLayout,
    vertex_buffer: Buffer,
    light: Option<Light>,
}

/// Light premultiplied by opacity, and opacity, of every pixel.
struct Light {
    size: [u32; 2],
    view: TextureView,
    bind_group: BindGroup,
}

impl SliceBlending {
    /// Compiles the shaders.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when the device refuses them.
    pub fn new(gpu: &Gpu, bindings: &Bindings) -> Result<Self> {
        // What a faint slice adds is less than the last place of a half: off by 9/255 for αd = linear,0.1,15 and steps
        // of a quarter.
        let is_single = gpu.device.features().contains(Features::FLOAT32_BLENDABLE);
        let format = if is_single { TextureFormat::Rgba32Float } else { TextureFormat::Rgba16Float };
        gpu.checked("preparing to draw slices", || {
            let light_layout = light_layout(gpu);
            let vertex_buffer = gpu.device.create_buffer(&BufferDescriptor {
                label: Some("slices"),
                size: ((MOST_VERTICES + MOST_VERTICES_OF_SLICE) * size_of::<SliceVertex>()) as u64,
                usage: BufferUsages::VERTEX | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            let attributes = vertex_attr_array![0 => Float32x4, 1 => Float32];
            let vertices = VertexBufferLayout {
                array_stride: size_of::<SliceVertex>() as u64,
                step_mode: VertexStepMode::Vertex,
                attributes: &attributes,
            };
            let slices = bindings.pipeline(
                gpu,
                &Pass {
                    vertices: ("slice_vertex", &[Some(vertices)]),
                    blend: Some(BlendState::PREMULTIPLIED_ALPHA_BLENDING),
                    ..Pass::new("slice_fragment", &[format])
                },
            );
            let pass = Pass { own: Some(&light_layout), ..Pass::new("slices_over_background", &[Target::FORMAT]) };
            let over_background = bindings.pipeline(gpu, &pass);
            Self { format, slices, over_background, light_layout, vertex_buffer, light: None }
        })
    }

    /// Draws some rows of the target; the others stay as they are. Uniforms are the frame's already.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when the device has no room for the light.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        bind_group: &BindGroup,
        (frame, slicing): (&Frame, &Slicing),
        target: &Target,
        rows: Range<u32>,
    ) -> Result<()> {
        let light = match self.light.take().filter(|light| light.size == target.size()) {
            Some(light) => light,
            None => gpu.checked("making room for slices", || self.light(gpu, target.size()))?,
        };
        let light = self.light.insert(light);
        let [width, height] = target.size();
        assert!(rows.start <= rows.end && rows.end <= height, "rows {rows:?} reach beyond {height}");
        let mut geometry = ProxyGeometry::new(frame, slicing);
        let mut vertices = Vec::new();
        let mut load = LoadOp::Clear(Color::TRANSPARENT);
        loop {
            vertices.clear();
            geometry.add_triangles(MOST_VERTICES, &mut vertices);
            gpu.queue.write_buffer(&self.vertex_buffer, 0, bytemuck::cast_slice(&vertices));
            let is_last = vertices.len() < MOST_VERTICES;
            let mut encoder = gpu.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("slices") });
            {
                let mut pass = encoder.begin_render_pass(&pass("slices", &[attachment(&light.view, load)]));
                pass.set_scissor_rect(0, rows.start, width, rows.end - rows.start);
                pass.set_pipeline(&self.slices);
                pass.set_bind_group(0, bind_group, &[]);
                pass.set_vertex_buffer(0, self.vertex_buffer.slice(..));
                pass.draw(0..vertices.len() as u32, 0..1);
            }
            // Before the next vertices are written into the same buffer.
            gpu.queue.submit([encoder.finish()]);
            if is_last {
                break;
            }
            load = LoadOp::Load;
        }
        let attachments = [attachment(target.view(), LoadOp::Load)];
        draw_rows(gpu, &self.over_background, &[bind_group, &light.bind_group], &attachments, (width, rows));
        Ok(())
    }

    fn light(&self, gpu: &Gpu, size: [u32; 2]) -> Light {
        let texture = gpu.device.create_texture(&TextureDescriptor {
            label: Some("light of slices"),
            size: Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format: self.format,
            usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let view = texture.create_view(&TextureViewDescriptor::default());
        let bind_group = gpu.device.create_bind_group(&BindGroupDescriptor {
            label: Some("light of slices"),
            layout: &self.light_layout,
            entries: &[BindGroupEntry { binding: 0, resource: BindingResource::TextureView(&view) }],
        });
        Light { size, view, bind_group }
    }
}

fn pass<'a>(
    label: &'a str,
    color_attachments: &'a [Option<RenderPassColorAttachment<'a>>],
) -> RenderPassDescriptor<'a> {
    RenderPassDescriptor { label: Some(label), color_attachments, ..RenderPassDescriptor::default() }
}

fn light_layout(gpu: &Gpu) -> BindGroupLayout {
    gpu.device.create_bind_group_layout(&BindGroupLayoutDescriptor {
        label: Some("light of slices"),
        entries: &[entry(0, float_texture(TextureViewDimension::D2))],
    })
}
