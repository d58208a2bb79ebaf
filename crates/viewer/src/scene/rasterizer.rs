//! Triangles into pixels: for each the colour of the nearest one, and where along the pixel's ray it lies.
//!
//! The rules are those of GPUs: corners lie on a raster of 1/256 of a pixel, and a pixel belongs to a triangle when its
//! middle lies inside or on an upper or left edge, so that triangles that share an edge leave no gap and draw no pixel
//! twice.
//!
//! Source: Pineda, A parallel algorithm for polygon rasterization, 1988; the fill rule is that of Vulkan and Direct3D.

use glam::{I64Vec2, Vec2, Vec3};
use rayon::prelude::*;

use super::projection::{NEAR, PixelProjection, pixel_middle};
use super::triangles::{Triangles, Vertex};
use crate::frame::Frame;
use crate::reference::shading::Lighting;

/// Parts of a pixel that corners lie on.
const SUBPIXELS: i64 = 256;
/// Rows of pixels that are drawn as one.
const BAND: usize = 16;
/// Triangles are cut off this far outside, in half pictures, so that whole numbers hold their corners.
const GUARD: f32 = 100.0;

/// What a pixel shows of opaque geometry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpaquePixel {
    /// Red, green, blue, lit.
    pub color: Vec3,
    /// Where along the pixel's ray it lies, in multiples of `L_min`; infinite where there is nothing.
    pub along: f32,
}

impl OpaquePixel {
    /// Nothing.
    pub const NONE: Self = Self { color: Vec3::ZERO, along: f32::INFINITY };

    /// Whether there is something.
    #[must_use]
    pub fn is_some(&self) -> bool {
        self.along < f32::INFINITY
    }
}

/// The nearest of all triangles in every pixel, the top row first; among equally near ones the first.
#[must_use]
pub fn rasterize(parts: &[&Triangles], frame: &Frame) -> Vec<OpaquePixel> {
    let [width, height] = frame.image_size.map(|side| side as usize);
    let mut pixels = vec![OpaquePixel::NONE; width * height];
    for part in parts {
        draw(&mut pixels, part, frame);
    }
    pixels
}

fn draw(pixels: &mut [OpaquePixel], triangles: &Triangles, frame: &Frame) {
    let projection = PixelProjection::from(frame);
    let vertices = triangles.vertices.par_iter();
    let corners: Vec<Vec3> = vertices.map(|vertex| projection.project(Vec3::from_array(vertex.position))).collect();
    let indices = triangles.indices.par_iter().enumerate();
    let pieces = indices.flat_map_iter(|(index, triangle)| {
        let corners = triangle.map(|corner| corners[corner as usize]);
        pieces(corners, projection.is_perspective, frame.image_size)
            .into_iter()
            .map(move |corners| Piece { corners, triangle: index as u32 })
    });
    let pieces: Vec<Piece> = pieces.collect();
    let [width, height] = frame.image_size;
    let mut bands = vec![Vec::new(); (height as usize).div_ceil(BAND)];
    for (index, piece) in pieces.iter().enumerate() {
        if let Some([first, last]) = piece.range(1, height) {
            for band in &mut bands[first as usize / BAND..=last as usize / BAND] {
                band.push(index as u32);
            }
        }
    }
    let bands = bands.into_par_iter().enumerate();
    pixels.par_chunks_mut(width as usize * BAND).zip(bands).for_each(|(pixels, (band, list))| {
        let nearest = Nearest { triangles, corners: &corners, frame };
        nearest.draw_band(pixels, (band * BAND) as u32, list.iter().map(|&piece| &pieces[piece as usize]));
    });
}

/// A triangle on the raster, or a part of one that is cut off outside the picture; clockwise, y downwards.
#[derive(Clone, Copy)]
struct Piece {
    corners: [I64Vec2; 3],
    triangle: u32,
}

impl Piece {
    /// The first and last pixel along an axis whose middle may lie inside; `None` where there is none below `end`.
    fn range(&self, axis: usize, end: u32) -> Option<[u32; 2]> {
        let [a, b, c] = self.corners.map(|corner| corner[axis]);
        let (least, most) = (a.min(b).min(c), a.max(b).max(c));
        let first = (least + SUBPIXELS / 2 - 1).div_euclid(SUBPIXELS).max(0);
        let last = (most - SUBPIXELS / 2).div_euclid(SUBPIXELS).min(i64::from(end) - 1);
        (first <= last).then_some([first as u32, last as u32])
    }
}

/// A triangle's parts on the raster: as a rule one.
fn pieces(corners: [Vec3; 3], is_perspective: bool, image_size: [u32; 2]) -> Vec<[I64Vec2; 3]> {
    if corners.iter().any(|corner| !corner.is_finite()) {
        return Vec::new();
    }
    let is_inside = |corner: &Vec3| {
        let room = GUARD * corner.z;
        (!is_perspective || corner.z >= NEAR) && corner.x.abs() <= room && corner.y.abs() <= room
    };
    let outline = if corners.iter().all(is_inside) { corners.to_vec() } else { cut_off(&corners, is_perspective) };
    let on_raster = |corner: &Vec3| {
        // Where a corner is so far away that all digits are lost, at least within the whole numbers' room.
        let place = Vec2::new(corner.x, -corner.y) / corner.z;
        let place = 0.5 * place.clamp(Vec2::splat(-GUARD), Vec2::splat(GUARD)) + 0.5;
        let [width, height] = image_size.map(|side| side as f32);
        (place * Vec2::new(width, height) * SUBPIXELS as f32).round().as_i64vec2()
    };
    let outline: Vec<I64Vec2> = outline.iter().map(on_raster).collect();
    let fans = (2..outline.len()).map(|last| [outline[0], outline[last - 1], outline[last]]);
    let clockwise = fans.filter_map(|[a, b, c]| match side(a, b, c) {
        0 => None,
        area if area > 0 => Some([a, b, c]),
        _ => Some([a, c, b]),
    });
    let is_seen = |corners: &[I64Vec2; 3]| {
        let piece = Piece { corners: *corners, triangle: 0 };
        (0..2).all(|axis| piece.range(axis, image_size[axis]).is_some())
    };
    clockwise.filter(is_seen).collect()
}

/// What of an outline lies in front of the eye and not too far outside the picture.
///
/// Source: Sutherland and Hodgman, Reentrant polygon clipping, 1974.
fn cut_off(corners: &[Vec3], is_perspective: bool) -> Vec<Vec3> {
    let near = Vec3::new(0.0, 0.0, 1.0);
    let sides = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y].map(|side| (side + GUARD * near, 0.0));
    let planes = is_perspective.then_some((near, NEAR)).into_iter().chain(sides);
    planes.fold(corners.to_vec(), |outline, (normal, limit)| {
        let ends = outline.iter().zip(outline.iter().cycle().skip(1));
        let mut kept = Vec::with_capacity(outline.len() + 1);
        for (&start, &end) in ends {
            let [at_start, at_end] = [start, end].map(|corner| normal.dot(corner) - limit);
            if at_start >= 0.0 {
                kept.push(start);
            }
            if (at_start >= 0.0) != (at_end >= 0.0) {
                kept.push(start + at_start / (at_start - at_end) * (end - start));
            }
        }
        kept
    })
}

/// Twice the area of a triangle: positive where `place` lies to the right of the way from `a` to `b`, y downwards.
fn side(a: I64Vec2, b: I64Vec2, place: I64Vec2) -> i64 {
    (b - a).perp_dot(place - a)
}

/// Finds the nearest triangle in every pixel of a band.
struct Nearest<'a> {
    triangles: &'a Triangles,
    /// As the projection gives them.
    corners: &'a [Vec3],
    frame: &'a Frame,
}

/// A triangle in a pixel, and how much of each corner.
#[derive(Clone, Copy)]
struct Hit {
    triangle: u32,
    weights: Vec3,
}

impl Nearest<'_> {
    fn draw_band<'p>(&self, pixels: &mut [OpaquePixel], first_row: u32, pieces: impl Iterator<Item = &'p Piece>) {
        let [width, height] = self.frame.image_size;
        let mut hits = vec![None; pixels.len()];
        for piece in pieces {
            let (Some(columns), Some([first, last])) = (piece.range(0, width), piece.range(1, height)) else {
                continue;
            };
            for y in first.max(first_row)..=last.min(first_row + BAND as u32 - 1) {
                let row = (y - first_row) as usize * width as usize;
                for x in covered(piece, columns, y) {
                    let at = row + x as usize;
                    if let Some((hit, along)) = self.hit(piece.triangle, [x, y])
                        && along < pixels[at].along
                    {
                        pixels[at].along = along;
                        hits[at] = Some(hit);
                    }
                }
            }
        }
        for (at, (pixel, hit)) in pixels.iter_mut().zip(hits).enumerate() {
            if let Some(hit) = hit {
                let (x, y) = (at % width as usize, at / width as usize);
                pixel.color = self.color(hit, [x as u32, first_row + y as u32]);
            }
        }
    }

    /// Where a triangle lies along a pixel's ray, unless that is cut away.
    fn hit(&self, triangle: u32, pixel: [u32; 2]) -> Option<(Hit, f32)> {
        let frame = self.frame;
        let indices = self.triangles.indices[triangle as usize];
        let weights =
            weights(indices.map(|index| self.corners[index as usize]), pixel_middle(pixel, frame.image_size))?;
        let vertices = indices.map(|index| self.triangles.vertices[index as usize]);
        let position = mix(weights, vertices.map(|vertex| vertex.position));
        let is_cut = |plane: &glam::Vec4| plane.truncate().dot(position) > plane.w;
        if vertices[0].is_cut() && frame.planes[..frame.plane_count as usize].iter().any(is_cut) {
            return None;
        }
        let ray = frame.ray(pixel[0], pixel[1]);
        let along = (position - ray.origin).dot(ray.direction);
        (along > 0.0).then_some((Hit { triangle, weights }, along))
    }

    fn color(&self, Hit { triangle, weights }: Hit, pixel: [u32; 2]) -> Vec3 {
        let frame = self.frame;
        let vertices: [Vertex; 3] =
            self.triangles.indices[triangle as usize].map(|index| self.triangles.vertices[index as usize]);
        let normal = mix(weights, vertices.map(|vertex| vertex.normal)).normalize_or_zero();
        let color = mix(weights, vertices.map(|vertex| [0, 1, 2].map(|axis| f32::from(vertex.color[axis]) / 255.0)));
        Lighting::new(-frame.ray(pixel[0], pixel[1]).direction, frame.light, &frame.shading).shade(color, normal)
    }
}

/// The pixels of a row whose middles lie inside.
fn covered(piece: &Piece, [first, last]: [u32; 2], y: u32) -> impl Iterator<Item = u32> {
    let middle = |pixel: u32| i64::from(pixel) * SUBPIXELS + SUBPIXELS / 2;
    let [a, b, c] = piece.corners;
    let start = I64Vec2::new(middle(first), middle(y));
    let edges = [(a, b), (b, c), (c, a)].map(|(from, to)| {
        let way = to - from;
        let is_upper_or_left = way.y < 0 || (way.y == 0 && way.x > 0);
        // What lies on any other edge belongs to the triangle beside it.
        (side(from, to, start) - i64::from(!is_upper_or_left), -way.y * SUBPIXELS)
    });
    (first..=last).filter(move |x| edges.iter().all(|(at_first, slope)| at_first + i64::from(x - first) * slope >= 0))
}

/// How much of each corner, in space, there is at a place in the picture; `None` where a triangle is seen edge on.
fn weights(corners: [Vec3; 3], place: Vec2) -> Option<Vec3> {
    // Seen from the place itself, so that no digits are lost on small triangles.
    let [a, b, c] = corners.map(|corner| corner.truncate() - corner.z * place);
    let areas = Vec3::new(b.perp_dot(c), c.perp_dot(a), a.perp_dot(b));
    // The raster's inside may reach a little beyond the triangle.
    let inside = (areas * areas.element_sum().signum()).max(Vec3::ZERO);
    let sum = inside.element_sum();
    (sum > 0.0).then(|| inside / sum)
}

fn mix(weights: Vec3, [a, b, c]: [[f32; 3]; 3]) -> Vec3 {
    weights.x * Vec3::from_array(a) + weights.y * Vec3::from_array(b) + weights.z * Vec3::from_array(c)
}
