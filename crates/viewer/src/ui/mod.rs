//! The window's panels: each is a function over the state that it shows. What they change is [`ViewState`] alone.

pub mod axis;
pub mod boundary;
pub mod brick_drawer;
pub mod brush;
pub mod camera;
pub mod clipping;
pub mod cpu_drawer;
pub mod curve;
pub mod device_loss;
pub mod distance_histogram;
pub mod drawer;
pub mod finer_levels;
mod form;
pub mod gpu_drawer;
pub mod histogram;
pub mod kept_window;
pub mod opened_volume;
pub mod painted_maps;
pub mod preview;
pub mod preview_scene;
pub mod readout;
pub mod refinement;
pub mod region_grip;
pub mod render_settings;
pub mod save_picture;
pub mod scene;
pub mod shown_target;
pub mod theme;
pub mod transfer_function;
pub mod viewport;

use std::sync::Arc;

use egui::{CentralPanel, Frame, Panel, RichText, ScrollArea, Ui};

use crate::state::{Region, TransferFunction, TwoSidedEmphasis, ViewState};
use finer_levels::FinerLevels;
use form::section;
use histogram::HistogramPanel;
use opened_volume::OpenedVolume;
use preview::{Drawn, Preview};
use refinement::Detail;
use save_picture::SavePicture;

/// Everything that a window holds.
pub struct ViewerWindow {
    /// What the picture looks like.
    pub view: ViewState,
    /// What is shown.
    pub volume: OpenedVolume,
    /// The picture.
    pub preview: Preview,
    /// The histogram of value and gradient magnitude.
    pub histogram: HistogramPanel,
    /// Saving.
    pub save: SavePicture,
    /// What is to be shown next.
    pub finer: FinerLevels,
    /// What there is to say of the session that was opened.
    pub notice: Option<String>,
    viewport: [u32; 2],
}

impl ViewerWindow {
    /// Shows the next finer level once it is read, or made ready to be drawn by bricks from its file. One that the device has no
    /// room for leaves the coarser one where it is.
    fn show_finer_level(&mut self, context: &egui::Context) {
        match self.finer.take() {
            Some(Ok(texels)) => {
                if let Err(error) = self.preview.replace_volume(&Arc::new(texels)) {
                    self.finer.stop(&error);
                }
            }
            Some(Err(error)) => self.finer.stop(&error),
            None => {}
        }
        let begun = match self.finer.take_in_file() {
            Some((reader, memory)) => self.preview.draw_bricks(reader, memory, context),
            None => Ok(()),
        };
        if let Err(error) = begun.and_then(|()| self.preview.look_after_bricks(context)) {
            self.finer.stop(&error);
        }
        if self.finer.is_reading() {
            context.request_repaint_after_secs(0.05);
        }
    }
}

/// The whole window: settings to the left, the transfer function to the right, the picture between them.
pub fn window_ui(ui: &mut Ui, window: &mut ViewerWindow) {
    window.show_finer_level(ui.ctx());
    window.save.go_on(ui.ctx(), &mut window.preview);
    Panel::bottom("status").resizable(false).show(ui, |ui| status_ui(ui, window));
    Panel::left("settings").resizable(true).default_size(280.0).size_range(240.0..=420.0).show(ui, |ui| {
        let ViewerWindow { view, preview, save, viewport, .. } = window;
        // Always in sight, whatever the settings above are scrolled to.
        Panel::bottom("save").resizable(false).frame(Frame::NONE).show(ui, |ui| {
            save_picture::save_picture_ui(ui, save, preview, view, *viewport);
        });
        ScrollArea::vertical().auto_shrink(false).show(ui, |ui| settings_ui(ui, window));
    });
    Panel::right("transfer function").resizable(true).default_size(390.0).size_range(340.0..=640.0).show(ui, |ui| {
        ScrollArea::vertical().auto_shrink(false).show(ui, |ui| transfer_ui(ui, window));
    });
    CentralPanel::no_frame().show(ui, |ui| {
        let pixels = ui.available_size() * ui.pixels_per_point();
        window.viewport = [pixels.x, pixels.y].map(|side| side.round().max(1.0) as u32);
        viewport::viewport_ui(ui, &mut window.view, &mut window.preview, &window.volume.description);
    });
}

fn settings_ui(ui: &mut Ui, window: &mut ViewerWindow) {
    let ViewerWindow { view, volume, preview, notice, .. } = window;
    section(ui, "Volume", |ui| {
        readout::readout_ui(ui, volume, &preview.drawn_by());
        if let Some(notice) = notice {
            let notice = sentence(notice);
            ui.label(RichText::new(notice).small().color(theme::ERROR));
        }
    });
    section(ui, "Camera", |ui| camera::camera_ui(ui, &mut view.camera));
    let dims = volume.description.dims;
    section(ui, "Clipping", |ui| clipping::clipping_ui(ui, &mut view.clipping, &view.camera, dims));
    let range = volume.description.value_range;
    section(ui, "Lines and surfaces", |ui| scene::scene_ui(ui, &mut view.scene, range));
    section(ui, "Rendering", |ui| {
        render_settings::render_settings_ui(ui, &mut view.render_settings, view.transfer_function.classification)
    });
}

fn transfer_ui(ui: &mut Ui, window: &mut ViewerWindow) {
    let ViewerWindow { view, volume, histogram, .. } = window;
    let TransferFunction { regions, emphasis, .. } = &mut view.transfer_function;
    section(ui, "Regions of value and gradient magnitude, αu(v, g)", |ui| {
        histogram::histogram_ui(ui, histogram, volume, regions);
        transfer_function::transfer_function_ui(ui, histogram, regions, &volume.proposed_regions);
    });
    section(ui, "Opacity by distance to the boundary, αd(d)", |ui| {
        let smallest_spacing = volume.description.smallest_spacing();
        let emphasis = selected_emphasis(ui, regions, histogram.selected, emphasis);
        distance_histogram::distance_histogram_ui(ui, &volume.distance, smallest_spacing, emphasis);
        boundary::boundary_ui(ui, emphasis, volume.description.d_max_in_spacings());
    });
    section(ui, "Opacity by value alone", |ui| {
        curve::curve_ui(ui, &mut view.transfer_function, volume.description.value_range);
    });
}

/// A message with a capital letter.
fn sentence(message: &str) -> String {
    let mut letters = message.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// The αd that is shown: that of the selected region, if it has its own, or else that of all others.
fn selected_emphasis<'a>(
    ui: &mut Ui,
    regions: &'a mut [Region],
    selected: Option<usize>,
    shared: &'a mut TwoSidedEmphasis,
) -> &'a mut TwoSidedEmphasis {
    let Some(index) = selected.filter(|&index| index < regions.len()) else { return shared };
    let own = &mut regions[index].emphasis;
    let mut has_own = own.is_some();
    let checkbox = ui.checkbox(&mut has_own, format!("Region {} has its own", index + 1));
    if checkbox.on_hover_text("Its boundaries alone; all others share one").changed() {
        *own = has_own.then_some(*shared);
    }
    own.as_mut().unwrap_or(shared)
}

fn status_ui(ui: &mut Ui, window: &ViewerWindow) {
    ui.horizontal(|ui| {
        let [width, height] = window.viewport;
        let Some(Drawn { detail, seconds }) = window.preview.last() else {
            ui.small("Drawing the first picture");
            return;
        };
        let what = if detail == Detail::FULL { "full picture" } else { "draft" };
        let level = match (window.preview.level(), window.finer.too_large()) {
            (0, _) => String::new(),
            (level, Some(why)) => format!("level {level} of the volume: {why}; "),
            (level, None) => match window.preview.preparing_bricks() {
                Some(share) => {
                    format!("level {level} of the volume, making level 0 ready in its file: {:.0} %; ", share * 100.0)
                }
                None => format!("level {level} of the volume, "),
            },
        };
        let mut text = format!("{level}{width} × {height} pixels, {what} in {:.0} ms", seconds * 1e3);
        if let Some(share) = window.preview.refining() {
            text += &format!(", refining {:.0} %", share * 100.0);
        }
        text += &format!("; {}", window.preview.drawn_by());
        ui.small(text);
        if let Some(failure) = window.finer.failure() {
            ui.label(RichText::new(format!("No finer level: {failure}")).small().color(theme::ERROR));
        }
    });
}
