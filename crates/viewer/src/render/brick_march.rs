//! The passes that draw a volume that comes brick by brick: rays that wait for a brick go on once it is there.
//!
//! Every ray marches until it meets a brick that something can be drawn of and that is not on the device, and says
//! which it is. Those that most rays wait for are brought, and all rays go on from where they were, so that the picture
//! is the same to the last bit however few bricks there is room for. After Crassin et al., GigaVoxels, 2009, and
//! Hadwiger et al., Interactive volume exploration of petascale microscopy data streams, 2012, with rays that wait in
//! place of coarser voxels.

use std::cmp::Reverse;
use std::collections::HashMap;
use std::ops::Range;
use std::time::Instant;

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindingResource, Color,
    CommandEncoderDescriptor, Extent3d, LoadOp, RenderPassDescriptor, RenderPipeline, Texture, TextureDescriptor,
    TextureDimension, TextureFormat, TextureUsages, TextureView, TextureViewDescriptor, TextureViewDimension,
};

use super::bindings::{Bindings, Pass, attachment, draw_rows, entry, integer_texture};
use super::brick_atlas::BrickAtlas;
use super::gpu::Gpu;
use super::target::{Target, read_back};
use super::uniforms::Uniforms;
use crate::{Result, Watch};

/// Rows that are drawn together: what their rays need should fit.
const STRIP: u32 = 64;
/// Bricks that a step needs at most: those of its middle and of its ends.
pub const MOST_OF_STEP: usize = 3;
/// Light, and how many steps lie behind with the brick that is waited for.
const FORMATS: [TextureFormat; 2] = [TextureFormat::Rgba32Uint, TextureFormat::Rg32Uint];

/// Its pipelines, and how far the rays of a strip have come.
pub struct BrickMarch {
    resume: RenderPipeline,
    finish: RenderPipeline,
    layout: BindGroupLayout,
    /// Each pass reads what the one before wrote.
    strips: Option<[Strip; 2]>,
    longest: f64,
}

/// How far rays have come.
struct Strip {
    progress: Texture,
    views: [TextureView; 2],
    bind_group: BindGroup,
}

impl BrickMarch {
    /// Compiles the shaders.
    pub fn new(gpu: &Gpu, bindings: &Bindings) -> Self {
        let layout = gpu.device.create_bind_group_layout(&BindGroupLayoutDescriptor {
            label: Some("progress"),
            entries: &[
                entry(0, integer_texture(TextureViewDimension::D2)),
                entry(1, integer_texture(TextureViewDimension::D2)),
            ],
        });
        let pipeline = |entry_point, formats| {
            bindings.pipeline(gpu, &Pass { has_bricks: true, own: Some(&layout), ..Pass::new(entry_point, formats) })
        };
        let (resume, finish) = (pipeline("fragment_resume", &FORMATS), pipeline("fragment_finish", &[Target::FORMAT]));
        Self { resume, finish, layout, strips: None, longest: 0.0 }
    }

    /// Seconds of the longest pass over the rows that were drawn last, for which the device worked without a break.
    pub fn longest(&self) -> f64 {
        self.longest
    }

    /// Draws some rows of the target, and waits for them; leaves some as they are where the picture is given up meanwhile.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when the device is lost; as [`BrickAtlas::bring`].
    pub fn draw_rows(
        &mut self,
        gpu: &Gpu,
        (bindings, bind_group): (&Bindings, &BindGroup),
        uniforms: &Uniforms,
        atlas: &mut BrickAtlas,
        target: &Target,
        (rows, watch): (Range<u32>, &Watch),
    ) -> Result<()> {
        let [width, _] = target.size();
        let strips = self.strips.take().filter(|[strip, _]| strip.progress.width() == width);
        let strips = self.strips.insert(match strips {
            Some(strips) => strips,
            None => gpu.checked("making room for rays", || [0; 2].map(|_| Strip::new(gpu, &self.layout, width)))?,
        });
        self.longest = 0.0;
        for first in rows.clone().step_by(STRIP as usize) {
            let strip = first..(first + STRIP).min(rows.end);
            bindings.set_uniforms(gpu, &uniforms.at_row(first));
            begin(gpu, &strips[0]);
            let mut leader = Leader::default();
            loop {
                let start = Instant::now();
                strips.swap(0, 1);
                let [after, before] = &*strips;
                let attachments = [0, 1].map(|index: usize| attachment(&after.views[index], LoadOp::Load));
                let groups = [bind_group, &before.bind_group];
                draw_rows(gpu, &self.resume, &groups, &attachments, (width, 0..strip.len() as u32));
                let waiting = after.waiting(gpu, strip.len() as u32)?;
                self.longest = self.longest.max(start.elapsed().as_secs_f64());
                if !leader.follow(&waiting) {
                    break;
                }
                if watch.is_given_up() {
                    return Ok(());
                }
                atlas.bring(gpu, &most_wanted(&waiting), &leader.bricks, watch)?;
            }
            let [after, _] = &*strips;
            let attachments = [attachment(target.view(), LoadOp::Load)];
            draw_rows(gpu, &self.finish, &[bind_group, &after.bind_group], &attachments, (width, strip));
        }
        Ok(())
    }
}

impl Strip {
    fn new(gpu: &Gpu, layout: &BindGroupLayout, width: u32) -> Self {
        let textures = FORMATS.map(|format| {
            gpu.device.create_texture(&TextureDescriptor {
                label: Some("progress"),
                size: Extent3d { width, height: STRIP, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format,
                usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_SRC,
                view_formats: &[],
            })
        });
        let views = [0, 1].map(|index: usize| textures[index].create_view(&TextureViewDescriptor::default()));
        let bind_group = gpu.device.create_bind_group(&BindGroupDescriptor {
            label: Some("progress"),
            layout,
            entries: &[
                BindGroupEntry { binding: 0, resource: BindingResource::TextureView(&views[0]) },
                BindGroupEntry { binding: 1, resource: BindingResource::TextureView(&views[1]) },
            ],
        });
        let [_, progress] = textures;
        Self { progress, views, bind_group }
    }

    /// The pixels whose rays wait, and for which bricks.
    fn waiting(&self, gpu: &Gpu, rows: u32) -> Result<Vec<(usize, usize)>> {
        let bytes = read_back(gpu, &self.progress, rows, "asking which bricks are needed")?;
        let pixels = bytes.as_chunks::<8>().0.iter().enumerate().filter_map(|(pixel, numbers)| {
            let [_, wanted]: [u32; 2] = bytemuck::pod_read_unaligned(numbers);
            (wanted > 0).then(|| (pixel, wanted as usize - 1))
        });
        Ok(pixels.collect())
    }
}

/// The first ray that waits. What it waited for last stays until it has gone on, so that rays do not take bricks from
/// each other for ever: a step can need several at once.
#[derive(Default)]
struct Leader {
    pixel: usize,
    bricks: Vec<usize>,
}

impl Leader {
    /// Takes note of what rays wait for; false when none does.
    fn follow(&mut self, waiting: &[(usize, usize)]) -> bool {
        let Some(&(pixel, brick)) = waiting.first() else { return false };
        if self.pixel != pixel {
            *self = Self { pixel, bricks: Vec::new() };
        }
        if self.bricks.len() == MOST_OF_STEP {
            self.bricks.remove(0);
        }
        self.bricks.push(brick);
        true
    }
}

/// The bricks that rays wait for: that of the first ray, then those that most wait for.
fn most_wanted(waiting: &[(usize, usize)]) -> Vec<usize> {
    let mut rays = HashMap::<usize, usize>::new();
    for (_, brick) in waiting {
        *rays.entry(*brick).or_default() += 1;
    }
    let first = waiting.first().map(|(_, brick)| *brick);
    let mut wanted: Vec<_> = rays.into_iter().collect();
    wanted.sort_unstable_by_key(|&(brick, rays)| (Some(brick) != first, Reverse(rays), brick));
    wanted.into_iter().map(|(brick, _)| brick).collect()
}

/// No ray has gone anywhere, and all have somewhere to go.
fn begin(gpu: &Gpu, strip: &Strip) {
    let waiting = Color { g: 1.0, ..Color::TRANSPARENT };
    let attachments = [(&strip.views[0], Color::TRANSPARENT), (&strip.views[1], waiting)]
        .map(|(view, color)| attachment(view, LoadOp::Clear(color)));
    let mut encoder = gpu.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("rays begin") });
    drop(encoder.begin_render_pass(&RenderPassDescriptor {
        label: Some("rays begin"),
        color_attachments: &attachments,
        ..RenderPassDescriptor::default()
    }));
    gpu.queue.submit([encoder.finish()]);
}
