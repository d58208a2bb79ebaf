//! `voxrole prepare` of one volume in several formats, folders among them.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

const SIZE: usize = 48;

/// A ball with a soft edge.
fn ball() -> Vec<u8> {
    let centre = (SIZE - 1) as f32 / 2.0;
    let square = |index: usize| (index as f32 - centre).powi(2);
    let voxel = |index: usize| {
        let radius = (square(index % SIZE) + square(index / SIZE % SIZE) + square(index / SIZE / SIZE)).sqrt();
        (2000.0 / (1.0 + (radius - 14.0).exp())) as u16
    };
    (0..SIZE * SIZE * SIZE).flat_map(|index| voxel(index).to_le_bytes()).collect()
}

fn run(folder: &Path, line: &str) -> Output {
    let voxrole = env!("CARGO_BIN_EXE_voxrole");
    Command::new(voxrole).args(line.split_whitespace()).current_dir(folder).output().expect("the program starts")
}

fn prepare(folder: &Path, line: &str) {
    let output = run(folder, &format!("prepare {line}"));
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
}

/// What a packed file says of itself: the voxels' hash, placement, ranges and counts, but not the input's name.
fn description(folder: &Path, packed: &str) -> serde_json::Value {
    let output = run(folder, &format!("info {packed} --json"));
    let mut description: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    description["source"]["name"] = "ball".into();
    ["made_by", "source", "geometry", "statistics"].map(|name| description[name].take()).into_iter().collect()
}

fn write_vti(folder: &Path, ball: &[u8]) {
    let last = SIZE - 1;
    let extent = format!("0 {last} 0 {last} 0 {last}");
    let header = format!(
        "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\" header_type=\"UInt64\"><ImageData WholeExtent=\"{extent}\">\
         <Piece Extent=\"{extent}\"><PointData><DataArray type=\"UInt16\" Name=\"ball\" format=\"appended\" offset=\"0\"/>\
         </PointData></Piece></ImageData><AppendedData encoding=\"raw\">_"
    );
    let length = (ball.len() as u64).to_le_bytes();
    fs::write(folder.join("ball.vti"), [header.as_bytes(), &length, ball, b"</AppendedData></VTKFile>"].concat())
        .expect("written");
}

/// A store of chunks of 20 slices.
#[cfg(feature = "zarr")]
fn write_zarr(folder: &Path, ball: &[u8]) {
    let metadata = format!(
        r#"{{"zarr_format": 2, "shape": [{SIZE}, {SIZE}, {SIZE}], "chunks": [20, {SIZE}, {SIZE}], "dtype": "<u2", "order": "C",
            "fill_value": 0, "filters": null, "compressor": null}}"#
    );
    let store = folder.join("ball.zarr");
    fs::create_dir(&store).expect("made");
    fs::write(store.join(".zarray"), metadata).expect("written");
    let mut padded = ball.to_vec();
    padded.resize(60 * SIZE * SIZE * 2, 0);
    for (index, chunk) in padded.chunks(20 * SIZE * SIZE * 2).enumerate() {
        fs::write(store.join(format!("{index}.0.0")), chunk).expect("written");
    }
}

#[test]
fn a_volume_is_the_same_in_every_format() {
    let folder = tempfile::tempdir().expect("a folder");
    let (folder, ball) = (folder.path(), ball());
    fs::write(folder.join("ball.raw"), &ball).expect("written");
    prepare(folder, &format!("ball.raw --dims {SIZE},{SIZE},{SIZE} --dtype u16 -o raw.vxr"));
    let expected = description(folder, "raw.vxr");
    write_vti(folder, &ball);
    let mut inputs = vec!["ball.vti"];
    if cfg!(feature = "zarr") {
        #[cfg(feature = "zarr")]
        write_zarr(folder, &ball);
        inputs.push("ball.zarr");
    }
    for input in inputs {
        prepare(folder, &format!("{input} -o whole.vxr"));
        prepare(folder, &format!("{input} -o blocks.vxr --memory 64MiB"));
        assert_eq!(description(folder, "whole.vxr"), expected, "{input}");
        let read = |name: &str| fs::read(folder.join(name)).expect("prepared");
        assert!(read("whole.vxr") == read("blocks.vxr"), "{input}");
    }
}

#[cfg(feature = "zarr")]
#[test]
fn nothing_is_written_into_an_input() {
    let folder = tempfile::tempdir().expect("a folder");
    write_zarr(folder.path(), &ball());
    for output in ["ball.zarr", "ball.zarr/", "ball.zarr/out.vxr", "ball.zarr/../ball.zarr/x.vxr", "ball.zarr/new/"] {
        let outcome = run(folder.path(), &format!("prepare ball.zarr -o {output}"));
        let message = String::from_utf8_lossy(&outcome.stderr).into_owned();
        assert_eq!(outcome.status.code(), Some(1), "{output}: {message}");
        assert!(message.contains("is an input"), "{output}: {message}");
    }
    assert_eq!(fs::read_dir(folder.path().join("ball.zarr")).expect("a folder").count(), 4);
}
