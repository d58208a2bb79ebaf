//! Where the voxels lie, against numbers worked out by hand.

use glam::DVec3;
use voxrole_pack::{ScalarType, WorldFrame};
use voxrole_preprocess::Grid;
use voxrole_preprocess::io::{ByteOrder, ReadOptions, StoredType, read_volume};

use crate::samples::{Files, Nifti, bytes, meta_header, nrrd_header, numbers};

const U8: StoredType = StoredType { scalar_type: ScalarType::U8, byte_order: ByteOrder::Little };

fn data() -> Vec<u8> {
    bytes(&numbers(ScalarType::U8), ByteOrder::Little)
}

fn nrrd(lines: &str) -> Grid {
    let header = nrrd_header(U8, &format!("encoding: raw\n{lines}"));
    read_volume(&Files::new([("a.nrrd", [header.as_bytes(), &data()].concat())]).path(), &ReadOptions::default())
        .expect(lines)
}

fn metaimage(lines: &str) -> Grid {
    let header = meta_header(U8, &format!("{lines}ElementDataFile = LOCAL\n"));
    read_volume(&Files::new([("a.mha", [header.as_bytes(), &data()].concat())]).path(), &ReadOptions::default())
        .expect(lines)
}

fn nifti(nifti: &Nifti) -> Grid {
    read_volume(&Files::new([("a.nii", nifti.file())]).path(), &ReadOptions::default()).expect("a good file")
}

#[track_caller]
fn assert_placed(grid: &Grid, spacing: [f64; 3], origin: [f64; 3], direction: [[f64; 3]; 3]) {
    let close = |found: &[f64], expected: &[f64]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 2e-7);
    assert!(close(&grid.geometry.spacing, &spacing), "spacing {:?}, expected {spacing:?}", grid.geometry.spacing);
    assert!(close(&grid.geometry.origin, &origin), "origin {:?}, expected {origin:?}", grid.geometry.origin);
    assert!(
        close(grid.geometry.direction.as_flattened(), direction.as_flattened()),
        "direction {:?}, expected {direction:?}",
        grid.geometry.direction
    );
}

const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

#[test]
fn nrrd_spacings_without_a_world() {
    let grid = nrrd("spacings: 0.5 1.5 2.5\nunits: \"um\" \"um\" \"um\"");
    assert_placed(&grid, [0.5, 1.5, 2.5], [0.0; 3], IDENTITY);
    assert_eq!((grid.geometry.unit.as_str(), grid.geometry.frame), ("µm", WorldFrame::Unspecified));
}

#[test]
fn nrrd_negative_axis_in_each_frame() {
    let lines =
        "space directions: (0,2,0) (-3,0,0) (0,0,-4)\nspace origin: (10,20,30)\nspace units: \"mm\" \"mm\" \"mm\"";
    let as_written = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]];
    let xy_negated = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]];
    let y_negated = [[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]];
    for (space, frame, origin, direction) in [
        ("left-posterior-superior", WorldFrame::LeftPosteriorSuperior, [10.0, 20.0, 30.0], as_written),
        ("LPS", WorldFrame::LeftPosteriorSuperior, [10.0, 20.0, 30.0], as_written),
        ("right-anterior-superior", WorldFrame::LeftPosteriorSuperior, [-10.0, -20.0, 30.0], xy_negated),
        ("RAS", WorldFrame::LeftPosteriorSuperior, [-10.0, -20.0, 30.0], xy_negated),
        ("left-anterior-superior", WorldFrame::LeftPosteriorSuperior, [10.0, -20.0, 30.0], y_negated),
        ("3D-right-handed", WorldFrame::Unspecified, [10.0, 20.0, 30.0], as_written),
    ] {
        let grid = nrrd(&format!("space: {space}\n{lines}"));
        assert_placed(&grid, [2.0, 3.0, 4.0], origin, direction);
        assert_eq!((grid.geometry.unit.as_str(), grid.geometry.frame), ("mm", frame), "{space}");
    }
    let grid = nrrd(&format!("space dimension: 3\n{lines}"));
    assert_eq!(grid.geometry.frame, WorldFrame::Unspecified);
    // The last voxel, (2, 3, 4): 10 − 3·3, 20 + 2·2, 30 − 4·4.
    let last = grid.geometry.world_from_index().transform_point3(DVec3::new(2.0, 3.0, 4.0));
    assert_eq!(last, DVec3::new(1.0, 24.0, 14.0));
}

#[test]
fn nrrd_rounded_directions_become_orthonormal() {
    // 30° about z at spacing 2, written with three decimals.
    let grid = nrrd("space: LPS\nspace directions: (1.732,1,0) (-1,1.732,0) (0,0,2)");
    let axes = grid.geometry.world_from_axes();
    let gram = axes.transpose() * axes;
    for (index, entry) in gram.to_cols_array().into_iter().enumerate() {
        assert!((entry - if index % 4 == 0 { 1.0 } else { 0.0 }).abs() < 1e-12, "{gram}");
    }
    assert!((grid.geometry.spacing[0] - 1.732_f64.hypot(1.0)).abs() < 1e-15);
}

#[test]
fn metaimage_matrix_gives_one_axis_after_the_other() {
    let lines = "TransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 1 2 3\nElementSpacing = 0.5 0.6 0.7\n";
    let direction = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let unknown = metaimage(&format!("{lines}AnatomicalOrientation = ???\n"));
    assert_placed(&unknown, [0.5, 0.6, 0.7], [1.0, 2.0, 3.0], direction);
    assert_eq!(unknown.geometry.frame, WorldFrame::Unspecified);
    let known = metaimage(&format!("{lines}AnatomicalOrientation = ALI\nDistanceUnits = mm\n"));
    assert_placed(&known, [0.5, 0.6, 0.7], [1.0, 2.0, 3.0], direction);
    assert_eq!((known.geometry.unit.as_str(), known.geometry.frame), ("mm", WorldFrame::LeftPosteriorSuperior));
    let last = known.geometry.world_from_index().transform_point3(DVec3::new(2.0, 3.0, 4.0));
    assert!(last.distance(DVec3::new(1.0 - 1.8, 2.0 + 1.0, 3.0 + 2.8)) < 1e-12, "{last}");
    for aliases in ["Rotation = 0 1 0 -1 0 0 0 0 1\nPosition", "Orientation = 0 1 0 -1 0 0 0 0 1\nOrigin"] {
        let grid = metaimage(&format!("{aliases} = 1 2 3\nElementSpacing = 0.5 0.6 0.7\n"));
        assert_placed(&grid, [0.5, 0.6, 0.7], [1.0, 2.0, 3.0], direction);
    }
}

#[test]
fn metaimage_spacing_comes_before_size() {
    let both = metaimage("ElementSize = 9 9 9\nElementSpacing = 1 2 3\n");
    assert_placed(&both, [1.0, 2.0, 3.0], [0.0; 3], IDENTITY);
    assert_placed(&metaimage("ElementSize = 4 5 6\n"), [4.0, 5.0, 6.0], [0.0; 3], IDENTITY);
    assert_placed(&metaimage(""), [1.0; 3], [0.0; 3], IDENTITY);
}

#[test]
fn nifti_sform_comes_before_qform() {
    let header = Nifti {
        codes: [1, 1],
        pixdim: [1.0, 9.0, 9.0, 9.0, 0.0, 0.0, 0.0, 0.0],
        quatern: [0.0, 0.0, 0.0, 7.0, 8.0, 9.0],
        // World x, y, z to the right, front and top: index x steps 2 to the front, y 3 to the left, z 4 up.
        srow: [0.0, -3.0, 0.0, 10.0, 2.0, 0.0, 0.0, 20.0, 0.0, 0.0, 4.0, 30.0],
        ..Nifti::new(U8)
    };
    let grid = nifti(&header);
    // To the back and left both world axes turn round.
    assert_placed(&grid, [2.0, 3.0, 4.0], [-10.0, -20.0, 30.0], [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
    assert_eq!((grid.geometry.unit.as_str(), grid.geometry.frame), ("mm", WorldFrame::LeftPosteriorSuperior));
}

#[test]
fn nifti_qform_is_a_quaternion() {
    // A third of a turn about (1, 1, 1): a = b = c = d = ½ takes x to y, y to z and z to x. A negative pixdim[0] turns
    // the third axis round.
    let header = Nifti { codes: [1, 0], quatern: [0.5, 0.5, 0.5, 10.0, 20.0, 30.0], xyzt_units: 3, ..Nifti::new(U8) };
    let grid = nifti(&header);
    assert_placed(&grid, [1.0, 2.0, 3.0], [-10.0, -20.0, 30.0], [[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]]);
    assert_eq!((grid.geometry.unit.as_str(), grid.geometry.frame), ("µm", WorldFrame::LeftPosteriorSuperior));
    let mirrored = Nifti { pixdim: [-1.0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0], ..header };
    assert_placed(
        &nifti(&mirrored),
        [1.0, 2.0, 3.0],
        [-10.0, -20.0, 30.0],
        [[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
    );
}

#[test]
fn nifti_without_codes_has_spacing_only() {
    let grid = nifti(&Nifti { xyzt_units: 8 | 1, srow: [1.0; 12], quatern: [0.5; 6], ..Nifti::new(U8) });
    assert_placed(&grid, [1.0, 2.0, 3.0], [0.0; 3], IDENTITY);
    assert_eq!((grid.geometry.unit.as_str(), grid.geometry.frame), ("m", WorldFrame::Unspecified));
}

#[test]
fn nifti_slope_maps_stored_to_physical() {
    let grid = nifti(&Nifti { scl: [0.5, -1024.0], ..Nifti::new(U8) });
    assert_eq!((grid.slope, grid.intercept), (0.5, -1024.0));
    // The fourth number is 255.
    assert_eq!((grid.scalars.get(3), grid.physical(3)), (255.0, -896.5));
    let grid = nifti(&Nifti { scl: [0.0, 5.0], ..Nifti::new(U8) });
    assert_eq!((grid.slope, grid.intercept), (1.0, 0.0));
}
