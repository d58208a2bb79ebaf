//! The picture in the window: what is drawn when, and how finely.

use std::sync::Arc;

use eframe::egui_wgpu::RenderState;
use egui::TextureId;

use super::cpu_drawer::CpuDrawer;
use super::drawer::{Drawer, Pace, picture_size};
use super::gpu_drawer::GpuDrawer;
use super::refinement::{Action, Detail, Refinement, work};
use crate::device_args::DeviceArgs;
use crate::render::Gpu;
use crate::state::ViewState;
use crate::volume::VolumeTexels;
use crate::{Error, Picture, Result};

/// What draws, and what it shows.
pub struct Preview {
    drawer: Box<dyn Drawer>,
    /// What was begun last: the state, its picture size being the window's.
    begun: Option<ViewState>,
    /// How fine the picture is that is being drawn, and at which pace.
    running: Option<(Detail, Pace)>,
    refinement: Refinement,
    last: Option<Drawn>,
    error: Option<String>,
    pictures: u64,
}

/// What the last finished picture took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn {
    /// How fine it was.
    pub detail: Detail,
    /// Seconds of what drew it.
    pub seconds: f64,
}

impl Preview {
    /// Draws a volume on the device that the window itself is drawn with, or on the CPU where that is asked for or all
    /// there is.
    ///
    /// # Errors
    /// [`Error::VolumeTooLarge`] when the volume does not fit, [`Error::Device`] when the device refuses.
    pub fn new(render_state: &RenderState, volume: &Arc<VolumeTexels>, device: DeviceArgs) -> Result<Self> {
        let gpu = Gpu::from_parts(&render_state.adapter, render_state.device.clone(), render_state.queue.clone());
        let on_cpu = device.wants_cpu(gpu.is_cpu);
        let drawer: Box<dyn Drawer> = if on_cpu {
            Box::new(CpuDrawer::new(volume)?)
        } else {
            Box::new(GpuDrawer::new(render_state, &gpu, volume, device.memory())?)
        };
        Ok(Self {
            drawer,
            begun: None,
            running: None,
            refinement: Refinement::new(on_cpu || gpu.is_cpu),
            last: None,
            error: None,
            pictures: 0,
        })
    }

    /// Shows another level of the same volume from now on.
    ///
    /// # Errors
    /// As [`Self::new`]; the volume shown before is then still shown.
    pub fn replace_volume(&mut self, volume: &Arc<VolumeTexels>) -> Result<()> {
        self.drawer.replace_volume(volume)?;
        self.drawer.give_up();
        self.begun = None;
        self.running = None;
        Ok(())
    }

    /// Says below the picture what went wrong.
    pub fn complain(&mut self, error: &Error) {
        self.error = Some(error.to_string());
    }

    /// Draws where that is due. `size` in pixels; asks for another pass where one is needed.
    pub fn update(&mut self, context: &egui::Context, view: &ViewState, size: [u32; 2]) {
        if matches!(self.running, Some((_, Pace::AtOnce))) {
            self.go_on(context);
            // A draft is never given up: while a hand moves there would be none at all.
            if self.running.is_some() {
                return;
            }
        }
        let mut wanted = view.clone();
        wanted.render_settings.image_size = size;
        let changed = self.begun.as_ref() != Some(&wanted);
        let (now, hand_down) = context.input(|input| (input.time, input.pointer.any_down()));
        let (detail, pace) = match self.refinement.next(changed, hand_down, now, full_work(&wanted)) {
            Action::Draft(detail) => (detail, Pace::AtOnce),
            Action::Refine(detail) => (detail, Pace::InParts),
            Action::Wait(seconds) => {
                context.request_repaint_after_secs(seconds as f32);
                return;
            }
            Action::Rest => return,
        };
        if changed || self.running != Some((detail, pace)) {
            let begun = self.drawer.begin(context, &wanted, detail);
            self.running = Some((detail, pace));
            self.begun = Some(wanted);
            if let Err(error) = begun {
                self.fail(&error);
            }
        }
        self.go_on(context);
    }

    /// The texture that shows the picture, once there is one.
    #[must_use]
    pub fn texture(&self) -> Option<TextureId> {
        self.drawer.texture()
    }

    /// Why the last picture could not be drawn.
    #[must_use]
    pub fn error(&self) -> Option<&str> {
        self.error.as_deref()
    }

    /// What draws.
    #[must_use]
    pub fn drawn_by(&self) -> String {
        self.drawer.name()
    }

    /// The level of detail that is shown.
    #[must_use]
    pub fn level(&self) -> usize {
        self.drawer.level()
    }

    /// What the last finished picture took.
    #[must_use]
    pub fn last(&self) -> Option<Drawn> {
        self.last
    }

    /// Which share of a finer picture is done, where one is being drawn.
    #[must_use]
    pub fn refining(&self) -> Option<f32> {
        matches!(self.running, Some((_, Pace::InParts))).then(|| self.drawer.progress()).flatten()
    }

    /// Whether the picture that was begun last is there in full.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.running.is_none() && self.last.is_some_and(|drawn| drawn.detail == Detail::FULL)
    }

    /// How many pictures the window has shown so far.
    #[must_use]
    pub fn pictures(&self) -> u64 {
        self.pictures
    }

    /// A picture of the settings' size and step, whatever the window shows.
    ///
    /// # Errors
    /// [`Error::PictureSize`] or [`Error::Device`] when it does not fit the device; as [`crate::scene::Surfaces::new`].
    pub fn picture(&mut self, view: &ViewState) -> Result<Picture> {
        self.drawer.picture(view)
    }

    /// The volume, where it is still in memory.
    #[must_use]
    pub fn into_volume(self) -> Option<Arc<VolumeTexels>> {
        self.drawer.into_volume()
    }

    /// Goes on with the picture that is being drawn, and takes note of it once it is complete.
    fn go_on(&mut self, context: &egui::Context) {
        let (Some((detail, pace)), Some(begun)) = (self.running, &self.begun) else { return };
        let seconds = match self.drawer.go_on(context, pace) {
            Ok(None) => return,
            Ok(Some(seconds)) => seconds,
            Err(error) => return self.fail(&error),
        };
        let settings = &begun.render_settings;
        let drawn = work(picture_size(settings.image_size, detail), settings.step * detail.step_factor);
        self.refinement.finished(detail, seconds, drawn);
        self.last = Some(Drawn { detail, seconds });
        self.pictures += 1;
        self.running = None;
        self.error = None;
        // Comes back to refine further, or to find that there is nothing left to do.
        context.request_repaint();
    }

    fn fail(&mut self, error: &Error) {
        self.drawer.give_up();
        self.running = None;
        self.complain(error);
    }
}

/// What the picture takes in full.
fn full_work(wanted: &ViewState) -> f64 {
    work(wanted.render_settings.image_size, wanted.render_settings.step)
}
