//! Finer levels of detail, read beside the window while it shows a coarser one.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::thread;

use voxrole_pack::Reader;

use crate::Result;
use crate::volume::VolumeTexels;

/// Levels on their way.
#[derive(Default)]
pub struct FinerLevels(Option<Receiver<Result<VolumeTexels>>>);

impl FinerLevels {
    /// Reads every level that is finer than `shown`, the coarsest first, on a thread of its own; `context` is woken for each.
    #[must_use]
    pub fn read(reader: Arc<Reader>, shown: usize, context: egui::Context) -> Self {
        // One level waits while the next is read: no more of them are in memory.
        let (sender, receiver) = sync_channel(0);
        thread::spawn(move || {
            for level in (0..shown).rev() {
                let texels = VolumeTexels::read_level(&reader, level);
                let failed = texels.is_err();
                context.request_repaint();
                if sender.send(texels).is_err() || failed {
                    return;
                }
            }
        });
        Self(Some(receiver))
    }

    /// The next level, if it is there by now.
    pub fn take(&mut self) -> Option<Result<VolumeTexels>> {
        match self.0.as_ref()?.try_recv() {
            Ok(texels) => Some(texels),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                self.0 = None;
                None
            }
        }
    }

    /// Whether more may come.
    #[must_use]
    pub fn is_reading(&self) -> bool {
        self.0.is_some()
    }
}
