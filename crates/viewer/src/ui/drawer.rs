//! What draws the picture in the window: one on the GPU, one on the CPU.

use std::sync::Arc;

use egui::TextureId;

use super::refinement::Detail;
use crate::state::ViewState;
use crate::volume::VolumeTexels;
use crate::{Picture, Result};

/// How much of a picture is drawn before the window goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// All of it if possible, because the window has nothing else to show.
    AtOnce,
    /// As much as leaves the window awake.
    InParts,
}

/// Draws one volume, one picture at a time.
pub trait Drawer {
    /// What it draws on, in words.
    fn name(&self) -> String;

    /// The level of detail of its volume.
    fn level(&self) -> usize;

    /// Draws another level of the same volume from now on.
    ///
    /// # Errors
    /// [`crate::Error::VolumeTooLarge`] when it does not fit the device, [`crate::Error::Device`] when the device refuses;
    /// the volume before is then still drawn.
    fn replace_volume(&mut self, volume: &Arc<VolumeTexels>) -> Result<()>;

    /// Begins a picture of a state, whose size is that of the window, in place of the one that is being drawn.
    ///
    /// # Errors
    /// [`crate::Error::PictureSize`] or [`crate::Error::Device`] when the picture does not fit the device.
    fn begin(&mut self, context: &egui::Context, wanted: &ViewState, detail: Detail) -> Result<()>;

    /// Goes on with the picture that was begun; returns the seconds that it took once it is complete, and shows it from
    /// then on. Sees to it that the window comes back while it is not.
    ///
    /// # Errors
    /// [`crate::Error::Device`] when the device is lost; as [`crate::scene::Surfaces::new`].
    fn go_on(&mut self, context: &egui::Context, pace: Pace) -> Result<Option<f64>>;

    /// Leaves the picture that is being drawn as it is.
    fn give_up(&mut self);

    /// Which share of the picture that was begun is there.
    fn progress(&self) -> Option<f32>;

    /// The last complete picture.
    fn texture(&self) -> Option<TextureId>;

    /// Begins a picture of the settings' size and step for a file, beside what the window shows and in place of the one
    /// before.
    ///
    /// # Errors
    /// [`crate::Error::PictureSize`] or [`crate::Error::Device`] when it does not fit the device.
    fn begin_saved(&mut self, context: &egui::Context, view: &ViewState) -> Result<()>;

    /// Goes on with that picture; returns it once it is complete, and the level of detail that it is of. Sees to it that the window
    /// comes back while it is not.
    ///
    /// # Errors
    /// As [`Self::go_on`].
    fn go_on_saved(&mut self, context: &egui::Context) -> Result<Option<(Picture, usize)>>;

    /// The volume, where it is still in memory; ends the drawer.
    fn into_volume(self: Box<Self>) -> Option<Arc<VolumeTexels>>;
}

/// The size of a picture that is as fine as that, for a window's picture of `size` pixels.
#[must_use]
pub fn picture_size(size: [u32; 2], detail: Detail) -> [u32; 2] {
    size.map(|side| side.div_ceil(detail.divisor).max(1))
}
