//! From a packed file to a picture file.

use std::path::{Path, PathBuf};

use clap::Parser;
use glam::DVec3;
use voxrole_pack::header::{Source, Statistics};
use voxrole_pack::histogram::HistogramShape;
use voxrole_pack::layer::Quantization;
use voxrole_pack::quantization::{NO_NORMAL, encode_normal};
use voxrole_pack::writer::Description;
use voxrole_pack::{
    DistanceQuantization, Histogram, HistogramAxis, HistogramKind, Layer, LayerKind, Precision, Reader, ScalarType,
    Writer,
};
use voxrole_preprocess::usage::UsageError;
use voxrole_tests::comparison::draw_on_cpu;
use voxrole_viewer::args::{Cli, Command};
use voxrole_viewer::state::{CameraPreset, PaintedMap};
use voxrole_viewer::{ViewState, VolumeTexels, headless};

use crate::phantom::{Phantom, Role, SHELLS, orthographic};

/// A folder of its own for each test, emptied first.
pub fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(test);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

fn small_shells() -> Phantom {
    let mut phantom = Phantom::concentric_shells();
    phantom.geometry.dims = [32; 3];
    phantom.geometry.spacing = [2.0; 3];
    phantom
}

/// Writes a phantom as `voxrole prepare` would; values as f32.
pub fn write(phantom: &Phantom, path: &Path) -> voxrole_pack::Result<u64> {
    let [width, height, depth] = phantom.geometry.dims_usize();
    let roles: Vec<_> = (0..width * height * depth)
        .map(|voxel| {
            phantom.role(DVec3::new(
                (voxel % width) as f64,
                (voxel / width % height) as f64,
                (voxel / (width * height)) as f64,
            ))
        })
        .collect();
    let values: Vec<f32> = roles.iter().map(|(value, _)| *value as f32).collect();
    let distance_quantization = DistanceQuantization::new(phantom.d_max as f32, Precision::default());
    let hit_gradient = phantom.hit_gradient();
    let distances: Vec<i16> = roles
        .iter()
        .map(|(_, hit)| {
            hit.map_or(DistanceQuantization::NO_BOUNDARY, |(distance, ..)| {
                distance_quantization.encode(distance as f32)
            })
        })
        .collect();
    let gradients: Vec<u16> =
        roles.iter().map(|(_, hit)| hit.map_or(0, |(_, gradient, _)| hit_gradient.encode(gradient as f32))).collect();
    let normals: Vec<u16> =
        roles.iter().map(|(_, hit)| hit.map_or(NO_NORMAL, |(.., normal)| encode_normal(normal.as_vec3()))).collect();

    let mut writer = Writer::create(path, phantom.geometry.clone(), 3)?;
    let linear = Quantization::Linear { slope: 1.0, intercept: 0.0 };
    writer.write_layer(Layer::new(LayerKind::Value, ScalarType::F32, linear), &values)?;
    let distance_layer =
        Layer::new(LayerKind::Distance, ScalarType::I16, Quantization::Distance(distance_quantization));
    writer.write_layer(distance_layer, &distances)?;
    let gradient_layer = Layer::new(LayerKind::HitGradient, ScalarType::U16, Quantization::HitGradient(hit_gradient));
    writer.write_layer(gradient_layer, &gradients)?;
    writer.write_layer(Layer::new(LayerKind::Normal, ScalarType::U16, Quantization::Octahedral), &normals)?;
    writer.write_histograms(vec![hit_histogram(phantom, &roles)])?;
    writer.finish(Description {
        made_by: "test".into(),
        source: Source { name: "phantom".into(), voxels_sha256: [0; 32] },
        parameters: Vec::new(),
        statistics: Statistics { value_range: phantom.value_range(), ..Statistics::default() },
    })
}

fn hit_histogram(phantom: &Phantom, roles: &[Role]) -> Histogram {
    let axes =
        vec![HistogramAxis { low: 0.0, high: 256.0, bins: 256 }, HistogramAxis { low: 0.0, high: 50.0, bins: 256 }];
    let mut counts = vec![0; 256 * 256];
    for (_, gradient, _) in roles.iter().filter_map(|(_, hit)| *hit) {
        // Halfway up the step, over those of the shells further out.
        let value = phantom.shells.iter().fold(0.0, |value, shell| {
            value
                + if shell.gradient() == gradient {
                    0.5 * shell.step
                } else if shell.gradient() < gradient {
                    shell.step
                } else {
                    0.0
                }
        });
        counts[axes[1].bin_of(gradient) * 256 + axes[0].bin_of(value)] += 1;
    }
    Histogram { shape: HistogramShape { kind: HistogramKind::HitValueHitGradient, axes }, counts }
}

pub fn render(file: &Path, output: &Path, options: &[&str]) -> anyhow::Result<()> {
    let (file, output) = (file.to_str().expect("UTF-8"), output.to_str().expect("UTF-8"));
    let size = if options.contains(&"--size") { &[][..] } else { &["--size", "48x48"] };
    let arguments = [&["voxrole-view", "render", file, "-o", output], size].concat();
    let cli = Cli::try_parse_from(arguments.iter().chain(options)).expect("arguments are understood");
    match cli.command {
        Some(Command::Render(arguments)) => headless::render(&arguments),
        _ => unreachable!("the command was given"),
    }
}

#[test]
fn a_packed_file_becomes_the_same_texels() {
    let path = folder("same_texels").join("shells.vxr");
    let phantom = small_shells();
    write(&phantom, &path).expect("is written");
    let read = VolumeTexels::read(&Reader::open(&path).expect("opens")).expect("reads");
    let made = phantom.texels();
    assert_eq!(read.description.dims, made.description.dims);
    assert_eq!(read.description.hit_gradient, made.description.hit_gradient);
    assert_eq!(read.texels.len(), made.texels.len());
    let [low, high] = read.description.value_range;
    let [_, made_high] = made.description.value_range;
    for (read, made) in read.texels.iter().zip(&made.texels) {
        assert_eq!(read[1..], made[1..]);
        // The value is stored as f32.
        let value = f64::from(read[0]) / 65535.0 * (high - low) + low;
        assert!((value - f64::from(made[0]) / 65535.0 * made_high).abs() < 0.01);
    }
}

#[test]
fn a_picture_file_is_drawn_without_any_knob() {
    let folder = folder("picture_file");
    let [packed, output] = ["shells.vxr", "shells.png"].map(|name| folder.join(name));
    write(&small_shells(), &packed).expect("is written");
    for options in [&["--cpu"][..], &[]] {
        render(&packed, &output, options).expect("is drawn");
        let picture = image::open(&output).expect("is a PNG").to_rgba8();
        assert_eq!(picture.dimensions(), (48, 48));
        let [red, _, blue, _] = picture.get_pixel(24, 24).0;
        assert!(red > blue && red > 60, "the inner boundary shows: {red} {blue}");
        std::fs::remove_file(&output).expect("is there");
    }
}

#[test]
fn coarse_levels_draw_boundaries_where_they_are() {
    let path = folder("coarse_levels").join("shells.vxr");
    let phantom = Phantom::concentric_shells();
    write(&phantom, &path).expect("is written");
    let reader = Reader::open(&path).expect("opens");
    let state = phantom.state(orthographic(CameraPreset::Front));
    let pictures = [0, 1, 2].map(|level| {
        let volume = VolumeTexels::read_level(&reader, level).expect("reads");
        draw_on_cpu(&volume, &state).rgba
    });
    // Every voxel predicts the boundary by its own plane, so that a level loses the curvature between its voxels alone.
    for (coarse, largest) in [(&pictures[1], 0.5), (&pictures[2], 2.0)] {
        let squares: f64 = coarse.iter().zip(&pictures[0]).map(|(&a, &b)| f64::from(a.abs_diff(b)).powi(2)).sum();
        let rms = (squares / coarse.len() as f64).sqrt();
        eprintln!("differs from the finest level by {rms:.2} of 255");
        assert!(rms < largest, "{rms}");
    }
    assert!(VolumeTexels::read_level(&reader, 3).is_err());
}

#[test]
fn turntables_sessions_depths_and_deep_pictures_are_written() {
    let folder = folder("turntables");
    let path = |name: &str| folder.join(name);
    let packed = path("shells.vxr");
    write(&small_shells(), &packed).expect("is written");
    let session = path("s.toml");
    let session = session.to_str().expect("Unicode");
    let small = ["--cpu", "--save-session", session];
    let run = |output: &str, options: &[&str]| render(&packed, &path(output), options);
    run("a.png", &[&small[..], &["--frames", "4", "--clip", "10,20", "--camera", "40,10"]].concat()).expect("drawn");
    let names = ["a-000.png", "a-001.png", "a-002.png", "a-003.png"];
    let pictures = names.map(|name| std::fs::read(path(name)).expect("is there"));
    assert!((1..4).all(|frame| pictures[frame] != pictures[0]) && !path("a.png").exists());
    let saved = ViewState::from_toml(&std::fs::read_to_string(session).expect("is there")).expect("is a session");
    assert!(!saved.transfer_function.regions.is_empty() && saved.clipping.planes.len() == 1);

    run("b.png", &["--cpu", "--session", session]).expect("is drawn");
    assert!(std::fs::read(path("b.png")).expect("is there") == pictures[0], "the same picture");
    // In its own place.
    let step = saved.render_settings.step;
    run("b.png", &[&small[..], &["--session", session, "--step", "3"]].concat()).expect("is drawn");
    let again = ViewState::from_toml(&std::fs::read_to_string(session).expect("is there")).expect("is a session");
    assert!(step != 3.0 && again.render_settings.step == 3.0);
    run("b.png", &[&small[..], &["--session", session, "--step", &step.to_string()]].concat()).expect("is drawn");
    run("c.apng", &["--cpu", "--session", session, "--frames", "3"]).expect("is drawn");
    assert!(std::fs::read(path("c.apng")).expect("is there").windows(4).filter(|tag| tag == b"fcTL").count() == 3);

    let binary = path("binary.toml");
    std::fs::write(&binary, [0xff, 0xfe]).expect("is written");
    let binary = binary.to_str().expect("Unicode");
    let depth = path("d.npy");
    let options = ["--session", session, "--bits", "16", "--transparent", "--depth", depth.to_str().expect("Unicode")];
    run("d.png", &options).expect("is drawn");
    let picture = image::open(path("d.png")).expect("is a PNG");
    assert_eq!(picture.color(), image::ColorType::Rgba16);
    let picture = picture.into_rgba16();
    let depth = std::fs::read(depth).expect("is there");
    let depths: Vec<f32> =
        depth[depth.len() - 4 * 48 * 48..].as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    let mut seen = 0;
    for (pixel, depth) in picture.pixels().zip(depths) {
        // Half of the light is stopped where alpha is a half, but for rounding.
        assert!(depth.is_nan() || pixel.0[3] >= 32767, "{depth} {pixel:?}");
        assert!(depth.is_finite() || pixel.0[3] <= 32768, "{depth} {pixel:?}");
        seen += u32::from(depth.is_finite());
    }
    assert!(seen > 20, "{seen}");

    for (output, options, reason) in [
        ("e.apng", &["--bits", "16"][..], "8 bits"),
        ("e.png", &["--depth", "e.txt"], "npy"),
        ("e.png", &["--depth", "e.npy", "--frames", "2"], "--frames"),
        ("e.png", &["--session", "none.toml"], "none.toml"),
        ("e.png", &["--session", binary], "is no session, which is text"),
        ("e.jpg", &[], "png, or apng"),
        ("e.png", &["--clip", "1,1", "--clip", "1,1", "--clip", "1,1", "--clip", "1,1", "--clip", "1,1"], "at most 4"),
    ] {
        let error = format!("{:#}", run(output, options).expect_err(reason));
        assert!(error.contains(reason), "{error}");
        assert!(!path(output).exists());
    }
}

#[test]
fn lines_and_surfaces_are_drawn_and_kept_in_sessions() {
    let folder = folder("scenes");
    let path = |name: &str| folder.join(name);
    let [packed, session, depth] = ["shells.vxr", "s.toml", "d.npy"].map(path);
    write(&small_shells(), &packed).expect("is written");
    let [session, depth] = [&session, &depth].map(|path| path.to_str().expect("Unicode"));
    let run = |output: &str, options: &[&str]| render(&packed, &path(output), options);
    let png = |name: &str| std::fs::read(path(name)).expect("is there");
    run("without.png", &["--cpu"]).expect("is drawn");
    let scene = ["--bounding-box", "--axes", "--scale-bar", "--isosurface", "135,FF0000", "--cpu"];
    run("a.png", &[&scene[..], &["--save-session", session]].concat()).expect("is drawn");
    assert!(png("a.png") != png("without.png"));
    run("b.png", &["--cpu", "--session", session]).expect("is drawn");
    assert!(png("b.png") == png("a.png"), "the same picture");

    // A mesh lies where the session does.
    std::fs::write(path("m.obj"), "v 0 0 0\nv 20 0 0\nv 0 0 20\nf 1 2 3\n").expect("is written");
    std::fs::write(path("m.toml"), "[scene]\nmeshes = [\"m.obj,FF0000\"]\n").expect("is written");
    let with_mesh = path("m.toml");
    run("m.png", &["--cpu", "--session", with_mesh.to_str().expect("Unicode")]).expect("is drawn");
    assert!(png("m.png") != png("without.png"));

    // What is opaque is so in a transparent picture, and has a depth.
    run("c.png", &["--session", session, "--transparent", "--depth", depth]).expect("is drawn");
    let picture = image::open(path("c.png")).expect("is a PNG").into_rgba8();
    let depth = std::fs::read(depth).expect("is there");
    let depths = depth[depth.len() - 4 * 48 * 48..].as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
    let middle = 24 * 48 + 24;
    let depths: Vec<f32> = depths.collect();
    assert!(depths[middle].is_finite() && picture.get_pixel(24, 24).0[3] == 255);
    assert!(picture.pixels().filter(|pixel| pixel.0[3] == 255).count() > 300);

    for (options, reason) in [
        (["--isosurface", "1e9"], "the volume's values are from"),
        (["--mesh", "none.stl"], "none.stl"),
        (["--mesh", "none.ply"], ".obj"),
    ] {
        let error = format!("{:#}", run("e.png", &options).expect_err(reason));
        assert!(error.contains(reason) && !path("e.png").exists(), "{error}");
    }
}

#[test]
fn value_alone_and_stored_opacities_are_drawn() {
    let folder = folder("by-value");
    let path = |name: &str| folder.join(name);
    let [packed, stored] = ["shells.vxr", "stored.npy"].map(path);
    write(&small_shells(), &packed).expect("is written");
    // A ball of fog: intensity and opacity, u8, the components last.
    let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    let header = "{'descr': '|u1', 'fortran_order': False, 'shape': (8, 8, 8, 2), }";
    bytes.extend(format!("{header:<117}\n").bytes());
    bytes.extend((0..512).flat_map(|index| [200, if (100..400).contains(&index) { 60 } else { 0 }]));
    std::fs::write(&stored, bytes).expect("is written");
    let curve = ["--classify", "value", "--curve", "100,000000,0;140,00FF00,0.9;180,000000,0"];
    let session = path("value.toml");
    let kept = ["--save-session", session.to_str().expect("Unicode")];
    render(&packed, &path("value.png"), &[&curve[..], &kept].concat()).expect("is drawn");
    render(&packed, &path("again.png"), &["--session", kept[1]]).expect("is drawn");
    render(&stored, &path("stored.png"), &["--classify", "stored"]).expect("is drawn");
    let picture = |name: &str| image::open(path(name)).expect("is a PNG").into_rgba8();
    assert!(picture("value.png").pixels().any(|pixel| pixel.0[1] > 40 && pixel.0[1] > pixel.0[0]), "green is seen");
    assert_eq!(picture("again.png"), picture("value.png"));
    assert!(picture("stored.png").pixels().any(|pixel| pixel.0[0] > 100 && pixel.0[0] == pixel.0[2]), "fog is grey");
    for (file, options, reason) in [
        (&packed, &["--classify", "value"][..], "needs a `--curve`"),
        (&packed, &["--classify", "stored"], "no stored opacities"),
        (&stored, &["--classify", "stored", "--component", "1"], "leave --component out"),
        (&packed, &["--component", "1"], "leave --component 1 out"),
    ] {
        let error = format!("{:#}", render(file, &path("e.png"), options).expect_err(reason));
        assert!(error.contains(reason) && !path("e.png").exists(), "{error}");
    }
}

#[test]
fn failures_say_why_and_leave_no_file() {
    let folder = folder("failures");
    let [packed, output, other] = ["none.vxr", "none.png", "other.raw"].map(|name| folder.join(name));
    let mut empty = small_shells();
    empty.d_max = 1e-3;
    empty.center = DVec3::new(1000.0, 0.0, 0.0);
    write(&empty, &packed).expect("is written");
    std::fs::write(&other, b"something else").expect("is written");
    let missing = folder.join("missing.vxr");
    for (file, reason) in [(&packed, "no boundary"), (&other, "--dims"), (&missing, "missing.vxr")] {
        let error = format!("{:#}", render(file, &output, &["--cpu"]).expect_err("fails"));
        assert!(error.contains(reason), "{error}");
        assert!(!output.exists());
    }
    let nowhere = folder.join("nowhere").join("a.png");
    let region = format!("0:300,{}:{},FFFFFF", 0.5 * SHELLS[1].gradient(), 2.0 * SHELLS[0].gradient());
    let error = format!("{:#}", render(&packed, &nowhere, &["--cpu", "--region", &region]).expect_err("fails"));
    assert!(error.contains("nowhere"), "{error}");
}

#[test]
fn a_box_beyond_the_volume_and_a_missing_mesh_are_told_of_as_what_they_are() {
    let folder = folder("beyond");
    let [packed, output] = ["shells.vxr", "a.png"].map(|name| folder.join(name));
    write(&small_shells(), &packed).expect("is written");
    let error = |options: &[&str]| {
        let error = render(&packed, &output, &[&["--cpu"], options].concat()).expect_err("is refused");
        assert!(!output.exists(), "{options:?}");
        (format!("{error:#}"), error.is::<UsageError>())
    };
    let (message, is_usage) = error(&["--crop", ":,32:,:"]);
    assert!(message.ends_with("along y the volume has the voxels 0 to 31") && !is_usage, "{message}");
    let (message, is_usage) = error(&["--crop", ":-1,:,:"]);
    assert!(message.contains("counted from 0") && is_usage, "{message}");
    let (message, _) = error(&["--mesh", "missing.stl"]);
    assert!(message.contains("missing.stl") && !message.contains("shells.vxr"), "{message}");
    render(&packed, &output, &["--cpu", "--crop", ":,31:,:"]).expect("the last voxel is the volume's");
    // Nor is what was read replaced.
    let map = folder.join("map.png");
    std::fs::write(&map, PaintedMap::blank().to_png().expect("is encoded")).expect("is written");
    let region = format!("map:{},0:300,1:2,FFFFFF", map.display());
    let error = format!("{:#}", render(&packed, &map, &["--cpu", "--region", &region]).expect_err("is refused"));
    assert!(error.contains("overwritten"), "{error}");
}

#[test]
fn an_animation_is_as_fast_as_is_asked_for() {
    let folder = folder("fps");
    let packed = folder.join("shells.vxr");
    write(&small_shells(), &packed).expect("is written");
    let delay = |options: &[&str]| {
        let output = folder.join("turn.apng");
        render(&packed, &output, &[&["--cpu", "--size", "8x8", "--frames", "2"], options].concat()).expect("is drawn");
        let file = std::io::BufReader::new(std::fs::File::open(output).expect("is written"));
        let mut reader = png::Decoder::new(file).read_info().expect("is a picture");
        let mut rgba = [0; 8 * 8 * 4];
        reader.next_frame(&mut rgba).expect("a frame");
        let control = reader.info().frame_control().expect("is an animation");
        [control.delay_num, control.delay_den]
    };
    assert_eq!([delay(&[]), delay(&["--fps", "50"])], [[1, 25], [1, 50]]);
    assert_eq!(delay(&["--fps", "12.5"]), [800, 10_000]);
    let error = render(&packed, &folder.join("a.png"), &["--frames", "2", "--fps", "50"]).expect_err("is refused");
    assert!(error.is::<UsageError>() && error.to_string().contains("OUT.apng"), "{error}");
}
