//! DICOM series and choices on the command line.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use crate::dicom_samples::{COLUMNS, EXPLICIT, Folder, ROWS, Value, file, slice, with};

fn run(folder: &Path, line: &str) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_voxrole"));
    program.args(line.split_whitespace()).current_dir(folder).output().expect("the program starts")
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A folder with the series `head.1` of 12 slices and the series `uneven`, of enough voxels to be prepared.
fn series() -> Folder {
    let workplace = Folder::new([]);
    let large = |k: usize, z: f64| {
        let pixels = (0..24 * 20).flat_map(|pixel| ((k * pixel) as u16 % 4096).to_le_bytes()).collect();
        let size = [(0x0028_0010, Value::Short(20)), (0x0028_0011, Value::Short(24))];
        with(slice(k, z), [(0x7fe0_0010, Value::Pixels(pixels))].into_iter().chain(size))
    };
    for (name, step) in [("head.1", 1.0), ("uneven", 1.3)] {
        fs::create_dir(workplace.file(name)).expect("a folder");
        for k in 0..12 {
            let z = if k > 5 { step * k as f64 } else { k as f64 };
            fs::write(workplace.file(name).join(format!("I{k}")), file(EXPLICIT, &large(k, z))).expect("written");
        }
    }
    fs::write(workplace.file("head.1").join("README"), "text").expect("written");
    workplace
}

#[test]
fn series_are_prepared_at_once_in_blocks_and_in_a_batch() {
    let workplace = series();
    let once = run(workplace.path(), "prepare head.1 -o once.vxr");
    assert!(once.status.success(), "{}", errors(&once));
    assert!(errors(&once).contains("voxrole: read 12 images, skipped 1 files that are none"), "{}", errors(&once));
    let by_file = run(workplace.path(), "prepare head.1/I3 -o file.vxr");
    assert!(by_file.status.success(), "{}", errors(&by_file));
    let batch = run(workplace.path(), "prepare head.1 uneven -o out --memory 64MiB");
    assert_eq!(batch.status.code(), Some(1));
    assert!(errors(&batch).contains("--resample"), "{}", errors(&batch));
    assert!(workplace.file("out/head.1.vxr").exists() && !workplace.file("out/uneven.vxr").exists());
    let resampled = run(workplace.path(), "prepare uneven -o uneven.vxr --resample --progress json");
    assert!(resampled.status.success(), "{}", errors(&resampled));
    let note = "{\"event\":\"note\",\"input\":\"uneven\",\"message\":\"resampled because of";
    assert!(errors(&resampled).contains(note), "{}", errors(&resampled));
}

#[test]
fn slices_are_never_overwritten() {
    let workplace = series();
    let before = fs::read(workplace.file("head.1/I7")).expect("reads");
    for line in
        ["prepare head.1 -o head.1/I7", "prepare head.1/I3 -o head.1/I7", "prepare head.1 -o a.vxr --report head.1/I7"]
    {
        let output = run(workplace.path(), line);
        assert_eq!(output.status.code(), Some(1), "{line}");
        let reasons = [
            "the input itself would be overwritten",
            "lies in the folder head.1, which is an input",
            "found another file",
        ];
        assert!(reasons.iter().any(|reason| errors(&output).contains(reason)), "{line}: {}", errors(&output));
    }
    assert_eq!(fs::read(workplace.file("head.1/I7")).expect("reads"), before);
    // So is the data file of a header.
    let header = format!("NDims = 3\nDimSize = {COLUMNS} {ROWS} 2\nElementType = MET_UCHAR\nElementDataFile = a.raw\n");
    fs::write(workplace.file("a.mhd"), header).expect("written");
    fs::write(workplace.file("a.raw"), [0; 2 * COLUMNS * ROWS]).expect("written");
    let output = run(workplace.path(), "prepare a.mhd -o a.raw");
    assert!(errors(&output).contains("a.raw: expected a packed file or nothing"), "{}", errors(&output));
}

#[test]
fn options_are_checked_against_the_input() {
    let workplace = series();
    for (line, expected) in [
        ("prepare head.1 -o a.vxr --component 0", "leave the option out"),
        ("prepare head.1 -o a.vxr --resample", "leave it out"),
        ("prepare head.1 -o a.vxr --series 6", "choose by --series: 7 (CT sample, 12 images)"),
        ("prepare head.1/README -o a.vxr --dims 2,2,1 --series 7", "--series"),
    ] {
        let output = run(workplace.path(), line);
        assert_eq!(output.status.code(), Some(1), "{line}");
        assert!(errors(&output).contains(expected), "{line}: {}", errors(&output));
        assert!(!workplace.file("a.vxr").exists());
    }
    let output = run(workplace.path(), "prepare head.1/README -o a.vxr --skip-bytes 3");
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
}
