//! Several volumes prepared by one command, and progress as schedulers read it.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;

struct Workplace(TempDir);

impl Workplace {
    /// With the volumes a.nrrd, b.nrrd and c.nrrd, and bad.nrrd that is none.
    fn new() -> Self {
        let workplace = Self(tempfile::tempdir().expect("a folder"));
        for (name, dims) in [("a", "24,20,22"), ("b", "30,30,30"), ("c", "20,20,40")] {
            workplace.succeed(&format!("phantom ball --dims {dims} -o {name}.nrrd"));
        }
        fs::write(workplace.path("bad.nrrd"), "not a volume").expect("writes");
        workplace
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn run(&self, line: &str) -> Output {
        let mut program = Command::new(env!("CARGO_BIN_EXE_voxrole"));
        program.args(line.split_whitespace()).current_dir(self.0.path()).output().expect("the program starts")
    }

    fn succeed(&self, line: &str) -> String {
        let output = self.run(line);
        assert!(output.status.success(), "{line}: {}", errors(&output));
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    fn names(&self, folder: &str) -> Vec<String> {
        let entries = fs::read_dir(self.path(folder)).expect("lists");
        let name = |entry: fs::DirEntry| entry.file_name().to_string_lossy().into_owned();
        let mut names: Vec<_> = entries.map(|entry| name(entry.expect("an entry"))).collect();
        names.sort();
        names
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&fs::read(self.path(name)).expect("reads")).expect("is JSON")
    }
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn events(output: &Output) -> Vec<Value> {
    errors(output).lines().map(|line| serde_json::from_str(line).expect(line)).collect()
}

#[test]
fn a_bad_volume_does_not_stop_the_others() {
    let workplace = Workplace::new();
    let output = workplace.run("prepare a.nrrd bad.nrrd none.nrrd b.nrrd -o out --report r.json");
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(workplace.names("out"), ["a.vxr", "b.vxr"]);
    let said = errors(&output);
    assert!(said.contains("voxrole: bad.nrrd: found a file of no known kind"), "{said}");
    assert!(said.contains("voxrole: a.nrrd: roles") && said.contains("none.nrrd"), "{said}");

    let table = String::from_utf8_lossy(&output.stdout);
    let lines: Vec<Vec<&str>> = table.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(lines.len(), 6, "{table}");
    let bytes = fs::metadata(workplace.path("out/a.vxr")).expect("there").len().to_string();
    assert_eq!([lines[1][0], lines[1][1], lines[1][4]], ["a.nrrd", "10560", &bytes], "{table}");
    assert_eq!(lines[2][..2], ["bad.nrrd", "error:"], "{table}");
    assert_eq!(lines[3][..2], ["none.nrrd", "error:"], "{table}");
    assert_eq!(lines[4][..2], ["b.nrrd", "27000"], "{table}");
    assert_eq!(lines[5].join(" "), "4 volumes: 2 prepared, 2 failed");

    let report = workplace.json("r.json");
    let inputs: Vec<_> = report.as_array().expect("an array").iter().map(|entry| &entry["input"]).collect();
    assert_eq!(inputs, ["a.nrrd", "bad.nrrd", "none.nrrd", "b.nrrd"]);
    assert_eq!(report[0]["counts"]["voxels"], 10560);
    assert!(report[1]["error"].as_str().expect("a message").contains("bad.nrrd"), "{report}");
    assert!(report[3].get("error").is_none());
}

#[test]
fn jobs_do_not_change_the_files() {
    let workplace = Workplace::new();
    workplace.succeed("prepare a.nrrd b.nrrd c.nrrd -o one");
    for (folder, options) in [
        ("two", "--jobs 2 --threads 2"),
        ("three", "--jobs 3 --threads 3 --progress bar"),
        ("more", "--jobs 64 --threads 2 --progress lines"),
    ] {
        let table = workplace.succeed(&format!("prepare a.nrrd b.nrrd c.nrrd -o {folder} {options}"));
        let order: Vec<_> = table.lines().skip(1).filter_map(|line| line.split_whitespace().next()).collect();
        assert_eq!(order, ["a.nrrd", "b.nrrd", "c.nrrd", "3"], "{table}");
        assert_eq!(workplace.names(folder), ["a.vxr", "b.vxr", "c.vxr"]);
        for name in ["a.vxr", "b.vxr", "c.vxr"] {
            let read = |folder: &str| fs::read(workplace.path(folder).join(name)).expect("reads");
            assert!(read("one") == read(folder), "{name} of {folder}");
        }
    }
    workplace.succeed("prepare a.nrrd -o single.vxr");
    let single = fs::read(workplace.path("single.vxr")).expect("reads");
    assert!(single == fs::read(workplace.path("one/a.vxr")).expect("reads"));
}

#[test]
fn what_is_there_can_be_left_alone() {
    let workplace = Workplace::new();
    workplace.succeed("prepare a.nrrd -o out/");
    let before = fs::metadata(workplace.path("out/a.vxr")).expect("there").modified().expect("a time");
    let output = workplace.run("prepare a.nrrd b.nrrd -o out --skip-existing --report r.json --progress json");
    assert!(output.status.success(), "{}", errors(&output));
    let events = events(&output);
    assert!(events[0]["event"] == "skipped" && events[0]["output"] == "out/a.vxr", "{}", events[0]);
    let summary = events.last().expect("events");
    assert!(summary["succeeded"] == 1 && summary["skipped"] == 1 && summary["failed"] == 0, "{summary}");
    let table = String::from_utf8_lossy(&output.stdout);
    assert!(table.contains("2 volumes: 1 prepared, 1 there already, 0 failed"), "{table}");
    assert_eq!(fs::metadata(workplace.path("out/a.vxr")).expect("there").modified().expect("a time"), before);
    let report = workplace.json("r.json");
    assert!(report[0]["skipped"] == true && report[1]["counts"]["voxels"] == 27000, "{report}");
    // What a report has of a volume that is left out is kept.
    workplace.succeed("prepare b.nrrd a.nrrd -o out --skip-existing --report r.json");
    let again = workplace.json("r.json");
    assert!(again[0] == report[1] && again[1] == report[0], "{again}");
    // One volume has one entry, skipped or not.
    workplace.succeed("prepare a.nrrd -o out --skip-existing --report one.json");
    assert_eq!(workplace.json("one.json")["skipped"], true);
    // Nothing that is cut off is taken for finished.
    fs::write(workplace.path("out/c.vxr"), "cut").expect("writes");
    let said = errors(&workplace.run("prepare c.nrrd -o out/c.vxr --skip-existing"));
    assert!(said.contains("out/c.vxr"), "{said}");
}

#[test]
fn jobs_share_the_memory() {
    let workplace = Workplace::new();
    let output = workplace.run("prepare a.nrrd b.nrrd c.nrrd -o out --jobs 2 --threads 2 --memory 2MiB");
    let said = errors(&output);
    assert!(said.contains("preparing b.nrrd with 1/2 of the memory: --memory 1.0 MiB"), "{said}");
    assert!(workplace.names("out").is_empty());
}

#[test]
fn one_volume_goes_into_a_folder_that_exists() {
    let workplace = Workplace::new();
    fs::create_dir(workplace.path("out")).expect("makes");
    fs::write(workplace.path("out/a.vxr"), "former").expect("writes");
    let said = workplace.succeed("prepare ./a.nrrd -o out --report r.json");
    assert!(said.contains("24x20x22") && said.contains("a.vxr"), "{said}");
    assert_eq!(workplace.names("out"), ["a.vxr"]);
    workplace.succeed("verify out/a.vxr");
    // As it was typed: names in several folders can be the same.
    assert_eq!(workplace.json("r.json")["input"], "./a.nrrd");
    workplace.succeed("prepare a.nrrd -o new/");
    assert_eq!(workplace.names("new"), ["a.vxr"]);
}

#[test]
fn what_would_do_harm_is_refused_before_any_work() {
    let workplace = Workplace::new();
    fs::create_dir(workplace.path("raw")).expect("makes");
    fs::write(workplace.path("raw/v.vxr"), [0; 27]).expect("writes");
    fs::copy(workplace.path("a.nrrd"), workplace.path("raw/a.nrrd")).expect("copies");
    let before = workplace.names(".");
    for (line, code, reason) in [
        ("a.nrrd raw/a.nrrd -o out", 2, "both be written to out/a.vxr"),
        ("a.nrrd a.nii.gz -o out", 2, "both be written to out/a.vxr"),
        ("a.nrrd a.nrrd -o out", 2, "both be written"),
        ("a.nrrd raw/v.vxr -o raw", 1, "overwritten"),
        ("a.nrrd b.nrrd -o c.nrrd", 1, "a file is in the way"),
        ("a.nrrd b.nrrd -o no/such", 1, "no folder no"),
        ("a.nrrd b.nrrd -o out --report b.nrrd", 1, "overwritten"),
        ("a.nrrd b.nrrd -o out --report out/b.vxr", 2, "two outputs"),
        ("a.nrrd b.nrrd -o out --report no/r.json", 1, "no folder"),
        ("a.nrrd b.nrrd -o out --step 0", 2, "--step"),
        ("a.nrrd .. -o out", 1, "not the name of a file"),
    ] {
        let output = workplace.run(&format!("prepare {line}"));
        assert_eq!(output.status.code(), Some(code), "{line}");
        let said = errors(&output);
        assert!(said.contains(reason) && !said.contains("roles"), "{line}: {said}");
        assert_eq!(workplace.names("."), before, "{line} left something behind");
        let refused = workplace.run(&format!("prepare {line} --progress json"));
        assert_eq!(refused.status.code(), Some(code), "{line}");
        let refused = events(&refused);
        assert!(refused.len() == 1 && refused[0]["event"] == "error" && refused[0].get("input").is_none(), "{line}");
    }
    assert_eq!(workplace.names("raw"), ["a.nrrd", "v.vxr"]);
    for line in ["prepare a.nrrd -o o.vxr --jobs 0", "prepare a.nrrd -o o.vxr --progress loud", "prepare -o out"] {
        assert_eq!(workplace.run(line).status.code(), Some(2), "{line}");
    }
}

#[test]
fn json_lines_tell_every_stage() {
    let workplace = Workplace::new();
    let output = workplace.run("prepare a.nrrd bad.nrrd c.nrrd -o out --jobs 2 --threads 2 --progress json");
    assert_eq!(output.status.code(), Some(1));
    let events = events(&output);
    let of = |input: &str| events.iter().filter(|event| event["input"] == input).collect::<Vec<_>>();
    for (input, packed) in [("a.nrrd", "out/a.vxr"), ("c.nrrd", "out/c.vxr")] {
        let mut stage = (&Value::Null, 0, 0);
        let mut stages = Vec::new();
        let (last, others) = of(input).split_last().map(|(last, others)| (*last, others.to_vec())).expect("events");
        for event in others {
            let steps = event["steps"].as_u64().expect("a number");
            if event["event"] == "begin" {
                assert_eq!(stage.1, stage.2, "the stage before has told its last step");
                stage = (&event["stage"], 0, steps);
                stages.push(event["stage"].as_str().expect("text"));
            } else {
                let done = event["done"].as_u64().expect("a number");
                assert!(event["event"] == "step" && &event["stage"] == stage.0 && steps == stage.2, "{event}");
                assert!(done > stage.1 && done <= steps, "{event}");
                stage.1 = done;
            }
        }
        assert_eq!(stages, ["reading", "looking at the volume", "roles", "packing"]);
        assert!(last["event"] == "done" && last["output"] == packed && last["seconds"].is_f64(), "{last}");
        assert_eq!(last["bytes"], fs::metadata(workplace.path(packed)).expect("there").len());
    }
    let bad = of("bad.nrrd");
    assert!(bad.len() == 1 && bad[0]["event"] == "error" && bad[0]["message"].is_string(), "{bad:?}");
    let summary = events.last().expect("events");
    assert!(summary["event"] == "summary" && summary["succeeded"] == 2 && summary["failed"] == 1, "{summary}");
}

#[test]
fn a_single_volume_tells_json_lines_too() {
    let workplace = Workplace::new();
    let output = workplace.run("prepare a.nrrd -o a.vxr --progress json");
    assert!(output.status.success());
    assert_eq!(events(&output).last().expect("events")["event"], "done");
    workplace.succeed("phantom ball --dims 48,48,48 --blur 0.3 -o sharp.nrrd");
    let warned = events(&workplace.run("prepare sharp.nrrd -o sharp.vxr --method accurate --progress json"));
    assert!(warned.iter().any(|event| event["event"] == "warning" && event["input"] == "sharp.nrrd"), "{warned:?}");
    let output = workplace.run("prepare bad.nrrd -o bad.vxr --progress json");
    assert_eq!(output.status.code(), Some(1));
    let failed = events(&output);
    assert!(failed.len() == 1 && failed[0]["event"] == "error" && failed[0]["input"] == "bad.nrrd", "{failed:?}");
    let output = workplace.run("prepare bad.nrrd -o bad.vxr");
    assert!(output.status.code() == Some(1) && errors(&output).starts_with("voxrole: bad.nrrd: "));
}

/// As schedulers set one.
#[cfg(unix)]
#[test]
fn a_limit_of_file_sizes_is_an_error() {
    let workplace = Workplace::new();
    let line = format!("ulimit -f 8; exec {} prepare a.nrrd -o a.vxr", env!("CARGO_BIN_EXE_voxrole"));
    let output = Command::new("sh").args(["-c", &line]).current_dir(workplace.path(".")).output().expect("runs");
    let said = errors(&output);
    assert!(output.status.code() == Some(1) && said.contains("a.vxr: File too large"), "{said}");
    let names = workplace.names(".");
    assert!(names.iter().all(|name| !name.contains(".vxr")), "{names:?}");
}
