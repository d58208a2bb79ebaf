//! The pass before the rays: opaque triangles into textures of colour and place along every pixel's ray, which the rays
//! end at.

use std::sync::Arc;

use wgpu::util::DeviceExt;
use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry,
    BindingType, Buffer, BufferBindingType, BufferUsages, Color, ColorTargetState, ColorWrites, CommandEncoder,
    CommandEncoderDescriptor, CompareFunction, DepthStencilState, Extent3d, FragmentState, IndexFormat, LoadOp,
    MultisampleState, Operations, PipelineCompilationOptions, PipelineLayoutDescriptor, PrimitiveState, RenderPass,
    RenderPassDepthStencilAttachment, RenderPassDescriptor, RenderPipeline, RenderPipelineDescriptor,
    ShaderModuleDescriptor, ShaderSource, ShaderStages, StoreOp, TextureDescriptor, TextureDimension, TextureFormat,
    TextureUsages, TextureView, TextureViewDescriptor, VertexAttribute, VertexBufferLayout, VertexFormat, VertexState,
    VertexStepMode, util,
};

use super::bindings::attachment;
use super::gpu::Gpu;
use super::shader;
use crate::Result;
use crate::frame::Frame;
use crate::scene::lines::lines;
use crate::scene::{Surfaces, Triangles, Vertex};
use crate::state::{Scene, ViewState};
use crate::volume::VolumeDescription;

/// Colours as they are shown.
const COLOR: TextureFormat = TextureFormat::Rgba8Unorm;
/// The bits of lengths along rays, in multiples of `L_min`.
const ALONG: TextureFormat = TextureFormat::R32Uint;
/// What decides which triangle is nearest.
const DEPTH: TextureFormat = TextureFormat::Depth32Float;

/// The pipeline, and what it draws into.
pub struct Geometry {
    pipeline: RenderPipeline,
    frame: BindGroup,
    /// What rays read where there is no scene.
    nothing: Targets,
    scene: Option<PreparedScene>,
    /// How often textures were made.
    generation: u64,
}

/// A scene that is ready to be drawn at one size.
struct PreparedScene {
    scene: Scene,
    surfaces: Arc<Surfaces>,
    buffers: Option<Buffers>,
    targets: Targets,
    /// The frame that the textures show.
    shown: Option<Frame>,
}

struct Buffers {
    vertices: Buffer,
    indices: Buffer,
    count: u32,
}

struct Targets {
    size: [u32; 2],
    color: TextureView,
    along: TextureView,
    depth: TextureView,
}

impl Geometry {
    /// Compiles the shaders; `uniforms` are the ray march's.
    pub fn new(gpu: &Gpu, uniforms: &Buffer) -> Self {
        let frame_layout = gpu.device.create_bind_group_layout(&BindGroupLayoutDescriptor {
            label: Some("geometry"),
            entries: &[BindGroupLayoutEntry {
                binding: 0,
                visibility: ShaderStages::VERTEX_FRAGMENT,
                ty: BindingType::Buffer {
                    ty: BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            }],
        });
        let frame = gpu.device.create_bind_group(&BindGroupDescriptor {
            label: Some("geometry"),
            layout: &frame_layout,
            entries: &[BindGroupEntry { binding: 0, resource: uniforms.as_entire_binding() }],
        });
        let nothing = Targets::new(gpu, [1, 1]);
        Self { pipeline: pipeline(gpu, &frame_layout), frame, nothing, scene: None, generation: 0 }
    }

    /// What rays read for a state's picture: colour and place along the ray of every pixel, which new textures have
    /// neither of; and a number that changes with the textures.
    pub fn views(&self, state: &ViewState, size: [u32; 2]) -> ([TextureView; 2], u64) {
        let prepared = self.scene.as_ref().filter(|prepared| prepared.is_of(state, size));
        let targets = prepared.map_or(&self.nothing, |prepared| &prepared.targets);
        let views = [&targets.color, &targets.along].map(TextureView::clone);
        (views, prepared.map_or(0, |_| self.generation))
    }

    /// Uploads what has changed, and makes room for a size.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when the device's memory does not suffice.
    pub fn prepare(&mut self, gpu: &Gpu, scene: &Scene, surfaces: &Arc<Surfaces>, size: [u32; 2]) -> Result<()> {
        let is_ready = |prepared: &PreparedScene| {
            prepared.scene == *scene && Arc::ptr_eq(&prepared.surfaces, surfaces) && prepared.targets.size == size
        };
        if self.scene.as_ref().is_some_and(is_ready) {
            return Ok(());
        }
        let before = self.scene.take();
        if scene.is_empty() {
            return Ok(());
        }
        self.scene = Some(gpu.checked("making room for surfaces", || {
            let (buffers, targets) = match before {
                Some(before) => (
                    Arc::ptr_eq(&before.surfaces, surfaces).then_some(before.buffers),
                    (before.targets.size == size).then_some(before.targets),
                ),
                None => (None, None),
            };
            PreparedScene {
                scene: scene.clone(),
                surfaces: surfaces.clone(),
                buffers: buffers.unwrap_or_else(|| Buffers::new(gpu, &surfaces.triangles)),
                targets: targets.unwrap_or_else(|| Targets::new(gpu, size)),
                shown: None,
            }
        })?);
        self.generation += 1;
        Ok(())
    }

    /// Draws where the state's scene is prepared for the frame's size and not drawn yet. The uniforms are the frame's.
    pub fn draw(&mut self, gpu: &Gpu, state: &ViewState, volume: &VolumeDescription, frame: &Frame) {
        let is_due =
            |prepared: &&mut PreparedScene| prepared.is_of(state, frame.image_size) && prepared.shown != Some(*frame);
        let Some(prepared) = self.scene.as_mut().filter(is_due) else { return };
        let mut encoder = gpu.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("geometry") });
        let lines = Buffers::new(gpu, &lines(state, volume, frame));
        {
            let mut pass = prepared.targets.begin(&mut encoder);
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.frame, &[]);
            for buffers in prepared.buffers.iter().chain(&lines) {
                buffers.draw(&mut pass);
            }
        }
        gpu.queue.submit([encoder.finish()]);
        prepared.shown = Some(*frame);
    }
}

impl PreparedScene {
    /// Whether it is that of a state, for pictures of a size.
    fn is_of(&self, state: &ViewState, size: [u32; 2]) -> bool {
        self.scene == state.scene && self.targets.size == size
    }
}

impl Buffers {
    /// Uploads triangles; `None` where there are none.
    fn new(gpu: &Gpu, triangles: &Triangles) -> Option<Self> {
        let upload = |label, contents, usage| {
            gpu.device.create_buffer_init(&util::BufferInitDescriptor { label: Some(label), contents, usage })
        };
        (!triangles.indices.is_empty()).then(|| Self {
            vertices: upload("vertices", bytemuck::cast_slice(&triangles.vertices), BufferUsages::VERTEX),
            indices: upload("triangles", bytemuck::cast_slice(&triangles.indices), BufferUsages::INDEX),
            count: 3 * triangles.indices.len() as u32,
        })
    }

    fn draw(&self, pass: &mut RenderPass<'_>) {
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.set_index_buffer(self.indices.slice(..), IndexFormat::Uint32);
        pass.draw_indexed(0..self.count, 0, 0..1);
    }
}

impl Targets {
    fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let texture = |label, format| {
            let texture = gpu.device.create_texture(&TextureDescriptor {
                label: Some(label),
                size: Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format,
                usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            texture.create_view(&TextureViewDescriptor::default())
        };
        let (color, along) = (texture("opaque colours", COLOR), texture("opaque places", ALONG));
        Self { size, color, along, depth: texture("opaque depths", DEPTH) }
    }

    /// Begins a pass with nothing in any pixel.
    fn begin<'e>(&self, encoder: &'e mut CommandEncoder) -> RenderPass<'e> {
        let nothing = LoadOp::Clear(Color::TRANSPARENT);
        encoder.begin_render_pass(&RenderPassDescriptor {
            label: Some("geometry"),
            color_attachments: &[attachment(&self.color, nothing), attachment(&self.along, nothing)],
            depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(Operations { load: LoadOp::Clear(0.0), store: StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..RenderPassDescriptor::default()
        })
    }
}

fn pipeline(gpu: &Gpu, layout: &BindGroupLayout) -> RenderPipeline {
    let module = gpu.device.create_shader_module(ShaderModuleDescriptor {
        label: Some("geometry"),
        source: ShaderSource::Wgsl(shader::GEOMETRY_SOURCE.into()),
    });
    let layout = gpu.device.create_pipeline_layout(&PipelineLayoutDescriptor {
        label: Some("geometry"),
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    let attribute = |format, offset, shader_location| VertexAttribute { format, offset, shader_location };
    let target = |format| Some(ColorTargetState { format, blend: None, write_mask: ColorWrites::ALL });
    gpu.device.create_render_pipeline(&RenderPipelineDescriptor {
        label: Some("geometry"),
        layout: Some(&layout),
        vertex: VertexState {
            module: &module,
            entry_point: Some("geometry_vertex"),
            compilation_options: PipelineCompilationOptions::default(),
            buffers: &[Some(VertexBufferLayout {
                array_stride: size_of::<Vertex>() as u64,
                step_mode: VertexStepMode::Vertex,
                attributes: &[
                    attribute(VertexFormat::Float32x3, 0, 0),
                    attribute(VertexFormat::Float32x3, 12, 1),
                    attribute(VertexFormat::Unorm8x4, 24, 2),
                ],
            })],
        },
        primitive: PrimitiveState::default(),
        depth_stencil: Some(DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(true),
            depth_compare: Some(CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: MultisampleState::default(),
        fragment: Some(FragmentState {
            module: &module,
            entry_point: Some("geometry_fragment"),
            compilation_options: PipelineCompilationOptions::default(),
            targets: &[target(COLOR), target(ALONG)],
        }),
        multiview_mask: None,
        cache: None,
    })
}
