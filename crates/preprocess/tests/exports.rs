//! Exports: read back by this program's own readers, and compared byte by byte where it has none.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;
use voxrole_pack::{GridGeometry, Reader, ScalarType, Scalars, WorldFrame};
use voxrole_preprocess::export::{Export, ExportFormat};
use voxrole_preprocess::fields::{Field, read_field};
use voxrole_preprocess::io::{ReadOptions, read_volume};
use voxrole_preprocess::progress::Silent;
use voxrole_preprocess::settings::{Method, Settings};
use voxrole_preprocess::{Grid, prepare};

const DIMS: [u32; 3] = [9, 7, 5];

/// An oblique, mirrored grid in patient coordinates.
fn oblique() -> GridGeometry {
    let (sine, cosine) = (0.6, 0.8);
    GridGeometry {
        origin: [-12.5, 30.25, 7.0],
        direction: [[cosine, sine, 0.0], [0.0, 0.0, 1.0], [-sine, cosine, 0.0]],
        unit: "mm".into(),
        frame: WorldFrame::LeftPosteriorSuperior,
        ..GridGeometry::axis_aligned(DIMS, [0.5, 1.25, 2.0])
    }
}

struct Workplace(TempDir);

impl Workplace {
    /// With step.vxr, a step along x.
    fn new(geometry: GridGeometry, slope: f64, intercept: f64) -> Self {
        let workplace = Self(tempfile::tempdir().expect("a folder"));
        let length = geometry.dims[0] as usize;
        let value = |voxel: usize| if voxel % length < length / 2 { 100 } else { 3000 + (voxel / length % 50) as i16 };
        let values = (0..geometry.voxel_count()).map(value).collect();
        let grid = Grid::with_mapping("step", geometry, Scalars::I16(values), slope, intercept).expect("a grid");
        prepare(&grid, &Settings::new(Method::Fast), &workplace.path("step.vxr"), &Silent).expect("prepares");
        workplace
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn reader(&self) -> Reader {
        Reader::open(&self.path("step.vxr")).expect("opens")
    }

    /// Writes a field; returns what was lost.
    fn export(&self, field: Field, level: usize, format: ExportFormat, name: &str) -> Vec<String> {
        let export = Export { field, level, format, compress: false };
        export.write(&self.reader(), &self.path(name)).expect(name)
    }

    fn run(&self, line: &str) -> Output {
        let mut program = Command::new(env!("CARGO_BIN_EXE_voxrole"));
        program.args(line.split_whitespace()).current_dir(self.0.path()).output().expect("the program starts")
    }

    fn succeed(&self, line: &str) -> String {
        let output = self.run(line);
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{line}: {errors}");
        errors
    }

    fn fail(&self, line: &str, code: i32, reason: &str) {
        let output = self.run(line);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(code) && errors.contains(reason), "{line}: {errors}");
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("lists");
    let mut names: Vec<_> =
        entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn read(path: &Path) -> Grid {
    read_volume(path, &ReadOptions::default()).expect("own file")
}

fn assert_near(found: &GridGeometry, expected: &GridGeometry) {
    let numbers = |geometry: &GridGeometry| {
        let directions = geometry.direction.as_flattened().iter();
        geometry.spacing.iter().chain(&geometry.origin).chain(directions).copied().collect::<Vec<_>>()
    };
    for (found, expected) in numbers(found).into_iter().zip(numbers(expected)) {
        assert!((found - expected).abs() < 1e-6 * expected.abs().max(1.0), "{found} instead of {expected}");
    }
    assert_eq!((found.dims, &found.unit, found.frame), (expected.dims, &expected.unit, expected.frame));
}

#[test]
fn nrrd_and_nifti_keep_numbers_and_placement() {
    let workplace = Workplace::new(oblique(), 1.0, 0.0);
    let (stored, ..) = workplace.reader().read_value().expect("reads");
    for name in ["value.nrrd", "value.nii", "value.nii.gz"] {
        let format = ExportFormat::from_path(Path::new(name)).expect("a format");
        assert!(workplace.export(Field::Value, 0, format, name).is_empty());
        let grid = read(&workplace.path(name));
        assert_eq!((&grid.scalars, grid.slope, grid.intercept), (&stored, 1.0, 0.0), "{name}");
        assert_near(&grid.geometry, &oblique());
    }
    for field in [Field::Distance, Field::HitGradient, Field::Role] {
        let expected = read_field(&workplace.reader(), field).expect("reads");
        for format in [ExportFormat::Nrrd, ExportFormat::Nifti] {
            let name = format!("{}.{}", field.name(), format.extensions()[0]);
            let is_trap = format == ExportFormat::Nifti && field != Field::Role;
            assert_eq!(workplace.export(field, 0, format, &name).len(), usize::from(is_trap));
            let found = read(&workplace.path(&name)).scalars;
            assert_eq!(found.scalar_type(), if field == Field::Role { ScalarType::I8 } else { ScalarType::F32 });
            let same = |voxel: usize| (found.get(voxel) as f32).to_bits() == expected[voxel].to_bits();
            assert!((0..expected.len()).all(same), "{name}");
        }
    }
}

#[test]
fn both_placements_of_nifti_are_the_same() {
    let workplace = Workplace::new(oblique(), 1.0, 0.0);
    workplace.export(Field::Role, 0, ExportFormat::Nifti, "role.nii");
    let mut bytes = fs::read(workplace.path("role.nii")).expect("reads");
    // Without its matrix the rotation is read.
    bytes[254..256].fill(0);
    fs::write(workplace.path("turned.nii"), bytes).expect("writes");
    assert_near(&read(&workplace.path("turned.nii")).geometry, &oblique());
}

#[test]
fn nifti_keeps_slope_and_intercept_where_others_write_physical_values() {
    let workplace = Workplace::new(oblique(), 0.5, -1024.0);
    let (stored, ..) = workplace.reader().read_value().expect("reads");
    workplace.export(Field::Value, 0, ExportFormat::Nifti, "value.nii");
    let grid = read(&workplace.path("value.nii"));
    assert_eq!((grid.scalars, grid.slope, grid.intercept), (stored, 0.5, -1024.0));
    workplace.export(Field::Value, 0, ExportFormat::Nrrd, "value.nrrd");
    let grid = read(&workplace.path("value.nrrd"));
    assert_eq!((grid.scalars.get(0), grid.scalars.scalar_type()), (-974.0, ScalarType::F32));

    // A slope that f32 does not hold.
    let workplace = Workplace::new(oblique(), 0.1, 0.0);
    workplace.export(Field::Value, 0, ExportFormat::Nifti, "value.nii");
    let grid = read(&workplace.path("value.nii"));
    assert_eq!((grid.scalars.get(0), grid.scalars.scalar_type(), grid.slope), (10.0, ScalarType::F32, 1.0));
}

#[test]
fn a_level_has_every_second_voxel() {
    let geometry = GridGeometry { dims: [70, 3, 3], ..oblique() };
    let workplace = Workplace::new(geometry.clone(), 1.0, 0.0);
    workplace.export(Field::Value, 1, ExportFormat::Nrrd, "level.nrrd");
    let (found, whole) = (read(&workplace.path("level.nrrd")), workplace.reader().read_value().expect("reads").0);
    let expected =
        GridGeometry { dims: [35, 2, 2], spacing: geometry.spacing.map(|spacing| 2.0 * spacing), ..geometry };
    assert_near(&found.geometry, &expected);
    for (index, (x, y, z)) in [(0, (0, 0, 0)), (34, (34, 0, 0)), (35, (0, 1, 0)), (139, (34, 1, 1))] {
        assert_eq!(found.scalars.get(index), whole.get((2 * z * 3 + 2 * y) * 70 + 2 * x));
    }
    workplace.fail("export step.vxr --field value --level 2 -o out.nrrd", 1, "its last is 1");
}

#[test]
fn a_vti_file_is_written_to_the_byte() {
    let workplace = Workplace::new(oblique(), 1.0, 0.0);
    workplace.export(Field::Role, 0, ExportFormat::Vti, "role.vti");
    let bytes = fs::read(workplace.path("role.vti")).expect("reads");
    let start = "<?xml version=\"1.0\"?>\n\
        <VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n  \
        <ImageData WholeExtent=\"0 8 0 6 0 4\" Origin=\"-12.5 30.25 7\" Spacing=\"0.5 1.25 2\" \
        Direction=\"0.8 0 -0.6 0.6 0 0.8 0 1 0\">\n    \
        <Piece Extent=\"0 8 0 6 0 4\">\n      <PointData Scalars=\"role\">\n        \
        <DataArray type=\"Int8\" Name=\"role\" NumberOfComponents=\"1\" format=\"appended\" offset=\"0\"/>\n      \
        </PointData>\n    </Piece>\n  </ImageData>\n  <AppendedData encoding=\"raw\">\n   _";
    assert_eq!(String::from_utf8_lossy(&bytes[..start.len()]), start);
    let voxels = 9 * 7 * 5;
    assert_eq!(bytes[start.len()..start.len() + 8], u64::to_le_bytes(voxels));
    let numbers = &bytes[start.len() + 8..];
    let expected = read_field(&workplace.reader(), Field::Role).expect("reads");
    assert!(expected.iter().zip(numbers).all(|(role, &byte)| *role == f32::from(byte as i8)));
    assert_eq!(&numbers[voxels as usize..], b"\n  </AppendedData>\n</VTKFile>\n");
}

#[test]
fn a_tiff_stack_lies_in_one_piece() {
    let workplace = Workplace::new(oblique(), 1.0, 0.0);
    let lost = workplace.export(Field::Value, 0, ExportFormat::Tiff, "value.tif");
    assert!(lost.len() == 1 && lost[0].contains("direction"), "{lost:?}");
    let bytes = fs::read(workplace.path("value.tif")).expect("reads");
    let text = String::from_utf8_lossy(&bytes[..600]);
    for line in ["ImageJ=1.54f", "images=5", "slices=5", "unit=mm", "spacing=2", "xorigin=25", "min=100", "max=3034"] {
        assert!(text.lines().any(|found| found.ends_with(line)), "{line} in {text}");
    }
    let numbers: Vec<u8> = match workplace.reader().read_value().expect("reads").0 {
        Scalars::I16(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        _ => panic!("another type"),
    };
    assert!(bytes.windows(numbers.len()).any(|window| window == numbers));
}

#[test]
fn an_array_is_indexed_z_y_x() {
    let workplace = Workplace::new(oblique(), 1.0, 0.0);
    for (field, start, numbers) in [
        (Field::Value, "{'descr': '<i2', 'fortran_order': False, 'shape': (5, 7, 9), }", 2),
        (Field::Normal, "{'descr': '<f4', 'fortran_order': False, 'shape': (5, 7, 9, 3), }", 12),
    ] {
        workplace.export(field, 0, ExportFormat::Npy, "a.npy");
        let bytes = fs::read(workplace.path("a.npy")).expect("reads");
        assert_eq!(String::from_utf8_lossy(&bytes[10..10 + start.len()]), start);
        assert_eq!(bytes.len(), 128 + 9 * 7 * 5 * numbers);
    }
}

#[test]
fn several_fields_go_into_a_folder() {
    let workplace = Workplace::new(oblique(), 1.0, 0.0);
    workplace.succeed("export step.vxr --all --format nifti -o all");
    let expected = ["distance.nii.gz", "hit-gradient.nii.gz", "normal.nii.gz", "role.nii.gz", "value.nii.gz"];
    assert_eq!(names(&workplace.path("all")), expected);
    workplace.succeed("export step.vxr --field value,role --format vti --compress -o two");
    assert_eq!(names(&workplace.path("two")), ["role.vti", "value.vti"]);
    workplace.succeed("export step.vxr --field normal --format tiff -o two");
    assert_eq!(names(&workplace.path("two")), ["normal.tif", "role.vti", "value.vti"]);
    let before = names(workplace.0.path());
    for (line, code, reason) in [
        ("--field value -o out.xyz", 2, ".ome.zarr"),
        ("--field value -o two", 2, "--format"),
        ("--field value --format vti -o out.nrrd", 2, "name it .vti"),
        ("--field value,role -o out.nrrd", 2, "--format"),
        ("--field value,role --format nrrd -o out.nrrd", 2, "folder"),
        ("--field gradient-magnitude -o out.nrrd", 1, "--keep derivatives"),
        ("--field value --compress -o out.npy", 2, "--compress"),
        ("--all --format nrrd -o no/such", 1, "no folder"),
        ("--all --format nrrd -o step.vxr", 1, "in the way"),
        ("--field value -o no/such.nii", 1, "no folder"),
    ] {
        workplace.fail(&format!("export step.vxr {line}"), code, reason);
        assert_eq!(names(workplace.0.path()), before, "{line}");
    }
}

#[cfg(feature = "zarr")]
#[test]
fn only_own_folders_are_replaced() {
    let workplace = Workplace::new(oblique(), 1.0, 0.0);
    for _ in 0..2 {
        let said = workplace.succeed("export step.vxr --field distance -o distance.ome.zarr");
        assert!(said.contains("warning") && said.contains("direction"), "{said}");
    }
    let metadata = fs::read(workplace.path("distance.ome.zarr/zarr.json")).expect("reads");
    let metadata: serde_json::Value = serde_json::from_slice(&metadata).expect("is JSON");
    let multiscale = &metadata["attributes"]["ome"]["multiscales"][0];
    let transformations = &multiscale["datasets"][0]["coordinateTransformations"];
    assert_eq!(transformations[0]["scale"], serde_json::json!([2.0, 1.25, 0.5]));
    assert_eq!(transformations[1]["translation"], serde_json::json!([7.0, 30.25, -12.5]));
    assert_eq!(multiscale["axes"][0], serde_json::json!({ "name": "z", "type": "space", "unit": "millimeter" }));
    assert_eq!(metadata["attributes"]["voxrole"]["world_from_index"][0][3], -12.5);
    assert_eq!(names(workplace.0.path()), ["distance.ome.zarr", "step.vxr"]);

    fs::create_dir(workplace.path("mine.zarr")).expect("makes");
    fs::write(workplace.path("mine.zarr/zarr.json"), "{}").expect("writes");
    workplace.fail("export step.vxr --field distance -o mine.zarr", 1, "did not write");
    assert_eq!(names(&workplace.path("mine.zarr")), ["zarr.json"]);
}
