//! A picture on the device that egui shows.

use eframe::egui_wgpu::RenderState;
use egui::TextureId;
use wgpu::FilterMode;

use crate::render::Target;

/// The last picture, under a name that stays.
pub struct ShownTarget {
    render_state: RenderState,
    /// Kept for as long as egui shows it.
    target: Option<Target>,
    texture: Option<TextureId>,
}

impl ShownTarget {
    /// None yet, in the window that is drawn so.
    #[must_use]
    pub fn new(render_state: &RenderState) -> Self {
        Self { render_state: render_state.clone(), target: None, texture: None }
    }

    /// Hands a finished picture to egui.
    pub fn show(&mut self, target: Target) {
        let (device, view, filter) = (&self.render_state.device, target.view(), FilterMode::Linear);
        let mut egui_renderer = self.render_state.renderer.write();
        match self.texture {
            Some(texture) => egui_renderer.update_egui_texture_from_wgpu_texture(device, view, filter, texture),
            None => self.texture = Some(egui_renderer.register_native_texture(device, view, filter)),
        }
        self.target = Some(target);
    }

    /// What egui calls it.
    #[must_use]
    pub fn texture(&self) -> Option<TextureId> {
        self.texture
    }
}

impl Drop for ShownTarget {
    fn drop(&mut self) {
        if let Some(texture) = self.texture {
            self.render_state.renderer.write().free_texture(&texture);
        }
    }
}
