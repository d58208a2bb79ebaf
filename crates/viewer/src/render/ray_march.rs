//! The pass that draws a volume: one triangle over the target, one ray a pixel.

use std::ops::Range;

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry,
    BindingResource, BindingType, Buffer, BufferBindingType, BufferDescriptor, BufferUsages, ColorTargetState,
    ColorWrites, CommandEncoder, FragmentState, LoadOp, MultisampleState, Operations, PipelineCompilationOptions,
    PipelineLayoutDescriptor, PrimitiveState, RenderPassColorAttachment, RenderPassDescriptor, RenderPipeline,
    RenderPipelineDescriptor, ShaderModuleDescriptor, ShaderSource, ShaderStages, StoreOp, TextureSampleType,
    TextureView, TextureViewDimension, VertexState,
};

use super::gpu::Gpu;
use super::lookup_textures::LookupTextures;
use super::shader;
use super::target::Target;
use super::uniforms::Uniforms;

/// The pipeline and its uniform buffer.
pub struct RayMarch {
    pipeline: RenderPipeline,
    layout: BindGroupLayout,
    uniforms: Buffer,
}

impl RayMarch {
    /// Compiles the shaders; `opaque` is the layout of what the rays end at.
    pub fn new(gpu: &Gpu, uniforms: Buffer, opaque: &BindGroupLayout) -> Self {
        let layout = gpu.device.create_bind_group_layout(&BindGroupLayoutDescriptor {
            label: Some("ray march"),
            entries: &[
                entry(
                    0,
                    BindingType::Buffer {
                        ty: BufferBindingType::Uniform,
                        has_dynamic_offset: false,
                        min_binding_size: None,
                    },
                ),
                entry(1, integer_texture(TextureViewDimension::D3)),
                entry(2, integer_texture(TextureViewDimension::D2)),
                entry(3, integer_texture(TextureViewDimension::D3)),
                entry(4, integer_texture(TextureViewDimension::D2)),
                entry(5, float_texture(TextureViewDimension::D2)),
                entry(6, float_texture(TextureViewDimension::D3)),
            ],
        });
        Self { pipeline: pipeline(gpu, [&layout, opaque]), layout, uniforms }
    }

    /// Binds a volume and what is made of it.
    pub fn bind(&self, gpu: &Gpu, volume: &TextureView, lookup_textures: &LookupTextures) -> BindGroup {
        let [opacity_table, occupancy, emphases, emphasis_table, preintegration] = lookup_textures.views();
        gpu.device.create_bind_group(&BindGroupDescriptor {
            label: Some("ray march"),
            layout: &self.layout,
            entries: &[
                BindGroupEntry { binding: 0, resource: self.uniforms.as_entire_binding() },
                BindGroupEntry { binding: 1, resource: BindingResource::TextureView(volume) },
                BindGroupEntry { binding: 2, resource: BindingResource::TextureView(&opacity_table) },
                BindGroupEntry { binding: 3, resource: BindingResource::TextureView(&occupancy) },
                BindGroupEntry { binding: 4, resource: BindingResource::TextureView(&emphases) },
                BindGroupEntry { binding: 5, resource: BindingResource::TextureView(&emphasis_table) },
                BindGroupEntry { binding: 6, resource: BindingResource::TextureView(&preintegration) },
            ],
        })
    }

    /// Sets the numbers of the next picture.
    pub fn set_uniforms(&self, gpu: &Gpu, uniforms: &Uniforms) {
        gpu.queue.write_buffer(&self.uniforms, 0, bytemuck::bytes_of(uniforms));
    }

    /// Records the pass over some rows of the target; the others stay as they are.
    pub fn record(
        &self,
        encoder: &mut CommandEncoder,
        bind_groups: [&BindGroup; 2],
        target: &Target,
        rows: Range<u32>,
    ) {
        let [width, height] = target.size();
        assert!(rows.start <= rows.end && rows.end <= height, "rows {rows:?} reach beyond {height}");
        let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
            label: Some("ray march"),
            color_attachments: &[Some(RenderPassColorAttachment {
                view: target.view(),
                depth_slice: None,
                resolve_target: None,
                // Every pixel of the rows is written: nothing needs to be cleared.
                ops: Operations { load: LoadOp::Load, store: StoreOp::Store },
            })],
            ..RenderPassDescriptor::default()
        });
        pass.set_scissor_rect(0, rows.start, width, rows.end - rows.start);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, bind_groups[0], &[]);
        pass.set_bind_group(1, bind_groups[1], &[]);
        pass.draw(0..3, 0..1);
    }
}

/// Room for the numbers of a picture.
pub fn uniforms(gpu: &Gpu) -> Buffer {
    gpu.device.create_buffer(&BufferDescriptor {
        label: Some("frame"),
        size: size_of::<Uniforms>() as u64,
        usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn entry(binding: u32, ty: BindingType) -> BindGroupLayoutEntry {
    BindGroupLayoutEntry { binding, visibility: ShaderStages::FRAGMENT, ty, count: None }
}

fn integer_texture(view_dimension: TextureViewDimension) -> BindingType {
    BindingType::Texture { sample_type: TextureSampleType::Uint, view_dimension, multisampled: false }
}

fn float_texture(view_dimension: TextureViewDimension) -> BindingType {
    let sample_type = TextureSampleType::Float { filterable: false };
    BindingType::Texture { sample_type, view_dimension, multisampled: false }
}

fn pipeline(gpu: &Gpu, [layout, opaque]: [&BindGroupLayout; 2]) -> RenderPipeline {
    let module = gpu.device.create_shader_module(ShaderModuleDescriptor {
        label: Some("ray march"),
        source: ShaderSource::Wgsl(shader::SOURCE.into()),
    });
    let layout = gpu.device.create_pipeline_layout(&PipelineLayoutDescriptor {
        label: Some("ray march"),
        bind_group_layouts: &[Some(layout), Some(opaque)],
        immediate_size: 0,
    });
    gpu.device.create_render_pipeline(&RenderPipelineDescriptor {
        label: Some("ray march"),
        layout: Some(&layout),
        vertex: VertexState {
            module: &module,
            entry_point: Some("vertex_main"),
            compilation_options: PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: PrimitiveState::default(),
        depth_stencil: None,
        multisample: MultisampleState::default(),
        fragment: Some(FragmentState {
            module: &module,
            entry_point: Some("fragment_main"),
            compilation_options: PipelineCompilationOptions::default(),
            targets: &[Some(ColorTargetState { format: Target::FORMAT, blend: None, write_mask: ColorWrites::ALL })],
        }),
        multiview_mask: None,
        cache: None,
    })
}
