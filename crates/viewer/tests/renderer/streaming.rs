//! Volumes whose texels stay in the packed file.

use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;

use voxrole_pack::brick::BRICK_EDGE;
use voxrole_pack::directory::Place;
use voxrole_pack::{LayerKind, Precision, Reader};
use voxrole_preprocess::phantom::{Phantom as Volume, PhantomSettings};
use voxrole_preprocess::settings::{Method, Settings};
use voxrole_tests::comparison::{draw_with_budget, gpu_or_skip, lit_share};
use voxrole_tests::prepared;
use voxrole_viewer::classify::{MacrocellRanges, MacrocellSamples};
use voxrole_viewer::drawing::Drawing;
use voxrole_viewer::scene::Surfaces;
use voxrole_viewer::state::{Camera, Classification, Technique};
use voxrole_viewer::{Error, Gpu, PackedVolume, Picture, Renderer, Target, TexelSource, ViewState, VolumeTexels};

use crate::packed_file::{folder, render, write};
use crate::phantom::{Phantom, Shell};

/// Bytes of a brick on the device.
const BRICK: u64 = 33 * 33 * 33 * 8;
/// More than any volume here takes.
const PLENTY: u64 = 1 << 30;

/// Bricks at the far faces are cut short, one of them to a single voxel.
fn shells() -> Phantom {
    let shells = [Shell { radius: 20.0, step: 80.0 }, Shell { radius: 30.0, step: 40.0 }];
    let mut phantom = Phantom::cube(97, &shells);
    phantom.geometry.dims = [97, 70, 65];
    phantom.center = glam::DVec3::new(50.0, 34.0, 30.0);
    phantom
}

fn in_file(path: &Path, level: usize, memory: u64) -> Arc<PackedVolume> {
    let reader = Reader::open(path).expect("opens");
    Arc::new(PackedVolume::new(reader, level, memory).expect("has all layers"))
}

/// The picture, and how many bricks were uploaded.
fn draw(gpu: &Gpu, volume: &Arc<PackedVolume>, state: &ViewState, budget: Option<u64>) -> (Picture, u64) {
    let source = TexelSource::File(Arc::clone(volume));
    let target = Target::new(gpu, state.render_settings.image_size).expect("a target");
    let mut renderer = Renderer::new(gpu, &source, budget).expect("a renderer");
    let surfaces = Surfaces::of_source(state, &source).expect("a scene");
    renderer.prepare_scene(&state.scene, &Arc::new(surfaces), target.size()).expect("has room");
    renderer.draw(state, &target).expect("draws");
    (target.read_back(gpu).expect("a picture"), renderer.bricks_uploaded().expect("is drawn brick by brick"))
}

fn states(phantom: &Phantom) -> Vec<ViewState> {
    let mut plain = phantom.state(Camera::default());
    plain.render_settings.image_size = [40, 45];
    let mut lit = plain.clone();
    lit.render_settings.shading.occlusion = 0.8;
    lit.camera.zoom = 3.0;
    let mut unskipped = plain.clone();
    unskipped.render_settings.leaps = false;
    let mut by_value = lit.clone();
    by_value.transfer_function.classification = Classification::Value;
    by_value.transfer_function.curve = "20,0060FF,0;60,00C0FF,0.1;110,FFC080,0.6".parse().expect("a curve");
    let mut scene = plain.clone();
    scene.scene.bounding_box = true;
    scene.scene.isosurfaces = vec!["90,00FF00".parse().expect("an isosurface")];
    vec![plain, lit, unskipped, by_value, scene]
}

#[test]
fn the_picture_is_that_of_all_texels() {
    let Some(gpu) = gpu_or_skip("the_picture_is_that_of_all_texels") else { return };
    let path = folder("streamed").join("shells.vxr");
    let phantom = shells();
    write(&phantom, &path).expect("is written");
    let reader = Reader::open(&path).expect("opens");
    let states = states(&phantom);
    let mut pictures = Vec::new();
    for (level, state) in states.iter().map(|state| (0, state)).chain([(1, &states[0]), (1, &states[4])]) {
        let texels = Arc::new(VolumeTexels::read_level(&reader, level).expect("reads"));
        let (whole, _) = draw_with_budget(&gpu, &texels, state, None);
        assert!(lit_share(&whole, [0, 0, 0, 255]) > 0.05);
        for (bricks, memory) in [(100, PLENTY), (4, 1 << 20)] {
            let (_, expected) = draw_with_budget(&gpu, &texels, state, Some(bricks * BRICK));
            let volume = in_file(&path, level, memory);
            let (picture, uploads) = draw(&gpu, &volume, state, Some(bricks * BRICK));
            assert!(picture == whole, "level {level}, {bricks} bricks, {memory} bytes: another picture");
            if let Some(expected) = expected {
                assert_eq!(uploads, expected, "level {level}, {bricks} bricks, {memory} bytes");
            }
            let all = volume.grid().len() as u64;
            let unpacked = volume.bricks_unpacked();
            // Each at most once, whatever is uploaded again, unless memory is short.
            assert!(unpacked > 0 && (memory < PLENTY || unpacked <= all), "{unpacked} of {all}");
        }
        pictures.push(whole.rgba);
    }
    pictures.sort();
    pictures.dedup();
    assert_eq!(pictures.len(), 6, "but for what leaping saves, every state has a picture of its own");
}

#[test]
fn only_what_can_be_drawn_is_unpacked() {
    let Some(gpu) = gpu_or_skip("only_what_can_be_drawn_is_unpacked") else { return };
    let path = folder("unpacked").join("ball.vxr");
    // A ball within the first of 64 bricks.
    let mut phantom = Phantom::cube(128, &[Shell { radius: 6.0, step: 80.0 }]);
    phantom.center = glam::DVec3::splat(14.0);
    write(&phantom, &path).expect("is written");
    let state = phantom.state(Camera::default());
    let volume = in_file(&path, 0, PLENTY);
    assert_eq!(draw(&gpu, &volume, &state, None).1, 1);
    // With those around its far faces.
    assert_eq!(volume.bricks_unpacked(), 8);
    draw(&gpu, &volume, &state, None);
    assert_eq!(volume.bricks_unpacked(), 8, "they are still there");
    let mut empty = state;
    empty.transfer_function.regions.clear();
    let volume = in_file(&path, 0, PLENTY);
    assert_eq!((draw(&gpu, &volume, &empty, None).1, volume.bricks_unpacked()), (0, 0));
}

#[test]
fn what_is_gathered_brick_by_brick_is_that_of_all_texels() {
    let folder = folder("gathered");
    for dims in [[97, 70, 65], [33, 33, 1], [32, 64, 34], [1, 5, 40]] {
        let path = folder.join("shells.vxr");
        let mut phantom = shells();
        phantom.geometry.dims = dims;
        write(&phantom, &path).expect("is written");
        for level in 0..Reader::open(&path).expect("opens").levels() {
            let volume = in_file(&path, level, PLENTY);
            let texels = VolumeTexels::read_level(&Reader::open(&path).expect("opens"), level).expect("reads");
            let ranges = MacrocellRanges::of(&TexelSource::File(Arc::clone(&volume))).expect("is read");
            assert_eq!(ranges, MacrocellRanges::new(&texels), "{dims:?}");
            let samples = MacrocellSamples::of_packed(&volume).expect("is read");
            assert_eq!(samples, MacrocellSamples::new(&texels), "{dims:?}");
            let depth = texels.description.texel_dims()[2] as usize;
            let values: Vec<u16> = texels.texels.iter().map(|texel| texel[0]).collect();
            assert_eq!(volume.values(0..depth).expect("is read"), values, "{dims:?}");
            assert!(volume.values(depth..depth + 1).is_err());
            assert!(volume.bricks(&[volume.grid().len()]).is_err());
        }
    }
}

#[test]
fn isosurfaces_are_found_row_by_row_of_bricks() {
    let path = folder("isosurfaces").join("shells.vxr");
    for depth in [1, 31, 33, 65] {
        let mut phantom = shells();
        phantom.geometry.dims[2] = depth;
        phantom.center.z = 0.5 * f64::from(depth);
        write(&phantom, &path).expect("is written");
        let mut state = ViewState::default();
        state.scene.isosurfaces = vec!["20".parse().expect("one"), "100".parse().expect("another")];
        let volume = in_file(&path, 0, PLENTY);
        let texels = VolumeTexels::read(&Reader::open(&path).expect("opens")).expect("reads");
        let expected = Surfaces::of(&state, &texels).expect("are found");
        let source = TexelSource::File(Arc::clone(&volume));
        assert!(Surfaces::of_source(&state, &source).expect("are found") == expected, "{depth} slices");
        assert_eq!(volume.bricks_unpacked(), 0, "values alone are read");
    }
}

#[test]
fn every_precision_is_read_from_the_file() {
    let settings = PhantomSettings { dims: [40, 36, 34], ..PhantomSettings::default() };
    let grid = Volume::ThreeBalls.generate(&settings).expect("is made");
    for bits in [8, 12, 16] {
        let precision = Precision::new(bits).expect("is one");
        let prepared = prepared(&grid, &Settings { precision, ..Settings::new(Method::Fast) });
        let texels = VolumeTexels::read(&prepared.reader).expect("reads");
        let dims = texels.description.texel_dims();
        let volume = PackedVolume::new(prepared.reader, 0, PLENTY).expect("has all layers");
        let (found, size) = volume.boxes(&[[0; 3]], 33).expect("is read").remove(0);
        assert_eq!(size, [33, 33, 33]);
        for (index, texel) in found.iter().enumerate() {
            let (x, y, z) = (index % 33, index / 33 % 33, index / (33 * 33));
            assert_eq!(*texel, texels.texels[(z * dims[1] as usize + y) * dims[0] as usize + x], "{bits} bits");
        }
    }
}

/// Writes over a layer's stored bricks in place, from one on.
fn damage(path: &Path, kind: LayerKind, from: usize) {
    let reader = Reader::open(path).expect("opens");
    let mut file: File = OpenOptions::new().write(true).open(path).expect("opens");
    for brick in from..reader.grid(0).expect("a level").len() {
        if let Place::Stored(extent) = reader.brick_entry(kind, 0, brick).expect("an entry").place {
            file.seek(SeekFrom::Start(extent.offset)).expect("is there");
            file.write_all(&vec![0x5a; extent.stored_bytes as usize]).expect("is written");
        }
    }
}

#[test]
fn a_brick_that_is_damaged_while_it_is_drawn_is_named() {
    let Some(gpu) = gpu_or_skip("a_brick_that_is_damaged_while_it_is_drawn_is_named") else { return };
    let path = folder("damaged").join("shells.vxr");
    let phantom = shells();
    write(&phantom, &path).expect("is written");
    let state = phantom.state(Camera::default());
    let volume = TexelSource::File(in_file(&path, 0, PLENTY));
    let mut drawing = Drawing::on_gpu(gpu, &volume, &state, Some(4 * BRICK)).expect("is made ready");
    damage(&path, LayerKind::Normal, 0);
    let error = drawing.draw(&state.camera).err().expect("is refused");
    let message = error.to_string();
    assert!(matches!(error, Error::Pack(_)) && message.contains("layer `normal` is damaged"), "{message}");
}

#[test]
fn damage_ends_a_run_without_a_picture() {
    if gpu_or_skip("damage_ends_a_run_without_a_picture").is_none() {
        return;
    }
    let folder = folder("damaged-run");
    let [packed, output] = ["shells.vxr", "a.png"].map(|name| folder.join(name));
    write(&shells(), &packed).expect("is written");
    let small = ["--memory", "1MiB", "--gpu-memory", "2MiB"];
    render(&packed, &output, &small).expect("is drawn");
    std::fs::remove_file(&output).expect("was written");
    for kind in [LayerKind::Normal, LayerKind::Distance] {
        damage(&packed, kind, 1);
        let error = format!("{:#}", render(&packed, &output, &small).expect_err("is refused"));
        for part in ["shells.vxr", "brick ", kind.name(), "damaged"] {
            assert!(error.contains(part), "{error}");
        }
        assert!(!output.exists());
    }
}

#[test]
fn what_needs_all_texels_says_what_would_fit() {
    let folder = folder("too-much");
    let [packed, output] = ["shells.vxr", "a.png"].map(|name| folder.join(name));
    let phantom = Phantom { geometry: shells().geometry, ..shells() };
    write(&phantom, &packed).expect("is written");
    for (memory, options, expected) in [
        ("3MiB", &["--cpu"][..], "draw `--level 1`, which takes 442 KiB"),
        ("3MiB", &["--transparent"], "`--depth` need all of it there"),
        ("100KiB", &["--cpu"], "draw `--level 2`"),
        ("1KiB", &["--cpu"], "; give more `--memory`"),
    ] {
        let error =
            format!("{:#}", render(&packed, &output, &[&["--memory", memory], options].concat()).expect_err(memory));
        assert!(
            error.contains(expected) && error.contains("shells.vxr: level 0 of the volume takes 3.4 MiB"),
            "{error}"
        );
        assert!(!output.exists());
    }
    render(&packed, &output, &["--cpu", "--memory", "3MiB", "--level", "1"]).expect("fits");
    let reader = Reader::open(&packed).expect("opens");
    let volume = PackedVolume::new(reader, 0, 60_000).expect("has all layers");
    for error in [
        MacrocellRanges::of(&TexelSource::File(Arc::new(volume))).expect_err("is refused"),
        MacrocellSamples::of_packed(&in_file(&packed, 0, 200_000)).expect_err("is refused"),
    ] {
        assert!(matches!(error, Error::TooMuchMemory { .. }), "{error}");
    }
}

#[test]
fn slices_of_a_volume_in_a_file_are_those_of_all_texels() {
    let Some(gpu) = gpu_or_skip("slices_of_a_volume_in_a_file_are_those_of_all_texels") else { return };
    let path = folder("sliced").join("shells.vxr");
    let phantom = shells();
    write(&phantom, &path).expect("is written");
    let mut state = phantom.state(Camera::default());
    state.render_settings.technique = Technique::Slices;
    state.render_settings.image_size = [40, 45];
    state.render_settings.step = 2.0;
    let texels = Arc::new(VolumeTexels::read(&Reader::open(&path).expect("opens")).expect("reads"));
    let (whole, _) = draw_with_budget(&gpu, &texels, &state, None);
    let (picture, uploads) = draw(&gpu, &in_file(&path, 0, 1 << 20), &state, Some(12 * BRICK));
    assert!(picture == whole && uploads > 12);
    let output = path.with_extension("png");
    render(&path, &output, &["--technique", "stacks", "--memory", "3MiB", "--gpu-memory", "4MiB"]).expect("is drawn");
    assert_eq!(BRICK_EDGE, 32, "a brick of a file begins where one on the device does");
}
