//! Volumes larger than the memory for them, drawn in the window by bricks from their file.

use std::fs::OpenOptions;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::{PointerButton, Rect, Vec2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use voxrole_pack::directory::Place;
use voxrole_pack::{LayerKind, Reader};
use voxrole_preprocess::phantom::{Phantom, PhantomSettings};
use voxrole_preprocess::progress::Silent;
use voxrole_preprocess::settings::{Method, Settings};
use voxrole_viewer::device_args::DeviceArgs;
use voxrole_viewer::drawing::Drawing;
use voxrole_viewer::ui::ViewerWindow;
use voxrole_viewer::ui::cpu_drawer::CpuDrawer;
use voxrole_viewer::ui::drawer::Drawer;
use voxrole_viewer::ui::finer_levels::FinerLevels;
use voxrole_viewer::ui::kept_window::KeptWindow;
use voxrole_viewer::ui::opened_volume::OpenedVolume;
use voxrole_viewer::{Gpu, Picture, TexelSource, ViewState, VolumeDescription, VolumeTexels};

use crate::saving::wait_for_file;
use crate::{CPU, GPU, PICTURE, drag, harness_of_size, rect_of, render_state};

/// Half of what the finest level takes, of which the next one takes a quarter.
const MEMORY: u64 = 80 * 80 * 80 * 8 / 2;
/// Room for seven bricks, and the coarser level, of the volume's 27.
const SMALL: DeviceArgs = DeviceArgs { gpu_memory: Some(5 << 19), ..GPU };

/// Shells of 80 voxels a side, prepared for one test alone.
fn packed(test: &str) -> PathBuf {
    let settings = PhantomSettings { dims: [80; 3], blur: 1.0, ..PhantomSettings::default() };
    let grid = Phantom::Shells.generate(&settings).expect("a phantom");
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("window-bricks-{test}.vxr"));
    voxrole_preprocess::prepare(&grid, &Settings::new(Method::Fast), &path, &Silent).expect("a packed file");
    path
}

/// A window as `app::run` opens it; its coarsest level is drawn.
fn open(path: &Path, device: DeviceArgs) -> Option<Harness<'static, ViewerWindow>> {
    let render_state = render_state()?;
    let reader = Arc::new(Reader::open(path).expect("opens"));
    let description = VolumeDescription::of(&reader, 0).expect("has all layers");
    let mut window = KeptWindow::new(OpenedVolume::read(path, &reader, &description).expect("has histograms"));
    window.view.render_settings.step = 4.0;
    let coarsest = reader.levels() - 1;
    let texels = Arc::new(VolumeTexels::read_level(&reader, coarsest).expect("reads"));
    let mut window = window.open(&render_state, &texels, device).expect("fits the device");
    let limits = (MEMORY, window.preview.room_beside_bricks(MEMORY));
    window.finer = FinerLevels::read(&reader, coarsest, limits, egui::Context::default());
    Some(harness_of_size(render_state, window, vec2(900.0, 360.0)))
}

fn wait(harness: &mut Harness<'_, ViewerWindow>, what: &str, is_so: impl Fn(&ViewerWindow) -> bool) {
    let deadline = Instant::now() + Duration::from_secs(120);
    while !is_so(harness.state()) {
        assert!(Instant::now() < deadline, "{what}: {:?}", harness.state().preview.error());
        std::thread::sleep(Duration::from_millis(2));
        harness.step();
    }
}

fn wait_for_bricks(harness: &mut Harness<'_, ViewerWindow>) {
    wait(harness, "the finest level is drawn", |window| {
        window.preview.level() == 0 && window.preview.is_finished() && window.finer.failure().is_none()
    });
}

/// What `voxrole-view render` draws within the same bounds.
fn rendered(path: &Path, view: &ViewState) -> Picture {
    let source = TexelSource::open(Reader::open(path).expect("opens"), 0, MEMORY).expect("opens");
    assert!(matches!(source, TexelSource::File(_)));
    let mut drawing =
        Drawing::on_gpu(Gpu::new().expect("opened before"), &source, view, SMALL.gpu_memory).expect("is made ready");
    drawing.draw(&view.camera).expect("is drawn").picture
}

/// The middle of the picture as the window shows it, and of what is rendered of the same state.
fn shown_and_rendered(harness: &mut Harness<'_, ViewerWindow>, path: &Path) -> [Vec<u8>; 2] {
    let rect = rect_of(harness, PICTURE);
    let mut view = harness.state().view.clone();
    view.render_settings.image_size = [rect.width().round() as u32, rect.height().round() as u32];
    let picture = rendered(path, &view);
    let middle = Rect::from_center_size(rect.center().round(), Vec2::splat(140.0));
    let shown = harness.render().expect("a picture of the window");
    let picture = image::RgbaImage::from_raw(picture.width, picture.height, picture.rgba).expect("is whole");
    let crop = |image, corner: egui::Pos2| {
        image::imageops::crop_imm(image, corner.x as u32, corner.y as u32, 140, 140).to_image().into_raw()
    };
    [crop(&shown, middle.min), crop(&picture, middle.min - rect.min.to_vec2())]
}

/// How many pixels are others.
fn differing(a: &[u8], b: &[u8]) -> usize {
    a.chunks(4).zip(b.chunks(4)).filter(|(a, b)| a != b).count()
}

#[test]
fn the_finest_level_follows_by_bricks_and_is_what_render_draws() {
    let path = packed("finest");
    for device in [SMALL, GPU] {
        let Some(mut harness) = open(&path, device) else { return };
        wait_for_bricks(&mut harness);
        let [shown, drawn] = shown_and_rendered(&mut harness, &path);
        assert!(drawn.chunks(4).filter(|pixel| pixel[..3] != [0; 3]).count() > 2000, "there is something to see");
        assert_eq!(differing(&shown, &drawn), 0, "{device:?}: another picture than `render` draws");

        if device == GPU {
            // Whatever room there is: what follows is the same.
            continue;
        }
        let window = harness.state_mut();
        window.save.path = path.with_extension("png").display().to_string();
        let _ = std::fs::remove_file(&window.save.path);
        window.view.render_settings.image_size = [70, 60];
        let view = window.view.clone();
        wait_for_bricks(&mut harness);
        harness.get_by_label("Save PNG").click();
        harness.step();
        wait_for_file(&mut harness);
        let saved = image::open(path.with_extension("png")).expect("a picture").into_rgba8();
        assert!(saved.into_raw() == rendered(&path, &view).rgba, "{device:?}: the file is what `render` writes");

        // While a hand moves the coarser level is drawn.
        let middle = rect_of(&harness, PICTURE).center();
        harness.hover_at(middle);
        harness.drag_at(middle);
        harness.hover_at(middle + vec2(30.0, 10.0));
        wait(&mut harness, "a draft is drawn", |window| window.preview.level() == 1);
        harness.drop_at(middle + vec2(30.0, 10.0));
        wait_for_bricks(&mut harness);
        let [shown_later, drawn] = shown_and_rendered(&mut harness, &path);
        assert!(shown_later == drawn && shown_later != shown, "{device:?}");
    }
}

#[test]
fn what_bricks_have_no_room_for_is_told_and_given_up_for_what_they_have() {
    let path = packed("room");
    let Some(mut harness) = open(&path, SMALL) else { return };
    wait_for_bricks(&mut harness);
    // As is whatever is being drawn by bricks when there is something else to draw.
    harness.state_mut().view.render_settings.step = 0.5;
    wait(&mut harness, "bricks are drawn", |window| window.preview.refining().is_some() || window.preview.level() == 1);
    harness.state_mut().view.render_settings.step = 4.0;
    wait_for_bricks(&mut harness);
    let [shown, rendered] = shown_and_rendered(&mut harness, &path);
    assert_eq!(differing(&shown, &rendered), 0);
    // A window that is closed while it draws, or makes ready.
    harness.state_mut().view.camera.orbit(10.0, 0.0);
    harness.step();
    drop(harness);
    drop(open(&path, SMALL));
}

#[test]
fn the_cpu_shows_what_fits_and_says_so() {
    let path = packed("cpu");
    let Some(mut harness) = open(&path, CPU) else { return };
    wait(&mut harness, "the level that fits is drawn", |window| {
        window.preview.level() == 1 && window.preview.is_finished() && !window.finer.is_reading()
    });
    let said = harness.state().finer.too_large().expect("is told").to_owned();
    assert_eq!(said, "level 0 takes 3.9 MiB of memory, of which 2.0 MiB may be taken");
    harness.run();
    harness.get_by_label_contains(&said);
}

/// Writes over a layer's stored bricks in place.
fn damage(path: &Path, kind: LayerKind) {
    let reader = Reader::open(path).expect("opens");
    let mut file = OpenOptions::new().write(true).open(path).expect("opens");
    for brick in 0..reader.grid(0).expect("a level").len() {
        if let Place::Stored(extent) = reader.brick_entry(kind, 0, brick).expect("an entry").place {
            file.seek(SeekFrom::Start(extent.offset)).expect("is there");
            file.write_all(&vec![0x5a; extent.stored_bytes as usize]).expect("is written");
        }
    }
}

#[test]
fn a_damaged_brick_is_told_of_and_the_coarser_level_stays() {
    // Distances are read before anything is drawn, normals as rays come to them.
    for kind in [LayerKind::Distance, LayerKind::Normal] {
        let path = packed(&format!("damaged-{}", kind.name()));
        damage(&path, kind);
        let Some(mut harness) = open(&path, SMALL) else { return };
        wait(&mut harness, "the damage is found", |window| window.finer.failure().is_some());
        let failure = harness.state().finer.failure().expect("there is one").to_owned();
        assert!(
            failure.contains("brick ") && failure.contains(kind.name()) && failure.contains("damaged"),
            "{failure}"
        );
        let is_drawn = |window: &ViewerWindow| window.preview.level() == 1 && window.preview.is_finished();
        wait(&mut harness, "the coarser level is drawn", is_drawn);
        harness.get_by_label(&format!("No finer level: {failure}"));
        let pictures = harness.state().preview.pictures();
        drag(
            &mut harness,
            PointerButton::Primary,
            egui::Modifiers::NONE,
            egui::pos2(400.0, 150.0),
            egui::pos2(420.0, 150.0),
        );
        wait(&mut harness, "the coarser level is drawn anew", is_drawn);
        assert!(harness.state().preview.pictures() > pictures && harness.state().preview.error().is_none());
    }
}

#[test]
fn a_saved_picture_is_of_the_level_that_it_was_begun_with() {
    let reader = Reader::open(&packed("level")).expect("opens");
    let texels = |level| Arc::new(VolumeTexels::read_level(&reader, level).expect("reads"));
    let mut drawer = CpuDrawer::new(&texels(1)).expect("begins a thread");
    let (context, mut view) = (egui::Context::default(), ViewState::default());
    view.render_settings.image_size = [40, 30];
    drawer.begin_saved(&context, &view).expect("fits");
    drawer.replace_volume(&texels(0)).expect("fits");
    let start = Instant::now();
    let level = loop {
        if let Some((_, level)) = drawer.go_on_saved(&context).expect("is drawn") {
            break level;
        }
        assert!(start.elapsed().as_secs() < 120, "the picture is not drawn");
        std::thread::sleep(Duration::from_millis(2));
    };
    assert_eq!((level, drawer.level()), (1, 0));
}
