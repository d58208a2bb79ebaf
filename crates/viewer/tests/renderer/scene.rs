//! Opaque geometry among boundaries: where it lies, what it hides, and that both renderers draw the same.

use std::f64::consts::{PI, TAU};
use std::fmt::Write;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3, Vec3};
use voxrole_pack::{GridGeometry, WorldFrame};
use voxrole_tests::comparison::{assert_same, draw_on_cpu, draw_on_gpu, gpu_or_skip};
use voxrole_viewer::frame::Frame;
use voxrole_viewer::reference::RayMarcher;
use voxrole_viewer::scene::lines::lines;
use voxrole_viewer::scene::rasterizer::rasterize;
use voxrole_viewer::scene::{OpaquePixel, Surfaces, Triangles, Vertex};
use voxrole_viewer::state::{Camera, CameraPreset, MeshFile, Technique};
use voxrole_viewer::{Error, ViewState, VolumeTexels};

use crate::phantom::{Phantom, orthographic};

/// A file that no other test writes.
fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("scene-{}-{name}", std::process::id()))
}

/// A sphere in world coordinates, as OBJ.
fn sphere(middle: DVec3, radius: f64) -> String {
    const BELTS: usize = 48;
    let mut text = String::new();
    for belt in 0..=BELTS {
        for side in 0..2 * BELTS {
            let (down, around) = (PI * belt as f64 / BELTS as f64, TAU * side as f64 / (2 * BELTS) as f64);
            let towards = DVec3::new(down.sin() * around.cos(), down.sin() * around.sin(), down.cos());
            let DVec3 { x, y, z } = middle + radius * towards;
            writeln!(text, "v {x} {y} {z}").expect("memory");
        }
    }
    let corner = |belt: usize, side: usize| 1 + belt * 2 * BELTS + side % (2 * BELTS);
    for (belt, side) in (0..BELTS).flat_map(|belt| (0..2 * BELTS).map(move |side| (belt, side))) {
        let [a, b] = [corner(belt, side), corner(belt, side + 1)];
        let [c, d] = [corner(belt + 1, side), corner(belt + 1, side + 1)];
        writeln!(text, "f {a} {c} {d} {b}").expect("memory");
    }
    text
}

fn mesh(path: &Path) -> MeshFile {
    format!("{},40A0FF", path.display()).parse().expect("a mesh")
}

fn surfaces(volume: &VolumeTexels, state: &ViewState) -> Surfaces {
    Surfaces::of(state, volume).expect("surfaces")
}

/// The phantom with everything that a scene may have.
fn full_state(phantom: &Phantom, camera: Camera, name: &str) -> ViewState {
    let path = file(name);
    let world = phantom.geometry.world_from_index();
    let middle = world.transform_point3(phantom.center / DVec3::from_array(phantom.geometry.spacing));
    let right = phantom.geometry.world_from_axes() * DVec3::new(14.0, 0.0, 3.0);
    std::fs::write(&path, sphere(middle + right, 9.0)).expect("is written");
    let mut state = phantom.state(camera);
    state.scene.bounding_box = true;
    state.scene.axes = true;
    state.scene.meshes = vec![mesh(&path)];
    state.scene.isosurfaces = vec!["70,FFC080".parse().expect("an isosurface")];
    state
}

#[test]
fn a_sphere_lies_where_geometry_says_and_hides_what_is_behind() {
    let phantom = Phantom::ball();
    let volume = phantom.texels();
    let path = file("sphere.obj");
    std::fs::write(&path, sphere(phantom.center, 12.0)).expect("is written");
    for camera in [orthographic(CameraPreset::Front), Camera::default()] {
        let mut state = phantom.state(camera);
        state.transfer_function.regions[0].opacity = 0.2;
        let without = RayMarcher::new(&volume, &state, [128, 128]).expect("a size").light().0;
        state.scene.meshes = vec![mesh(&path)];
        let marcher = RayMarcher::new(&volume, &state, [128, 128]).expect("a scene");
        let opaque = marcher.opaque();
        let with = marcher.light().0;
        let mut seen = 0;
        for (x, y) in (0..128).flat_map(|y| (0..128).map(move |x| (x, y))) {
            let ray = marcher.frame().ray(x, y);
            let to_middle = phantom.center.as_vec3() - ray.origin;
            let middle = to_middle.dot(ray.direction);
            let off = (to_middle.length_squared() - middle * middle).max(0.0).sqrt();
            let at = (y * 128 + x) as usize;
            // Chords of the circle lie 0.03 inside.
            if off < 11.9 {
                let depth = middle - (144.0 - off * off).sqrt();
                let most = 0.04 * 12.0 / (144.0 - off * off).sqrt();
                assert!((opaque[at].along - depth).abs() < most, "{x} {y}: {} is not {depth}", opaque[at].along);
                assert_eq!(with.pixels[at].light.w, 1.0);
                assert_eq!(with.pixels[at].depth, opaque[at].along);
                seen += 1;
            } else if off > 12.1 {
                assert_eq!(opaque[at], OpaquePixel::NONE);
                assert_eq!(with.pixels[at].light, without.pixels[at].light, "{x} {y}");
            }
        }
        assert!(seen > 400, "{seen}");
    }
}

#[test]
fn an_opaque_boundary_hides_what_is_inside_and_is_hidden_by_what_is_in_front() {
    let phantom = Phantom::ball();
    let volume = phantom.texels();
    let mut state = phantom.state(orthographic(CameraPreset::Front));
    state.transfer_function.regions[0].opacity = 1.0;
    state.transfer_function.emphasis = "convex,1,3,9".parse().expect("an emphasis");
    let without = draw_on_cpu(&volume, &state);
    let [inside, around] = [("inside.obj", 10.0), ("around.obj", 24.0)].map(|(name, radius)| {
        let path = file(name);
        std::fs::write(&path, sphere(phantom.center, radius)).expect("is written");
        mesh(&path)
    });
    state.scene.meshes = vec![inside];
    assert_eq!(draw_on_cpu(&volume, &state).pixel(64, 64), without.pixel(64, 64));
    // Without the boundary it is there.
    let mut alone = state.clone();
    alone.transfer_function.regions.clear();
    assert!(draw_on_cpu(&volume, &alone).pixel(64, 64)[2] > 100);
    state.scene.meshes = vec![around];
    let covered = draw_on_cpu(&volume, &state);
    alone.scene = state.scene.clone();
    assert_eq!(covered, draw_on_cpu(&volume, &alone), "the ball lies inside as a whole");
}

#[test]
fn a_step_that_is_cut_short_counts_for_its_share() {
    // A flat wall in a haze that is as thick everywhere: how much of it is seen depends on the wall's depth alone.
    let phantom = Phantom::ball();
    let volume = phantom.texels();
    let wall = file("wall.obj");
    let mut state = phantom.state(orthographic(CameraPreset::Front));
    state.transfer_function.emphasis = "linear,0.2,15".parse().expect("an emphasis");
    let mut alphas = Vec::new();
    for (technique, step) in [(Technique::Rays, 0.05), (Technique::Rays, 1.5), (Technique::Slices, 1.5)] {
        state.render_settings.technique = technique;
        for shift in 0..12 {
            let y = 24.0 + 0.25 * f64::from(shift);
            std::fs::write(&wall, format!("v -50 {y} -50\nv 150 {y} -50\nv 50 {y} 250\nf 1 2 3\n"))
                .expect("is written");
            state.render_settings.step = step;
            state.scene.meshes = vec![format!("{},FFFFFF", wall.display()).parse().expect("a mesh")];
            let marcher = RayMarcher::new(&volume, &state, [9, 9]).expect("a scene");
            let light = marcher.light().0.pixels[4 * 9 + 4].light;
            let wall = marcher.opaque()[4 * 9 + 4].color;
            // Of the wall's blue, which the ball has little of.
            alphas.push((light.z, wall.z));
        }
    }
    for (fine, coarse) in alphas[..12].iter().cycle().zip(&alphas[12..]) {
        assert!((fine.0 - coarse.0).abs() < 0.01, "{fine:?} {coarse:?}");
    }
}

/// Every triangle against a ray, in double precision: the least depth.
fn naive(triangles: &Triangles, origin: DVec3, direction: DVec3) -> f64 {
    let mut nearest = f64::INFINITY;
    for triangle in &triangles.indices {
        let [a, b, c] = triangle.map(|index| Vec3::from_array(triangles.vertices[index as usize].position).as_dvec3());
        let matrix = DMat3::from_cols(b - a, c - a, -direction);
        if matrix.determinant().abs() < 1e-12 {
            continue;
        }
        let solved = matrix.inverse() * (origin - a);
        if solved.x.min(solved.y).min(1.0 - solved.x - solved.y) >= 0.0 && solved.z > 0.0 {
            nearest = nearest.min(solved.z);
        }
    }
    nearest
}

#[test]
fn the_rasterizer_equals_its_naive_twin() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    // The last camera stands inside the box, so that triangles lie behind it and across the eye's plane.
    let inside = Camera { zoom: 9.0, field_of_view: 90.0, ..Camera::default() };
    for (name, camera) in
        [("default", Camera::default()), ("front", orthographic(CameraPreset::Iso)), ("inside", inside)]
    {
        let state = full_state(&phantom, camera, &format!("twin-{name}.obj"));
        let marcher = RayMarcher::new(&volume, &state, [40, 30]).expect("a scene");
        let frame = marcher.frame();
        let mut all = lines(&state, &volume.description, frame);
        // A large triangle that no corner of lies in the picture, and one through the eye.
        let far = [[-900.0, 20.0, -900.0], [900.0, 25.0, -800.0], [0.0, 30.0, 1500.0]];
        all.push_polygon(&far.map(|place| Vertex::uncut(Vec3::from_array(place), Vec3::ZERO, [1.0; 3])));
        all.append(Triangles {
            indices: surfaces(&volume, &state).triangles.indices.into_iter().step_by(7).collect(),
            ..surfaces(&volume, &state).triangles
        });
        let found = rasterize(&[&all], frame);
        let off = off_pixels(name, &all, frame, &found);
        println!("{name}: {off} of 1200 pixels by less than a part of the raster");
        assert!(off < 12, "{name}: {off} pixels");
    }
}

/// How many pixels are not as their middle's ray has it, but as one beside it: corners lie on a raster of 1/256 of a
/// pixel, so that a ray that meets an edge may fall to either side of it.
fn off_pixels(name: &str, triangles: &Triangles, frame: &Frame, found: &[OpaquePixel]) -> usize {
    let rays = &frame.rays;
    let [wide, tall] = frame.image_size.map(f64::from);
    let at = |middle: Vec3, right: Vec3, up: Vec3, [x, y]: [f64; 2]| {
        middle.as_dvec3() + (x / wide * 2.0 - 1.0) * right.as_dvec3() + (1.0 - y / tall * 2.0) * up.as_dvec3()
    };
    let nearest = |place: [f64; 2]| {
        let origin = at(rays.origin, rays.origin_right, rays.origin_up, place);
        let direction = at(rays.direction, rays.direction_right, rays.direction_up, place);
        naive(triangles, origin, direction.normalize())
    };
    let mut off = 0;
    for (index, pixel) in found.iter().enumerate() {
        let [x, y] = [index % wide as usize, index / wide as usize].map(|at| at as f64 + 0.5);
        let along = f64::from(pixel.along);
        let is_same = |place: [f64; 2]| {
            let expected = nearest(place);
            along == expected || (along - expected).abs() < 1e-3 * expected
        };
        if !is_same([x, y]) {
            let part = 1.0 / 256.0;
            let mut around = [[-part, -part], [-part, part], [part, -part], [part, part]].into_iter();
            assert!(around.any(|[right, down]| is_same([x + right, y + down])), "{name} {x} {y}: {along}");
            off += 1;
        }
    }
    off
}

#[test]
fn gpu_and_cpu_draw_the_same_scene() {
    let Some(gpu) = gpu_or_skip("gpu_and_cpu_draw_the_same_scene") else { return };
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    let close = Camera { zoom: 6.0, ..Camera::default() };
    let cameras = [("default", Camera::default()), ("iso", orthographic(CameraPreset::Iso)), ("close", close)];
    for (name, camera) in cameras {
        let mut state = full_state(&phantom, camera, &format!("same-{name}.obj"));
        let rays = Technique::Rays;
        for (technique, jitter, clip) in [
            (rays, false, None),
            (rays, true, Some("30,20,0.2")),
            (Technique::Slices, false, None),
            (Technique::Stacks, false, Some("30,20,0.2")),
        ] {
            state.render_settings.technique = technique;
            state.render_settings.jitter = jitter;
            state.clipping.planes = clip.iter().map(|plane: &&str| plane.parse().expect("a plane")).collect();
            state.clipping.crop = if jitter { "4:,:,:56" } else { ":,:,:" }.parse().expect("a crop");
            let [on_cpu, on_gpu] = [draw_on_cpu(&volume, &state), draw_on_gpu(&gpu, &volume, &state)];
            assert_same(&format!("{name} {technique:?} {clip:?}"), &on_cpu, &on_gpu);
        }
    }
}

#[test]
fn leaping_changes_nothing_before_what_is_opaque() {
    let phantom = Phantom::concentric_shells();
    let volume = phantom.texels();
    for (index, camera) in [Camera::default(), orthographic(CameraPreset::Iso)].into_iter().enumerate() {
        let mut state = full_state(&phantom, camera, &format!("leaps-{index}.obj"));
        for jitter in [false, true] {
            state.render_settings.jitter = jitter;
            let [with, without] = [true, false].map(|leaps| {
                state.render_settings.leaps = leaps;
                draw_on_cpu(&volume, &state)
            });
            assert_eq!(with, without);
        }
    }
}

#[test]
fn meshes_and_isosurfaces_meet_on_turned_and_uneven_grids() {
    let mut phantom = Phantom::ball();
    phantom.geometry = GridGeometry {
        origin: [100.0, -50.0, 7.0],
        direction: [[0.6, 0.8, 0.0], [0.8, -0.6, 0.0], [0.0, 0.0, 1.0]],
        ..GridGeometry::axis_aligned([60, 40, 30], [1.0, 1.5, 2.0])
    };
    phantom.center = DVec3::new(30.0, 30.0, 29.0);
    let volume = phantom.texels();
    let mut state = phantom.state(Camera::default());
    state.scene.isosurfaces = vec!["50".parse().expect("an isosurface")];
    for vertex in &surfaces(&volume, &state).triangles.vertices {
        let from_middle = Vec3::from_array(vertex.position) - phantom.center.as_vec3();
        // L_min is 1 world unit. Interpolation flattens the ball by h²/8R along each axis, 0.045 in all, and moves the
        // edge, which is blurred by 1.5, by 0.385/(6 · 1.5²) at most, 0.029.
        assert!((from_middle.length() - 20.0).abs() < 0.075, "{}", from_middle.length());
        assert!(Vec3::from_array(vertex.normal).dot(-from_middle.normalize()) > 0.99);
    }
    let geometry = &phantom.geometry;
    let middle = DVec3::from_array(geometry.origin) + geometry.world_from_axes() * phantom.center;
    let path = file("turned.obj");
    for (header, frame, middle) in [
        ("", WorldFrame::Unspecified, middle),
        ("# SPACE=RAS\n", WorldFrame::Unspecified, middle),
        ("# SPACE=RAS\n", WorldFrame::LeftPosteriorSuperior, middle * DVec3::new(-1.0, -1.0, 1.0)),
    ] {
        std::fs::write(&path, format!("{header}{}", sphere(middle, 20.0))).expect("is written");
        let mut volume = volume.clone();
        volume.description.frame = frame;
        state.scene.isosurfaces.clear();
        state.scene.meshes = vec![mesh(&path)];
        for vertex in &surfaces(&volume, &state).triangles.vertices {
            let radius = (Vec3::from_array(vertex.position) - phantom.center.as_vec3()).length();
            assert!((radius - 20.0).abs() < 1e-3, "{radius}");
        }
    }
}

#[test]
fn surfaces_are_cut_and_lines_are_not() {
    let phantom = Phantom::ball();
    let volume = phantom.texels();
    let mut state = phantom.state(orthographic(CameraPreset::Front));
    state.transfer_function.regions.clear();
    state.scene.isosurfaces = vec!["50".parse().expect("an isosurface")];
    let lit = |state: &ViewState| {
        let opaque = RayMarcher::new(&volume, state, [64, 64]).expect("a scene").opaque();
        [0, 1].map(|half| (0..64 * 64).filter(|at| at % 64 / 32 == half && opaque[*at].is_some()).count())
    };
    let whole = lit(&state);
    state.clipping.planes = vec!["90,0".parse().expect("a plane")];
    assert_eq!(lit(&state), [whole[0], 0]);
    state.clipping.planes.clear();
    state.clipping.crop = "31.5:,:,:".parse().expect("a crop");
    assert_eq!(lit(&state), [0, whole[1]]);
    state.scene.isosurfaces.clear();
    state.scene.bounding_box = true;
    let with_inner_box = lit(&state);
    assert!(with_inner_box.iter().all(|&pixels| pixels > 20));
    state.clipping.planes = vec!["0,0,-1".parse().expect("a plane")];
    assert_eq!(lit(&state), with_inner_box);
}

#[test]
fn places_beyond_all_digits_do_no_harm() {
    let phantom = Phantom::ball();
    let volume = phantom.texels();
    let path = file("far.obj");
    let corners = "v 3e38 1 0\nv -3e38 1e38 5\nv 0 2 -3e38\nv 1e30 1 1\nv 1 1e20 1\nv 1 1 1\n";
    std::fs::write(&path, format!("{corners}f 1 2 3\nf 4 5 6\nf 1 5 6\nf 6 6 6\nf 2 4 6\n")).expect("is written");
    for camera in [Camera::default(), Camera { zoom: 50.0, ..Camera::default() }, orthographic(CameraPreset::Iso)] {
        let mut state = phantom.state(camera);
        state.scene.meshes = vec![mesh(&path)];
        assert_eq!(draw_on_cpu(&volume, &state).rgba.len(), 4 * 128 * 128);
    }
}

#[test]
fn what_cannot_be_drawn_is_refused_with_a_reason() {
    let phantom = Phantom::ball();
    let volume = phantom.texels();
    let mut state = phantom.state(Camera::default());
    for (name, content, reason) in [
        ("a.stl", &b"\0\x01garbage"[..], "too short"),
        ("b.stl", &[255; 200], "cut short"),
        ("c.obj", b"f 1 2 3\n", "line 1"),
        ("d.obj", b"nothing\n", "no triangle"),
        ("e.obj", b"v nan 0 0\nv 0 1 0\nv 1 1 1\nf 1 2 3\n", "finite"),
        ("f.obj", b"v 1e300 0 0\nv 0 1 0\nv 1 1 1\nf 1 2 3\n", "finite"),
        ("g.ply", b"ply\n", ".obj"),
    ] {
        let path = file(name);
        std::fs::write(&path, content).expect("is written");
        state.scene.meshes = vec![mesh(&path)];
        let error = RayMarcher::new(&volume, &state, [8, 8]).err().expect("is refused");
        let message = error.to_string();
        assert!(message.contains(reason) && message.contains(name), "{message}");
    }
    state.scene.meshes = vec![mesh(&file("missing.stl"))];
    assert!(matches!(RayMarcher::new(&volume, &state, [8, 8]), Err(Error::Mesh { .. })));
    state.scene.meshes.clear();
    for value in ["-1", "101"] {
        state.scene.isosurfaces = vec![value.parse().expect("an isosurface")];
        let error = RayMarcher::new(&volume, &state, [8, 8]).err().expect("is refused").to_string();
        assert!(error.contains("from 0 to 100"), "{error}");
    }
}
