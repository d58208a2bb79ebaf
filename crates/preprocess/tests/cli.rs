//! The `voxrole` program as a user meets it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;
use voxrole_pack::{ScalarType, Scalars};

struct Workplace {
    folder: TempDir,
}

impl Workplace {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a folder") }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, line: &str) -> Output {
        Command::new(env!("CARGO_BIN_EXE_voxrole"))
            .args(line.split_whitespace())
            .current_dir(self.folder.path())
            .output()
            .expect("the program starts")
    }

    fn succeed(&self, line: &str) -> String {
        let output = self.run(line);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{line}: {errors}");
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// Runs a command that must fail cleanly: exit code 1, no panic, nothing written. Returns its message.
    fn fail(&self, line: &str) -> String {
        self.fail_with(1, line)
    }

    /// As [`Self::fail`], with the exit code of a command line that asks for what cannot be.
    fn refuse(&self, line: &str) -> String {
        self.fail_with(2, line)
    }

    fn fail_with(&self, code: i32, line: &str) -> String {
        let before = self.names();
        let output = self.run(line);
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{line}: {errors}");
        assert!(!errors.contains("panicked"), "{line}: {errors}");
        assert_eq!(self.names(), before, "{line} left a file behind");
        errors
    }

    fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(self.folder.path()).expect("lists");
        let mut names: Vec<_> =
            entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        fs::write(self.path(name), bytes).expect("writes");
    }

    fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).expect("reads")
    }

    fn prepared_ball(dims: &str) -> Self {
        let workplace = Self::new();
        workplace.succeed(&format!("phantom ball --dims {dims} --dtype u16 -o ball.nrrd --truth truth.nrrd"));
        workplace.succeed("prepare ball.nrrd -o ball.vxr --keep derivatives --report report.json");
        workplace
    }
}

/// The numbers of an NRRD file as this program writes it, of whatever type.
fn floats(path: &Path) -> Vec<f32> {
    let bytes = fs::read(path).expect("reads");
    let start = bytes.windows(2).position(|window| window == b"\n\n").expect("a header") + 2;
    let header = String::from_utf8_lossy(&bytes[..start]);
    let name = header.lines().find_map(|line| line.strip_prefix("type: ")).expect("a type");
    let scalar_type = match name {
        "int8" => ScalarType::I8,
        "uint16" => ScalarType::U16,
        _ => ScalarType::F32,
    };
    let scalars = Scalars::from_le_bytes(scalar_type, &bytes[start..]);
    (0..scalars.len()).map(|index| scalars.get(index) as f32).collect()
}

#[test]
fn the_main_job() {
    let workplace = Workplace::prepared_ball("24,20,22");
    let info = workplace.succeed("info ball.vxr");
    assert!(info.contains("24 x 20 x 22") && info.contains("second-derivative"), "{info}");
    let json: serde_json::Value = serde_json::from_str(&workplace.succeed("info ball.vxr --json")).expect("is JSON");
    assert_eq!(json["source"]["name"], "ball.nrrd");
    assert!(workplace.succeed("verify ball.vxr").contains("sound"));
    for kind in ["v-g", "v-f2", "v-hit", "hit-hit", "distance"] {
        workplace.succeed(&format!("histogram ball.vxr --kind {kind} -o {kind}.png"));
        workplace.succeed(&format!("histogram ball.vxr --kind {kind} -o {kind}.npy"));
        let table = workplace.succeed(&format!("histogram ball.vxr --kind {kind} -o {kind}.csv"));
        assert!(table.is_empty());
        assert!(workplace.read(&format!("{kind}.png")).starts_with(b"\x89PNG"));
        assert!(workplace.read(&format!("{kind}.csv")).len() > 50);
    }
    for field in ["value", "distance", "hit-gradient", "normal", "role", "gradient-magnitude", "second-derivative"] {
        workplace.succeed(&format!("slice ball.vxr --field {field} --axis y --index 10 -o {field}.png"));
        assert!(workplace.read(&format!("{field}.png")).starts_with(b"\x89PNG"));
    }
    let report: serde_json::Value = serde_json::from_slice(&workplace.read("report.json")).expect("is JSON");
    let count = |name: &str| report["counts"][name].as_u64().expect("a count");
    assert_eq!(count("voxels"), 24 * 20 * 22);
    assert_eq!(count("hits") + count("misses") + count("masked"), count("voxels"));
    assert_eq!(count("flat") + count("skipped") + count("traced") + count("masked"), count("voxels"));
    assert!(report["stages"].as_array().expect("stages").len() > 5);
}

#[test]
fn exports_are_in_physical_units() {
    let workplace = Workplace::prepared_ball("34,36,35");
    let export = |field: &str| {
        workplace.succeed(&format!("export ball.vxr --field {field} -o {field}.nrrd"));
        floats(&workplace.path(&format!("{field}.nrrd")))
    };
    let voxels = 34 * 36 * 35;
    let (distance, hit, role) = (export("distance"), export("hit-gradient"), export("role"));
    let (value, g, f2) = (export("value"), export("gradient-magnitude"), export("second-derivative"));
    let normal = export("normal");
    assert!([&distance, &hit, &role, &value, &g, &f2].iter().all(|field| field.len() == voxels));
    assert_eq!(normal.len(), 3 * voxels);
    let truth = floats(&workplace.path("truth.nrrd"));
    for voxel in 0..voxels {
        assert_eq!(distance[voxel].is_nan(), hit[voxel].is_nan());
        assert_eq!(distance[voxel].is_nan(), role[voxel] == 0.0);
        assert_eq!(distance[voxel].is_nan(), normal[3 * voxel].is_nan());
        if role[voxel] == 1.0 {
            let (found, exact) = (distance[voxel], truth[voxel]);
            assert!(found.abs() <= 0.5 && (found - exact).abs() < 0.2, "voxel {voxel}: {found}, exactly {exact}");
        } else if role[voxel] != 0.0 {
            assert_eq!(distance[voxel] > 0.0, role[voxel] == 2.0);
        }
    }
    assert!(value.iter().all(|value| (1000.0..=30000.0).contains(value)));
    assert!(g.iter().all(|&g| g >= 0.0) && f2.iter().any(|&f2| f2 < 0.0) && f2.iter().any(|&f2| f2 > 0.0));
    assert!(role.contains(&2.0) && role.contains(&3.0));
}

#[test]
fn bytes_do_not_depend_on_threads_or_skipping() {
    let workplace = Workplace::new();
    workplace.succeed("phantom three-balls --dims 40,40,40 --noise 0.01 --seed 3 -o in.nrrd");
    for method in [
        "fast",
        "paper",
        "fast --smooth gaussian-value",
        "fast --smooth bilateral-value",
        "auto",
        "accurate --edge plus",
        "fast --derivative central4 --reconstruction cubic --root chandrupatla",
        "accurate --derivative bspline3 --reconstruction quintic",
        "accurate --derivative gaussian:1.2",
        "fast --root cubic",
    ] {
        let bytes = ["--threads 1", "--threads 2", "--threads 7", "--no-skip"].map(|option| {
            workplace.succeed(&format!("prepare in.nrrd -o out.vxr --method {method} {option}"));
            workplace.read("out.vxr")
        });
        assert!(bytes.iter().all(|other| *other == bytes[0]), "{method}");
    }
}

#[test]
fn skipping_saves_work_and_says_so() {
    let workplace = Workplace::new();
    workplace.succeed("phantom ball --dims 48,48,48 -o in.nrrd");
    let samples = ["", "--no-skip"].map(|option| {
        workplace.succeed(&format!("prepare in.nrrd -o out.vxr --noise-floor 0 --report r.json {option}"));
        let report: serde_json::Value = serde_json::from_slice(&workplace.read("r.json")).expect("is JSON");
        ["samples", "traced"].map(|count| report["counts"][count].as_u64().expect("a count"))
    });
    assert!(samples[0][0] < samples[1][0] && samples[0][1] <= samples[1][1], "{samples:?}");
}

#[test]
fn what_is_chosen_and_what_is_unwise_is_said() {
    let workplace = Workplace::new();
    workplace.succeed("phantom ball --dims 48,48,48 --noise 0.02 -o noisy.nrrd");
    let said = workplace.succeed("prepare noisy.nrrd -o noisy.vxr --report r.json");
    let report: serde_json::Value = serde_json::from_slice(&workplace.read("r.json")).expect("is JSON");
    let choice = &report["choice"];
    let [noise, blur, sigma] =
        ["noise_share", "blur", "sigma"].map(|figure| choice[figure].as_f64().expect("a number"));
    assert!((noise / 0.02 - 1.0).abs() < 0.15 && (blur / 1.5 - 1.0).abs() < 0.15 && sigma > 0.5, "{choice}");
    assert!(said.contains(choice["reason"].as_str().expect("a reason")), "{said}");
    assert!(workplace.succeed("info noisy.vxr").contains("bspline5"));

    workplace.succeed("phantom ball --dims 48,48,48 --blur 0.3 -o sharp.nrrd");
    let warned = |options: &str| {
        let output = workplace.run(&format!("prepare sharp.nrrd -o sharp.vxr {options}"));
        assert!(output.status.success());
        String::from_utf8_lossy(&output.stderr).contains("under-sampled")
    };
    assert!(warned("--method accurate") && warned("--method fast --derivative bspline3"));
    assert!(!warned("") && !warned("--method fast"));
    let said = workplace.succeed("prepare sharp.nrrd -o sharp.vxr");
    assert!(said.contains("central2"), "{said}");
    // What is exact on a spline keeps it, whatever the edges are.
    assert!(warned("--reconstruction exact"));
    assert!(workplace.succeed("info sharp.vxr").contains("bspline5"));

    // Blurred by 1.5 voxels along x and y, but by half a voxel along z.
    workplace.succeed("phantom ball --dims 64,64,24 --spacing 1,1,3 -o thick.nrrd");
    let said = workplace.succeed("prepare thick.nrrd -o thick.vxr");
    assert!(said.contains("central2") && said.contains(" 0 are masked"), "{said}");
    let said = workplace.succeed("prepare noisy.nrrd -o given.vxr --smooth none --derivative central4");
    assert!(said.contains("the kernel was given") && said.contains("smoothing was given"), "{said}");

    // A ramp has no edge: noise is blamed only where a floor is there for it.
    let ramp: Vec<u8> = (0..24 * 24 * 24).map(|voxel| (voxel % 24) as u8 * 10).collect();
    fs::write(workplace.path("ramp.raw"), ramp).expect("writes");
    let blamed = |floor: &str| {
        let line = "prepare ramp.raw --dims 24,24,24 --dtype u8 -o ramp.vxr --method fast --noise-floor";
        let output = workplace.run(&format!("{line} {floor}"));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(said.contains("no voxel has a boundary"), "{said}");
        said.contains("give --noise-floor 0")
    };
    assert!(blamed("4") && !blamed("0"));
}

#[test]
fn rays_are_as_long_as_is_asked_for_whatever_the_step() {
    let workplace = Workplace::new();
    workplace.succeed("phantom ball --dims 24,24,24 -o ball.nrrd");
    let hits = |options: &str| {
        workplace.succeed(&format!("prepare ball.nrrd -o ball.vxr --method fast --report r.json {options}"));
        let report: serde_json::Value = serde_json::from_slice(&workplace.read("r.json")).expect("is JSON");
        report["counts"]["hits"].as_f64().expect("a number")
    };
    let [long, short] = ["--dmax 1.9 --step 1", "--dmax 1.9 --step 0.1"].map(hits);
    assert!((long / short - 1.0).abs() < 0.03, "{long} and {short}");
}

#[test]
fn usage_errors_exit_with_2() {
    let workplace = Workplace::new();
    for line in [
        "",
        "prepare",
        "prepare a.nrrd",
        "prepare a -o b --method best",
        "prepare a -o b --derivative central3",
        "prepare a -o b --reconstruction smooth",
        "prepare Cargo.toml -o -",
        "phantom ball --dims 4,4,4 -o -",
        "slice a --field value --axis q",
        "walk",
    ] {
        assert_eq!(workplace.run(line).status.code(), Some(2), "{line}");
    }
    for line in ["--help", "--version", "prepare --help", "phantom --list"] {
        assert_eq!(workplace.run(line).status.code(), Some(0), "{line}");
    }
}

fn nrrd(dims: &str, extra: &str, data: &[u8]) -> Vec<u8> {
    let header = format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: {dims}\nencoding: raw\n{extra}\n");
    [header.as_bytes(), data].concat()
}

#[test]
fn bad_volumes_end_in_a_clear_error() {
    let workplace = Workplace::new();
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("empty.nrrd", vec![]),
        ("text.nrrd", b"hello".to_vec()),
        ("short.nrrd", nrrd("4 4 4", "", &[0; 63])),
        ("long.nrrd", nrrd("4 4 4", "", &[0; 65])),
        ("huge.nrrd", nrrd("2147483648 2147483648 2147483648", "", &[0; 64])),
        ("large.nrrd", nrrd("2000 2000 2000", "", &[0; 64])),
        ("zero.nrrd", nrrd("4 0 4", "", &[0; 64])),
        ("negative.nrrd", nrrd("4 -4 4", "", &[0; 64])),
        ("spacing.nrrd", nrrd("4 4 4", "spacings: 1 -1 1\n", &[0; 64])),
        ("nan.nrrd", nrrd("4 4 4", "spacings: 1 0 nan\n", &[0; 64])),
        ("flat.nrrd", nrrd("4 4", "", &[0; 16])),
        ("sheared.nrrd", nrrd("4 4 4", "space dimension: 3\nspace directions: (1,0,0) (1,1,0) (0,0,1)\n", &[0; 64])),
        ("missing.nhdr", nrrd("4 4 4", "data file: nowhere.raw\n", &[])),
        ("type.nrrd", b"NRRD0004\ntype: block\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n\n".to_vec()),
        ("bzip.nrrd", b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: bzip2\n\n".to_vec()),
        ("broken.nii.gz", [&[0x1f, 0x8b, 8, 0][..], &[7; 400]].concat()),
        ("short.nii", 348_u32.to_le_bytes().to_vec()),
        ("none.mhd", b"ObjectType = Image\nNDims = 3\nDimSize = 4 4 4\nElementType = MET_UCHAR\n".to_vec()),
        (
            "lost.mhd",
            b"ObjectType = Image\nNDims = 3\nDimSize = 4 4 4\nElementType = MET_UCHAR\nElementDataFile = x.raw\n"
                .to_vec(),
        ),
        ("nan_only.nrrd", nrrd("1 1 1", "", &[]).into_iter().collect()),
    ];
    for (name, bytes) in &cases {
        workplace.write(name, bytes);
        let message = workplace.fail(&format!("prepare {name} -o out.vxr"));
        assert!(message.contains(name) && message.len() > name.len() + 20, "{name}: {message}");
    }
    workplace.write("plain.raw", &[0; 100]);
    for layout in
        ["", "--dims 5,5,5 --dtype u8", "--dims 5,5,4 --dtype u16be", "--dims 5,5,4 --dtype u8 --skip-bytes 1"]
    {
        let message = workplace.fail(&format!("prepare plain.raw -o out.vxr {layout}"));
        assert!(message.contains("plain.raw"), "{layout}: {message}");
    }
    assert!(workplace.fail("prepare nowhere.nrrd -o out.vxr").contains("nowhere.nrrd"));
    assert!(workplace.fail("prepare plain.raw --dims 5,5,4 --dtype u8 -o no/such/out.vxr").contains("no/such"));
    assert!(cases.len() + 6 >= 20);
}

#[test]
fn damaged_packed_files_end_in_a_clear_error() {
    let workplace = Workplace::prepared_ball("16,16,16");
    let whole = workplace.read("ball.vxr");
    let flipped = |place: usize| {
        let mut bytes = whole.clone();
        bytes[place] ^= 4;
        bytes
    };
    for (what, bytes) in [
        ("empty", vec![]),
        ("a few bytes", whole[..40].to_vec()),
        ("half", whole[..whole.len() / 2].to_vec()),
        ("one byte less", whole[..whole.len() - 1].to_vec()),
        ("one byte more", [whole.as_slice(), &[0]].concat()),
        ("magic", flipped(1)),
        ("version", flipped(8)),
        ("length", flipped(17)),
        ("directory", flipped(whole.len() - 9)),
        ("text", b"not a packed file at all, just some text that is long enough to be one, as it were".to_vec()),
    ] {
        workplace.write("bad.vxr", &bytes);
        for line in [
            "info bad.vxr",
            "verify bad.vxr",
            "export bad.vxr --field distance -o out.nrrd",
            "histogram bad.vxr --kind distance -o out.png",
            "slice bad.vxr --field value --axis z --index 3 -o out.png",
        ] {
            let message = workplace.fail(line);
            assert!(message.contains("bad.vxr"), "{what}: {line}: {message}");
        }
    }
    workplace.write("bad.vxr", &flipped(100));
    assert!(workplace.fail("verify bad.vxr").contains("checksum"));
}

#[test]
fn wrong_requests_are_explained() {
    let workplace = Workplace::prepared_ball("16,16,16");
    workplace.succeed("prepare ball.nrrd -o lean.vxr");
    for (line, reason) in [
        ("export lean.vxr --field second-derivative -o out.nrrd", "--keep derivatives"),
        ("slice ball.vxr --field value --axis z --index 16 -o out.png", "16"),
        ("prepare ball.nrrd -o ball.nrrd", "overwritten"),
        ("prepare ball.nrrd -o out.vxr --report no/such.json", "no folder"),
        ("phantom marschner-lobb --dims 8,8,8 -o out.nrrd --truth truth2.nrrd", "never sharp"),
        ("phantom ball --dims 8,8,8 -o out.nrrd --crossing no/such.nrrd", "no folder"),
    ] {
        let message = workplace.fail(line);
        assert!(message.contains(reason), "{line}: {message}");
    }
    for (line, reason) in [
        ("histogram ball.vxr --kind v-g -o out.txt", ".png"),
        ("prepare ball.nrrd -o out.vxr --step 0", "--step"),
        ("prepare ball.nrrd -o out.vxr --dmax 0.1", "--dmax"),
        ("prepare ball.nrrd -o out.vxr --smooth gaussian-value --spatial-sigma 0", "--spatial-sigma"),
        ("export ball.vxr --field value -o ball.vxr", "ball.vxr"),
        ("slice ball.vxr --field value --axis z --index 3 -o out.jpg", "png"),
        ("histogram ball.vxr --kind v-g -o .", "."),
        ("prepare ball.nrrd -o out.vxr --report out.vxr", "two outputs"),
        ("prepare ball.nrrd -o out.vxr --report ./out.vxr", "two outputs"),
        ("prepare ball.nrrd -o out.vxr --smooth gaussian-value --spatial-sigma 1e-39", "--spatial-sigma"),
        ("prepare ball.nrrd -o out.vxr --smooth bilateral-value --range-sigma 1e-39", "--range-sigma"),
        ("prepare ball.nrrd -o out.vxr --derivative gaussian:1e-39", "gaussian"),
        ("prepare ball.nrrd -o out.vxr --radius 3", "--smooth"),
        ("prepare ball.nrrd -o out.vxr --smooth gaussian-value --range-sigma 0.1", "--range-sigma"),
        ("prepare ball.nrrd -o out.vxr --smooth gaussian-value --bilateral exact", "--bilateral"),
        ("prepare ball.nrrd -o out.vxr --derivative central4 --reconstruction exact", "bspline5"),
        ("prepare ball.nrrd -o out.vxr --method accurate --smooth bilateral-derivatives", "--reconstruction"),
        ("prepare ball.nrrd -o out.vxr --derivative gaussian:0", "gaussian"),
        ("phantom ball --dims 0,4,4 -o out.nrrd", "dimensions"),
        ("phantom ball --dims 4,4,4 --blur 0 -o out.nrrd", "blur"),
        ("phantom slab-pair --dims 64,64,64 --thickness 0 -o out.nrrd", "thickness"),
        ("phantom slab-pair --dims 64,64,64 --thickness 40 -o out.nrrd", "40 voxels thick"),
        ("phantom ball --dims 8,8,8 --thickness 4 -o out.nrrd", "slab-pair"),
        ("phantom ball --dims 8,8,8 --rotation 0,nan,0 -o out.nrrd", "rotation"),
        ("phantom ball --dims 8,8,8 --offset 0,inf,0 -o out.nrrd", "offset"),
        ("phantom ball --dims 8,8,8 --value-scale 0 -o out.nrrd", "value scale"),
        ("phantom ball --dims 8,8,8 --value-scale 1e38 -o out.nrrd", "f32"),
        ("phantom ball --dims 8,8,8 --value-offset 3 --dtype u12 -o out.nrrd", "range of stored numbers"),
        ("phantom marschner-lobb --dims 8,8,8 --blur 2 -o out.nrrd", "blur"),
        ("phantom ball --dims 8,8,8 -o out.nrrd --truth out.nrrd", "two outputs"),
        ("phantom ball --dims 8,8,8 -o out.nrrd --truth ./out.nrrd", "two outputs"),
    ] {
        let message = workplace.refuse(line);
        assert!(message.contains(reason), "{line}: {message}");
    }
}

#[test]
fn phantoms_of_every_kind() {
    let workplace = Workplace::new();
    let list = workplace.succeed("phantom --list");
    let names: Vec<_> = list.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert!(names.len() == 10 && names.contains(&"marschner-lobb") && names.contains(&"slab-pair"), "{list}");
    for name in names {
        let small = "--dims 32,32,32 --rotation 10,-20,30 --offset -0.5,0,0.25 --noise 0.02 --noise-kind rician";
        let thickness = if name == "slab-pair" { "--thickness 2" } else { "" };
        workplace.succeed(&format!("phantom {name} {small} {thickness} --dtype u12 -o v.nrrd --crossing c.nrrd"));
        workplace.succeed("prepare v.nrrd -o v.vxr");
        let crossings = floats(&workplace.path("c.nrrd"));
        assert!(crossings.len() == 32 * 32 * 32 && crossings.iter().any(|distance| distance.is_finite()), "{name}");
    }
    // A blurred ball of radius 10: the crossing lies s²/R = 0.225 inside the surface.
    workplace.succeed("phantom blurred-ball --dims 32,32,32 -o v.nrrd --truth t.nrrd --crossing c.nrrd");
    let (truth, crossing) = (floats(&workplace.path("t.nrrd")), floats(&workplace.path("c.nrrd")));
    let shifts =
        crossing.iter().zip(&truth).map(|(crossing, truth)| crossing - truth).filter(|shift| shift.is_finite());
    assert!(shifts.map(|shift| (shift + 0.225).abs()).fold(0.0, f32::max) < 0.01);
    assert_eq!(workplace.run("phantom ball --dims 8,8,8 --dtype u13 -o o.nrrd").status.code(), Some(2));
}

#[test]
fn the_accuracy_bench_writes_a_table_and_plots() {
    let workplace = Workplace::new();
    let tables = workplace.succeed("bench accuracy --quick --repeats 1 -o results");
    assert!(tables.contains("ball, 32³, blur 1.5, noise 1 %, f32"), "{tables}");
    assert!(tables.lines().any(|line| line.starts_with("* ")), "members of the front are marked");
    let table = String::from_utf8(workplace.read("results/accuracy.csv")).expect("text");
    assert_eq!(table.lines().count(), 1 + 3 * 26);
    assert!(table.lines().any(|line| line.starts_with("slab-pair,32,1.5,3,0,f32,auto,")), "{table}");
    for name in ["pareto", "pareto-noise", "noise-rms", "noise-wrong"] {
        assert!(workplace.read(&format!("results/{name}.png")).starts_with(b"\x89PNG"));
        assert!(workplace.read(&format!("results/{name}.svg")).starts_with(b"<svg"));
    }
    workplace.write("taken", b"a file");
    assert!(workplace.fail("bench accuracy --quick -o taken").contains("in the way"));
    assert!(workplace.fail("bench accuracy --quick -o no/such").contains("no folder no"));
    assert_eq!(workplace.run("bench accuracy --quick --full -o other").status.code(), Some(2));
}

#[test]
fn the_smoothing_study_says_what_is_wrong_before_it_measures() {
    let workplace = Workplace::new();
    assert!(workplace.fail("bench smoothing --quick -o out --canny none.csv").contains("none.csv"));
    workplace.write("canny.csv", b"phantom,sigma\nball,1\n");
    let message = workplace.fail("bench smoothing --quick -o out --canny canny.csv");
    assert!(message.contains("canny.csv") && message.contains("line 2"), "{message}");
    assert!(!workplace.path("out").exists());
}

#[test]
fn all_bad_voxels_are_refused_and_some_are_masked() {
    let workplace = Workplace::new();
    let raw = |numbers: &[f32]| numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>();
    workplace.write("nan.raw", &raw(&[f32::NAN; 27]));
    let message = workplace.fail("prepare nan.raw --dims 3,3,3 --dtype f32 -o out.vxr");
    assert!(message.contains("nan.raw") && message.contains("NaN"), "{message}");
    let mut numbers: Vec<f32> = (0..512).map(|voxel| if voxel % 8 < 4 { 0.0 } else { 1.0 }).collect();
    numbers[0] = f32::INFINITY;
    workplace.write("some.raw", &raw(&numbers));
    assert!(workplace.succeed("prepare some.raw --dims 8,8,8 --dtype f32 -o some.vxr").contains("masked"));
    assert!(workplace.succeed("info some.vxr").contains("7 masked"), "{}", workplace.succeed("info some.vxr"));
}

#[test]
fn the_sample_volumes_are_what_their_commands_make() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data");
    let readme = fs::read_to_string(data.join("README.md")).expect("reads");
    let commands: Vec<_> = readme.split('`').filter_map(|code| code.strip_prefix("voxrole phantom ")).collect();
    assert_eq!(commands.len(), 2);
    let workplace = Workplace::new();
    for command in commands {
        workplace.succeed(&format!("phantom {command}"));
        let name = command.split_whitespace().last().expect("a file");
        assert!(workplace.read(name) == fs::read(data.join(name)).expect("reads"), "{name} differs");
    }
}

#[test]
fn nothing_of_another_kind_is_replaced() {
    let workplace = Workplace::new();
    workplace.succeed("phantom ball --dims 12,12,12 -o a.nrrd");
    workplace.succeed("phantom box --dims 12,12,12 -o b.nrrd");
    let before = workplace.read("b.nrrd");
    for line in ["prepare a.nrrd -o b.nrrd", "prepare a.nrrd -o a.vxr --report b.nrrd"] {
        let message = workplace.fail(line);
        assert!(message.contains("b.nrrd: expected a") && message.contains("remove that file first"), "{message}");
    }
    assert_eq!(workplace.read("b.nrrd"), before);
    let message = workplace.refuse("prepare a.nrrd b.nrrd -o both.vxr");
    assert!(message.contains("expected a folder for the packed files of 2 volumes"), "{message}");
    // Its own kind is.
    workplace.succeed("prepare a.nrrd -o a.vxr --report a.json");
    workplace.succeed("prepare b.nrrd -o a.vxr --report a.json");
    assert!(workplace.succeed("info a.vxr").contains("b.nrrd"));
}

#[test]
fn a_volume_without_boundaries_is_warned_of() {
    let workplace = Workplace::new();
    let mask: Vec<u8> = (0..16 * 16 * 16).map(|voxel| u8::from(voxel % 16 >= 8)).collect();
    workplace.write("mask.raw", &mask);
    let prepare = "prepare mask.raw --dims 16,16,16 --dtype u8 -o mask.vxr --method fast";
    let found = workplace.run(prepare);
    let message = String::from_utf8_lossy(&found.stderr).into_owned();
    assert!(found.status.success() && message.contains("warning: no voxel has a boundary"), "{message}");
    assert!(message.contains("--noise-floor 0"), "{message}");
    assert!(!workplace.succeed(&format!("{prepare} --noise-floor 0")).contains(" 0 voxels have a boundary"));
}

#[test]
fn noise_that_is_stronger_in_a_part_is_warned_of() {
    let workplace = Workplace::new();
    let number = |voxel: usize| (voxel as u32 ^ 0x9e37).wrapping_mul(2_654_435_761) >> 16;
    // A third as strong in three quarters of the volume, where the median is taken.
    let noisy = |strong: u32| {
        let value = |voxel: usize| (100 + number(voxel) % if voxel % 48 < 36 { 8 } else { strong }) as u8;
        (0..48 * 48 * 48).map(value).collect::<Vec<u8>>()
    };
    let prepare = "prepare noise.raw --dims 48,48,48 --dtype u8 -o noise.vxr --method fast --report noise.json";
    for (strong, is_warned) in [(8, false), (24, true)] {
        workplace.write("noise.raw", &noisy(strong));
        let message = String::from_utf8_lossy(&workplace.run(prepare).stderr).into_owned();
        assert_eq!(message.contains("--noise-floor 8 (now 4)"), is_warned, "{strong}: {message}");
    }
    // As it says.
    let found = workplace.run(&format!("{prepare} --noise-floor 64"));
    assert!(found.status.success() && !String::from_utf8_lossy(&found.stderr).contains("twice the noise floor"));
}

#[test]
fn a_step_that_takes_for_ever_is_refused() {
    let workplace = Workplace::new();
    workplace.succeed("phantom ball --dims 12,12,12 -o a.nrrd");
    assert!(workplace.refuse("prepare a.nrrd -o a.vxr --step 1e-9").contains("--step"));
}

/// A full disk under the log, or nobody who reads it, must not cost a night's work.
#[cfg(target_os = "linux")]
#[test]
fn what_cannot_be_said_costs_nothing() {
    let workplace = Workplace::new();
    workplace.succeed("phantom ball --dims 12,12,12 -o a.nrrd");
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").expect("opens");
    let prepare = |out: bool, name: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_voxrole"));
        command.current_dir(workplace.folder.path()).args(["prepare", "a.nrrd", "--report", "a.json", "-o", name]);
        let command = if out { command.stdout(full()) } else { command.stderr(full()) };
        command.output().expect("the program starts")
    };
    assert!(prepare(false, "one.vxr").status.success());
    workplace.succeed("verify one.vxr");
    fs::remove_file(workplace.path("a.json")).expect("was written");
    let output = prepare(true, "two.vxr");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("writing to standard output") && !message.contains("panicked"), "{message}");
    workplace.succeed("verify two.vxr");
    assert!(workplace.read("a.json").starts_with(b"{"));
}
