//! Bricks that were unpacked lately, within so many bytes.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use super::texel_brick::TexelBrick;

/// Those that were asked for last are kept.
#[derive(Debug, Default)]
pub struct BrickCache {
    /// Each with when it was last asked for.
    bricks: HashMap<usize, (Arc<TexelBrick>, u64)>,
    by_age: BTreeMap<u64, usize>,
    clock: u64,
    bytes: u64,
}

impl BrickCache {
    /// A brick, if it is there.
    pub fn get(&mut self, brick: usize) -> Option<Arc<TexelBrick>> {
        let (texels, asked_for) = self.bricks.get_mut(&brick)?;
        self.clock += 1;
        self.by_age.remove(asked_for);
        self.by_age.insert(self.clock, brick);
        *asked_for = self.clock;
        Some(Arc::clone(texels))
    }

    /// Keeps a brick that is not there, and of all only what `room` bytes hold.
    pub fn insert(&mut self, brick: usize, texels: Arc<TexelBrick>, room: u64) {
        self.clock += 1;
        self.bytes += texels.bytes();
        self.by_age.insert(self.clock, brick);
        self.bricks.insert(brick, (texels, self.clock));
        self.shrink(room);
    }

    /// Keeps only what `room` bytes hold.
    pub fn shrink(&mut self, room: u64) {
        while self.bytes > room {
            let Some((_, oldest)) = self.by_age.pop_first() else { break };
            self.bytes -= self.bricks.remove(&oldest).map_or(0, |(texels, _)| texels.bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn those_asked_for_last_stay_within_the_room() {
        let brick = Arc::new(TexelBrick::uniform([7; 4]));
        let mut cache = BrickCache::default();
        let room = 3 * brick.bytes();
        (0..3).for_each(|number| cache.insert(number, Arc::clone(&brick), room));
        assert!(cache.get(0).is_some());
        cache.insert(3, Arc::clone(&brick), room);
        let there =
            |cache: &BrickCache| -> Vec<usize> { (0..5).filter(|number| cache.bricks.contains_key(number)).collect() };
        assert_eq!((there(&cache), cache.bytes), (vec![0, 2, 3], room));
        cache.shrink(room / 3);
        assert_eq!((there(&cache), cache.by_age.len()), (vec![3], 1));
        cache.insert(5, brick, 0);
        assert!(there(&cache).is_empty() && cache.bytes == 0);
    }
}
