//! Exit codes of the command line.

use std::fs;
use std::process::{Command, Output};

#[cfg(unix)]
use voxrole_pack::{GridGeometry, Scalars};

/// What the program says of a line.
fn run(line: &str) -> Output {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("usage");
    fs::create_dir_all(&folder).expect("a folder");
    let mut program = Command::new(env!("CARGO_BIN_EXE_voxrole-view"));
    program.args(line.split_whitespace()).current_dir(folder).output().expect("the program starts")
}

#[test]
fn what_the_command_line_cannot_mean_is_told_with_exit_code_2() {
    for (options, expected) in [
        ("--classify value --curve 0,FF0000,0.5 --region 1:2,3:4,FFFFFF", "leave --region out"),
        ("--transparent --background FFFFFF", "leave --background out"),
        ("--integration pre-2d", "--classify value"),
        ("--cpu --gpu-memory 1GiB", "cannot be used with"),
        ("--cpu --normals compressed", "cannot be used with"),
        ("--bits 16 --gpu-memory 1GiB", "leave --gpu, --gpu-memory and --normals out"),
        ("--spacing 0,1,1", "above 0"),
        ("--depth a.npy --frames 2", "without --frames"),
        ("--clip 1,1 --clip 1,1 --clip 1,1 --clip 1,1 --clip 1,1", "at most 4"),
        ("--region map:none.jpg,1:2,3:4,FFFFFF", "is not map:FILE.png"),
        ("--region 1:2,3:4,FFFFFF,1.5", "between 0 and 1"),
        ("--step 0", "between"),
    ] {
        let output = run(&format!("render none.vxr -o a.png {options}"));
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{options}: {message}");
        assert!(message.contains(expected), "{options}: {message}");
    }
    let bench = run("bench none.vxr -o b --scale-bar");
    assert_eq!(bench.status.code(), Some(2), "{}", String::from_utf8_lossy(&bench.stderr));
    let demo = run("demo --spacing 1,1,2");
    assert_eq!(demo.status.code(), Some(2), "{}", String::from_utf8_lossy(&demo.stderr));
    // A folder may be a volume.
    let folder = run("render . -o a.png");
    let said = String::from_utf8_lossy(&folder.stderr);
    assert!(folder.status.code() == Some(1) && said.contains("expected a folder"), "{said}");
    let map = run("render none.vxr -o a.png --region map:none.png,1:2,3:4,FFFFFF");
    let said = String::from_utf8_lossy(&map.stderr);
    assert!(map.status.code() == Some(1) && said.contains("map:none.png: "), "{said}");
    let missing = run("render none.vxr -o a.png");
    assert_eq!(missing.status.code(), Some(1), "{}", String::from_utf8_lossy(&missing.stderr));
}

/// A run that prepares a volume in a folder of its own for temporary files, started by a line of the shell in which `$view` is the
/// program; and what is left in that folder.
#[cfg(unix)]
fn run_in_shell(line: &str) -> (Output, usize) {
    let folder = tempfile::tempdir().expect("a folder");
    let temporary = folder.path().join("temporary");
    fs::create_dir(&temporary).expect("a folder");
    let mut file = fs::File::create(folder.path().join("ramp.nrrd")).expect("a file");
    let values = (0..96 * 96 * 96_u32).map(|index| (index % 96) as f32 + (index % 7) as f32).collect();
    let geometry = GridGeometry::axis_aligned([96; 3], [1.0; 3]);
    voxrole_preprocess::io::nrrd_writer::write_scalars(&mut file, &geometry, &Scalars::F32(values), "a ramp")
        .expect("writes");
    let mut shell = Command::new("sh");
    shell.args(["-c", line]).current_dir(folder.path());
    shell.env("view", env!("CARGO_BIN_EXE_voxrole-view")).env("TMPDIR", &temporary);
    let output = shell.output().expect("runs");
    assert!(!folder.path().join("a.png").exists());
    (output, fs::read_dir(temporary).expect("lists").count())
}

#[cfg(unix)]
#[test]
fn nothing_is_left_of_a_volume_whose_preparation_ends_early() {
    // As schedulers limit the sizes of files.
    let (output, left) = run_in_shell("ulimit -f 8; exec $view render ramp.nrrd -o a.png --cpu");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && said.contains("File too large") && left == 0, "{left} files, {said}");
    // The folder is there once the program says that it prepares the volume.
    let interrupted = "$view render ramp.nrrd -o a.png --size 2000x2000 --step 0.02 --cpu 2>said & \
                       while kill -0 $! && ! grep -q preparing said; do sleep 0.05; done; kill -INT $!; wait $!";
    let (output, left) = run_in_shell(interrupted);
    assert!(output.status.code() == Some(130) && left == 0, "{left} files, {:?}", output.status);
}
