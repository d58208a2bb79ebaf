//! Rotation, offset and spacing move the grid and the scene, not the values.

use super::*;

#[test]
fn every_voxel_holds_the_scenes_value_at_its_place_in_the_world() {
    let settings = PhantomSettings {
        spacing: [0.8, 1.1, 1.7],
        rotation: [25.0, -40.0, 110.0],
        offset: [1.25, -0.5, 2.0],
        scalar_type: ScalarType::F64,
        ..settings([20, 18, 16])
    };
    for phantom in Phantom::ALL.into_iter().filter(|phantom| *phantom != Phantom::SlabPair) {
        let (scene, values) = (phantom.scene(&settings).expect("a scene"), values(phantom, &settings));
        let world_from_index = phantom.generate(&settings).expect("a volume").geometry.world_from_index();
        for (index, value) in values.iter().enumerate() {
            let place = DVec3::new((index % 20) as f64, (index / 20 % 18) as f64, (index / 360) as f64);
            assert_eq!(*value, scene.value(world_from_index.transform_point3(place)), "{}", phantom.name());
        }
    }
}

#[test]
fn rotation_turns_the_grid_about_its_middle_and_leaves_the_scene() {
    let straight = PhantomSettings { scalar_type: ScalarType::F64, ..settings([17; 3]) };
    let turned = PhantomSettings { rotation: [0.0, 0.0, 90.0], ..straight.clone() };
    for phantom in [Phantom::Ball, Phantom::Torus, Phantom::Box, Phantom::Junction, Phantom::MarschnerLobb] {
        assert_eq!(phantom.scene(&straight).expect("a scene"), phantom.scene(&turned).expect("a scene"));
        let (before, after) = (values(phantom, &straight), values(phantom, &turned));
        // The grid's x axis is now the world's y, its y axis the world's −x.
        for (index, value) in after.iter().enumerate() {
            let (x, y, z) = (index % 17, index / 17 % 17, index / 289);
            assert_eq!(*value, before[16 - y + 17 * x + 289 * z], "{} {x} {y} {z}", phantom.name());
        }
    }
    let oblique = PhantomSettings { rotation: [12.0, 34.0, 56.0], spacing: [1.0, 2.0, 3.0], ..straight.clone() };
    let geometry = oblique.geometry();
    geometry.validate().expect("a rotation");
    let middle = geometry.world_from_index().transform_point3(DVec3::splat(8.0));
    assert!(middle.distance(DVec3::new(8.0, 16.0, 24.0)) < 1e-12);
    assert!(geometry.world_from_axes().determinant() > 0.999);
    assert_eq!(straight.geometry(), voxrole_pack::GridGeometry::axis_aligned([17; 3], [1.0; 3]));
}

#[test]
fn offset_moves_the_scene_by_smallest_spacings() {
    let still = PhantomSettings { spacing: [0.5, 1.0, 0.75], ..settings([64, 32, 48]) };
    let moved = PhantomSettings { offset: [2.0, -1.5, 0.25], ..still.clone() };
    let shift = 0.5 * DVec3::from_array(moved.offset);
    for phantom in Phantom::ALL {
        let (a, b) = (phantom.scene(&still).expect("a scene"), phantom.scene(&moved).expect("a scene"));
        for point in scattered_points(still.middle(), 15.0) {
            let (before, after) = (a.value(point), b.value(point + shift));
            assert!((before - after).abs() < 1e-12, "{} {point}: {before} {after}", phantom.name());
            if let (Some(before), Some(after)) = (a.signed_distance(point), b.signed_distance(point + shift)) {
                assert!((before - after).abs() < 1e-12, "{} {point}: {before} {after}", phantom.name());
            }
        }
    }
    assert_eq!(still.geometry(), moved.geometry());
}

#[test]
fn spacing_scales_the_scene() {
    let unit = settings([64; 3]);
    let scaled = PhantomSettings { spacing: [3.0; 3], ..unit.clone() };
    for phantom in Phantom::ALL {
        let (a, b) = (phantom.scene(&unit).expect("a scene"), phantom.scene(&scaled).expect("a scene"));
        for point in scattered_points(unit.middle(), 30.0) {
            assert!((a.value(point) - b.value(3.0 * point)).abs() < 1e-12, "{} {point}", phantom.name());
            let gradients = (a.gradient(point), 3.0 * b.gradient(3.0 * point));
            assert!((gradients.0 - gradients.1).length() < 1e-11, "{} {point}", phantom.name());
            let bends = (a.second_derivative(point), 9.0 * b.second_derivative(3.0 * point));
            assert!((bends.0 - bends.1).abs() < 1e-8, "{} {point}: {bends:?}", phantom.name());
        }
    }
}
