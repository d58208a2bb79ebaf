//! What sampling must not add to a picture, whichever technique it is drawn with: bands and sheets.

use glam::{DVec3, Vec3};
use voxrole_pack::quantization::encode_normal;
use voxrole_pack::{DistanceQuantization, GridGeometry, HitGradientQuantization, Precision};
use voxrole_preprocess::phantom::{Phantom as Volume, PhantomSettings};
use voxrole_preprocess::settings::{Method, Settings};
use voxrole_tests::comparison::{draw_on_cpu, lit_share};
use voxrole_tests::prepared;
use voxrole_viewer::reference::RayMarcher;
use voxrole_viewer::state::{BoundaryEmphasis, Camera, CameraPreset, EmphasisKind, Integration, Technique};
use voxrole_viewer::{ViewState, VolumeDescription, VolumeTexels};

use crate::phantom::{orthographic, region_at};

const EDGE: u32 = 48;
const THIN: BoundaryEmphasis = BoundaryEmphasis { kind: EmphasisKind::Concave, a: 0.5, d_c: 3.0, n: 3.0 };

/// A plane boundary through the middle of a cube, seen by every voxel within 15 voxels.
fn plane(normal: DVec3) -> VolumeTexels {
    let normal = normal.normalize();
    let geometry = GridGeometry::axis_aligned([EDGE; 3], [1.0; 3]);
    let hit_gradient = HitGradientQuantization::new(0.4, 0.6, Precision::default());
    let quantization = DistanceQuantization::new(15.0, Precision::default());
    let texel = |voxel: u32| {
        let index = [voxel % EDGE, voxel / EDGE % EDGE, voxel / (EDGE * EDGE)].map(f64::from);
        let distance = (DVec3::from_array(index) - 0.5 * f64::from(EDGE - 1)).dot(normal);
        let value = 0.5 * libm::erfc(-distance / 2.0);
        let value = (65535.0 * value).round() as u16;
        if distance.abs() > 15.0 {
            return [value, DistanceQuantization::NO_BOUNDARY as u16, 0, encode_normal(Vec3::ZERO)];
        }
        [value, quantization.encode(distance as f32) as u16, hit_gradient.encode(0.5), encode_normal(normal.as_vec3())]
    };
    let texels = (0..EDGE * EDGE * EDGE).map(texel).collect();
    VolumeTexels { description: VolumeDescription::new(&geometry, 15.0, [0.0, 1.0], hit_gradient), texels }
}

fn state_of_region(gradient: [f32; 2], emphasis: BoundaryEmphasis, camera: Camera) -> ViewState {
    let mut state = ViewState { camera, ..ViewState::default() };
    state.transfer_function.regions = vec![region_at(0.5, 1.0, [1.0; 3])];
    state.transfer_function.regions[0].gradient = gradient;
    state.transfer_function.emphasis = emphasis.into();
    state.render_settings.image_size = [200, 200];
    state
}

/// The largest second difference of opacity from one pixel of the picture's middle to the next, in 1/255.
fn largest_bend(volume: &VolumeTexels, state: &ViewState) -> f32 {
    let (light, _) = RayMarcher::new(volume, state, [200, 200]).expect("a size").light();
    let mut bend = 0.0_f32;
    // Well within the volume: where rays leave it through a side, less is seen.
    for y in (80..120).step_by(10) {
        let row: Vec<f32> = (75..125).map(|x| 255.0 * light.pixels[y * 200 + x].light.w).collect();
        assert!(row.iter().all(|&opacity| opacity > 50.0), "{row:?}");
        bend = row.windows(3).map(|three| (three[0] - 2.0 * three[1] + three[2]).abs()).fold(bend, f32::max);
    }
    bend
}

#[test]
fn planes_show_no_bands() {
    let turned = DVec3::new(0.2, -1.0, 0.35);
    for (normal, camera, name) in [
        (DVec3::NEG_Y, orthographic(CameraPreset::Front), "face on"),
        (turned, orthographic(CameraPreset::Front), "slanted"),
        (turned, Camera::default(), "slanted, in perspective"),
        (DVec3::new(1.0, -1.0, 0.5), Camera { azimuth: 10.0, ..Camera::default() }, "more slanted, in perspective"),
    ] {
        let volume = plane(normal);
        for technique in Technique::ALL {
            let mut state = state_of_region([0.4, 0.6], THIN, camera);
            state.render_settings.technique = technique;
            // Without integration a slanted plane has faint bands, those of stacks 1/cos as far apart as the voxels'
            // planes.
            for (integration, most) in [(Integration::Preintegrated, 0.03), (Integration::PostClassified, 6.0)] {
                state.render_settings.integration = integration;
                // What is followed from cell to cell needs no short steps.
                state.render_settings.step = if integration == Integration::Preintegrated { 1.0 } else { 0.25 };
                let bend = largest_bend(&volume, &state);
                println!("{name} {technique:?} {integration:?}: bends by {bend:.3}/255");
                assert!(bend < most, "{name} {technique:?} {integration:?}: {bend}");
            }
        }
    }
}

#[test]
fn translucent_cut_faces_show_no_bands() {
    let volume = plane(DVec3::NEG_Y);
    let thick = BoundaryEmphasis { kind: EmphasisKind::Convex, a: 0.15, d_c: 14.0, n: 100.0 };
    for technique in Technique::ALL {
        let mut state = state_of_region([0.4, 0.6], thick, orthographic(CameraPreset::Front));
        state.clipping.planes = vec!["35,20,0.1".parse().expect("a plane")];
        state.render_settings.technique = technique;
        let bend = largest_bend(&volume, &state);
        println!("{technique:?}: bends by {bend:.3}/255");
        assert!(bend < 0.3, "{technique:?}: {bend}");
    }
}

fn read(phantom: Volume) -> (VolumeTexels, Vec<f32>) {
    let settings = PhantomSettings { dims: [EDGE; 3], ..PhantomSettings::default() };
    let grid = phantom.generate(&settings).expect("a phantom");
    let volume = VolumeTexels::read(&prepared(&grid, &Settings::new(Method::Fast)).reader).expect("reads");
    let scene = phantom.scene(&settings).expect("a scene");
    (volume, scene.boundaries.iter().map(|boundary| boundary.gradient_magnitude().abs() as f32).collect())
}

#[test]
fn a_gradient_between_those_of_two_slabs_lights_nothing() {
    let (volume, gradients) = read(Volume::Slabs);
    let low = gradients.iter().copied().fold(f32::INFINITY, f32::min);
    let high = gradients.iter().copied().fold(0.0, f32::max);
    let convex = BoundaryEmphasis { kind: EmphasisKind::Convex, a: 1.0, d_c: 15.0, n: 3.0 };
    for technique in Technique::ALL {
        let draw = |gradient| {
            let mut state = state_of_region(gradient, convex, Camera::default());
            state.render_settings.technique = technique;
            lit_share(&draw_on_cpu(&volume, &state), [0, 0, 0, 255])
        };
        assert_eq!(draw([1.1 * low, 0.85 * high]), 0.0, "{technique:?}");
        // Central differences flatten gradients, and the thin slab's faces lie close to each other.
        assert!(draw([0.7 * low, 1.1 * low]) > 0.05 && draw([0.85 * high, 1.1 * high]) > 0.05, "{technique:?}");
    }
}

#[test]
fn layers_of_slabs_and_of_a_junction_are_lit_at_boundaries_alone() {
    const D_C: f32 = 2.0;
    let settings = PhantomSettings { dims: [EDGE; 3], ..PhantomSettings::default() };
    let convex = BoundaryEmphasis { kind: EmphasisKind::Convex, a: 1.0, d_c: D_C, n: 3.0 };
    for phantom in [Volume::Slabs, Volume::Junction] {
        let (volume, _) = read(phantom);
        let truth = phantom.truth(&settings).expect("exact distances");
        let side = EDGE as usize;
        let distance = |[x, y, z]: [usize; 3]| truth[(z * side + y) * side + x].abs();
        for technique in Technique::ALL {
            let mut seen = [0; 3];
            for z in [11, 23, 35] {
                let mut state = state_of_region([0.01, 10.0], convex, orthographic(CameraPreset::Top));
                state.render_settings.technique = technique;
                state.clipping.crop = format!(":,:,{z}:{}", z + 1).parse().expect("a crop");
                state.render_settings.image_size = [96, 96];
                let marcher = RayMarcher::new(&volume, &state, [96, 96]).expect("a size");
                let light = marcher.light().0;
                for (pixel, light) in light.pixels.iter().enumerate() {
                    let ray = marcher.frame().ray(pixel as u32 % 96, pixel as u32 / 96);
                    let place =
                        (ray.origin + (z as f32 + 0.5 - ray.origin.z) / ray.direction.z * ray.direction).floor();
                    if place.x < 0.0 || place.y < 0.0 || place.x.max(place.y) >= (EDGE - 1) as f32 {
                        continue;
                    }
                    let [x, y] = [place.x as usize, place.y as usize];
                    let corners =
                        (0..8).map(|corner| distance([x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2)]));
                    let [least, most] = corners.fold([f32::INFINITY, 0.0], |[least, most], distance| {
                        [f32::min(least, distance), f32::max(most, distance)]
                    });
                    // A voxel's plane stands for its cell, and where three materials meet edges are round.
                    if least > D_C + 1.5 {
                        seen[0] += 1;
                        assert_eq!(
                            light.light.w, 0.0,
                            "{phantom:?} {technique:?}: {x} {y} {z}, {least} from a boundary"
                        );
                    } else if most < 0.9 {
                        seen[1] += 1;
                        seen[2] += usize::from(light.light.w <= 0.2);
                    }
                }
            }
            println!("{phantom:?} {technique:?}: {seen:?} pixels far, near, and near but dark");
            // Where three materials meet there is no one boundary.
            let dark = if matches!(phantom, Volume::Junction) { seen[1] / 20 } else { 0 };
            assert!(seen[0] > 1000 && seen[1] > 40 && seen[2] <= dark, "{phantom:?} {technique:?}: {seen:?}");
        }
    }
}
