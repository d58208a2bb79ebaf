//! The passes that draw a volume as slices: all slices into a texture of light, blended back to front, then that over
//! the background. Where the volume comes brick by brick, tile by tile of the picture, and as many slices at a time as their
//! bricks have room.

use std::collections::HashSet;
use std::ops::Range;
use std::time::Instant;

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindingResource,
    BlendState, Buffer, BufferDescriptor, BufferUsages, Color, CommandEncoderDescriptor, Extent3d, Features, LoadOp,
    PollType, RenderPassColorAttachment, RenderPassDescriptor, RenderPipeline, TextureDescriptor, TextureDimension,
    TextureFormat, TextureUsages, TextureView, TextureViewDescriptor, TextureViewDimension, VertexBufferLayout,
    VertexStepMode, vertex_attr_array,
};

use super::bindings::{Bindings, Pass, attachment, draw_rows, entry, float_texture};
use super::brick_atlas::BrickAtlas;
use super::gpu::Gpu;
use super::proxy_geometry::{ProxyGeometry, SliceVertex};
use super::slice_bricks::{BrickExtent, Needed, Tile};
use super::target::Target;
use super::volume_textures::too_large;
use crate::frame::Frame;
use crate::slicing::Slicing;
use crate::{Result, Watch};

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
    longest: f64,
}

/// Light premultiplied by opacity, and opacity, of every pixel.
struct Light {
    size: [u32; 2],
    view: TextureView,
    bind_group: BindGroup,
}

/// Slices that are drawn together.
#[derive(Default)]
struct Run {
    vertices: Range<usize>,
    bricks: HashSet<usize>,
}

/// All slices of a frame: those on one side of the eye, then those on the other, each from the back. No ray meets both.
struct Slices {
    vertices: Vec<SliceVertex>,
    /// Of each its number, and where its corners are; numbers rise on the first side, and fall on the other.
    sides: [Vec<(i32, Range<usize>)>; 2],
}

impl Slices {
    fn new(frame: &Frame, slicing: &Slicing) -> Self {
        let mut geometry = ProxyGeometry::new(frame, slicing);
        let mut corners = [Vec::new(), Vec::new()];
        let mut slice = Vec::new();
        loop {
            // One slice, whose corners come at once.
            geometry.add_triangles(1, &mut slice);
            let Some(first) = slice.first() else { break };
            corners[usize::from(geometry.is_beyond_eye(first.number))].append(&mut slice);
        }
        let mut vertices = Vec::new();
        let sides = corners.map(|corners| {
            let of_slice = |slice: &[SliceVertex]| {
                let start = vertices.len();
                vertices.extend_from_slice(slice);
                (slice[0].number as i32, start..vertices.len())
            };
            corners.chunk_by(|a, b| a.number == b.number).map(of_slice).collect()
        });
        Self { vertices, sides }
    }
}

/// The numbers of a side's first and last slice; `None` where there are none.
fn ends(side: &[(i32, Range<usize>)]) -> Option<[i32; 2]> {
    Some([side.first()?.0, side.last()?.0])
}

impl SliceBlending {
    /// Compiles the shaders, for a volume that is there as a whole or brick by brick.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when the device refuses them.
    pub fn new(gpu: &Gpu, bindings: &Bindings, has_bricks: bool) -> Result<Self> {
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
                    has_bricks,
                    blend: Some(BlendState::PREMULTIPLIED_ALPHA_BLENDING),
                    ..Pass::new("slice_fragment", &[format])
                },
            );
            let pass = Pass { own: Some(&light_layout), ..Pass::new("slices_over_background", &[Target::FORMAT]) };
            let over_background = bindings.pipeline(gpu, &pass);
            Self { format, slices, over_background, light_layout, vertex_buffer, light: None, longest: 0.0 }
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
        self.make_room(gpu, target, &rows)?;
        let [width, _] = target.size();
        let mut geometry = ProxyGeometry::new(frame, slicing);
        let mut vertices = Vec::new();
        let mut load = LoadOp::Clear(Color::TRANSPARENT);
        loop {
            vertices.clear();
            geometry.add_triangles(MOST_VERTICES, &mut vertices);
            let tile = Tile { low: [0, rows.start], high: [width, rows.end] };
            self.blend(gpu, bind_group, &vertices, (tile, load));
            if vertices.len() < MOST_VERTICES {
                break;
            }
            load = LoadOp::Load;
        }
        self.put_over_background(gpu, bind_group, target, rows);
        Ok(())
    }

    /// Draws some rows of the target by bricks, of which `drawable` are needed where they are met, and waits for them; leaves
    /// some as they are where the picture is given up meanwhile.
    ///
    /// # Errors
    /// As [`Self::draw`] and [`BrickAtlas::bring`]; [`crate::Error::VolumeTooLarge`] when there is no room for what one slice
    /// needs in one pixel.
    pub fn draw_bricks(
        &mut self,
        gpu: &Gpu,
        bind_group: &BindGroup,
        (frame, slicing): (&Frame, &Slicing),
        (atlas, drawable): (&mut BrickAtlas, &[usize]),
        target: &Target,
        (rows, watch): (Range<u32>, &Watch),
    ) -> Result<()> {
        self.make_room(gpu, target, &rows)?;
        self.longest = 0.0;
        let tile = Tile { low: [0, rows.start], high: [target.size()[0], rows.end] };
        self.blend(gpu, bind_group, &[], (tile, LoadOp::Clear(Color::TRANSPARENT)));
        let extents: Vec<_> =
            drawable.iter().map(|&brick| BrickExtent::new(brick, atlas.start(brick), frame, slicing)).collect();
        let slices = Slices::new(frame, slicing);
        let mut tiles = vec![(tile, extents)];
        while let Some((tile, mut extents)) = tiles.pop() {
            extents.retain(|extent| extent.is_in(tile));
            let of_side = |side: &Vec<_>| ends(side).map_or(0, |ends| Needed::most(&extents, ends));
            let most = slices.sides.iter().map(of_side).max().unwrap_or(0);
            if most <= atlas.room() {
                self.draw_tile(gpu, bind_group, (&slices, &extents), atlas, (tile, watch))?;
            } else if let Some(halves) = tile.halves() {
                tiles.extend(halves.map(|half| (half, extents.clone())));
            } else {
                let room = atlas.room();
                return Err(too_large(
                    gpu,
                    format!("there is room for {room} bricks of it, and slices need {most} at once; draw it with rays"),
                ));
            }
            if watch.is_given_up() {
                return Ok(());
            }
        }
        self.put_over_background(gpu, bind_group, target, rows);
        Ok(())
    }

    /// Seconds of the longest pass over the rows that were drawn last by bricks, for which the device worked without a break.
    pub fn longest(&self) -> f64 {
        self.longest
    }

    /// Draws all slices of a tile of which none needs more bricks than there is room for.
    fn draw_tile(
        &mut self,
        gpu: &Gpu,
        bind_group: &BindGroup,
        (slices, extents): (&Slices, &[BrickExtent]),
        atlas: &mut BrickAtlas,
        (tile, watch): (Tile, &Watch),
    ) -> Result<()> {
        let mut run = Run::default();
        for side in &slices.sides {
            let Some(ends) = ends(side) else { continue };
            let mut needed = Needed::new(extents, ends);
            for (number, vertices) in side {
                let bricks: Vec<_> = needed.by(*number).collect();
                if bricks.is_empty() {
                    continue;
                }
                let more = bricks.iter().filter(|brick| !run.bricks.contains(brick)).count();
                let is_next = run.vertices.end == vertices.start;
                let is_full = run.bricks.len() + more > atlas.room() || run.vertices.len() >= MOST_VERTICES;
                if !is_next || is_full {
                    self.draw_run(gpu, bind_group, &slices.vertices, &run, atlas, tile)?;
                    if watch.is_given_up() {
                        return Ok(());
                    }
                    run = Run { vertices: vertices.start..vertices.start, bricks: HashSet::new() };
                }
                run.bricks.extend(bricks);
                run.vertices.end = vertices.end;
            }
        }
        self.draw_run(gpu, bind_group, &slices.vertices, &run, atlas, tile)
    }

    fn draw_run(
        &mut self,
        gpu: &Gpu,
        bind_group: &BindGroup,
        vertices: &[SliceVertex],
        run: &Run,
        atlas: &mut BrickAtlas,
        tile: Tile,
    ) -> Result<()> {
        if run.vertices.is_empty() {
            return Ok(());
        }
        debug_assert!(run.bricks.len() <= atlas.room(), "a run needs no more bricks than there is room for");
        let mut bricks: Vec<usize> = run.bricks.iter().copied().collect();
        // Which come in the place of which must not depend on how they are kept here.
        bricks.sort_unstable();
        // All of them: what is blended cannot be taken back.
        atlas.bring(gpu, &bricks, &bricks, &Watch::default())?;
        let start = Instant::now();
        self.blend(gpu, bind_group, &vertices[run.vertices.clone()], (tile, LoadOp::Load));
        let waited = gpu.device.poll(PollType::wait_indefinitely());
        waited.map_err(|error| gpu.error("drawing slices", &error))?;
        self.longest = self.longest.max(start.elapsed().as_secs_f64());
        Ok(())
    }

    /// Blends slices over the light of a tile.
    fn blend(&self, gpu: &Gpu, bind_group: &BindGroup, vertices: &[SliceVertex], (tile, load): (Tile, LoadOp<Color>)) {
        let Some(light) = &self.light else { return };
        gpu.queue.write_buffer(&self.vertex_buffer, 0, bytemuck::cast_slice(vertices));
        let mut encoder = gpu.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("slices") });
        {
            let mut pass = encoder.begin_render_pass(&pass("slices", &[attachment(&light.view, load)]));
            let [width, height] = [0, 1].map(|axis: usize| tile.high[axis] - tile.low[axis]);
            pass.set_scissor_rect(tile.low[0], tile.low[1], width, height);
            pass.set_pipeline(&self.slices);
            pass.set_bind_group(0, bind_group, &[]);
            pass.set_vertex_buffer(0, self.vertex_buffer.slice(..));
            pass.draw(0..vertices.len() as u32, 0..1);
        }
        // Before the next vertices are written into the same buffer.
        gpu.queue.submit([encoder.finish()]);
    }

    fn put_over_background(&self, gpu: &Gpu, bind_group: &BindGroup, target: &Target, rows: Range<u32>) {
        let Some(light) = &self.light else { return };
        let attachments = [attachment(target.view(), LoadOp::Load)];
        let groups = [bind_group, &light.bind_group];
        draw_rows(gpu, &self.over_background, &groups, &attachments, (target.size()[0], rows));
    }

    /// Makes room for the light of a target's pixels.
    fn make_room(&mut self, gpu: &Gpu, target: &Target, rows: &Range<u32>) -> Result<()> {
        let [_, height] = target.size();
        assert!(rows.start <= rows.end && rows.end <= height, "rows {rows:?} reach beyond {height}");
        if self.light.as_ref().is_none_or(|light| light.size != target.size()) {
            self.light = Some(gpu.checked("making room for slices", || self.light(gpu, target.size()))?);
        }
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
