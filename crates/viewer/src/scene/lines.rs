//! What faces the camera: the edges of boxes and the world's axes, as wide on the picture wherever they are.

use glam::Vec3;

use super::projection::{NEAR, PixelProjection};
use super::triangles::{Triangles, Vertex};
use crate::frame::{Frame, drawn_box};
use crate::state::{Crop, ViewState};
use crate::volume::VolumeDescription;

/// Width of an edge as a share of the picture's shorter side; arrows are twice as wide.
const WIDTH: f32 = 1.0 / 400.0;
/// Least width of an edge in pixels: narrower ones have gaps.
const LEAST_WIDTH: f32 = 1.5;
/// Length of the axes as a share of the box's diagonal.
const AXIS_LENGTH: f32 = 0.3;
/// Length and radius of an arrow's head as shares of its length.
const HEAD: [f32; 2] = [0.2, 0.06];
/// Sides of an arrow's head.
const HEAD_SIDES: u32 = 24;
/// x red, y green, z blue.
const AXIS_COLORS: [[f32; 3]; 3] = [[0.94, 0.27, 0.23], [0.3, 0.75, 0.3], [0.3, 0.52, 1.0]];

/// The lines of a scene as this frame sees them.
#[must_use]
pub fn lines(state: &ViewState, volume: &VolumeDescription, frame: &Frame) -> Triangles {
    let mut lines = Lines::new(frame);
    let whole = drawn_box(volume.dims, Vec3::from_array(volume.relative_spacing()));
    if state.scene.bounding_box {
        let ink = readable_on(frame.background);
        lines.push_box(whole, ink);
        if state.clipping.crop != Crop::default() {
            lines.push_box(kept_box(&state.clipping.crop, volume, whole), ink);
        }
    }
    if state.scene.axes {
        let axes_from_world = volume.axes_from_world();
        let length = AXIS_LENGTH * (whole[1] - whole[0]).length();
        let towards = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axes_from_world * axis);
        // The corner of least x + y + z in the world: along a grid that is only mirrored or relabelled the arrows
        // follow its edges.
        let diagonal = towards[0] + towards[1] + towards[2];
        let start = Vec3::select(diagonal.cmpge(Vec3::ZERO), whole[0], whole[1]);
        for (axis, color) in towards.into_iter().zip(AXIS_COLORS) {
            lines.push_arrow(start, length * axis, color);
        }
    }
    lines.triangles
}

/// A grey that is seen on a colour: light on dark, dark on light.
#[must_use]
pub fn readable_on(background: Vec3) -> [f32; 3] {
    let lightness = background.dot(Vec3::new(0.2126, 0.7152, 0.0722));
    [if lightness < 0.5 { 190.0 / 255.0 } else { 50.0 / 255.0 }; 3]
}

/// The box of voxels that is kept, as far as it lies inside the volume's own.
fn kept_box(crop: &Crop, volume: &VolumeDescription, [low, high]: [Vec3; 2]) -> [Vec3; 2] {
    let spacing = Vec3::from_array(volume.relative_spacing());
    [0, 1].map(|end| (Vec3::from_array(crop.faces().map(|ends| ends[end])) * spacing).clamp(low, high))
}

struct Lines {
    projection: PixelProjection,
    image_size: [u32; 2],
    /// Half of an edge's width in pixels.
    half_width: f32,
    triangles: Triangles,
}

impl Lines {
    fn new(frame: &Frame) -> Self {
        let image_size = frame.image_size;
        let width = (WIDTH * image_size[0].min(image_size[1]) as f32).max(LEAST_WIDTH);
        let projection = PixelProjection::from(frame);
        Self { projection, image_size, half_width: 0.5 * width, triangles: Triangles::default() }
    }

    fn push_box(&mut self, [low, high]: [Vec3; 2], color: [f32; 3]) {
        let corner = |bits: u32| {
            let side = |axis: usize| if bits >> axis & 1 == 0 { low[axis] } else { high[axis] };
            Vec3::new(side(0), side(1), side(2))
        };
        for (start, bit) in (0..8).flat_map(|bits| [1, 2, 4].map(|bit| (bits, bit))) {
            if start & bit == 0 {
                self.push_line(corner(start), corner(start | bit), self.half_width, color);
            }
        }
    }

    /// The front of a thin tube: a strip that faces the eye, half its width closer to it, so that a thick line hides a
    /// thin one in the same place. It reaches as far beyond its ends, so that lines that meet there have a corner.
    fn push_line(&mut self, start: Vec3, end: Vec3, half_width: f32, color: [f32; 3]) {
        let Some([start, end]) = self.before_the_eye([start, end]) else { return };
        let along = (end - start).normalize_or_zero();
        let ends = [(start, -along), (end, along)].map(|(place, outwards)| {
            let half = half_width * self.projection.pixel_width(self.projection.depth(place), self.image_size);
            let away = self.projection.direction_to(place);
            let across = along.cross(away).normalize_or_zero();
            (place + half * (outwards - away), half * across)
        });
        let [(start, across_start), (end, across_end)] = ends;
        let corners = [start - across_start, start + across_start, end + across_end, end - across_end];
        self.triangles.push_polygon(&corners.map(|corner| Vertex::uncut(corner, Vec3::ZERO, color)));
    }

    /// The part of a line in front of the eye.
    fn before_the_eye(&self, ends: [Vec3; 2]) -> Option<[Vec3; 2]> {
        let depths = ends.map(|end| self.projection.depth(end) - 2.0 * NEAR);
        let meets = || ends[0].lerp(ends[1], depths[0] / (depths[0] - depths[1]));
        match depths.map(|depth| depth >= 0.0) {
            _ if !self.projection.is_perspective => Some(ends),
            [true, true] => Some(ends),
            [true, false] => Some([ends[0], meets()]),
            [false, true] => Some([meets(), ends[1]]),
            [false, false] => None,
        }
    }

    /// A line with a cone at its end, which is lit.
    fn push_arrow(&mut self, start: Vec3, arrow: Vec3, color: [f32; 3]) {
        let [head_length, head_radius] = HEAD;
        let base = start + (1.0 - head_length) * arrow;
        self.push_line(start, base, 2.0 * self.half_width, color);
        let (length, tip) = (arrow.length(), start + arrow);
        let along = arrow / length;
        let (right, up) = along.any_orthonormal_pair();
        let radius = head_radius * length;
        let around = |step: u32| {
            let (sin, cos) = (std::f32::consts::TAU * step as f32 / HEAD_SIDES as f32).sin_cos();
            cos * right + sin * up
        };
        let rim: Vec<Vec3> = (0..HEAD_SIDES).map(|step| base + radius * around(step)).collect();
        for step in 0..HEAD_SIDES {
            let next = (step + 1) % HEAD_SIDES;
            let vertex = |place: Vec3, outwards: Vec3| {
                let normal = (outwards * head_length + along * head_radius).normalize();
                Vertex::uncut(place, normal, color)
            };
            let middle = (around(step) + around(next)).normalize();
            self.triangles.push_polygon(&[
                vertex(rim[step as usize], around(step)),
                vertex(rim[next as usize], around(next)),
                vertex(tip, middle),
            ]);
        }
        let bottom: Vec<Vertex> = rim.into_iter().map(|place| Vertex::uncut(place, along, color)).collect();
        self.triangles.push_polygon(&bottom);
    }
}
