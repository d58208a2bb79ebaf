//! The picture in the window: drawn by the renderer into a texture that egui shows.

use std::sync::Arc;
use std::time::Instant;

use eframe::egui_wgpu::RenderState;
use egui::TextureId;
use glam::Vec3;
use wgpu::{FilterMode, PollType};

use super::preview_scene::PreviewScene;
use super::refinement::{Action, Detail, PASS_BUDGET, Refinement};
use crate::drawing::scale_bar;
use crate::render::{Gpu, Renderer, Target};
use crate::scene::scale_bar::draw_over_picture;
use crate::state::ViewState;
use crate::volume::VolumeTexels;
use crate::{Error, Picture, Result};

/// Renderer, texture, and what it shows.
pub struct Preview {
    render_state: RenderState,
    renderer: Renderer,
    /// Most bytes of the device that a volume takes.
    budget: Option<u64>,
    scene: PreviewScene,
    /// Kept for as long as egui shows it.
    target: Option<Target>,
    texture: Option<TextureId>,
    /// What the texture shows: the state, its picture size being the window's.
    shown: Option<ViewState>,
    refinement: Refinement,
    /// The finer picture of the same state that is being drawn.
    refining: Option<PartialPicture>,
    last: Option<Drawn>,
    error: Option<String>,
    pictures: u64,
}

/// What the last finished picture took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn {
    /// How fine it was.
    pub detail: Detail,
    /// Seconds of the device.
    pub seconds: f64,
}

/// A picture whose upper rows are drawn.
struct PartialPicture {
    detail: Detail,
    target: Target,
    rows: u32,
    seconds: f64,
}

impl PartialPicture {
    fn new(gpu: &Gpu, wanted: &ViewState, detail: Detail) -> Result<Self> {
        let size = wanted.render_settings.image_size.map(|side| side.div_ceil(detail.divisor).max(1));
        Ok(Self { detail, target: Target::new(gpu, size)?, rows: 0, seconds: 0.0 })
    }

    fn height(&self) -> u32 {
        self.target.size()[1]
    }
}

impl Preview {
    /// Uploads a volume to the device that the window itself is drawn with, where it takes `budget` bytes at most.
    ///
    /// # Errors
    /// [`Error::VolumeTooLarge`] when the volume does not fit, [`Error::Device`] when the device refuses.
    pub fn new(render_state: &RenderState, volume: &Arc<VolumeTexels>, budget: Option<u64>) -> Result<Self> {
        let gpu = Gpu::from_parts(&render_state.adapter, render_state.device.clone(), render_state.queue.clone());
        let refinement = Refinement::new(gpu.is_cpu);
        Ok(Self {
            render_state: render_state.clone(),
            renderer: Renderer::new(&gpu, volume, budget)?,
            budget,
            scene: PreviewScene::new(volume),
            target: None,
            texture: None,
            shown: None,
            refinement,
            refining: None,
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
        self.renderer = Renderer::new(self.renderer.gpu(), volume, self.budget)?;
        self.scene.replace_volume(volume);
        self.shown = None;
        self.refining = None;
        Ok(())
    }

    /// Says below the picture what went wrong.
    pub fn complain(&mut self, error: &Error) {
        self.error = Some(error.to_string());
    }

    /// The level of detail that is shown.
    #[must_use]
    pub fn level(&self) -> usize {
        self.renderer.level()
    }

    /// Draws where that is due. `size` in pixels; asks for another pass where one is needed.
    pub fn update(&mut self, context: &egui::Context, view: &ViewState, size: [u32; 2]) {
        let mut wanted = view.clone();
        wanted.render_settings.image_size = size;
        let changed = self.shown.as_ref() != Some(&wanted);
        let (now, hand_down) = context.input(|input| (input.time, input.pointer.any_down()));
        let action = self.refinement.next(changed, hand_down, now, work(size, view.render_settings.step));
        let outcome = match action {
            Action::Draft(detail) => {
                self.refining = None;
                self.draft(&wanted, detail)
            }
            Action::Refine(detail) => self.refine(&wanted, detail),
            Action::Wait(seconds) => {
                context.request_repaint_after_secs(seconds as f32);
                return;
            }
            Action::Rest => return,
        };
        self.shown = Some(wanted);
        self.error = outcome.err().map(|error| error.to_string());
        if self.error.is_none() {
            // Comes back to refine further, or to find that there is nothing left to do.
            context.request_repaint();
        }
    }

    /// The texture that shows the picture, once there is one.
    #[must_use]
    pub fn texture(&self) -> Option<TextureId> {
        self.texture
    }

    /// Why the last picture could not be drawn.
    #[must_use]
    pub fn error(&self) -> Option<&str> {
        self.error.as_deref()
    }

    /// The device's name.
    #[must_use]
    pub fn device_name(&self) -> &str {
        &self.renderer.gpu().name
    }

    /// What the last finished picture took.
    #[must_use]
    pub fn last(&self) -> Option<Drawn> {
        self.last
    }

    /// Which share of a finer picture is done, where one is being drawn.
    #[must_use]
    pub fn refining(&self) -> Option<f32> {
        self.refining.as_ref().map(|partial| partial.rows as f32 / partial.height() as f32)
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
        let gpu = self.renderer.gpu().clone();
        let target = Target::new(&gpu, view.render_settings.image_size)?;
        self.renderer.prepare_scene(&view.scene, &self.scene.surfaces(&view.scene)?, target.size())?;
        self.renderer.draw(view, &target)?;
        let mut picture = target.read_back(&gpu)?;
        if let Some(bar) = scale_bar(view, self.renderer.volume()) {
            draw_over_picture(&bar, &mut picture, Vec3::from_array(view.render_settings.background))?;
        }
        Ok(picture)
    }

    /// Draws and shows a picture.
    fn draft(&mut self, wanted: &ViewState, detail: Detail) -> Result<()> {
        let mut partial = PartialPicture::new(self.renderer.gpu(), wanted, detail)?;
        let rows = partial.height();
        self.draw_rows(wanted, &mut partial, rows)?;
        self.show(wanted, partial);
        Ok(())
    }

    /// Draws as many rows of a finer picture as a pass has time for, and shows it once it is complete.
    fn refine(&mut self, wanted: &ViewState, detail: Detail) -> Result<()> {
        let mut partial = match self.refining.take().filter(|partial| partial.detail == detail) {
            Some(partial) => partial,
            None => PartialPicture::new(self.renderer.gpu(), wanted, detail)?,
        };
        let [width, height] = partial.target.size();
        let row_work = work([width, 1], wanted.render_settings.step * detail.step_factor);
        let start = Instant::now();
        while partial.rows < height && start.elapsed().as_secs_f64() < PASS_BUDGET {
            let seconds = self.draw_rows(wanted, &mut partial, self.refinement.strip(row_work))?;
            self.refinement.strip_finished(seconds);
        }
        if partial.rows < height {
            self.refining = Some(partial);
        } else {
            self.show(wanted, partial);
        }
        Ok(())
    }

    /// Draws the next rows and waits for them; returns the seconds that they took.
    fn draw_rows(&mut self, wanted: &ViewState, partial: &mut PartialPicture, rows: u32) -> Result<f64> {
        let mut state = wanted.clone();
        state.render_settings.step *= partial.detail.step_factor;
        let end = (partial.rows + rows).min(partial.height());
        let surfaces = self.scene.surfaces(&state.scene)?;
        self.renderer.prepare_scene(&state.scene, &surfaces, partial.target.size())?;
        let start = Instant::now();
        self.renderer.draw_rows(&state, &partial.target, partial.rows..end)?;
        // Waited for, because the window waits for its picture anyway, and so that the time is the device's.
        let gpu = self.renderer.gpu();
        gpu.device.poll(PollType::wait_indefinitely()).map_err(|error| Error::Device {
            action: "drawing the picture",
            device: gpu.name.clone(),
            reason: error.to_string(),
        })?;
        let seconds = start.elapsed().as_secs_f64();
        partial.seconds += seconds;
        partial.rows = end;
        Ok(seconds)
    }

    /// Hands a finished picture to egui.
    fn show(&mut self, wanted: &ViewState, PartialPicture { detail, target, seconds, .. }: PartialPicture) {
        let step = wanted.render_settings.step * detail.step_factor;
        self.refinement.finished(detail, seconds, work(target.size(), step));
        self.last = Some(Drawn { detail, seconds });
        self.pictures += 1;
        let (device, view, filter) = (&self.render_state.device, target.view(), FilterMode::Linear);
        let mut egui_renderer = self.render_state.renderer.write();
        match self.texture {
            Some(texture) => egui_renderer.update_egui_texture_from_wgpu_texture(device, view, filter, texture),
            None => self.texture = Some(egui_renderer.register_native_texture(device, view, filter)),
        }
        self.target = Some(target);
    }
}

/// Pixels times samples per `L_min`.
fn work([width, height]: [u32; 2], step: f32) -> f64 {
    f64::from(width) * f64::from(height) / f64::from(step.max(1e-3))
}
