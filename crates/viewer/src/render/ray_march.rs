//! The pass that draws a volume that is there as a whole: one triangle over the target, one ray a pixel.

use std::ops::Range;

use wgpu::{BindGroup, LoadOp, RenderPipeline};

use super::bindings::{Bindings, Pass, attachment, draw_rows};
use super::gpu::Gpu;
use super::target::Target;

/// Its pipeline.
pub struct RayMarch(RenderPipeline);

impl RayMarch {
    /// Compiles the shaders.
    pub fn new(gpu: &Gpu, bindings: &Bindings) -> Self {
        Self(bindings.pipeline(gpu, &Pass::new("fragment_main", &[Target::FORMAT])))
    }

    /// Draws some rows of the target; the others stay as they are.
    pub fn draw_rows(&self, gpu: &Gpu, bind_group: &BindGroup, target: &Target, rows: Range<u32>) {
        // Every pixel of the rows is written: nothing needs to be cleared.
        let attachments = [attachment(target.view(), LoadOp::Load)];
        draw_rows(gpu, &self.0, &[bind_group], &attachments, (target.size()[0], rows));
    }
}
