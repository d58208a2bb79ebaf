//! The surface on which the value, trilinearly interpolated, is one number: surface nets, whose vertices lie on it.
//!
//! Every cell of eight voxels with values on both sides has one vertex: the mean of where its edges are crossed, moved
//! onto the surface of the interpolated value. Every crossed edge joins the vertices of the four cells around it. A
//! further layer of cells around the volume, in which values go on unchanged, takes the surface to the faces of the
//! box.
//!
//! Source: S. Gibson, Constrained elastic surface nets, 1998, without the relaxation that moves vertices off the
//! surface.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::triangles::{Triangles, Vertex};

/// Steps towards the surface of the interpolated value: each doubles the digits.
const STEPS: usize = 4;

/// Values on a grid.
pub struct ScalarField<F> {
    /// Number of voxels along x, y, z.
    pub dims: [u32; 3],
    /// Distance between voxels in the frame's space; voxel (0, 0, 0) lies at its origin.
    pub spacing: Vec3,
    /// The corners of the box that surfaces go on to.
    pub drawn_box: [Vec3; 2],
    /// The value of a voxel, by its number, x fastest.
    pub value: F,
}

/// The vertices in one layer of cells, by their cells: x fastest.
struct Layer {
    /// Where each row of cells begins, and where the last one ends.
    rows: Vec<usize>,
    /// Each vertex's cell along x.
    columns: Vec<u32>,
    vertices: Vec<Vertex>,
}

impl Layer {
    /// The number of a cell's vertex, which must have one.
    fn number(&self, x: u32, y: usize) -> usize {
        let (start, end) = (self.rows[y], self.rows[y + 1]);
        start + self.columns[start..end].partition_point(|&column| column < x)
    }
}

/// A surface as far as it was found, slice by slice of voxels.
pub struct SurfaceNet {
    level: f32,
    color: [f32; 3],
    most: usize,
    /// Layer 0 lies below the first voxels.
    layers: Vec<Layer>,
    /// How many vertices lie before each layer, and in all.
    offsets: Vec<u32>,
    quads: Vec<[u32; 4]>,
}

impl SurfaceNet {
    /// Nothing of a surface between values below `level` and all others, in one colour and of at most `most` triangles.
    #[must_use]
    pub fn new(level: f32, color: [f32; 3], most: usize) -> Self {
        Self { level, color, most, layers: Vec::new(), offsets: vec![0], quads: Vec::new() }
    }

    /// The slices whose values [`Self::extend`] asks for, of `depth` in all.
    #[must_use]
    pub fn needed(slices: &Range<usize>, depth: usize) -> Range<usize> {
        slices.start.saturating_sub(1)..(slices.end + 2).min(depth)
    }

    /// Goes on through the next slices of voxels, which begin where the last ones ended; `None` where the surface has too
    /// many triangles.
    pub fn extend<F: Fn(usize) -> f32 + Sync>(&mut self, field: &ScalarField<F>, slices: Range<usize>) -> Option<()> {
        let most = self.most / 2;
        let found = AtomicUsize::new(self.offsets[self.offsets.len() - 1] as usize);
        let layers = (self.layers.len()..slices.end + 1).into_par_iter().map(|layer| {
            let room = most.saturating_sub(found.load(Ordering::Relaxed));
            let layer = field.layer(layer as i32 - 1, self.level, self.color, room)?;
            let all = found.fetch_add(layer.vertices.len(), Ordering::Relaxed) + layer.vertices.len();
            (all <= most).then_some(layer)
        });
        for layer in layers.collect::<Option<Vec<Layer>>>()? {
            self.offsets.push(self.offsets[self.offsets.len() - 1] + layer.vertices.len() as u32);
            self.layers.push(layer);
        }
        let (layers, offsets, level) = (&self.layers, &self.offsets, self.level);
        let quads = slices.into_par_iter().flat_map_iter(|z| {
            let number = |[x, y, z]: [usize; 3]| offsets[z] + layers[z].number(x as u32, y) as u32;
            field.crossed_edges(z, level).into_iter().map(move |around| around.map(number)).collect::<Vec<_>>()
        });
        self.quads.par_extend(quads);
        Some(())
    }

    /// The surface that was found; `None` where it has too many triangles.
    #[must_use]
    pub fn finish(self) -> Option<Triangles> {
        let vertices: Vec<Vertex> = self.layers.into_iter().flat_map(|layer| layer.vertices).collect();
        let indices: Vec<[u32; 3]> = self.quads.into_par_iter().flat_map_iter(|quad| split(quad, &vertices)).collect();
        (indices.len() <= self.most).then_some(Triangles { vertices, indices })
    }
}

impl<F: Fn(usize) -> f32 + Sync> ScalarField<F> {
    /// The surface between values below `level` and all others, in one colour; `None` where it would have more than
    /// `most` triangles.
    #[must_use]
    pub fn surface(&self, level: f32, color: [f32; 3], most: usize) -> Option<Triangles> {
        let mut net = SurfaceNet::new(level, color, most);
        net.extend(self, 0..self.dims[2] as usize)?;
        net.finish()
    }

    /// The value of a voxel; outside, of the nearest one.
    fn at(&self, index: IVec3) -> f32 {
        let [width, height, depth] = self.dims.map(|dim| dim as i32);
        let [x, y, z] = index.clamp(IVec3::ZERO, IVec3::new(width - 1, height - 1, depth - 1)).to_array();
        let [width, height, x, y, z] = [width, height, x, y, z].map(|number| number as usize);
        (self.value)((z * height + y) * width + x)
    }

    /// The vertices of a layer of cells; `None` where there are more than `room`.
    fn layer(&self, z: i32, level: f32, color: [f32; 3], room: usize) -> Option<Layer> {
        let [width, height, _] = self.dims.map(|dim| dim as i32);
        let mut layer = Layer { rows: vec![0], columns: Vec::new(), vertices: Vec::new() };
        for y in -1..height {
            // The four values on the cell's side to higher x are those on the next one's to lower x.
            let column = |x: i32| [0, 1, 2, 3].map(|side| self.at(IVec3::new(x, y + (side & 1), z + (side >> 1))));
            let mut low = column(-1);
            for x in -1..width {
                let high = column(x + 1);
                let is_above = |value: &f32| *value >= level;
                let above = low.iter().chain(&high).filter(|value| is_above(value)).count();
                if above != 0 && above != 8 {
                    let corners = std::array::from_fn(|corner| [low, high][corner & 1][corner >> 1]);
                    layer.columns.push((x + 1) as u32);
                    layer.vertices.push(self.vertex(IVec3::new(x, y, z), &corners, level, color));
                }
                low = high;
            }
            layer.rows.push(layer.vertices.len());
            if layer.vertices.len() > room {
                return None;
            }
        }
        Some(layer)
    }

    /// The vertex of a cell by its lowest voxel and its corners' values, x fastest.
    fn vertex(&self, base: IVec3, corners: &[f32; 8], level: f32, color: [f32; 3]) -> Vertex {
        let mut fraction = mean_crossing(corners, level);
        let per_spacing = self.spacing.recip();
        for _ in 0..STEPS {
            let (value, slope) = interpolate(corners, fraction);
            // Straight towards the surface in space, which is not straight in indices where spacings differ.
            let gradient = slope * per_spacing;
            let squared = gradient.dot(gradient);
            if squared > 0.0 {
                fraction += (level - value) / squared * gradient * per_spacing;
                fraction = fraction.clamp(Vec3::ZERO, Vec3::ONE);
            }
        }
        let [box_low, box_high] = self.drawn_box;
        let position: [f32; 3] = std::array::from_fn(|axis| match base[axis] {
            -1 => box_low[axis],
            last if last + 1 == self.dims[axis] as i32 => box_high[axis],
            cell => (cell as f32 + fraction[axis]) * self.spacing[axis],
        });
        Vertex::of_surface(Vec3::from_array(position), self.normal(base, fraction), color)
    }

    /// The direction in which the value grows fastest: central differences, interpolated.
    fn normal(&self, base: IVec3, fraction: Vec3) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for corner in 0..8 {
            let offset = corner_offset(corner);
            let voxel = base + offset.as_ivec3();
            let weights = offset * fraction + (1.0 - offset) * (1.0 - fraction);
            let slope = [IVec3::X, IVec3::Y, IVec3::Z].map(|axis| self.at(voxel + axis) - self.at(voxel - axis));
            sum += weights.element_product() * Vec3::from_array(slope);
        }
        (sum / self.spacing).normalize_or_zero()
    }

    /// For every crossed edge that begins at a voxel of a layer, the four cells around it, one after another: their
    /// numbers, which are one above those of their lowest voxels.
    fn crossed_edges(&self, z: usize, level: f32) -> Vec<[[usize; 3]; 4]> {
        let [width, height, depth] = self.dims.map(|dim| dim as usize);
        let is_above = |x: usize, y: usize, z: usize| self.at(IVec3::new(x as i32, y as i32, z as i32)) >= level;
        let mut edges = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let here = is_above(x, y, z);
                if x + 1 < width && is_above(x + 1, y, z) != here {
                    edges.push([[x + 1, y, z], [x + 1, y + 1, z], [x + 1, y + 1, z + 1], [x + 1, y, z + 1]]);
                }
                if y + 1 < height && is_above(x, y + 1, z) != here {
                    edges.push([[x, y + 1, z], [x + 1, y + 1, z], [x + 1, y + 1, z + 1], [x, y + 1, z + 1]]);
                }
                if z + 1 < depth && is_above(x, y, z + 1) != here {
                    edges.push([[x, y, z + 1], [x + 1, y, z + 1], [x + 1, y + 1, z + 1], [x, y + 1, z + 1]]);
                }
            }
        }
        edges
    }
}

/// Two triangles, parted along the shorter diagonal.
fn split(quad: [u32; 4], vertices: &[Vertex]) -> [[u32; 3]; 2] {
    let [a, b, c, d] = quad.map(|index| Vec3::from_array(vertices[index as usize].position));
    let [first, second, third, fourth] = quad;
    if a.distance_squared(c) <= b.distance_squared(d) {
        [[first, second, third], [first, third, fourth]]
    } else {
        [[first, second, fourth], [second, third, fourth]]
    }
}

fn corner_offset(corner: usize) -> Vec3 {
    Vec3::new((corner & 1) as f32, (corner >> 1 & 1) as f32, (corner >> 2) as f32)
}

/// The mean of the places at which a cell's edges are crossed.
fn mean_crossing(corners: &[f32; 8], level: f32) -> Vec3 {
    let (mut sum, mut count) = (Vec3::ZERO, 0.0);
    for (start, bit) in (0..8).flat_map(|corner| [1, 2, 4].map(|bit| (corner, bit))) {
        let end = start | bit;
        if start != end && (corners[start] >= level) != (corners[end] >= level) {
            let along = (level - corners[start]) / (corners[end] - corners[start]);
            sum += corner_offset(start).lerp(corner_offset(end), along);
            count += 1.0;
        }
    }
    sum / f32::max(count, 1.0)
}

/// The value at a place in a cell, and by how much it grows along the cell's axes.
fn interpolate(corners: &[f32; 8], fraction: Vec3) -> (f32, Vec3) {
    let (mut value, mut slope) = (0.0, Vec3::ZERO);
    for (corner, at_corner) in corners.iter().enumerate() {
        let offset = corner_offset(corner);
        let weights = offset * fraction + (1.0 - offset) * (1.0 - fraction);
        let signs = 2.0 * offset - 1.0;
        value += weights.element_product() * at_corner;
        let others = Vec3::new(weights.y * weights.z, weights.x * weights.z, weights.x * weights.y);
        slope += signs * others * at_corner;
    }
    (value, slope)
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;

    /// Minus the distance from a place, in a grid of uneven voxels.
    fn cone(dims: [u32; 3], spacing: Vec3, middle: Vec3) -> ScalarField<impl Fn(usize) -> f32 + Sync> {
        let [width, height, _] = dims.map(|dim| dim as usize);
        let value = move |voxel: usize| {
            let index = [voxel % width, voxel / width % height, voxel / (width * height)].map(|index| index as f32);
            -(Vec3::from_array(index) * spacing - middle).length()
        };
        let last = Vec3::from_array(dims.map(|dim| dim as f32 - 1.0)) * spacing;
        ScalarField { dims, spacing, drawn_box: [Vec3::ZERO, last], value }
    }

    #[test]
    fn a_ball_is_closed_round_and_lit_from_its_middle() {
        let (spacing, middle) = (Vec3::new(1.0, 1.5, 2.0), Vec3::new(15.2, 14.9, 15.7));
        let surface = cone([32, 21, 17], spacing, middle).surface(-10.0, [1.0; 3], usize::MAX).expect("a surface");
        let mut edges = HashMap::new();
        for [a, b, c] in &surface.indices {
            for (start, end) in [(a, b), (b, c), (c, a)] {
                *edges.entry([start.min(end), start.max(end)]).or_insert(0) += 1;
            }
        }
        assert!(edges.values().all(|&sides| sides == 2), "every edge has two sides");
        let euler = surface.vertices.len() as i64 - edges.len() as i64 + surface.indices.len() as i64;
        assert_eq!(euler, 2);
        for Vertex { position, normal, .. } in &surface.vertices {
            let from_middle = Vec3::from_array(*position) - middle;
            // The interpolated value is too low by up to an eighth of the squared spacing over the radius: 0.09.
            let radius = from_middle.length();
            assert!((9.9..10.001).contains(&radius), "{radius}");
            let off = 1.0 - Vec3::from_array(*normal).dot(-from_middle / radius);
            assert!(off < 1e-3, "{off}");
        }
    }

    #[test]
    fn a_plane_reaches_the_faces_of_the_box() {
        for dims in [[8, 6, 5], [8, 6, 1]] {
            let mut field = ScalarField {
                dims,
                spacing: Vec3::ONE,
                drawn_box: [Vec3::ZERO, Vec3::from_array(dims.map(|dim| dim as f32 - 1.0))],
                value: |voxel: usize| (voxel % 8) as f32,
            };
            if dims[2] == 1 {
                (field.drawn_box[0].z, field.drawn_box[1].z) = (-0.5, 0.5);
            }
            let surface = field.surface(2.25, [1.0; 3], usize::MAX).expect("a surface");
            let area: f32 = surface
                .indices
                .iter()
                .map(|triangle| {
                    let [a, b, c] = triangle.map(|index| Vec3::from_array(surface.vertices[index as usize].position));
                    0.5 * (b - a).cross(c - a).length()
                })
                .sum();
            let extent = field.drawn_box[1] - field.drawn_box[0];
            assert!((area - extent.y * extent.z).abs() < 1e-4, "{dims:?}: {area}");
            assert!(surface.vertices.iter().all(|vertex| (vertex.position[0] - 2.25).abs() < 1e-5));
        }
    }

    #[test]
    fn too_many_triangles_are_refused() {
        let field = cone([16; 3], Vec3::ONE, Vec3::splat(7.5));
        let all = field.surface(-5.0, [1.0; 3], usize::MAX).expect("a surface").indices.len();
        assert!(field.surface(-5.0, [1.0; 3], all / 2).is_none());
        assert!(field.surface(-50.0, [1.0; 3], 0).expect("nothing").indices.is_empty());
    }
}
