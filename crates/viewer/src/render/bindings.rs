//! What passes over a volume have in common: what they bind, how their pipelines are made, and how rows are drawn.

use std::ops::Range;

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry,
    BindingResource, BindingType, BlendState, Buffer, BufferBindingType, BufferDescriptor, BufferUsages, Color,
    ColorTargetState, ColorWrites, CommandEncoderDescriptor, FragmentState, LoadOp, MultisampleState, Operations,
    PipelineCompilationOptions, PipelineLayoutDescriptor, PrimitiveState, RenderPassColorAttachment,
    RenderPassDescriptor, RenderPipeline, RenderPipelineDescriptor, ShaderModuleDescriptor, ShaderSource, ShaderStages,
    StoreOp, TextureFormat, TextureSampleType, TextureView, TextureViewDimension, VertexBufferLayout, VertexState,
};

use super::device_memory::Normals;
use super::gpu::Gpu;
use super::lookup_textures::LookupTextures;
use super::shader;
use super::uniforms::Uniforms;

/// What every pass over a volume binds: its numbers, the volume, and what is made of it.
pub struct Bindings {
    layout: BindGroupLayout,
    uniforms: Buffer,
    normals: Normals,
}

impl Bindings {
    /// Of no volume yet; its normals will be kept so.
    pub fn new(gpu: &Gpu, normals: Normals) -> Self {
        let layout = gpu.device.create_bind_group_layout(&BindGroupLayoutDescriptor {
            label: Some("volume"),
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
                entry(7, integer_texture(TextureViewDimension::D3)),
                entry(8, float_texture(TextureViewDimension::D2)),
                entry(9, float_texture(TextureViewDimension::D2)),
                entry(10, float_texture(TextureViewDimension::D2)),
                entry(11, integer_texture(TextureViewDimension::D2)),
                entry(12, integer_texture(TextureViewDimension::D3)),
                entry(13, integer_texture(TextureViewDimension::D3)),
                entry(14, float_texture(TextureViewDimension::D3)),
            ],
        });
        let uniforms = gpu.device.create_buffer(&BufferDescriptor {
            label: Some("frame"),
            size: size_of::<Uniforms>() as u64,
            usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Self { layout, uniforms, normals }
    }

    /// Binds a volume, what is made of it, and what its rays end at.
    pub fn bind(
        &self,
        gpu: &Gpu,
        [volume, pages, gradients, normals]: [TextureView; 4],
        lookup_textures: &LookupTextures,
        [opaque_color, opaque_along]: [TextureView; 2],
    ) -> BindGroup {
        let [opacity_table, occupancy, emphases, emphasis_table, preintegration, value_table, front_to_back] =
            lookup_textures.views();
        gpu.device.create_bind_group(&BindGroupDescriptor {
            label: Some("volume"),
            layout: &self.layout,
            entries: &[
                BindGroupEntry { binding: 0, resource: self.uniforms.as_entire_binding() },
                BindGroupEntry { binding: 1, resource: BindingResource::TextureView(&volume) },
                BindGroupEntry { binding: 2, resource: BindingResource::TextureView(&opacity_table) },
                BindGroupEntry { binding: 3, resource: BindingResource::TextureView(&occupancy) },
                BindGroupEntry { binding: 4, resource: BindingResource::TextureView(&emphases) },
                BindGroupEntry { binding: 5, resource: BindingResource::TextureView(&emphasis_table) },
                BindGroupEntry { binding: 6, resource: BindingResource::TextureView(&preintegration) },
                BindGroupEntry { binding: 7, resource: BindingResource::TextureView(&pages) },
                BindGroupEntry { binding: 8, resource: BindingResource::TextureView(&value_table) },
                BindGroupEntry { binding: 9, resource: BindingResource::TextureView(&front_to_back) },
                BindGroupEntry { binding: 10, resource: BindingResource::TextureView(&opaque_color) },
                BindGroupEntry { binding: 11, resource: BindingResource::TextureView(&opaque_along) },
                BindGroupEntry { binding: 12, resource: BindingResource::TextureView(&lookup_textures.occlusion()) },
                BindGroupEntry { binding: 13, resource: BindingResource::TextureView(&gradients) },
                BindGroupEntry { binding: 14, resource: BindingResource::TextureView(&normals) },
            ],
        })
    }

    /// The numbers of the next picture.
    pub fn uniforms(&self) -> &Buffer {
        &self.uniforms
    }

    /// Sets the numbers of the next picture.
    pub fn set_uniforms(&self, gpu: &Gpu, uniforms: &Uniforms) {
        gpu.queue.write_buffer(&self.uniforms, 0, bytemuck::bytes_of(uniforms));
    }

    /// How a pass with these bindings draws: with textures of its own behind them, where it has any.
    pub fn pipeline(&self, gpu: &Gpu, pass: &Pass<'_>) -> RenderPipeline {
        let module = gpu.device.create_shader_module(ShaderModuleDescriptor {
            label: Some(pass.entry_point),
            source: ShaderSource::Wgsl(shader::SOURCE.into()),
        });
        let mut layouts = vec![Some(&self.layout)];
        layouts.extend(pass.own.map(Some));
        let layout = gpu.device.create_pipeline_layout(&PipelineLayoutDescriptor {
            label: Some(pass.entry_point),
            bind_group_layouts: &layouts,
            immediate_size: 0,
        });
        let compilation_options = PipelineCompilationOptions {
            constants: &[
                ("HAS_BRICKS", f64::from(u8::from(pass.has_bricks))),
                ("COUNTS", f64::from(u8::from(pass.counts))),
                ("HAS_COMPRESSED_NORMALS", f64::from(u8::from(self.normals == Normals::Compressed))),
            ],
            ..PipelineCompilationOptions::default()
        };
        let (vertex_entry_point, buffers) = pass.vertices;
        let targets: Vec<_> = pass
            .formats
            .iter()
            .map(|&format| Some(ColorTargetState { format, blend: pass.blend, write_mask: ColorWrites::ALL }))
            .collect();
        gpu.device.create_render_pipeline(&RenderPipelineDescriptor {
            label: Some(pass.entry_point),
            layout: Some(&layout),
            vertex: VertexState {
                module: &module,
                entry_point: Some(vertex_entry_point),
                compilation_options: compilation_options.clone(),
                buffers,
            },
            primitive: PrimitiveState::default(),
            depth_stencil: None,
            multisample: MultisampleState::default(),
            fragment: Some(FragmentState {
                module: &module,
                entry_point: Some(pass.entry_point),
                compilation_options,
                targets: &targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// How a pass draws.
pub struct Pass<'a> {
    /// The vertices' entry point, and what they are made of.
    pub vertices: (&'a str, &'a [Option<VertexBufferLayout<'a>>]),
    /// The fragments'.
    pub entry_point: &'a str,
    /// Whether the volume is there brick by brick.
    pub has_bricks: bool,
    /// Whether samples are counted.
    pub counts: bool,
    /// What it binds of its own.
    pub own: Option<&'a BindGroupLayout>,
    /// What is drawn into.
    pub formats: &'a [TextureFormat],
    /// How that goes together with what is there.
    pub blend: Option<BlendState>,
}

impl<'a> Pass<'a> {
    /// One triangle over what is drawn into, whose pixels replace what is there, for a volume that is there as a whole.
    pub fn new(entry_point: &'a str, formats: &'a [TextureFormat]) -> Self {
        Self {
            vertices: ("vertex_main", &[]),
            entry_point,
            has_bricks: false,
            counts: false,
            own: None,
            formats,
            blend: None,
        }
    }
}

pub(super) fn entry(binding: u32, ty: BindingType) -> BindGroupLayoutEntry {
    BindGroupLayoutEntry { binding, visibility: ShaderStages::FRAGMENT, ty, count: None }
}

pub(super) fn integer_texture(view_dimension: TextureViewDimension) -> BindingType {
    BindingType::Texture { sample_type: TextureSampleType::Uint, view_dimension, multisampled: false }
}

pub(super) fn float_texture(view_dimension: TextureViewDimension) -> BindingType {
    let sample_type = TextureSampleType::Float { filterable: false };
    BindingType::Texture { sample_type, view_dimension, multisampled: false }
}

/// Draws some rows of what is drawn into, which is so wide.
pub(super) fn draw_rows(
    gpu: &Gpu,
    pipeline: &RenderPipeline,
    bind_groups: &[&BindGroup],
    attachments: &[Option<RenderPassColorAttachment<'_>>],
    (width, rows): (u32, Range<u32>),
) {
    let mut encoder = gpu.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("rows") });
    let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
        label: Some("rows"),
        color_attachments: attachments,
        ..RenderPassDescriptor::default()
    });
    pass.set_scissor_rect(0, rows.start, width, rows.end - rows.start);
    pass.set_pipeline(pipeline);
    for (index, bind_group) in (0..).zip(bind_groups) {
        pass.set_bind_group(index, *bind_group, &[]);
    }
    pass.draw(0..3, 0..1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
}

/// Something to draw into.
pub(super) fn attachment(view: &TextureView, load: LoadOp<Color>) -> Option<RenderPassColorAttachment<'_>> {
    let ops = Operations { load, store: StoreOp::Store };
    Some(RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
}
