//! The pass that draws a volume that is there as a whole: one triangle over the target, one ray a pixel.

use std::ops::Range;

use wgpu::{
    BindGroup, Extent3d, LoadOp, RenderPipeline, Texture, TextureDescriptor, TextureDimension, TextureFormat,
    TextureUsages, TextureViewDescriptor,
};

use super::bindings::{Bindings, Pass, attachment, draw_rows};
use super::gpu::Gpu;
use super::target::{Target, read_back};
use crate::Result;
use crate::reference::SampleCounts;

/// What of every pixel's ray was sampled, and all of it.
const COUNTS: TextureFormat = TextureFormat::Rg32Uint;

/// Its pipeline, and another one where samples are counted: counting costs nothing where it is not asked for.
pub struct RayMarch {
    plain: RenderPipeline,
    counting: Option<Counting>,
}

/// Writes how many samples every pixel took beside its colour; they are summed once they are asked for.
struct Counting {
    pipeline: RenderPipeline,
    /// Of the last picture.
    counts: Option<Texture>,
}

impl RayMarch {
    /// Compiles the shaders.
    pub fn new(gpu: &Gpu, bindings: &Bindings) -> Self {
        let plain = bindings.pipeline(gpu, &Pass::new("fragment_main", &[Target::FORMAT]));
        Self { plain, counting: None }
    }

    /// Counts samples from now on.
    pub fn count_samples(&mut self, gpu: &Gpu, bindings: &Bindings) {
        let formats = [Target::FORMAT, COUNTS];
        let pass = Pass { counts: true, ..Pass::new("fragment_count", &formats) };
        self.counting.get_or_insert_with(|| Counting { pipeline: bindings.pipeline(gpu, &pass), counts: None });
    }

    /// How many samples the last picture took, where they are counted.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when the device is lost.
    pub fn samples(&self, gpu: &Gpu) -> Result<Option<SampleCounts>> {
        let Some(counts) = self.counting.as_ref().and_then(|counting| counting.counts.as_ref()) else {
            return Ok(None);
        };
        let bytes = read_back(gpu, counts, counts.height(), "counting samples")?;
        let counts = bytes.as_chunks::<8>().0.iter().map(|numbers| {
            let [taken, all]: [u32; 2] = bytemuck::pod_read_unaligned(numbers);
            SampleCounts { taken: taken.into(), all: all.into() }
        });
        Ok(Some(counts.fold(SampleCounts::default(), SampleCounts::plus)))
    }

    /// The next picture is not drawn by rays.
    pub fn forget_samples(&mut self) {
        if let Some(counting) = &mut self.counting {
            counting.counts = None;
        }
    }

    /// Draws some rows of the target; the others stay as they are.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when there is no room for counts.
    pub fn draw_rows(&mut self, gpu: &Gpu, bind_group: &BindGroup, target: &Target, rows: Range<u32>) -> Result<()> {
        let size @ [width, _] = target.size();
        // Every pixel of the rows is written: nothing needs to be cleared.
        let picture = attachment(target.view(), LoadOp::Load);
        let Some(Counting { pipeline, counts }) = &mut self.counting else {
            draw_rows(gpu, &self.plain, &[bind_group], &[picture], (width, rows));
            return Ok(());
        };
        let counts = match counts.take().filter(|counts| [counts.width(), counts.height()] == size) {
            Some(before) => counts.insert(before),
            None => counts.insert(gpu.checked("making room for counts", || counts_texture(gpu, size))?),
        };
        let counts = counts.create_view(&TextureViewDescriptor::default());
        let attachments = [picture, attachment(&counts, LoadOp::Load)];
        draw_rows(gpu, pipeline, &[bind_group], &attachments, (width, rows));
        Ok(())
    }
}

fn counts_texture(gpu: &Gpu, [width, height]: [u32; 2]) -> Texture {
    gpu.device.create_texture(&TextureDescriptor {
        label: Some("samples"),
        size: Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: TextureDimension::D2,
        format: COUNTS,
        usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}
