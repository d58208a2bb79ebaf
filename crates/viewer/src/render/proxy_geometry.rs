//! Polygons that slices are drawn on: a volume's box cut by planes, as triangles in drawing order.
//!
//! A plane meets the edges of a box in six places at most. They are sorted around their middle by a pseudo-angle, a
//! quotient that grows with the angle (Moret and Shapiro, Algorithms from P to NP, 1991; in volume rendering: Ikits,
//! Kniss, Lefohn and Hansen, GPU Gems, chapter 39, 2004), and what planes cut away of the polygon is clipped off
//! (Sutherland and Hodgman, Reentrant polygon clipping, 1974). Polygons are a little larger than what they show: which
//! pixels a slice reaches is decided in each pixel, by the same numbers as on the CPU.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3, Vec4};

use crate::frame::{Frame, PixelRays};
use crate::slicing::{NEAR, Slicing};

/// By how much polygons reach beyond the picture, as a share of its half.
const MARGIN: f32 = 0.1;

/// A corner of a triangle as the vertex shader reads it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SliceVertex {
    /// Homogeneous place in the picture: x to the right and y up, from −1 to 1.
    pub position: [f32; 4],
    /// The number of its slice's slab.
    pub number: f32,
}

/// The slices of a frame, those at the back first.
pub struct ProxyGeometry {
    slicing: Slicing,
    rays: PixelRays,
    corners: [Vec3; 8],
    half_spaces: Vec<Vec4>,
    basis: [Vec3; 2],
    /// The slabs that are not yet drawn.
    next: [i32; 2],
    /// Where the eye is, as a number.
    eye: f32,
    polygon: Vec<Vec3>,
    clipped: Vec<Vec3>,
}

impl ProxyGeometry {
    /// Those of `slicing`, which is the frame's.
    #[must_use]
    pub fn new(frame: &Frame, slicing: &Slicing) -> Self {
        let rays = frame.rays;
        let extent = frame.box_high - frame.box_low;
        let slack = 2.0 * NEAR + 1e-5 * (rays.origin.length() + extent.length());
        let (low, high) = (frame.box_low - slack, frame.box_high + slack);
        let corners = std::array::from_fn(|corner| {
            let is_high = |axis: usize| corner >> axis & 1 == 1;
            Vec3::from_array(std::array::from_fn(|axis| if is_high(axis) { high[axis] } else { low[axis] }))
        });
        let numbers = corners.map(|corner| slicing.number(corner));
        let first = numbers.iter().copied().fold(f32::INFINITY, f32::min);
        let last = numbers.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let next = [(first - 0.5).ceil() as i32, (last - 0.5).floor() as i32];
        let mut half_spaces: Vec<_> =
            frame.planes[..frame.plane_count as usize].iter().map(|plane| plane + Vec4::W * slack).collect();
        let is_perspective = rays.origin_right == Vec3::ZERO;
        half_spaces.extend(visible(&rays));
        let eye = if is_perspective {
            slicing.number(rays.origin)
        } else if slicing.growth.dot(rays.direction) > 0.0 {
            next[0] as f32
        } else {
            next[1] as f32 + 1.0
        };
        let (right, up) = slicing.growth.normalize_or(Vec3::Z).any_orthonormal_pair();
        let (polygon, clipped) = (Vec::new(), Vec::new());
        Self { slicing: *slicing, rays, corners, half_spaces, basis: [right, up], next, eye, polygon, clipped }
    }

    /// Adds the triangles of the next slices, until there are at least `count` corners more or nothing is left to draw.
    pub fn add_triangles(&mut self, count: usize, vertices: &mut Vec<SliceVertex>) {
        let enough = vertices.len() + count;
        while self.next[0] <= self.next[1] && vertices.len() < enough {
            // From both ends towards the eye, which may be between them.
            let [low, high] = self.next.map(|number| number as f32);
            let number = if (low + 0.5 - self.eye).abs() > (high + 0.5 - self.eye).abs() {
                self.next[0] += 1;
                low
            } else {
                self.next[1] -= 1;
                high
            };
            self.slice(number + 0.5);
            self.add_fan(number, vertices);
        }
    }

    /// Whether a slice lies where numbers are larger than the eye's.
    #[must_use]
    pub fn is_beyond_eye(&self, number: f32) -> bool {
        number + 0.5 > self.eye
    }

    /// Makes the polygon of all places with a number that are drawn.
    fn slice(&mut self, number: f32) {
        let heights = self.corners.map(|corner| self.slicing.number(corner) - number);
        self.polygon.clear();
        for (start, end) in (0..8).flat_map(|corner| [1, 2, 4].map(|axis| (corner, corner | axis))) {
            if start != end && (heights[start] < 0.0) != (heights[end] < 0.0) {
                let share = heights[start] / (heights[start] - heights[end]);
                self.polygon.push(self.corners[start].lerp(self.corners[end], share));
            }
        }
        if self.polygon.len() < 3 {
            self.polygon.clear();
            return;
        }
        let middle = self.polygon.iter().sum::<Vec3>() / self.polygon.len() as f32;
        let [right, up] = self.basis;
        let angle = |corner: &Vec3| {
            let from_middle = corner - middle;
            pseudo_angle(Vec2::new(right.dot(from_middle), up.dot(from_middle)))
        };
        self.polygon.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        for half_space in &self.half_spaces {
            clip(&self.polygon, *half_space, &mut self.clipped);
            std::mem::swap(&mut self.polygon, &mut self.clipped);
        }
    }

    fn add_fan(&self, number: f32, vertices: &mut Vec<SliceVertex>) {
        let [first, rest @ ..] = self.polygon.as_slice() else { return };
        let vertex = |corner| SliceVertex { position: project(&self.rays, corner).to_array(), number };
        for pair in rest.windows(2) {
            vertices.extend([*first, pair[0], pair[1]].map(vertex));
        }
    }
}

/// Grows with a vector's angle to x, from 0 to 4 for a full turn.
fn pseudo_angle(Vec2 { x, y }: Vec2) -> f32 {
    let length = x.abs() + y.abs();
    let tangent = if length > 0.0 { y / length } else { 0.0 };
    if x < 0.0 {
        2.0 - tangent
    } else if y < 0.0 {
        4.0 + tangent
    } else {
        tangent
    }
}

/// What of a convex polygon lies where the product with the normal is at most the limit.
fn clip(polygon: &[Vec3], half_space: Vec4, clipped: &mut Vec<Vec3>) {
    clipped.clear();
    let height = |corner: Vec3| half_space.truncate().dot(corner) - half_space.w;
    let Some(&(mut start)) = polygon.last() else { return };
    for &end in polygon {
        let heights = [height(start), height(end)];
        if (heights[0] > 0.0) != (heights[1] > 0.0) {
            clipped.push(start.lerp(end, heights[0] / (heights[0] - heights[1])));
        }
        if heights[1] <= 0.0 {
            clipped.push(end);
        }
        start = end;
    }
}

/// What the picture shows, and a little more: a corner far outside would leave a polygon's edges imprecise.
fn visible(rays: &PixelRays) -> Vec<Vec4> {
    let at_origin = |normal: Vec3, limit: f32| normal.extend(normal.dot(rays.origin) + limit);
    let mut half_spaces = Vec::new();
    for (origin, direction) in [(rays.origin_right, rays.direction_right), (rays.origin_up, rays.direction_up)] {
        for sign in [-1.0, 1.0] {
            if origin == Vec3::ZERO {
                let side = sign * direction / direction.length_squared();
                half_spaces.push(at_origin(side - (1.0 + MARGIN) * rays.direction, 0.0));
            } else {
                half_spaces.push(at_origin(sign * origin / origin.length_squared(), 1.0 + MARGIN));
            }
        }
    }
    if rays.origin_right == Vec3::ZERO {
        half_spaces.push(at_origin(-rays.direction, -0.5 * NEAR));
    }
    half_spaces
}

/// Where in the picture a place is seen.
fn project(rays: &PixelRays, place: Vec3) -> Vec4 {
    let from_origin = place - rays.origin;
    // Either origins or directions move across the picture.
    let (right, up) = (rays.origin_right + rays.direction_right, rays.origin_up + rays.direction_up);
    let is_perspective = rays.origin_right == Vec3::ZERO;
    let depth = if is_perspective { from_origin.dot(rays.direction) / rays.direction.length_squared() } else { 1.0 };
    let along = |side: Vec3| from_origin.dot(side) / side.length_squared();
    Vec4::new(along(right), along(up), 0.0, depth)
}

#[cfg(test)]
mod tests {
    use voxrole_pack::{GridGeometry, HitGradientQuantization, Precision};

    use super::*;
    use crate::ViewState;
    use crate::classify::EmphasisTable;
    use crate::state::{Camera, ClipPlane, Projection, Technique};
    use crate::volume::VolumeDescription;

    fn frame(technique: Technique, camera: Camera, planes: &[ClipPlane]) -> Frame {
        let geometry = GridGeometry::axis_aligned([21, 14, 9], [1.0, 1.5, 2.5]);
        let hit_gradient = HitGradientQuantization::new(0.0, 1.0, Precision::default());
        let volume = VolumeDescription::new(&geometry, 15.0, [0.0, 1.0], hit_gradient);
        let mut state = ViewState { camera, ..ViewState::default() };
        state.render_settings.technique = technique;
        state.clipping.planes = planes.to_vec();
        Frame::new(&state, &volume, &EmphasisTable::new(&state.transfer_function), [40, 30])
    }

    fn cameras() -> Vec<Camera> {
        let mut cameras = Vec::new();
        for projection in [Projection::Perspective, Projection::Orthographic] {
            for (azimuth, elevation, zoom) in
                [(0.0, 0.0, 1.0), (30.0, 20.0, 1.0), (-120.0, 70.0, 2.0), (45.0, 30.0, 8.0)]
            {
                cameras.push(Camera { azimuth, elevation, zoom, projection, ..Camera::default() });
            }
        }
        cameras
    }

    #[test]
    fn pseudo_angles_grow_with_angles() {
        let angles: Vec<f32> = (0..360)
            .map(|degrees| f64::from(degrees).to_radians().sin_cos())
            .map(|(sin, cos)| pseudo_angle(Vec2::new(3.0 * cos as f32, 3.0 * sin as f32)))
            .collect();
        assert!(angles.windows(2).all(|pair| pair[1] > pair[0]) && angles[359] < 4.0, "{angles:?}");
        assert_eq!(pseudo_angle(Vec2::ZERO), 0.0);
    }

    #[test]
    fn places_are_seen_where_their_rays_go() {
        for camera in cameras() {
            let frame = frame(Technique::Slices, camera, &[]);
            for (x, y) in [(0, 0), (39, 29), (17, 3)] {
                let ray = frame.ray(x, y);
                let seen = project(&frame.rays, ray.origin + 20.0 * ray.direction);
                let place = Vec2::new(seen.x / seen.w * 20.0 + 20.0, 15.0 - seen.y / seen.w * 15.0);
                let expected = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                assert!((place - expected).length() < 1e-3, "{place} is not {expected}");
            }
        }
    }

    #[test]
    fn clipping_a_square_leaves_what_is_inside() {
        let square = [Vec3::ZERO, Vec3::X, Vec3::ONE - Vec3::Z, Vec3::Y];
        let mut clipped = Vec::new();
        clip(&square, Vec3::ONE.extend(1.5), &mut clipped);
        assert_eq!(clipped.len(), 5);
        assert!(clipped.iter().all(|corner| corner.element_sum() <= 1.5));
        clip(&square, Vec3::X.extend(-0.1), &mut clipped);
        assert!(clipped.is_empty());
    }

    /// Slices are convex, lie where their numbers say, have a corner more for each plane at most, and come back to
    /// front.
    #[test]
    fn slices_are_convex_polygons_from_back_to_front() {
        let plane = ClipPlane { azimuth: 60.0, elevation: 10.0, offset: 0.2 };
        for (technique, camera, planes) in [Technique::Slices, Technique::Stacks]
            .into_iter()
            .flat_map(|technique| cameras().into_iter().map(move |camera| (technique, camera)))
            .flat_map(|(technique, camera)| [vec![], vec![plane]].map(|planes| (technique, camera, planes)))
        {
            let frame = frame(technique, camera, &planes);
            let slicing = frame.slicing.expect("slices");
            let mut geometry = ProxyGeometry::new(&frame, &slicing);
            let (mut farthest, mut drawn) = (f32::INFINITY, 0);
            while geometry.next[0] <= geometry.next[1] {
                let mut vertices = Vec::new();
                geometry.add_triangles(1, &mut vertices);
                let Some(vertex) = vertices.first() else { continue };
                drawn += 1;
                let distance = (vertex.number + 0.5 - geometry.eye).abs();
                assert!(distance <= farthest, "{distance} after {farthest}");
                farthest = distance;
                assert!(vertices.len() <= 3 * (4 + geometry.half_spaces.len()), "{} corners", vertices.len());
                let corners = &geometry.polygon;
                let normal = slicing.growth.normalize();
                for index in 0..corners.len() {
                    let [a, b, c] = [0, 1, 2].map(|next| corners[(index + next) % corners.len()]);
                    assert!((slicing.number(a) - vertex.number - 0.5).abs() < 1e-3);
                    let turn = (b - a).cross(c - b).dot(normal);
                    assert!(turn * geometry.basis[0].cross(geometry.basis[1]).dot(normal) > -1e-3, "{turn}");
                }
            }
            assert!(drawn > 10, "{drawn} slices");
        }
    }
}
