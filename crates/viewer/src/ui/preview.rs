//! The picture in the window: what is drawn when, and how finely.

use std::sync::Arc;

use eframe::egui_wgpu::RenderState;
use egui::TextureId;
use voxrole_pack::Reader;

use super::brick_drawer::{BrickDrawer, Room};
use super::cpu_drawer::CpuDrawer;
use super::drawer::{Drawer, Pace, picture_size};
use super::gpu_drawer::GpuDrawer;
use super::refinement::{Action, Detail, Refinement, work};
use crate::device_args::DeviceArgs;
use crate::render::{Gpu, Normals, normals_of_a_file};
use crate::state::ViewState;
use crate::streaming::memory_bound::{BYTES_PER_TEXEL, level_bytes};
use crate::volume::VolumeTexels;
use crate::{Error, Picture, Result};

/// Of the memory for a volume that comes brick by brick, a coarser level takes this share at most, and of the device's that.
const COARSER_OF_MEMORY: u64 = 4;
const COARSER_OF_DEVICE: u64 = 2;

/// What draws, and what it shows.
pub struct Preview {
    drawer: Box<dyn Drawer>,
    /// Draws the finest level of a volume that is larger than the memory for it; the drawer above has a coarser one.
    bricks: Option<BrickDrawer>,
    /// Where bricks can be drawn, and how much of the device's memory the volume takes at most.
    device: Option<(RenderState, Gpu, DeviceArgs)>,
    /// Whether the bricks' picture is the last one.
    shows_bricks: bool,
    /// Whether the picture for a file is the bricks'.
    saves_bricks: bool,
    /// Why bricks are drawn no more, until that is told.
    damage: Option<Error>,
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
        let is_cpu = on_cpu || gpu.is_cpu;
        Ok(Self {
            drawer,
            bricks: None,
            device: (!on_cpu).then(|| (render_state.clone(), gpu, device)),
            shows_bricks: false,
            saves_bricks: false,
            damage: None,
            begun: None,
            running: None,
            refinement: Refinement::new(is_cpu),
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

    /// The most bytes of a coarser level beside a finest one that comes brick by brick, of which `memory` bytes are kept; `None`
    /// where no bricks can be drawn.
    #[must_use]
    pub fn room_beside_bricks(&self, memory: u64) -> Option<u64> {
        let (.., device) = self.device.as_ref()?;
        Some((memory / COARSER_OF_MEMORY).min(device.gpu_memory.map_or(u64::MAX, |budget| budget / COARSER_OF_DEVICE)))
    }

    /// Makes ready, beside the window, to draw the finest level of a file by bricks, of which `memory` bytes are kept. The level
    /// that is shown goes on to be drawn while a hand moves.
    ///
    /// # Errors
    /// As [`BrickDrawer::new`]; [`Error::Normals`] where they are to be compressed.
    pub fn draw_bricks(&mut self, reader: Arc<Reader>, memory: u64, context: &egui::Context) -> Result<()> {
        let Some((render_state, gpu, device)) = &self.device else { return Ok(()) };
        if device.normals == Some(Normals::Compressed) {
            return Err(normals_of_a_file());
        }
        let texels = level_bytes(&reader, self.drawer.level())?;
        // Its values are kept for isosurfaces.
        let values = texels / BYTES_PER_TEXEL * 2;
        let room = Room {
            memory,
            coarser: if gpu.shares_memory { texels + values } else { values },
            device: device.gpu_memory.map(|budget| budget.saturating_sub(texels)),
        };
        self.bricks = Some(BrickDrawer::new((render_state, gpu), reader, room, context)?);
        Ok(())
    }

    /// Which share is done of what it takes before bricks can be drawn, where that is being done.
    #[must_use]
    pub fn preparing_bricks(&self) -> Option<f32> {
        self.bricks.as_ref().and_then(BrickDrawer::preparation)
    }

    /// Looks after bricks that are made ready; goes back to the coarser level for good where they cannot be, or one is damaged.
    ///
    /// # Errors
    /// Why that is, once.
    pub fn look_after_bricks(&mut self, context: &egui::Context) -> Result<()> {
        if let Some(damage) = self.damage.take() {
            return Err(damage);
        }
        let Some(bricks) = &mut self.bricks else { return Ok(()) };
        match bricks.becomes_ready(context) {
            Ok(false) => Ok(()),
            Ok(true) => {
                self.refinement.set_coarser(true);
                let running = self.running.iter_mut().map(|(detail, _)| detail);
                running.chain(self.last.iter_mut().map(|last| &mut last.detail)).for_each(|of| of.is_coarser = true);
                Ok(())
            }
            Err(error) => {
                self.without_bricks();
                Err(error)
            }
        }
    }

    fn without_bricks(&mut self) {
        self.bricks = None;
        self.shows_bricks = false;
        self.refinement.set_coarser(false);
        self.begun = None;
        self.running = None;
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
            let begun = self.begin(context, &wanted, detail);
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
        if self.shows_bricks { self.bricks.as_ref()?.texture() } else { self.drawer.texture() }
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
        if self.shows_bricks { 0 } else { self.drawer.level() }
    }

    /// What the last finished picture took.
    #[must_use]
    pub fn last(&self) -> Option<Drawn> {
        self.last
    }

    /// Which share of a finer picture is done, where one is being drawn.
    #[must_use]
    pub fn refining(&self) -> Option<f32> {
        match (self.running, &self.bricks) {
            (Some((detail, Pace::InParts)), Some(bricks)) if self.is_of_bricks(detail) => bricks.progress(),
            (Some((_, Pace::InParts)), _) => self.drawer.progress(),
            _ => None,
        }
    }

    /// Whether a picture is the bricks' to draw.
    fn is_of_bricks(&self, detail: Detail) -> bool {
        !detail.is_coarser && self.bricks.as_ref().is_some_and(|bricks| bricks.preparation().is_none())
    }

    fn begin(&mut self, context: &egui::Context, wanted: &ViewState, detail: Detail) -> Result<()> {
        let is_of_bricks = self.is_of_bricks(detail);
        if let Some(bricks) = &mut self.bricks {
            if is_of_bricks {
                self.drawer.give_up();
                return bricks.begin(context, wanted);
            }
            bricks.give_up();
        }
        self.drawer.begin(context, wanted, detail)
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

    /// Begins a picture of the settings' size and step for a file, whatever the window shows, in place of the one before.
    ///
    /// # Errors
    /// [`Error::PictureSize`] or [`Error::Device`] when it does not fit the device.
    pub fn begin_saved(&mut self, context: &egui::Context, view: &ViewState) -> Result<()> {
        self.saves_bricks = self.is_of_bricks(Detail::FULL);
        match &mut self.bricks {
            Some(bricks) if self.saves_bricks => bricks.begin_saved(context, view),
            _ => self.drawer.begin_saved(context, view),
        }
    }

    /// Goes on with that picture; returns it once it is complete, and the level of detail that it is of.
    ///
    /// # Errors
    /// As [`Drawer::go_on`]; [`Error::GivenUp`] where it was to be of bricks, which are there no more.
    pub fn go_on_saved(&mut self, context: &egui::Context) -> Result<Option<(Picture, usize)>> {
        match &mut self.bricks {
            Some(bricks) if self.saves_bricks => Ok(bricks.go_on_saved()?.map(|picture| (picture, 0))),
            None if self.saves_bricks => Err(Error::GivenUp),
            _ => self.drawer.go_on_saved(context),
        }
    }

    /// The volume, where it is still in memory.
    #[must_use]
    pub fn into_volume(self) -> Option<Arc<VolumeTexels>> {
        self.drawer.into_volume()
    }

    /// Goes on with the picture that is being drawn, and takes note of it once it is complete.
    fn go_on(&mut self, context: &egui::Context) {
        let (Some((detail, pace)), Some(begun)) = (self.running, &self.begun) else { return };
        let is_of_bricks = self.is_of_bricks(detail);
        let gone_on = match &mut self.bricks {
            Some(bricks) if is_of_bricks => bricks.go_on(context),
            _ => self.drawer.go_on(context, pace),
        };
        let seconds = match gone_on {
            Ok(None) => return,
            Ok(Some(seconds)) => seconds,
            Err(error @ Error::Pack(_)) if is_of_bricks => {
                // The file is damaged: the coarser level, which was read, is what there is.
                self.without_bricks();
                self.damage = Some(error);
                context.request_repaint();
                return;
            }
            Err(error) => return self.fail(&error),
        };
        let settings = &begun.render_settings;
        let drawn = work(picture_size(settings.image_size, detail), settings.step * detail.step_factor);
        self.refinement.finished(detail, seconds, drawn);
        self.last = Some(Drawn { detail, seconds });
        self.pictures += 1;
        self.shows_bricks = is_of_bricks;
        self.running = None;
        self.error = None;
        // Comes back to refine further, or to find that there is nothing left to do.
        context.request_repaint();
    }

    fn fail(&mut self, error: &Error) {
        self.drawer.give_up();
        if let Some(bricks) = &mut self.bricks {
            bricks.give_up();
        }
        self.running = None;
        self.refinement.failed();
        self.complain(error);
    }
}

/// What the picture takes in full.
fn full_work(wanted: &ViewState) -> f64 {
    work(wanted.render_settings.image_size, wanted.render_settings.step)
}
