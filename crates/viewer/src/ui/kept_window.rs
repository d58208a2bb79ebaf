//! A window without its device: what the first one is opened with, and what is left when the device is lost.

use std::sync::Arc;

use eframe::egui_wgpu::RenderState;

use super::ViewerWindow;
use super::finer_levels::FinerLevels;
use super::histogram::HistogramPanel;
use super::opened_volume::OpenedVolume;
use super::preview::Preview;
use super::save_picture::SavePicture;
use crate::Result;
use crate::device_args::DeviceArgs;
use crate::state::{SavedVolume, TransferFunction, ViewState};
use crate::volume::VolumeTexels;

/// Everything that a window holds but the picture and what draws it.
pub struct KeptWindow {
    /// What the picture looks like.
    pub view: ViewState,
    volume: OpenedVolume,
    histogram: HistogramPanel,
    save: SavePicture,
    finer: FinerLevels,
    /// What there is to say of the session that was opened.
    notice: Option<String>,
    /// What was drawn, where it is still in memory: a device that has all of it is the only one that does.
    pub texels: Option<Arc<VolumeTexels>>,
}

impl KeptWindow {
    /// For the first picture of a volume: the proposed regions, everything else as it is by default.
    #[must_use]
    pub fn new(volume: OpenedVolume) -> Self {
        let regions = volume.proposed_regions.clone();
        let transfer_function = TransferFunction { regions, ..TransferFunction::default() };
        Self {
            view: ViewState {
                transfer_function,
                volume: Some(SavedVolume::of(&volume.header)),
                ..ViewState::default()
            },
            histogram: HistogramPanel::new(&volume),
            save: SavePicture::new(&volume.path),
            finer: FinerLevels::default(),
            notice: None,
            volume,
            texels: None,
        }
    }

    /// Shows what a session says; the proposed regions stay where it draws nothing. Returns what is to be said where it was saved of
    /// another volume; the window says so too.
    pub fn open_session(&mut self, mut session: ViewState) -> Option<&str> {
        let volume = SavedVolume::of(&self.volume.header);
        self.notice = volume.mismatch(session.volume.as_ref());
        session.volume = Some(volume);
        let proposed = std::mem::replace(&mut self.view, session).transfer_function.regions;
        let transfer_function = &mut self.view.transfer_function;
        if transfer_function.draws_nothing() {
            transfer_function.regions = proposed;
        }
        self.notice.as_deref()
    }

    /// Of a window that is closed because its device is lost.
    #[must_use]
    pub fn of(window: ViewerWindow) -> Self {
        let ViewerWindow { view, volume, preview, histogram, mut save, finer, notice, .. } = window;
        let histogram = histogram.without_textures();
        save.device_is_lost();
        Self { view, volume, histogram, save, finer, notice, texels: preview.into_volume() }
    }

    /// The window on a device, with a level of the volume to begin with.
    ///
    /// # Errors
    /// As [`Preview::new`].
    pub fn open(
        self,
        render_state: &RenderState,
        texels: &Arc<VolumeTexels>,
        device: DeviceArgs,
    ) -> Result<ViewerWindow> {
        let Self { view, volume, histogram, save, finer, notice, .. } = self;
        let preview = Preview::new(render_state, texels, device)?;
        Ok(ViewerWindow { view, volume, preview, histogram, save, finer, notice, viewport: [1, 1] })
    }
}
