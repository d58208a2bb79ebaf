//! A level of a packed file whose texels stay there: bricks of it are unpacked when they are asked for.

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;
use voxrole_pack::brick::{BRICK_EDGE, BrickGrid};
use voxrole_pack::error::vec_with_capacity;
use voxrole_pack::{LayerKind, with_scalar_type};
use voxrole_preprocess::byte_size::byte_size_text;

use super::brick_cache::BrickCache;
use super::memory_bound::too_much;
use super::texel_brick::{TexelBrick, ValueShares};
use crate::open::Opened;
use crate::volume::VolumeDescription;
use crate::{Error, Result};

/// Bricks whose outcome waits for its turn in a pass over all of them.
const BRICKS_OF_PASS: usize = 1024;

/// Texels, x fastest, and how many there are along x, y, z.
pub type TexelBox = (Vec<[u16; 4]>, [u32; 3]);

/// The file, and what of it was unpacked lately.
pub struct PackedVolume {
    opened: Opened,
    description: VolumeDescription,
    grid: BrickGrid,
    /// Bytes that everything below takes at most.
    memory: u64,
    kept: Mutex<Kept>,
    unpacked: AtomicU64,
    /// How many bricks the pass over all of them that is being made, or was last, has behind it.
    passed: AtomicUsize,
    is_given_up: AtomicBool,
}

/// What takes memory.
#[derive(Default)]
struct Kept {
    cache: BrickCache,
    /// What others keep of this volume, in bytes, by its name.
    claims: BTreeMap<&'static str, u64>,
}

impl Kept {
    /// Bytes that are left for bricks.
    fn room(&self, memory: u64) -> u64 {
        memory.saturating_sub(self.claims.values().sum())
    }
}

impl PackedVolume {
    /// Takes over a file, of which at most `memory` bytes are kept at a time.
    ///
    /// # Errors
    /// [`crate::Error::Pack`] when there is no such level, or a layer is missing.
    pub fn new(opened: impl Into<Opened>, level: usize, memory: u64) -> Result<Self> {
        let opened = opened.into();
        let description = VolumeDescription::of(&opened.reader, level)?;
        let grid = opened.reader.grid(level)?;
        Ok(Self {
            opened,
            description,
            grid,
            memory,
            kept: Mutex::default(),
            unpacked: AtomicU64::new(0),
            passed: AtomicUsize::new(0),
            is_given_up: AtomicBool::new(false),
        })
    }

    /// What its texels mean.
    #[must_use]
    pub fn description(&self) -> &VolumeDescription {
        &self.description
    }

    /// Where its bricks lie.
    #[must_use]
    pub fn grid(&self) -> &BrickGrid {
        &self.grid
    }

    /// Texels of a slice across z, and how many slices there are.
    #[must_use]
    pub fn slices(&self) -> [usize; 2] {
        let [width, height, depth] = self.description.texel_dims().map(|dim| dim as usize);
        [width * height, depth]
    }

    /// Bytes that are kept of it at most.
    #[must_use]
    pub fn memory(&self) -> u64 {
        self.memory
    }

    /// How many bricks were unpacked so far; those that are found unpacked do not count.
    #[must_use]
    pub fn bricks_unpacked(&self) -> u64 {
        self.unpacked.load(Ordering::Relaxed)
    }

    /// Which share of the bricks the pass over all of them that is being made, or was last, has behind it.
    #[must_use]
    pub fn passed(&self) -> f32 {
        self.passed.load(Ordering::Relaxed) as f32 / self.grid.len().max(1) as f32
    }

    /// Nothing is read any more: whoever waits for bricks, on whichever thread, is told soon.
    pub fn give_up(&self) {
        self.is_given_up.store(true, Ordering::Relaxed);
    }

    fn check_wanted(&self) -> Result<()> {
        if self.is_given_up.load(Ordering::Relaxed) { Err(Error::GivenUp) } else { Ok(()) }
    }

    /// The error for what needs all texels in memory.
    #[must_use]
    pub fn too_large(&self, reason: String) -> Error {
        too_much(&self.opened.reader, self.description.level, self.memory, reason).unwrap_or_else(|error| error)
    }

    /// Sets memory aside for what is made of all bricks; once for each name. A quarter stays for bricks at least.
    ///
    /// # Errors
    /// [`crate::Error::TooMuchMemory`] when there is less.
    pub fn claim(&self, name: &'static str, bytes: u64) -> Result<()> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let others: u64 = kept.claims.iter().filter(|(of, _)| **of != name).map(|(_, bytes)| bytes).sum();
        let all = others.saturating_add(bytes);
        if all > self.memory - self.memory / 4 {
            let [bytes, others] = [bytes, others].map(byte_size_text);
            return Err(
                self.too_large(format!("{name} takes {bytes} even where bricks come as needed, beside {others}"))
            );
        }
        kept.claims.insert(name, bytes);
        let room = kept.room(self.memory);
        kept.cache.shrink(room);
        Ok(())
    }

    /// Gives back what was set aside under a name.
    pub fn release(&self, name: &'static str) {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).claims.remove(name);
    }

    /// Sets a quarter of the memory aside for bricks on a device whose memory is the machine's; says how much that is.
    ///
    /// # Errors
    /// As [`Self::claim`].
    pub fn claim_for_device(&self) -> Result<u64> {
        let bytes = self.memory / 4;
        self.claim("what is uploaded", bytes)?;
        Ok(bytes)
    }

    /// Bricks by their numbers, unpacked on every thread where they are not there.
    ///
    /// # Errors
    /// [`crate::Error::Pack`], naming brick and layer, when one is damaged or there is none of that number,
    /// [`crate::Error::GivenUp`] after [`Self::give_up`].
    pub fn bricks(&self, wanted: &[usize]) -> Result<HashMap<usize, Arc<TexelBrick>>> {
        let lock = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let mut wanted = wanted.to_vec();
        wanted.sort_unstable();
        wanted.dedup();
        let mut kept = lock();
        let mut there: HashMap<_, _> =
            wanted.iter().filter_map(|&brick| Some((brick, kept.cache.get(brick)?))).collect();
        drop(kept);
        let absent: Vec<usize> = wanted.into_iter().filter(|brick| !there.contains_key(brick)).collect();
        let read = |&brick: &usize| {
            self.check_wanted()?;
            TexelBrick::read(&self.opened.reader, &self.description, brick).map(Arc::new)
        };
        let unpacked: Vec<_> = absent.par_iter().with_max_len(1).map(read).collect::<Result<_>>()?;
        self.unpacked.fetch_add(absent.len() as u64, Ordering::Relaxed);
        let mut kept = lock();
        let room = kept.room(self.memory);
        for (brick, texels) in absent.into_iter().zip(unpacked) {
            kept.cache.insert(brick, Arc::clone(&texels), room);
            there.insert(brick, texels);
        }
        Ok(there)
    }

    /// Boxes of at most `side` texels along each axis, [`BRICK_EDGE`] or one more, that begin where a brick does.
    ///
    /// # Errors
    /// As [`Self::bricks`].
    pub fn boxes(&self, starts: &[[u32; 3]], side: u32) -> Result<Vec<TexelBox>> {
        let dims = self.description.texel_dims();
        let size = |start: [u32; 3]| -> [u32; 3] { std::array::from_fn(|axis| side.min(dims[axis] - start[axis])) };
        let parts: Vec<_> = starts.iter().map(|&start| (size(start), self.parts(start, size(start)))).collect();
        let wanted: Vec<usize> = parts.iter().flat_map(|(_, parts)| parts.iter().map(|(brick, _)| *brick)).collect();
        let bricks = self.bricks(&wanted)?;
        let boxes = parts.into_par_iter().with_max_len(1).map(|(size, parts)| {
            let [width, height, depth] = size.map(|side| side as usize);
            let mut texels = vec![[0; 4]; width * height * depth];
            for (brick, place) in parts {
                let brick = &bricks[&brick];
                let range = |axis: usize| 0..brick.dims()[axis].min(size[axis] as usize - place[axis]);
                brick.copy_to([range(0), range(1), range(2)], &mut texels, [width, height], place);
            }
            (texels, size)
        });
        Ok(boxes.collect())
    }

    /// The bricks of a box: by number, with the place of the first texel in the box.
    fn parts(&self, start: [u32; 3], size: [u32; 3]) -> Vec<(usize, [usize; 3])> {
        let [nx, ny, _] = self.description.texel_dims().map(|dim| (dim as usize).div_ceil(BRICK_EDGE));
        let along = |axis: usize| (0..size[axis] as usize).step_by(BRICK_EDGE);
        let mut parts = Vec::new();
        for z in along(2) {
            for (y, x) in along(1).flat_map(|y| along(0).map(move |x| (y, x))) {
                let place = [x, y, z];
                let [i, j, k] = [0, 1, 2].map(|axis: usize| (start[axis] as usize + place[axis]) / BRICK_EDGE);
                parts.push(((k * ny + j) * nx + i, place));
            }
        }
        parts
    }

    /// Unpacks every brick, without its normals, on every thread, and hands what is made of each on in the order of bricks.
    ///
    /// # Errors
    /// As [`Self::bricks`].
    pub fn for_each_brick<T: Send>(
        &self,
        make: impl Fn(usize, &TexelBrick) -> T + Sync,
        mut take: impl FnMut(usize, T),
    ) -> Result<()> {
        let read = |brick: usize| {
            self.check_wanted()?;
            let texels = TexelBrick::read_without_normals(&self.opened.reader, &self.description, brick)?;
            self.passed.fetch_add(1, Ordering::Relaxed);
            Ok(make(brick, &texels))
        };
        self.passed.store(0, Ordering::Relaxed);
        for first in (0..self.grid.len()).step_by(BRICKS_OF_PASS) {
            let bricks = first..(first + BRICKS_OF_PASS).min(self.grid.len());
            let made: Vec<T> = bricks.clone().into_par_iter().with_max_len(1).map(read).collect::<Result<_>>()?;
            bricks.zip(made).for_each(|(brick, made)| take(brick, made));
        }
        Ok(())
    }

    /// The values of some slices across z, as texels have them, x fastest.
    ///
    /// # Errors
    /// [`crate::Error::Pack`], naming the brick, when one is damaged, there are no such slices, or memory does not suffice,
    /// [`crate::Error::GivenUp`] after [`Self::give_up`].
    pub fn values(&self, slices: Range<usize>) -> Result<Vec<u16>> {
        self.check_wanted()?;
        let reader = &self.opened.reader;
        let (_, layer) = reader.header().layer(LayerKind::Value)?;
        let shares = ValueShares::new(&layer.quantization, self.description.value_range)?;
        let [width, height, _] = self.description.texel_dims().map(|dim| dim as usize);
        let range = [0..width, 0..height, slices];
        let mut values = vec_with_capacity(range.iter().map(Range::len).product(), "values of slices")?;
        with_scalar_type!(layer.scalar_type, T => {
            let stored: Vec<T> = reader.read_region(LayerKind::Value, self.description.level, range)?;
            stored.into_par_iter().map(|stored| shares.of(stored)).collect_into_vec(&mut values);
        });
        Ok(values)
    }
}
