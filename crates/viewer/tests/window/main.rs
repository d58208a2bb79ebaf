//! The window, driven without a display: clicks, drags and pictures through egui's test harness.
//!
//! Without a GPU adapter the tests skip and say so; with `VOXROLE_REQUIRE_GPU=1` they fail.

mod bricks;
mod camera;
mod saving;

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use eframe::egui_wgpu::{RenderState, RendererOptions, WgpuSetup, WgpuSetupCreateNew};
use egui::{Event, Modifiers, PointerButton, Pos2, Rect, Vec2, pos2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use egui_kittest::wgpu::{WgpuTestRenderer, create_render_state};
use voxrole_pack::Reader;
use voxrole_preprocess::phantom::{Phantom, PhantomSettings};
use voxrole_preprocess::progress::Silent;
use voxrole_preprocess::settings::{Method, Settings};
use voxrole_tests::comparison::gpu_or_skip;
use voxrole_viewer::device_args::DeviceArgs;
use voxrole_viewer::frame::Frame;
use voxrole_viewer::state::{Classification, EmphasisKind, Integration, Region, Shape, Technique};
use voxrole_viewer::ui::axis::PlotArea;
use voxrole_viewer::ui::device_loss::DeviceLoss;
use voxrole_viewer::ui::kept_window::KeptWindow;
use voxrole_viewer::ui::opened_volume::OpenedVolume;
use voxrole_viewer::ui::refinement::Detail;
use voxrole_viewer::ui::{ViewerWindow, theme, window_ui};
use voxrole_viewer::{Gpu, Picture, ViewState, VolumeTexels};

const HISTOGRAM: &str = "Histogram of value and gradient magnitude at the hit";
/// Seconds between two passes of the window.
const STEP_SECONDS: f32 = 0.05;
/// What draws: the two that there are.
const CPU: DeviceArgs = DeviceArgs { cpu: true, gpu: false, gpu_memory: None, normals: None };
const GPU: DeviceArgs = DeviceArgs { cpu: false, gpu: true, gpu_memory: None, normals: None };
const PICTURE: &str = "Picture of the volume";

/// Two concentric shells of 32 voxels a side, prepared once.
fn shells() -> &'static Path {
    static FILE: OnceLock<PathBuf> = OnceLock::new();
    FILE.get_or_init(|| {
        let settings = PhantomSettings { dims: [32; 3], blur: 1.0, ..PhantomSettings::default() };
        let grid = Phantom::Shells.generate(&settings).expect("a phantom");
        // Another process may run another of these tests.
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("window-shells-{}.vxr", std::process::id()));
        voxrole_preprocess::prepare(&grid, &Settings::new(Method::Fast), &path, &Silent).expect("a packed file");
        path
    })
}

/// The device as `app::run` asks for it, or `None` where there is none and none is required.
fn render_state() -> Option<RenderState> {
    gpu_or_skip("window")?;
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    setup.device_descriptor = Arc::new(Gpu::device_descriptor);
    Some(create_render_state(WgpuSetup::CreateNew(setup), RendererOptions::PREDICTABLE))
}

fn texels() -> VolumeTexels {
    VolumeTexels::read(&Reader::open(shells()).expect("opens")).expect("reads")
}

/// A window that the CPU ray marcher draws, as it does where there is no GPU; its first picture is there in full.
fn open() -> Option<Harness<'static, ViewerWindow>> {
    open_on(CPU)
}

/// The same with what draws chosen.
fn open_on(device: DeviceArgs) -> Option<Harness<'static, ViewerWindow>> {
    let render_state = render_state()?;
    let texels = texels();
    let reader = Reader::open(shells()).expect("opens");
    let volume = OpenedVolume::read(shells(), &reader, &texels.description).expect("has histograms");
    let mut window = KeptWindow::new(volume);
    // A software adapter is four times faster at it.
    window.view.render_settings.step = 1.0;
    let window = window.open(&render_state, &Arc::new(texels), device).expect("fits the device");
    Some(harness(render_state, window))
}

/// Drives a window, whose first picture is drawn in full.
fn harness(render_state: RenderState, window: ViewerWindow) -> Harness<'static, ViewerWindow> {
    harness_of_size(render_state, window, vec2(900.0, 1400.0))
}

/// The same in another size; lavapipe draws small pictures alone in little time.
fn harness_of_size(render_state: RenderState, window: ViewerWindow, size: Vec2) -> Harness<'static, ViewerWindow> {
    let mut harness = Harness::builder()
        .with_size(size)
        .with_max_steps(200)
        // Short enough for a double click.
        .with_step_dt(STEP_SECONDS)
        .with_context_setup(theme::apply)
        .renderer(WgpuTestRenderer::from_render_state(render_state))
        .build_ui_state(window_ui, window);
    settle(&mut harness);
    harness
}

/// Lets the hand rest until the picture is drawn in full, however slow the device is.
fn settle(harness: &mut Harness<'_, ViewerWindow>) {
    let start = Instant::now();
    harness.run();
    while !harness.state().preview.is_finished() {
        assert!(start.elapsed().as_secs() < 120, "the picture is not drawn in full");
        // The CPU ray marcher draws beside the window.
        std::thread::sleep(Duration::from_millis(2));
        harness.step();
    }
    harness.run();
}

/// What would be saved of a state.
fn picture(harness: &mut Harness<'_, ViewerWindow>, view: &ViewState) -> Picture {
    let context = harness.ctx.clone();
    let preview = &mut harness.state_mut().preview;
    preview.begin_saved(&context, view).expect("fits the device");
    loop {
        if let Some((picture, _)) = preview.go_on_saved(&context).expect("is drawn") {
            return picture;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn rect_of(harness: &Harness<'_, ViewerWindow>, label: &str) -> Rect {
    harness.get_by_label(label).rect()
}

fn drag(harness: &mut Harness<'_, ViewerWindow>, button: PointerButton, modifiers: Modifiers, from: Pos2, to: Pos2) {
    let press = |pos, pressed| Event::PointerButton { pos, button, pressed, modifiers };
    harness.hover_at(from);
    harness.step();
    harness.event_modifiers(press(from, true), modifiers);
    harness.step();
    for share in [0.5, 1.0] {
        harness.event_modifiers(Event::PointerMoved(from + share * (to - from)), modifiers);
        harness.step();
    }
    harness.event_modifiers(press(to, false), modifiers);
    harness.step();
    harness.remove_cursor();
    settle(harness);
}

fn plot_area(harness: &Harness<'_, ViewerWindow>) -> PlotArea {
    let [x, y] = harness.state().histogram.span();
    PlotArea { rect: rect_of(harness, HISTOGRAM), x, y }
}

fn is_close(found: f32, expected: f64, tolerance: f64) -> bool {
    (f64::from(found) - expected).abs() <= tolerance
}

#[test]
fn the_first_picture_shows_the_proposed_regions_unchanged_by_egui() {
    let mut all_shown = Vec::new();
    for device in [CPU, GPU] {
        let Some(mut harness) = open_on(device) else { return };
        let window = harness.state();
        assert!(!window.volume.proposed_regions.is_empty());
        assert_eq!(window.view.transfer_function.regions, window.volume.proposed_regions);
        assert_eq!(window.preview.drawn_by().starts_with("CPU, "), device.cpu, "{}", window.preview.drawn_by());

        let rect = rect_of(&harness, PICTURE);
        let shown = harness.render().expect("a picture of the window");
        let mut view = harness.state().view.clone();
        view.render_settings.image_size = [rect.width().round() as u32, rect.height().round() as u32];
        let picture = picture(&mut harness, &view);
        let middle = Rect::from_center_size(rect.center().round(), Vec2::splat(160.0));
        let (mut different, mut lit, mut count) = (0, 0, 0);
        for y in middle.top() as u32..middle.bottom() as u32 {
            for x in middle.left() as u32..middle.right() as u32 {
                let expected = picture.pixel(x - rect.left() as u32, y - rect.top() as u32);
                let found = shown.get_pixel(x, y).0;
                count += 1;
                lit += u32::from(expected[..3] != [0; 3]);
                different +=
                    u32::from(found.iter().zip(expected).any(|(found, expected)| found.abs_diff(expected) > 1));
            }
        }
        assert!(lit > count / 10, "{lit} of {count} pixels are lit");
        assert!(different < count / 1000, "{different} of {count} pixels differ from the picture that was drawn");
        all_shown
            .push(image::imageops::crop_imm(&shown, middle.left() as u32, middle.top() as u32, 160, 160).to_image());
    }
    let [on_cpu, on_gpu] = [0, 1].map(|index| all_shown[index].as_raw());
    let off = on_cpu.iter().zip(on_gpu).filter(|(cpu, gpu)| cpu.abs_diff(**gpu) > 2).count();
    assert!(off < on_cpu.len() / 1000, "{off} of {} channels differ between the CPU and the GPU", on_cpu.len());
}

#[test]
fn a_window_at_rest_draws_nothing() {
    for device in [CPU, GPU] {
        let Some(mut harness) = open_on(device) else { return };
        let pictures = harness.state().preview.pictures();
        assert!((1..=5).contains(&pictures), "{pictures} pictures for the first one");
        harness.run_steps(5);
        assert_eq!(harness.state().preview.pictures(), pictures);
        let delay = harness.output().viewport_output[&egui::ViewportId::ROOT].repaint_delay;
        assert_eq!(delay, Duration::MAX, "no further pass is asked for");
    }
}

/// A setting that is changed, and how.
type Knob = (&'static str, fn(&mut ViewState));

const KNOBS: [Knob; 12] = [
    ("color", |view| view.transfer_function.regions[0].color = [0.1, 0.9, 0.4]),
    ("value", |view| view.transfer_function.regions[0].value[1] *= 0.9),
    ("shape", |view| view.transfer_function.regions[0].shape = Shape::Ellipse),
    ("opacity by distance", |view| view.transfer_function.emphasis.high.d_c *= 0.7),
    ("curve", |view| view.transfer_function.curve = "0,ff0000,0.1;1,00ff00,0.2".parse().expect("a curve")),
    ("camera", |view| view.camera.orbit(5.0, 3.0)),
    ("crop", |view| view.clipping.crop = "4:,:,:20".parse().expect("a crop")),
    ("plane", |view| view.clipping.planes.push("20,10,0.2".parse().expect("a plane"))),
    ("light", |view| view.render_settings.light.azimuth += 20.0),
    ("shading", |view| view.render_settings.shading.specular = 0.5),
    ("integration", |view| view.render_settings.integration = Integration::PostClassified),
    ("background", |view| view.render_settings.background = [0.5; 3]),
];

#[test]
fn every_knob_redraws_within_two_frames() {
    for device in [CPU, GPU] {
        let Some(mut harness) = open_on(device) else { return };
        for (name, turn) in KNOBS {
            let pictures = harness.state().preview.pictures();
            turn(&mut harness.state_mut().view);
            (0..2).for_each(|_| harness.step());
            assert!(harness.state().preview.pictures() > pictures, "{name}, {}", harness.state().preview.drawn_by());
        }
    }
}

#[test]
fn regions_are_dragged_resized_drawn_and_removed_in_the_histogram() {
    let Some(mut harness) = open() else { return };
    let area = plot_area(&harness);
    let [per_x, per_y] = area.plot_per_screen();
    let at = |x: f32, y: f32| area.rect.lerp_inside(vec2(x, y));
    let [left, right, top, bottom] = [at(0.3, 0.0), at(0.6, 0.0), at(0.0, 0.3), at(0.0, 0.7)];
    let [value_low, gradient_low] = area.plot_from_screen(pos2(left.x, bottom.y));
    let [value_high, gradient_high] = area.plot_from_screen(pos2(right.x, top.y));
    let regions = &mut harness.state_mut().view.transfer_function.regions;
    regions.truncate(1);
    regions[0].value = [value_low as f32, value_high as f32];
    regions[0].gradient = [gradient_low as f32, gradient_high as f32];
    let start = regions[0].clone();
    settle(&mut harness);
    let pictures = harness.state().preview.pictures();

    // The inside moves it.
    let none = Modifiers::NONE;
    let middle = pos2(0.5 * (left.x + right.x), 0.5 * (top.y + bottom.y));
    drag(&mut harness, PointerButton::Primary, none, middle, middle + vec2(30.0, -20.0));
    let moved = harness.state().view.transfer_function.regions[0].clone();
    assert!(is_close(moved.value[0], f64::from(start.value[0]) + 30.0 * per_x, per_x), "{moved:?}");
    assert!(is_close(moved.gradient[1], f64::from(start.gradient[1]) + 20.0 * per_y, per_y), "{moved:?}");
    assert_eq!(harness.state().histogram.selected, Some(0));
    assert!(harness.state().preview.pictures() > pictures, "the picture follows");

    // The right edge changes the highest value alone.
    let edge = pos2(right.x + 30.0, middle.y - 20.0);
    drag(&mut harness, PointerButton::Primary, none, edge, edge + vec2(-25.0, 50.0));
    let resized = harness.state().view.transfer_function.regions[0].clone();
    assert!(is_close(resized.value[1], f64::from(moved.value[1]) - 25.0 * per_x, per_x), "{resized:?}");
    assert_eq!((resized.value[0], resized.gradient), (moved.value[0], moved.gradient));

    // Free ground draws another one.
    drag(&mut harness, PointerButton::Primary, none, at(0.05, 0.9), at(0.2, 0.8));
    let regions = &harness.state().view.transfer_function.regions;
    assert_eq!(regions.len(), 2);
    assert!(is_close(regions[1].value[1], area.plot_from_screen(at(0.2, 0.8))[0], per_x), "{:?}", regions[1]);
    assert_ne!(regions[0].color, regions[1].color);

    harness.key_press(egui::Key::Delete);
    settle(&mut harness);
    assert_eq!(harness.state().view.transfer_function.regions, [resized]);
}

#[test]
fn a_region_is_painted_and_erased_in_the_histogram() {
    let Some(mut harness) = open() else { return };
    harness.state_mut().view.transfer_function.regions.clear();
    settle(&mut harness);
    harness.get_by_label("Paint").click();
    settle(&mut harness);
    let area = plot_area(&harness);
    let painted = |harness: &Harness<'_, ViewerWindow>, place: [f32; 2]| {
        let regions = &harness.state().view.transfer_function.regions;
        let [Region { shape: Shape::Painted(map), .. }] = regions.as_slice() else { panic!("{regions:?}") };
        map.weight_at(place)
    };
    let at = |[x, y]: [f32; 2]| area.rect.lerp_inside(vec2(x, 1.0 - y));
    // Over everything, row by row, and the boundaries among it are drawn.
    let dark = harness.render().expect("a picture of the window");
    let pictures = harness.state().preview.pictures();
    harness.state_mut().histogram.brush.radius = 40.0;
    for row in 0..6 {
        let y = (row as f32 + 0.5) / 6.0;
        drag(&mut harness, PointerButton::Primary, Modifiers::NONE, at([0.01, y]), at([0.99, y]));
    }
    assert_eq!([painted(&harness, [0.5, 0.5]), painted(&harness, [0.1, 0.95])], [1.0; 2]);
    assert_eq!(harness.state().histogram.selected, Some(0));
    assert!(harness.state().preview.pictures() > pictures, "the picture follows");
    let lit = harness.render().expect("a picture of the window");
    let picture = rect_of(&harness, PICTURE);
    let middle = Rect::from_center_size(picture.center().round(), Vec2::splat(100.0));
    let mut changed = 0;
    for y in middle.top() as u32..middle.bottom() as u32 {
        for x in middle.left() as u32..middle.right() as u32 {
            changed += u32::from(dark.get_pixel(x, y) != lit.get_pixel(x, y));
        }
    }
    assert!(changed > 5000, "{changed} of 10000 pixels");

    // A click erases what is under it and nothing else; the region stays where it is.
    let start = harness.state().view.transfer_function.regions[0].clone();
    harness.state_mut().histogram.brush.radius = 14.0;
    harness.get_by_label("Erase").click();
    settle(&mut harness);
    drag(&mut harness, PointerButton::Primary, Modifiers::NONE, at([0.5, 0.5]), at([0.5, 0.5]));
    assert_eq!([painted(&harness, [0.5, 0.5]), painted(&harness, [0.2, 0.5])], [0.0, 1.0]);
    let regions = &harness.state().view.transfer_function.regions;
    assert_eq!((regions[0].value, regions[0].gradient), (start.value, start.gradient));

    // Dragged by what is painted; free ground draws another region, under the map as well.
    harness.get_by_label("Outline").click();
    settle(&mut harness);
    harness.state_mut().histogram.selected = None;
    drag(&mut harness, PointerButton::Primary, Modifiers::NONE, at([0.2, 0.5]), at([0.3, 0.5]));
    let regions = &harness.state().view.transfer_function.regions;
    assert!(regions[0].value[0] > start.value[0] && regions[0].shape != start.shape, "{regions:?}");
    let session = harness.state().view.to_toml().expect("is written");
    assert_eq!(ViewState::from_toml(&session), Ok(harness.state().view.clone()));
}

#[test]
fn an_outline_becomes_a_painted_region_and_a_box_again() {
    let Some(mut harness) = open() else { return };
    harness.get_by_label("Region 1").click();
    settle(&mut harness);
    let start = harness.state().view.transfer_function.regions[0].clone();
    let painted = Shape::Painted(start.shape.painted(start.softness));
    for (choice, expected) in [("painted", painted), ("box", Shape::Box)] {
        harness.get_by_label("Outline of region 1").click();
        settle(&mut harness);
        harness.get_by_label(choice).click();
        settle(&mut harness);
        let region = &harness.state().view.transfer_function.regions[0];
        assert_eq!((&region.shape, region.value), (&expected, start.value));
    }
    assert_eq!(harness.state().view.transfer_function.regions[0], start);
}

#[test]
fn the_region_list_adds_removes_and_proposes() {
    let Some(mut harness) = open() else { return };
    let proposed = harness.state().volume.proposed_regions.clone();
    harness.get_by_label("Add region").click();
    settle(&mut harness);
    assert_eq!(harness.state().view.transfer_function.regions.len(), proposed.len() + 1);
    harness.get_by_label("Remove region 1").click();
    settle(&mut harness);
    let regions = &harness.state().view.transfer_function.regions;
    assert_eq!((regions.len(), regions[0] == proposed[0]), (proposed.len(), false));
    harness.get_by_label("Proposed regions").click();
    settle(&mut harness);
    assert_eq!(harness.state().view.transfer_function.regions, proposed);
}

#[test]
fn a_curve_is_made_point_by_point_and_decides_everywhere() {
    let Some(mut harness) = open() else { return };
    for _ in 0..3 {
        harness.get_by_label("Add point").click();
        settle(&mut harness);
    }
    harness.get_by_label("Remove point 2").click();
    settle(&mut harness);
    let points = harness.state().view.transfer_function.curve.points().to_vec();
    assert!(points.len() == 2 && points[0].value < points[1].value, "{points:?}");
    let pictures = harness.state().preview.pictures();
    harness.get_by_label("everywhere").click();
    settle(&mut harness);
    assert_eq!(harness.state().view.transfer_function.classification, Classification::Value);
    assert!(harness.state().preview.pictures() > pictures);
    harness.get_by_label("at boundaries").click();
    settle(&mut harness);
    assert_eq!(harness.state().view.transfer_function.classification, Classification::Roles);
}

#[test]
fn the_boundary_sliders_and_presets_change_the_emphasis_and_the_picture() {
    let Some(mut harness) = open() else { return };
    let pictures = harness.state().preview.pictures();
    let slider = harness.get_by_role_and_label(egui::Role::Slider, "a").rect();
    let from = slider.right_center() - vec2(4.0, 0.0);
    drag(&mut harness, PointerButton::Primary, Modifiers::NONE, from, slider.center());
    let a = harness.state().view.transfer_function.emphasis.high.a;
    assert!((0.4..0.6).contains(&a), "{a}");
    assert!(harness.state().preview.pictures() > pictures);

    harness.get_by_label("convex, n = 3").click();
    settle(&mut harness);
    let emphasis = harness.state().view.transfer_function.emphasis.high;
    assert_eq!((emphasis.kind, emphasis.a, emphasis.n), (EmphasisKind::Convex, 1.0, 3.0));
    assert!((emphasis.d_c - 15.0).abs() < 1e-3, "{}", emphasis.d_c);
    harness.get_by_label("linear").click();
    settle(&mut harness);
    assert_eq!(harness.state().view.transfer_function.emphasis.low.kind, EmphasisKind::Linear);
}

#[test]
fn lines_and_surfaces_are_switched_on_and_shown() {
    let Some(mut harness) = open() else { return };
    for label in ["bounding box", "axes", "scale bar", "Add isosurface"] {
        let pictures = harness.state().preview.pictures();
        harness.get_by_label(label).click();
        settle(&mut harness);
        assert!(harness.state().preview.pictures() > pictures, "{label}");
        assert_eq!(harness.state().preview.error(), None, "{label}");
    }
    let scene = &harness.state().view.scene;
    assert!(scene.bounding_box && scene.axes && scene.scale_bar && scene.isosurfaces.len() == 1);
    harness.get_by_label("Remove isosurface 1").click();
    settle(&mut harness);
    assert!(harness.state().view.scene.isosurfaces.is_empty());
}

#[test]
fn a_level_that_cannot_be_read_is_told_of_whatever_is_drawn_meanwhile() {
    let Some(mut harness) = open() else { return };
    let error = voxrole_pack::Error::Format("brick 3 is damaged".into());
    harness.state_mut().finer.stop(&error.into());
    settle(&mut harness);
    harness.get_by_label("No finer level: brick 3 is damaged");
}

#[test]
fn a_slow_picture_is_given_up_for_what_is_wanted_now() {
    let Some(mut harness) = open() else { return };
    // Far more than can be drawn while the hand rests.
    harness.state_mut().view.render_settings.step = Frame::STEP_RANGE[0];
    let deadline = Instant::now() + Duration::from_secs(60);
    while harness.state().preview.refining().is_none() {
        assert!(Instant::now() < deadline, "no finer picture is begun");
        harness.step();
    }
    let pictures = harness.state().preview.pictures();
    harness.state_mut().view.camera.orbit(10.0, 0.0);
    (0..2).for_each(|_| harness.step());
    assert!(harness.state().preview.pictures() > pictures, "a draft of the new state is there");
    assert_ne!(harness.state().preview.last().expect("is drawn").detail, Detail::FULL);
    harness.state_mut().view.render_settings.step = 1.0;
    settle(&mut harness);
}

#[test]
fn a_region_and_a_side_can_have_an_emphasis_of_their_own() {
    let Some(mut harness) = open() else { return };
    harness.get_by_label("Region 1").click();
    settle(&mut harness);
    harness.get_by_label("Region 1 has its own").click();
    settle(&mut harness);
    harness.get_by_label("linear").click();
    settle(&mut harness);
    let transfer_function = harness.state().view.transfer_function.clone();
    let own = transfer_function.regions[0].emphasis.expect("the region has one");
    assert_eq!([own.high.kind, own.low.kind], [EmphasisKind::Linear; 2]);
    assert_eq!(transfer_function.emphasis.high.kind, EmphasisKind::Concave);

    let pictures = harness.state().preview.pictures();
    harness.get_by_label("Each side its own").click();
    settle(&mut harness);
    harness.get_all_by_label("convex").last().expect("that of the low side").click();
    settle(&mut harness);
    let own = harness.state().view.transfer_function.regions[0].emphasis.expect("the region has one");
    assert_eq!([own.high.kind, own.low.kind], [EmphasisKind::Linear, EmphasisKind::Convex]);
    assert!(harness.state().preview.pictures() > pictures);
    harness.get_by_label("Region 1 has its own").click();
    settle(&mut harness);
    assert_eq!(harness.state().view.transfer_function.regions[0].emphasis, None);
}

#[test]
fn techniques_are_chosen_by_a_click_and_refined_in_parts() {
    let Some(mut harness) = open_on(GPU) else { return };
    harness.state_mut().view.render_settings.step = 2.0;
    settle(&mut harness);
    for (name, technique) in [("slices", Technique::Slices), ("stacks", Technique::Stacks), ("rays", Technique::Rays)] {
        let pictures = harness.state().preview.pictures();
        harness.get_by_label(name).click();
        settle(&mut harness);
        let ViewerWindow { view, preview, .. } = harness.state();
        assert_eq!((view.render_settings.technique, preview.error()), (technique, None));
        // A draft, and one finer picture at least.
        assert!(preview.pictures() > pictures + 1, "{name}: {} pictures", preview.pictures() - pictures);
        assert_eq!(preview.last().expect("is drawn").detail, Detail::FULL);
    }
}

#[test]
fn a_window_goes_on_as_it_was_when_its_device_is_lost() {
    for device in [CPU, GPU] {
        let Some(render_state) = render_state() else { return };
        let reader = Reader::open(shells()).expect("opens");
        let volume = OpenedVolume::read(shells(), &reader, &texels().description).expect("has histograms");
        let mut window = KeptWindow::new(volume);
        window.view.render_settings.step = 4.0;
        let window = window.open(&render_state, &Arc::new(texels()), device).expect("fits the device");
        let lost = render_state.device.clone();
        let mut before = harness(render_state, window);
        let loss = DeviceLoss::watch(&lost, &before.ctx);
        before.state_mut().view.camera.orbit(40.0, 10.0);
        before.get_by_label("Region 1").click();
        settle(&mut before);
        let (view, shown) = (before.state().view.clone(), before.render().expect("a picture of the window"));
        assert_eq!(loss.reason(), None);

        lost.destroy();
        let _ = lost.poll(wgpu::PollType::wait_indefinitely());
        assert_eq!(loss.reason(), Some("Destroyed"));
        // Pictures fail, or come from the CPU; nothing panics.
        let context = before.ctx.clone();
        let _ = before.state_mut().preview.begin_saved(&context, &view);
        let _ = before.state_mut().preview.go_on_saved(&context);

        let mut kept = KeptWindow::of(before.into_state());
        let kept_texels = kept.texels.take();
        assert_eq!(kept_texels.is_some(), device.cpu, "what a device has all of is not kept beside it");
        let again = self::render_state().expect("was there before");
        let texels = kept_texels.unwrap_or_else(|| Arc::new(texels()));
        let window = kept.open(&again, &texels, device).expect("fits the device");
        let mut after = harness(again, window);
        assert_eq!((&after.state().view, after.state().histogram.selected), (&view, Some(0)));
        let shown_again = after.render().expect("a picture of the window");
        for label in [PICTURE, HISTOGRAM] {
            let corner = (rect_of(&after, label).center() - Vec2::splat(80.0)).round();
            let crop = |shown| image::imageops::crop_imm(shown, corner.x as u32, corner.y as u32, 160, 160).to_image();
            assert!(crop(&shown) == crop(&shown_again), "{label}: the same as before");
        }
    }
}
