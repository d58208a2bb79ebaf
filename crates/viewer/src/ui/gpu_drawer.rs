//! Draws the window's picture on the device that the window itself is drawn with.

use std::sync::Arc;
use std::time::Instant;

use eframe::egui_wgpu::RenderState;
use egui::TextureId;
use wgpu::PollType;

use super::drawer::{Drawer, Pace, picture_size};
use super::preview_scene::PreviewScene;
use super::refinement::{Detail, PASS_BUDGET, StripLength, work};
use super::shown_target::ShownTarget;
use crate::drawing::finished_picture;
use crate::render::{DeviceMemory, Gpu, Renderer, Target};
use crate::state::ViewState;
use crate::volume::VolumeTexels;
use crate::{Picture, Result};

/// Renderer, texture, and the picture that is being drawn.
pub struct GpuDrawer {
    renderer: Renderer,
    /// What a volume may take of the device's.
    memory: DeviceMemory,
    scene: PreviewScene,
    shown: ShownTarget,
    strip: StripLength,
    partial: Option<PartialPicture>,
    /// The picture for a file.
    saved: Option<PartialPicture>,
}

/// A picture whose upper rows are drawn.
struct PartialPicture {
    /// With steps as long as the picture's detail says.
    state: ViewState,
    target: Target,
    rows: u32,
    seconds: f64,
}

impl GpuDrawer {
    /// Uploads a volume to the device, of whose memory it takes so much.
    ///
    /// # Errors
    /// [`crate::Error::VolumeTooLarge`] when the volume does not fit, [`crate::Error::Device`] when the device refuses.
    pub fn new(
        render_state: &RenderState,
        gpu: &Gpu,
        volume: &Arc<VolumeTexels>,
        memory: DeviceMemory,
    ) -> Result<Self> {
        Ok(Self {
            renderer: Renderer::new(gpu, volume, memory)?,
            memory,
            scene: PreviewScene::new(volume),
            shown: ShownTarget::new(render_state),
            strip: StripLength::default(),
            partial: None,
            saved: None,
        })
    }

    /// Draws the next rows and waits for them; returns the seconds that they took.
    fn draw_rows(&mut self, partial: &mut PartialPicture, rows: u32) -> Result<f64> {
        let PartialPicture { state, target, .. } = &*partial;
        let [_, height] = target.size();
        let end = partial.rows.saturating_add(rows).min(height);
        let surfaces = self.scene.surfaces(&state.scene)?;
        self.renderer.prepare_scene(&state.scene, &surfaces, target.size())?;
        let start = Instant::now();
        self.renderer.draw_rows(state, target, partial.rows..end)?;
        // Waited for, because the window waits for its picture anyway, and so that the time is the device's.
        let gpu = self.renderer.gpu();
        let waited = gpu.device.poll(PollType::wait_indefinitely());
        waited.map_err(|error| gpu.error("drawing the picture", &error))?;
        let seconds = start.elapsed().as_secs_f64();
        partial.seconds += seconds;
        partial.rows = end;
        Ok(seconds)
    }

    /// Draws as many rows as a pass has time for.
    fn draw_part(&mut self, partial: &mut PartialPicture) -> Result<()> {
        let [width, height] = partial.target.size();
        let row_work = work([width, 1], partial.state.render_settings.step);
        let start = Instant::now();
        while partial.rows < height && start.elapsed().as_secs_f64() < PASS_BUDGET {
            let seconds = self.draw_rows(partial, self.strip.rows(row_work))?;
            self.strip.drawn(seconds);
        }
        Ok(())
    }
}

impl Drawer for GpuDrawer {
    fn name(&self) -> String {
        self.renderer.gpu().name.clone()
    }

    fn level(&self) -> usize {
        self.renderer.level()
    }

    fn replace_volume(&mut self, volume: &Arc<VolumeTexels>) -> Result<()> {
        self.renderer = Renderer::new(self.renderer.gpu(), volume, self.memory)?;
        self.scene.replace_volume(volume);
        // All of it is of one level.
        self.saved.iter_mut().for_each(|saved| saved.rows = 0);
        Ok(())
    }

    fn begin(&mut self, _: &egui::Context, wanted: &ViewState, detail: Detail) -> Result<()> {
        let mut state = wanted.clone();
        state.render_settings.step *= detail.step_factor;
        let target = Target::new(self.renderer.gpu(), picture_size(wanted.render_settings.image_size, detail))?;
        self.partial = Some(PartialPicture { state, target, rows: 0, seconds: 0.0 });
        Ok(())
    }

    fn go_on(&mut self, context: &egui::Context, pace: Pace) -> Result<Option<f64>> {
        let Some(mut partial) = self.partial.take() else { return Ok(None) };
        match pace {
            Pace::AtOnce => self.draw_rows(&mut partial, u32::MAX).map(|_| ()),
            Pace::InParts => self.draw_part(&mut partial),
        }?;
        let [_, height] = partial.target.size();
        if partial.rows < height {
            self.partial = Some(partial);
            context.request_repaint();
            return Ok(None);
        }
        self.shown.show(partial.target);
        Ok(Some(partial.seconds))
    }

    fn give_up(&mut self) {
        self.partial = None;
    }

    fn progress(&self) -> Option<f32> {
        self.partial.as_ref().map(|partial| partial.rows as f32 / partial.target.size()[1] as f32)
    }

    fn texture(&self) -> Option<TextureId> {
        self.shown.texture()
    }

    fn begin_saved(&mut self, context: &egui::Context, view: &ViewState) -> Result<()> {
        let target = Target::new(self.renderer.gpu(), view.render_settings.image_size)?;
        self.saved = Some(PartialPicture { state: view.clone(), target, rows: 0, seconds: 0.0 });
        context.request_repaint();
        Ok(())
    }

    fn go_on_saved(&mut self, context: &egui::Context) -> Result<Option<(Picture, usize)>> {
        let Some(mut saved) = self.saved.take() else { return Ok(None) };
        self.draw_part(&mut saved)?;
        let [_, height] = saved.target.size();
        if saved.rows < height {
            self.saved = Some(saved);
            context.request_repaint();
            return Ok(None);
        }
        let picture = finished_picture(&self.renderer, &saved.state, &saved.target)?;
        Ok(Some((picture, self.level())))
    }

    fn into_volume(self: Box<Self>) -> Option<Arc<VolumeTexels>> {
        // It was given up once it was uploaded.
        None
    }
}
