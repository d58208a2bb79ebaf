//! Bricks of a volume of which the device has no room for all: those that rays need, in one texture, and where each of
//! them lies.

use std::collections::HashSet;

use glam::Vec3;
use wgpu::{Extent3d, Origin3d, PollType, Texture, TextureView};

use super::gpu::Gpu;
use super::volume_textures::{
    BYTES_PER_TEXEL, UPLOAD_BYTES, not_apart, texture_bytes, too_large, view, volume_texture, write_texels,
};
use crate::classify::Occupancy;
use crate::classify::macrocells::MACROCELL;
use crate::frame::Frame;
use crate::streaming::TexelSource;
use crate::streaming::packed_volume::TexelBox;
use crate::volume::VolumeTexels;
use crate::{Result, Watch};

/// Cells along a side of a brick.
pub const BRICK: u32 = 32;
/// Voxels along a side: those on the faces between two bricks are in both, so that every cell has all of its own.
const SIDE: u32 = BRICK + 1;
/// What a brick takes of the device's memory.
pub(super) const BRICK_BYTES: u64 = SIDE as u64 * SIDE as u64 * SIDE as u64 * BYTES_PER_TEXEL as u64;
const UPLOADS_AT_ONCE: u64 = UPLOAD_BYTES as u64 / BRICK_BYTES;

/// Bricks that are made ready together: bounds the memory that takes, and gives every thread something to do.
const MADE_AT_ONCE: usize = 32;

/// As many bricks as there is room for; others take their place when rays want them.
pub struct BrickAtlas {
    source: TexelSource,
    /// Bricks along x, y, z.
    grid: [u32; 3],
    texture: Texture,
    pages: Texture,
    /// In place of what only compressed normals have.
    not_apart: [Texture; 2],
    /// For every brick where its first voxel lies in the texture, and 1, or 0 where it is not there; x fastest.
    places: Vec<[u16; 4]>,
    /// Which brick each slot holds.
    slots: Vec<Option<usize>>,
    /// The slot that is filled next: that which was filled the longest time ago.
    next: usize,
    uploads: u64,
}

impl BrickAtlas {
    /// Makes room for as many bricks as `budget` bytes hold, or as many as there are. None is there yet.
    ///
    /// # Errors
    /// [`crate::Error::VolumeTooLarge`] when not even one fits.
    pub fn new(gpu: &Gpu, source: &TexelSource, budget: u64) -> Result<Self> {
        let dims = source.description().texel_dims();
        let grid = dims.map(|dim| dim.saturating_sub(1).max(1).div_ceil(BRICK));
        let count = grid.iter().map(|&bricks| bricks as usize).product::<usize>();
        let limit = gpu.device.limits().max_texture_dimension_3d / SIDE;
        let [across, down, deep] = slots_along((budget / BRICK_BYTES).min(count as u64), limit);
        if across == 0 {
            let least = BRICK_BYTES.div_ceil(1 << 20);
            return Err(too_large(gpu, format!("a brick of it takes {least} MiB, and there is room for less")));
        }
        let textures = gpu.checked("making room for bricks", || {
            let size = extent([across, down, deep].map(|slots| slots * SIDE));
            ([volume_texture(gpu, "bricks", size), volume_texture(gpu, "pages", extent(grid))], not_apart(gpu))
        });
        let ([texture, pages], not_apart) = textures.map_err(|error| too_large(gpu, error.to_string()))?;
        Ok(Self {
            source: source.clone(),
            grid,
            texture,
            pages,
            not_apart,
            places: vec![[0; 4]; count],
            slots: vec![None; across as usize * down as usize * deep as usize],
            next: 0,
            uploads: 0,
        })
    }

    /// What a shader reads: the bricks, where each of them lies, and that normals are with the bricks.
    pub fn views(&self) -> [TextureView; 4] {
        let [gradients, normals] = &self.not_apart;
        [&self.texture, &self.pages, gradients, normals].map(view)
    }

    /// What the bricks take of the device's memory.
    pub fn bytes(&self) -> u64 {
        texture_bytes(&self.texture)
    }

    /// How many bricks were brought to the device so far.
    pub fn uploads(&self) -> u64 {
        self.uploads
    }

    /// Brings bricks that something can be drawn of, those nearest to the eye first, as long as there are slots that
    /// were never filled; all that may be drawn where rays do not leap.
    ///
    /// # Errors
    /// As [`Self::bring`].
    pub fn fill(&mut self, gpu: &Gpu, occupancy: Option<&Occupancy>, frame: &Frame, watch: &Watch) -> Result<()> {
        let free = self.slots.iter().filter(|slot| slot.is_none()).count();
        if free == 0 {
            return Ok(());
        }
        let distance = |&brick: &usize| {
            let start = Vec3::from_array(self.start(brick).map(|voxel| voxel as f32));
            (((start + 0.5 * BRICK as f32) * frame.spacing - frame.rays.origin).length() * 256.0) as u64
        };
        let mut absent = self.drawable(occupancy);
        absent.retain(|&brick| self.places[brick][3] == 0);
        absent.sort_by_cached_key(distance);
        absent.truncate(free);
        self.bring(gpu, &absent, &[], watch)
    }

    /// The bricks that something can be drawn of; all where rays do not leap.
    pub fn drawable(&self, occupancy: Option<&Occupancy>) -> Vec<usize> {
        let drawable = occupancy.map(|occupancy| occupancy.drawn_blocks((BRICK / MACROCELL) as usize));
        (0..self.places.len()).filter(|&brick| drawable.as_ref().is_none_or(|drawable| drawable[brick])).collect()
    }

    /// The first voxel of a brick.
    pub fn start(&self, brick: usize) -> [u32; 3] {
        along_axes(brick, [self.grid[0] as usize, self.grid[1] as usize]).map(|brick| brick * BRICK)
    }

    /// How many bricks there are.
    pub fn count(&self) -> usize {
        self.places.len()
    }

    /// How many bricks there is room for.
    pub fn room(&self) -> usize {
        self.slots.len()
    }

    /// Brings bricks that are not there, the first ones first, in the place of those that have been there the longest,
    /// but for those that have to stay; as many as there is room for, and fewer where the picture is given up meanwhile.
    ///
    /// # Errors
    /// [`crate::Error::Pack`], naming brick and layer, when one cannot be read from its file, [`crate::Error::Device`] when
    /// the device is lost.
    pub fn bring(&mut self, gpu: &Gpu, bricks: &[usize], staying: &[usize], watch: &Watch) -> Result<()> {
        let staying: HashSet<usize> = staying.iter().copied().collect();
        let is_staying = |slot: &Option<usize>| slot.is_some_and(|brick| staying.contains(&brick));
        let slots = (0..self.slots.len()).map(|index| (self.next + index) % self.slots.len());
        let slots = slots.filter(|&slot| !is_staying(&self.slots[slot]));
        let is_there = |brick: &usize| self.places[*brick][3] != 0;
        let room = self.slots.len() - staying.iter().filter(|brick| is_there(brick)).count();
        let mut absent: Vec<usize> = bricks.iter().copied().filter(|brick| !is_there(brick)).take(room).collect();
        // Neighbours together: they are made of the same bricks of a file.
        absent.sort_by_cached_key(|brick| z_order(self.start(*brick).map(|voxel| voxel / BRICK)));
        let brought: Vec<(usize, usize)> = absent.into_iter().zip(slots).collect();
        let mut parts = brought.chunks(MADE_AT_ONCE).take_while(|_| !watch.is_given_up());
        let outcome = parts.try_for_each(|brought| self.replace(gpu, brought));
        // Also where one could not be read: those before it lie in the places of others by now.
        write_texels(gpu, &self.pages, Origin3d::ZERO, extent(self.grid), &self.places);
        gpu.queue.submit([]);
        outcome
    }

    /// Puts bricks into slots.
    fn replace(&mut self, gpu: &Gpu, brought: &[(usize, usize)]) -> Result<()> {
        let bricks: Vec<usize> = brought.iter().map(|(brick, _)| *brick).collect();
        for (&(brick, slot), (texels, size)) in brought.iter().zip(self.texels(&bricks)?) {
            if let Some(old) = self.slots[slot].replace(brick) {
                self.places[old] = [0; 4];
            }
            self.upload(gpu, (brick, slot), &texels, size)?;
            self.next = (slot + 1) % self.slots.len();
        }
        Ok(())
    }

    fn upload(&mut self, gpu: &Gpu, (brick, slot): (usize, usize), texels: &[[u16; 4]], dims: [u32; 3]) -> Result<()> {
        let size = self.texture.size();
        let across = [size.width, size.height].map(|side| (side / SIDE) as usize);
        let origin = along_axes(slot, across).map(|slot| slot * SIDE);
        let [x, y, z] = origin;
        self.places[brick] = [x as u16, y as u16, z as u16, 1];
        write_texels(gpu, &self.texture, Origin3d { x, y, z }, extent(dims), texels);
        self.uploads += 1;
        if self.uploads.is_multiple_of(UPLOADS_AT_ONCE) {
            // Hands them over now instead of gathering all of them first, and waits until their memory is free again.
            gpu.queue.submit([]);
            let waited = gpu.device.poll(PollType::wait_indefinitely());
            waited.map_err(|error| gpu.error("uploading bricks", &error))?;
        }
        Ok(())
    }

    /// The texels of some bricks.
    fn texels(&self, bricks: &[usize]) -> Result<Vec<TexelBox>> {
        match &self.source {
            TexelSource::Memory(volume) => Ok(bricks.iter().map(|&brick| texels(volume, self.start(brick))).collect()),
            TexelSource::File(volume) => {
                let starts: Vec<_> = bricks.iter().map(|&brick| self.start(brick)).collect();
                volume.boxes(&starts, SIDE)
            }
        }
    }
}

/// The texels of a brick that begins at a voxel.
fn texels(volume: &VolumeTexels, start: [u32; 3]) -> TexelBox {
    let dims = volume.description.texel_dims();
    let size: [u32; 3] = std::array::from_fn(|axis| SIDE.min(dims[axis] - start[axis]));
    let [width, height, _] = dims.map(|dim| dim as usize);
    let mut texels = Vec::with_capacity(size.iter().map(|&side| side as usize).product());
    for z in start[2]..start[2] + size[2] {
        for y in start[1]..start[1] + size[1] {
            let first = (z as usize * height + y as usize) * width + start[0] as usize;
            texels.extend_from_slice(&volume.texels[first..first + size[0] as usize]);
        }
    }
    (texels, size)
}

/// Where a place of a grid comes on the curve that goes through cubes of cubes.
fn z_order(place: [u32; 3]) -> u64 {
    // 21 bits are more than a texture has places.
    let bits = (0..21).flat_map(|bit| (0..3).map(move |axis| (bit, axis)));
    bits.fold(0, |order, (bit, axis)| order | u64::from(place[axis] >> bit & 1) << (3 * bit + axis as u32))
}

fn extent([width, height, depth_or_array_layers]: [u32; 3]) -> Extent3d {
    Extent3d { width, height, depth_or_array_layers }
}

/// Where number `index` of a grid lies.
fn along_axes(index: usize, [width, height]: [usize; 2]) -> [u32; 3] {
    [index % width, index / width % height, index / (width * height)].map(|place| place as u32)
}

/// How many of at most `count` slots go along each axis, as evenly as `limit` lets them.
fn slots_along(count: u64, limit: u32) -> [u32; 3] {
    let count = count.min(u64::from(limit).pow(3));
    let across = ((count as f64).cbrt() as u64).clamp(u64::from(count > 0), limit.into());
    if across == 0 {
        return [0; 3];
    }
    let down = (((count / across) as f64).sqrt() as u64).clamp(1, limit.into());
    let deep = (count / (across * down)).min(limit.into());
    [across, down, deep].map(|slots| slots as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_near_in_z_order() {
        let orders = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1], [2, 0, 0], [3, 5, 1]].map(z_order);
        assert_eq!(orders, [0, 1, 2, 7, 8, 0b010_001_111]);
    }

    #[test]
    fn slots_keep_within_count_and_limit() {
        for limit in [1, 7, 62] {
            for count in (0..2000).chain([1 << 20, u64::MAX]) {
                let slots = slots_along(count, limit);
                let all: u64 = slots.iter().map(|&slots| u64::from(slots)).product();
                let most = count.min(u64::from(limit).pow(3));
                assert!(slots.iter().all(|&slots| slots <= limit) && all <= most, "{count} {limit}: {slots:?}");
                // Little of the room is lost.
                assert!(5 * all >= 3 * most, "{count} {limit}: {slots:?}");
            }
        }
    }
}
