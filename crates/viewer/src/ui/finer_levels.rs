//! Finer levels of detail, read beside the window while it shows a coarser one, and which of them stay in the file.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::thread;

use voxrole_pack::Reader;
use voxrole_preprocess::byte_size::byte_size_text;

use crate::streaming::memory_bound::level_bytes;
use crate::volume::VolumeTexels;
use crate::{Error, Result};

/// Levels on their way.
#[derive(Default)]
pub struct FinerLevels {
    levels: Option<Receiver<Result<VolumeTexels>>>,
    in_file: Option<(Arc<Reader>, u64)>,
    too_large: Option<String>,
    failure: Option<String>,
}

impl FinerLevels {
    /// Reads every level that is finer than `shown` and takes at most `memory` bytes, the coarsest first, on a thread of its
    /// own; `context` is woken for each. Where the finest takes more and can be drawn by bricks from the file, only levels that
    /// take at most `beside_bricks` bytes.
    #[must_use]
    pub fn read(
        reader: &Arc<Reader>,
        shown: usize,
        (memory, beside_bricks): (u64, Option<u64>),
        context: egui::Context,
    ) -> Self {
        let reader = Arc::clone(reader);
        let bytes = |level| level_bytes(&reader, level).unwrap_or(u64::MAX);
        let beside_bricks = beside_bricks.filter(|_| shown > 0 && bytes(0) > memory);
        let most = beside_bricks.unwrap_or(memory);
        let in_file = beside_bricks.map(|_| (Arc::clone(&reader), memory));
        let finest = (0..shown).find(|&level| bytes(level) <= most).unwrap_or(shown);
        let too_large = finest.checked_sub(1).filter(|_| in_file.is_none()).map(|level| {
            format!(
                "level {level} takes {} of memory, of which {} may be taken",
                byte_size_text(bytes(level)),
                byte_size_text(memory)
            )
        });
        // One level waits while the next is read: no more of them are in memory.
        let (sender, receiver) = sync_channel(0);
        thread::spawn(move || {
            for level in (finest..shown).rev() {
                let texels = VolumeTexels::read_level(&reader, level);
                let failed = texels.is_err();
                context.request_repaint();
                if sender.send(texels).is_err() || failed {
                    return;
                }
            }
        });
        Self { levels: Some(receiver), in_file, too_large, failure: None }
    }

    /// The file whose finest level is to be drawn by bricks, and how much memory that may take, once all levels that are read are
    /// taken.
    pub fn take_in_file(&mut self) -> Option<(Arc<Reader>, u64)> {
        if self.is_reading() { None } else { self.in_file.take() }
    }

    /// Why the finest level will not be shown, where memory does not suffice.
    #[must_use]
    pub fn too_large(&self) -> Option<&str> {
        self.too_large.as_deref()
    }

    /// Shows none any more, because of what has happened to one.
    pub fn stop(&mut self, error: &Error) {
        *self = Self { failure: Some(error.to_string()), ..Self::default() };
    }

    /// What has stopped them.
    #[must_use]
    pub fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    /// The next level, if it is there by now.
    pub fn take(&mut self) -> Option<Result<VolumeTexels>> {
        match self.levels.as_ref()?.try_recv() {
            Ok(texels) => Some(texels),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                self.levels = None;
                None
            }
        }
    }

    /// Whether more may come.
    #[must_use]
    pub fn is_reading(&self) -> bool {
        self.levels.is_some()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn levels_that_take_too_much_memory_are_not_read() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../pack/tests/data/v1_ball.vxr");
        let read = |memory, beside_bricks| {
            let reader = Arc::new(Reader::open(&path).expect("opens"));
            let shown = reader.levels() - 1;
            let mut finer = FinerLevels::read(&reader, shown, (memory, beside_bricks), egui::Context::default());
            let mut levels = Vec::new();
            while finer.is_reading() {
                assert!(finer.take_in_file().is_none());
                levels.extend(finer.take().map(|texels| texels.expect("reads").description.level));
            }
            let in_file = finer.take_in_file().map(|(_, memory)| memory);
            (shown, levels, finer.too_large().map(str::to_owned), in_file)
        };
        for beside_bricks in [None, Some(0)] {
            let (shown, levels, too_large, in_file) = read(u64::MAX, beside_bricks);
            assert_eq!((levels, too_large, in_file), ((0..shown).rev().collect(), None, None));
        }
        let (_, levels, too_large, in_file) = read(1000, Some(250));
        assert_eq!((levels, too_large, in_file), (vec![], None, Some(1000)), "the rest comes brick by brick");
        let (shown, levels, too_large, _) = read(1000, None);
        assert!(shown > 0 && levels == (1..shown).rev().collect::<Vec<_>>());
        assert_eq!(too_large.as_deref(), Some("level 0 takes 5.3 KiB of memory, of which 1000 bytes may be taken"));
    }
}
