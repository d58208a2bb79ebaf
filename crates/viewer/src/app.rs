//! The window: what eframe needs to know, and nothing else.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, ensure};
use eframe::egui_wgpu::{WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew};
use egui::ViewportBuilder;

use voxrole_preprocess::io::ReadOptions;

use crate::headless::read_session;
use crate::open::open_or_prepare;
use crate::render::Gpu;
use crate::state::{Classification, ViewState};
use crate::streaming::memory_bound::{bound, require};
use crate::ui::finer_levels::FinerLevels;
use crate::ui::opened_volume::OpenedVolume;
use crate::ui::{ViewerWindow, theme, window_ui};
use crate::volume::VolumeTexels;

/// The window's size at first, in points.
const SIZE: [f32; 2] = [1280.0, 800.0];
/// The smallest window in which every panel still has its room, in points.
const LEAST_SIZE: [f32; 2] = [960.0, 600.0];

/// Opens a window on a volume, with what a session says, and runs it until it is closed. The volume takes `budget`
/// bytes of the GPU at most, and `memory` bytes of the machine's.
///
/// # Errors
/// When the volume cannot be opened or does not fit the device, or where there is no GPU adapter or no display; the
/// message then says to use `render` instead.
pub fn run(
    path: &Path,
    session: Option<&Path>,
    [budget, memory]: [Option<u64>; 2],
    options: &ReadOptions,
) -> anyhow::Result<()> {
    let session = session.map(read_session).transpose()?;
    let is_stored = |session: &ViewState| session.transfer_function.classification == Classification::Stored;
    ensure!(!session.as_ref().is_some_and(is_stored), "stored opacities are drawn by `voxrole-view render` alone");
    let named = || path.display().to_string();
    let opened = open_or_prepare(path, options)?;
    let reader = &opened.reader;
    let memory = bound(memory)?;
    require(reader, reader.levels() - 1, memory, "the window needs all of its coarsest level").with_context(named)?;
    // Before the volume is read and a window flashes up. The device is given back: eframe opens its own.
    drop(Gpu::new().with_context(|| without_window(path))?);
    // A small level is there at once; finer ones follow when the window is open.
    let texels = Arc::new(VolumeTexels::read_level(reader, reader.levels() - 1).with_context(named)?);
    let volume = OpenedVolume::read(path, reader, &texels.description).with_context(named)?;
    let title = format!("{} - Voxrole", volume.header.source.name);
    let options = eframe::NativeOptions {
        viewport: ViewportBuilder::default().with_title(&title).with_inner_size(SIZE).with_min_inner_size(LEAST_SIZE),
        wgpu_options: WgpuConfiguration { wgpu_setup: wgpu_setup(), ..WgpuConfiguration::default() },
        ..eframe::NativeOptions::default()
    };
    let creator = Box::new(move |creation: &eframe::CreationContext<'_>| {
        theme::apply(&creation.egui_ctx);
        let render_state = creation.wgpu_render_state.as_ref().ok_or("the window was opened without wgpu")?;
        let mut window = ViewerWindow::new(render_state, volume, &texels, budget)?;
        if let Some(session) = session {
            window.open_session(session);
        }
        window.finer = FinerLevels::read(opened.reader, texels.description.level, memory, creation.egui_ctx.clone());
        Ok(Box::new(App { window }) as Box<dyn eframe::App>)
    });
    eframe::run_native(&title, options, creator).map_err(|error| match error {
        // The volume's own trouble, not the display's.
        eframe::Error::AppCreation(error) => anyhow::anyhow!("{error}").context(named()),
        error => anyhow::anyhow!("{error}").context(without_window(path)),
    })
}

fn without_window(path: &Path) -> String {
    let file = path.display();
    format!("no window can be opened here; draw a picture instead with `voxrole-view render {file} -o OUT.png`")
}

/// The device that [`Gpu`] would open, among the adapters that can show on the window.
fn wgpu_setup() -> WgpuSetup {
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    setup.device_descriptor = Arc::new(Gpu::device_descriptor);
    setup.into()
}

struct App {
    window: ViewerWindow,
}

impl eframe::App for App {
    fn ui(&mut self, ui: &mut egui::Ui, _: &mut eframe::Frame) {
        window_ui(ui, &mut self.window);
    }
}
