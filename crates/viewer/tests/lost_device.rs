//! A real window whose device is lost: it is opened again, and not for ever. With `VOXROLE_REQUIRE_WINDOW=1` alone, because
//! it needs a display, on which windows flash up; `xvfb-run` gives one. On the main thread, as windows have to be.

use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::Duration;

use eframe::CreationContext;
use egui::ViewportCommand;
use voxrole_preprocess::io::ReadOptions;
use voxrole_preprocess::phantom::{Phantom, PhantomSettings};
use voxrole_preprocess::progress::Silent;
use voxrole_preprocess::settings::{Method, Settings};
use voxrole_viewer::app::run_and_tell;
use voxrole_viewer::device_args::DeviceArgs;

/// How long a window is open before something happens to it.
const OPEN: Duration = Duration::from_secs(2);

fn main() {
    if std::env::var_os("VOXROLE_REQUIRE_WINDOW").is_none_or(|value| value != "1") {
        println!("lost_device: SKIPPED, because windows are opened with VOXROLE_REQUIRE_WINDOW=1 alone");
        return;
    }
    let settings = PhantomSettings { dims: [32; 3], blur: 1.0, ..PhantomSettings::default() };
    let grid = Phantom::Shells.generate(&settings).expect("a phantom");
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("lost-device-shells.vxr");
    voxrole_preprocess::prepare(&grid, &Settings::new(Method::Fast), &path, &Silent).expect("a packed file");

    for gpu in [false, true] {
        let device = DeviceArgs { cpu: !gpu, gpu, gpu_memory: None, normals: None };
        let (openings, outcome) = run(&path, device, 1);
        outcome.expect("the second window is closed as windows are");
        assert_eq!(openings, 2);
        println!("lost_device: {device:?}: opened again");
    }
    let (openings, outcome) = run(&path, DeviceArgs::default(), u32::MAX);
    let message = outcome.expect_err("is given up").to_string();
    assert!(message.contains("was lost 4 times in a row (Destroyed)"), "{message}");
    assert_eq!(openings, 4);
    println!("lost_device: given up: {message}");
}

/// Runs a window of which the first `losses` devices are lost; returns how many windows there were.
fn run(path: &Path, device: DeviceArgs, losses: u32) -> (u32, anyhow::Result<()>) {
    let openings = AtomicU32::new(0);
    let opened = |creation: &CreationContext<'_>| {
        let is_lost = openings.fetch_add(1, Ordering::Relaxed) < losses;
        let context = creation.egui_ctx.clone();
        let device = creation.wgpu_render_state.as_ref().expect("is drawn with wgpu").device.clone();
        thread::spawn(move || {
            thread::sleep(OPEN);
            if is_lost {
                device.destroy();
                context.request_repaint();
            } else {
                context.send_viewport_cmd(ViewportCommand::Close);
                context.request_repaint();
            }
        });
    };
    let outcome = run_and_tell(path, None, (device, None), &ReadOptions::default(), opened);
    (openings.into_inner(), outcome)
}
