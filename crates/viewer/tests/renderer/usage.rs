//! Exit codes of the command line.

use std::process::{Command, Output};

/// What the program says of a line.
fn run(line: &str) -> Output {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("usage");
    std::fs::create_dir_all(&folder).expect("a folder");
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
        ("--region map:none.png,1:2,3:4,FFFFFF", "none.png: "),
        ("--region 1:2,3:4,FFFFFF,1.5", "between 0 and 1"),
        ("--step 0", "between"),
    ] {
        let output = run(&format!("render none.vxr -o a.png {options}"));
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{options}: {message}");
        assert!(message.contains(expected), "{options}: {message}");
    }
    let demo = run("demo --spacing 1,1,2");
    assert_eq!(demo.status.code(), Some(2), "{}", String::from_utf8_lossy(&demo.stderr));
    let missing = run("render none.vxr -o a.png");
    assert_eq!(missing.status.code(), Some(1), "{}", String::from_utf8_lossy(&missing.stderr));
}
