//! Surfaces out of files.

use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use voxrole_pack::WorldFrame;

use super::surfaces::frame_from_world;
use super::triangles::{Triangles, Vertex};
use super::{obj, stl};
use crate::state::MeshFile;
use crate::volume::VolumeDescription;
use crate::{Error, Result};

/// Longest file that is read.
const MOST_BYTES: u64 = 2 << 30;
/// Facets that meet at a larger angle than 30 degrees have an edge between them: its cosine.
const SMOOTH: f32 = 0.866_025_4;
/// Corners of more facets than this are not smoothed.
const MOST_AROUND: usize = 64;

/// What a file says: corners in its own coordinates, and which three make each triangle.
#[derive(Debug, Default, PartialEq)]
pub(super) struct FileMesh {
    pub vertices: Vec<[f64; 3]>,
    pub triangles: Vec<[u32; 3]>,
    /// Whether the file says that its x points to the right and its y to the front, as 3D Slicer writes it.
    pub is_right_anterior: bool,
}

/// Whether a header or a comment says that coordinates are right, anterior, superior.
pub(super) fn says_right_anterior(text: &[u8]) -> bool {
    text.windows(9).any(|window| window.eq_ignore_ascii_case(b"SPACE=RAS"))
}

/// Reads a mesh into the frame's space, with at most `most` triangles. Facets that meet at less than 30 degrees are lit
/// as one smooth surface; normals that the file has are not needed.
///
/// # Errors
/// [`Error::Mesh`] when the file cannot be read, is neither STL nor OBJ, is damaged, or has too many triangles or none.
pub fn read_mesh(mesh: &MeshFile, volume: &VolumeDescription, most: usize) -> Result<Triangles> {
    let fail = |reason: String| Error::Mesh { path: mesh.path.clone(), reason };
    let parse = parser(Path::new(&mesh.path)).map_err(fail)?;
    let file = File::open(&mesh.path).map_err(|error| fail(error.to_string()))?;
    let mut bytes = Vec::new();
    file.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(|error| fail(error.to_string()))?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(fail(format!("more than {} MiB are not read", MOST_BYTES >> 20)));
    }
    let file_mesh = parse(&bytes, most).map_err(fail)?;
    drop(bytes);
    if file_mesh.triangles.is_empty() {
        return Err(fail("there is no triangle in it".to_owned()));
    }
    let mirrored = file_mesh.is_right_anterior && volume.frame == WorldFrame::LeftPosteriorSuperior;
    let to_world = if mirrored { DVec3::new(-1.0, -1.0, 1.0) } else { DVec3::ONE };
    let vertices = file_mesh.vertices.par_iter();
    let positions: Vec<Vec3> =
        vertices.map(|&vertex| frame_from_world(volume, to_world * DVec3::from_array(vertex))).collect();
    if positions.iter().any(|position| !position.is_finite()) {
        return Err(fail("a corner is not a finite place".to_owned()));
    }
    Ok(smooth(&positions, &file_mesh.triangles, mesh.color))
}

/// Reads a file's bytes, with at most so many triangles; the error says what is wrong with them.
type Parser = fn(&[u8], usize) -> std::result::Result<FileMesh, String>;

/// What a file's name says about how it is to be read.
fn parser(path: &Path) -> std::result::Result<Parser, String> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    match extension.as_str() {
        "stl" => Ok(stl::parse),
        "obj" => Ok(obj::parse),
        _ => Err("a mesh is a file that ends in .stl or .obj".to_owned()),
    }
}

/// Triangles with corners of their own, whose normals are the mean of the facets around that are nearly parallel, by
/// area.
fn smooth(positions: &[Vec3], triangles: &[[u32; 3]], color: [f32; 3]) -> Triangles {
    // STL has every corner once for each facet.
    let mut places = HashMap::new();
    let mut place_of = |corner: u32| {
        // Minus zero is zero.
        let place = (positions[corner as usize] + 0.0).to_array().map(f32::to_bits);
        let next = places.len() as u32;
        *places.entry(place).or_insert(next)
    };
    let facets = triangles.iter().map(|triangle| {
        let [a, b, c] = triangle.map(|corner| positions[corner as usize]);
        (*triangle, triangle.map(&mut place_of), (b - a).cross(c - a))
    });
    let facets: Vec<([u32; 3], [u32; 3], Vec3)> = facets.collect();
    let mut starts = vec![0_u32; places.len() + 1];
    facets.iter().flat_map(|(_, places, _)| places).for_each(|&place| starts[place as usize + 1] += 1);
    (1..starts.len()).for_each(|place| starts[place] += starts[place - 1]);
    let mut around = vec![0_u32; 3 * facets.len()];
    let mut filled = starts.clone();
    for (index, (_, places, _)) in facets.iter().enumerate() {
        for &place in places {
            around[filled[place as usize] as usize] = index as u32;
            filled[place as usize] += 1;
        }
    }
    let vertices = facets.par_iter().flat_map_iter(|(corners, places, area)| {
        let own = area.normalize_or_zero();
        let normals = places.map(|place| {
            let around = &around[starts[place as usize] as usize..starts[place as usize + 1] as usize];
            if around.len() > MOST_AROUND {
                return own;
            }
            let areas = around.iter().map(|&facet| facets[facet as usize].2);
            // Facets of either winding lie on one surface.
            let alike = areas.filter_map(|area| {
                let aligned = area.normalize_or_zero().dot(own);
                (aligned.abs() >= SMOOTH).then_some(area * aligned.signum())
            });
            alike.sum::<Vec3>().normalize_or(own)
        });
        [0, 1, 2].map(|corner| Vertex::of_surface(positions[corners[corner] as usize], normals[corner], color))
    });
    let vertices: Vec<Vertex> = vertices.collect();
    let indices = (0..facets.len() as u32).map(|facet| [3 * facet, 3 * facet + 1, 3 * facet + 2]).collect();
    Triangles { vertices, indices }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(
            start in prop::sample::select(vec!["", "solid a\nfacet\nvertex 0 0 ", "v 0 0 0\nv 1 1 1\nf 1 2 "]),
            bytes in prop::collection::vec(any::<u8>(), 0..300),
            count in 0_u8..6,
        ) {
            let mut content = [start.as_bytes(), &bytes].concat();
            if content.len() > 84 {
                content[80..84].copy_from_slice(&[count, 0, 0, 0]);
            }
            for parse in [stl::parse, obj::parse] {
                if let Ok(mesh) = parse(&content, 4) {
                    prop_assert!(mesh.triangles.len() <= 4);
                    let mut corners = mesh.triangles.iter().flatten();
                    prop_assert!(corners.all(|&corner| (corner as usize) < mesh.vertices.len()));
                }
            }
        }
    }

    #[test]
    fn edges_stay_sharp_and_round_things_become_smooth() {
        // Two squares that meet at a right angle, and one that goes on nearly straight.
        let positions = [
            [0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [1.0, 0.0, 0.0],
            [1.0, 1.0, 0.0],
            [2.0, 0.0, 0.2],
            [2.0, 1.0, 0.2],
            [0.0, 0.0, 1.0],
            [0.0, 1.0, 1.0],
        ]
        .map(Vec3::from_array);
        let triangles = [[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5], [0, 1, 6], [1, 7, 6]];
        let smooth = smooth(&positions, &triangles, [1.0; 3]);
        let normal = |corner: usize| Vec3::from_array(smooth.vertices[corner].normal);
        assert!((normal(0) - Vec3::Z).length() < 1e-6, "the first square's own, at the edge");
        assert!(normal(12).abs_diff_eq(Vec3::X, 1e-6), "the upright one's own");
        let between = normal(1);
        assert!(between.x < -0.02 && between.x > -0.19 && between.z > 0.98, "{between}");
    }
}
