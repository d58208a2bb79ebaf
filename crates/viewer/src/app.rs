//! The window: what eframe needs to know, and nothing else. A window whose device is lost is opened again on another one.

use std::cell::RefCell;
use std::path::Path;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use eframe::CreationContext;
use eframe::egui_wgpu::{WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew};
use egui::{ViewportBuilder, ViewportCommand};
use voxrole_pack::Reader;
use voxrole_preprocess::console::tell;
use voxrole_preprocess::io::ReadOptions;
use wgpu::{Device, PollType};

use crate::device_args::DeviceArgs;
use crate::headless::read_session;
use crate::open::open_or_prepare;
use crate::render::Gpu;
use crate::state::{Classification, ViewState};
use crate::streaming::memory_bound::{bound, require};
use crate::ui::device_loss::DeviceLoss;
use crate::ui::finer_levels::FinerLevels;
use crate::ui::kept_window::KeptWindow;
use crate::ui::opened_volume::OpenedVolume;
use crate::ui::{ViewerWindow, theme, window_ui};
use crate::volume::{VolumeDescription, VolumeTexels};

/// The window's size at first, in points.
const SIZE: [f32; 2] = [1280.0, 800.0];
/// The smallest window in which every panel still has its room, in points.
const LEAST_SIZE: [f32; 2] = [960.0, 600.0];
/// How many devices may be lost in a row.
const MOST_LOSSES: u32 = 3;
/// A window that has been open for so long begins a new row.
const STEADY: Duration = Duration::from_secs(60);
/// How long a driver has to come back before the window is opened again.
const PAUSE: Duration = Duration::from_millis(500);

/// Opens a window on a volume, with what a session says, and runs it until it is closed. The volume takes `memory` bytes of
/// the machine's memory at most.
///
/// # Errors
/// When the volume cannot be opened or does not fit the device, or where there is no GPU adapter or no display; the
/// message then says to use `render` instead. When one device after another is lost.
pub fn run(
    path: &Path,
    session: Option<&Path>,
    limits: (DeviceArgs, Option<u64>),
    options: &ReadOptions,
) -> anyhow::Result<()> {
    run_and_tell(path, session, limits, options, |_| ())
}

/// The same; tells of every window that is opened: the first one, and another for each device that is lost.
///
/// # Errors
/// As [`run`].
pub fn run_and_tell(
    path: &Path,
    session: Option<&Path>,
    (device, memory): (DeviceArgs, Option<u64>),
    options: &ReadOptions,
    mut opened_window: impl FnMut(&CreationContext<'_>),
) -> anyhow::Result<()> {
    let session = session.map(read_session).transpose()?;
    let is_stored = |session: &ViewState| session.transfer_function.classification == Classification::Stored;
    ensure!(!session.as_ref().is_some_and(is_stored), "stored opacities are drawn by `voxrole-view render` alone");
    let memory = bound(memory)?;
    let opened = open_or_prepare(path, options, memory)?;
    let named = || path.display().to_string();
    let coarsest = opened.reader.levels() - 1;
    require(&opened.reader, coarsest, memory, "the window needs all of its coarsest level").with_context(named)?;
    // Before the volume is read and a window flashes up. The device is given back: eframe opens its own.
    drop(Gpu::new().with_context(|| without_window(path))?);
    let description = VolumeDescription::of(&opened.reader, 0).with_context(named)?;
    let mut window = KeptWindow::new(OpenedVolume::read(path, &opened.reader, &description).with_context(named)?);
    if let Some(mismatch) = session.and_then(|session| window.open_session(session)) {
        tell(format!("voxrole-view: {mismatch}"));
    }
    let runner = Runner { path, reader: opened.reader, device, memory };
    let mut kept = Kept { window, memory: None, place: ViewportBuilder::default().with_inner_size(SIZE) };
    let mut losses = 0;
    loop {
        let began = Instant::now();
        let Some((left, reason)) = runner.run(kept, &mut opened_window)? else { return Ok(()) };
        losses = if began.elapsed() > STEADY { 1 } else { losses + 1 };
        ensure!(
            losses <= MOST_LOSSES,
            "the window's device was lost {losses} times in a row ({reason}); {}",
            instead_of_window(path)
        );
        tell(format!("voxrole-view: the device is lost ({reason}); opening the window again"));
        thread::sleep(PAUSE);
        kept = left;
    }
}

/// A volume that windows are opened on, one after another.
struct Runner<'a> {
    path: &'a Path,
    reader: Arc<Reader>,
    device: DeviceArgs,
    /// Most bytes that the volume takes of the machine's.
    memory: u64,
}

/// What one window leaves to the next.
struct Kept {
    window: KeptWindow,
    /// How wide panels are, and what they are scrolled to.
    memory: Option<egui::Memory>,
    /// Where it lies on the screen, and how large it is.
    place: ViewportBuilder,
}

impl Runner<'_> {
    /// Opens a window and runs it until it is closed; returns what is left of it where that is because its device is lost,
    /// and why that is.
    fn run(
        &self,
        kept: Kept,
        opened_window: &mut dyn FnMut(&CreationContext<'_>),
    ) -> anyhow::Result<Option<(Kept, String)>> {
        let Kept { mut window, memory, place } = kept;
        let named = || self.path.display().to_string();
        let kept_texels = window.texels.take();
        let is_read_anew = kept_texels.is_none();
        let texels = match kept_texels {
            Some(texels) => texels,
            // A small level is there at once; finer ones follow when the window is open.
            None => Arc::new(VolumeTexels::read_level(&self.reader, self.reader.levels() - 1).with_context(named)?),
        };
        let left = RefCell::new(None);
        let creator = |creation: &CreationContext<'_>| {
            let context = creation.egui_ctx.clone();
            if let Some(memory) = memory {
                context.memory_mut(|all| *all = memory);
            }
            theme::apply(&context);
            let render_state = creation.wgpu_render_state.as_ref().ok_or("the window was opened without wgpu")?;
            let device = render_state.device.clone();
            let loss = DeviceLoss::watch(&device, &context);
            let mut window = window.open(render_state, &texels, self.device)?;
            if is_read_anew {
                let limits = (self.memory, window.preview.room_beside_bricks(self.memory));
                window.finer = FinerLevels::read(&self.reader, texels.description.level, limits, context.clone());
            }
            // Kept by the window alone, where at all.
            drop(texels);
            opened_window(creation);
            Ok(Box::new(App { window: Some(window), context, device, loss, left: &left }) as Box<dyn eframe::App>)
        };
        let title = format!("{} - Voxrole", self.reader.header().source.name);
        let outcome = eframe::run_native(&title, native_options(place.with_title(&title)), Box::new(creator));
        outcome.map_err(|error| match error {
            // The volume's own trouble, not the display's.
            eframe::Error::AppCreation(error) => anyhow::anyhow!("{error}").context(named()),
            error => anyhow::anyhow!("{error}").context(without_window(self.path)),
        })?;
        Ok(left.take())
    }
}

fn without_window(path: &Path) -> String {
    format!("no window can be opened here; {}", instead_of_window(path))
}

fn instead_of_window(path: &Path) -> String {
    format!("draw a picture instead with `voxrole-view render {} -o OUT.png`", path.display())
}

/// The device that [`Gpu`] would open, among the adapters that can show on the window.
fn native_options(place: ViewportBuilder) -> eframe::NativeOptions {
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    setup.device_descriptor = Arc::new(Gpu::device_descriptor);
    eframe::NativeOptions {
        viewport: place.with_min_inner_size(LEAST_SIZE),
        wgpu_options: WgpuConfiguration { wgpu_setup: WgpuSetup::CreateNew(setup), ..WgpuConfiguration::default() },
        // So that there can be another window.
        run_and_return: true,
        ..eframe::NativeOptions::default()
    }
}

struct App<'a> {
    /// Until it is closed.
    window: Option<ViewerWindow>,
    context: egui::Context,
    device: Device,
    loss: DeviceLoss,
    /// For what is left when the device is lost.
    left: &'a RefCell<Option<(Kept, String)>>,
}

impl eframe::App for App<'_> {
    fn ui(&mut self, ui: &mut egui::Ui, _: &mut eframe::Frame) {
        match &mut self.window {
            Some(window) if !is_lost(&self.device, &self.loss) => {
                window_ui(ui, window);
                if is_lost(&self.device, &self.loss) {
                    // egui ends the program where it has something to paint and no device: once more, with nothing.
                    ui.request_discard("the device is lost");
                }
            }
            _ => ui.send_viewport_cmd(ViewportCommand::Close),
        }
    }

    fn on_exit(&mut self) {
        if let (Some(window), Some(reason)) = (self.window.take(), self.loss.reason()) {
            let kept = Kept {
                window: KeptWindow::of(window),
                memory: Some(self.context.memory(Clone::clone)),
                place: place(&self.context),
            };
            self.left.replace(Some((kept, reason.to_owned())));
        }
    }
}

/// Asks a device whether it is lost.
fn is_lost(device: &Device, loss: &DeviceLoss) -> bool {
    // What it answers is told to whoever watches it.
    let _ = device.poll(PollType::Poll);
    loss.reason().is_some()
}

/// Where a window lies and how large it is, as far as that is known.
fn place(context: &egui::Context) -> ViewportBuilder {
    let info = context.input(|input| input.viewport().clone());
    let mut place = ViewportBuilder::default();
    place = place.with_inner_size(info.inner_rect.map_or(SIZE.into(), |rect| rect.size()));
    if let Some(rect) = info.outer_rect {
        place = place.with_position(rect.min);
    }
    place.with_maximized(info.maximized == Some(true)).with_fullscreen(info.fullscreen == Some(true))
}
