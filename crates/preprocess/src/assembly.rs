//! From the bricks of finished blocks to the layers of a packed file.

use rayon::prelude::*;
use voxrole_pack::brick::BrickGrid;
use voxrole_pack::directory::Encoding;
use voxrole_pack::packed_brick::{PackedBrick, PackedLayerBrick, PackedMask, Workbenches};
use voxrole_pack::scalar::Scalar;
use voxrole_pack::unfinished::Unfinished;
use voxrole_pack::{Layer, LayerKind, Writer};

use crate::Result;
use crate::block_plan::BlockPlan;

/// Bricks that are packed at once: bounds the memory in flight whatever the number of threads.
const BRICKS_IN_FLIGHT: usize = 64;

/// Bricks of finished blocks on their way into the file.
pub struct FinishedBricks<'a> {
    unfinished: &'a Unfinished,
    plan: &'a BlockPlan,
    grid: BrickGrid,
    /// Where a block has its masks.
    masks: usize,
}

impl<'a> FinishedBricks<'a> {
    /// Of a volume of `dims` voxels, whose blocks have their masks behind so many layers.
    pub fn new(unfinished: &'a Unfinished, plan: &'a BlockPlan, dims: [usize; 3], masks: usize) -> Self {
        Self { unfinished, plan, grid: BrickGrid::new(dims), masks }
    }

    fn brick(&self, layer: usize, index: usize) -> voxrole_pack::Result<PackedBrick> {
        let (block, brick) = self.plan.locate(index);
        self.unfinished.brick(block, layer, brick)
    }

    /// Writes layer `index` of the blocks as it is.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when reading or writing fails.
    pub fn copy<T: Scalar>(&self, writer: &mut Writer, layer: &Layer, index: usize) -> Result<()> {
        let workbenches = Workbenches::<T>::default();
        let copied = |place: usize| {
            let brick = self.brick(index, place)?;
            let needs_mask = layer.kind == LayerKind::Distance || brick.encoding == Encoding::SparseZstd;
            let mask = needs_mask.then(|| self.brick(self.masks, place)).transpose()?;
            let mask = mask.map(|mask| PackedMask::of_brick(mask, self.grid.voxel_count(place))).transpose()?;
            workbenches.unpack(layer, self.grid.dims_of(place), brick, mask)
        };
        self.write(writer, layer, copied)
    }

    /// Writes `encode` of layer `index` of the blocks, whose numbers are f32.
    ///
    /// # Errors
    /// As [`Self::copy`].
    pub fn encode<T: Scalar>(
        &self,
        writer: &mut Writer,
        layer: &Layer,
        index: usize,
        encode: impl Fn(f32) -> T + Copy + Sync,
    ) -> Result<()> {
        let (workbenches, masks) = (Workbenches::default(), writer.masks().to_vec());
        let encoded = |place: usize| {
            let working: Vec<f32> = self.brick(index, place)?.unpack(self.grid.voxel_count(place))?;
            workbenches.pack(layer, self.grid.dims_of(place), &working, encode, masks.get(place).copied())
        };
        self.write(writer, layer, encoded)
    }

    fn write<T: Scalar>(
        &self,
        writer: &mut Writer,
        layer: &Layer,
        packed: impl Fn(usize) -> voxrole_pack::Result<PackedLayerBrick<T>> + Sync,
    ) -> Result<()> {
        let groups = (0..self.grid.len()).step_by(BRICKS_IN_FLIGHT);
        let bricks = groups.flat_map(|first| {
            let group = first..(first + BRICKS_IN_FLIGHT).min(self.grid.len());
            group.into_par_iter().with_max_len(1).map(&packed).collect::<Vec<_>>()
        });
        Ok(writer.write_packed_layer(layer, bricks)?)
    }
}
