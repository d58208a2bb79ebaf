//! Rays beside each other: each goes on until a few of its samples wait, then all that wait are worked out side by side.

use fearless_simd::Simd;
use glam::{Vec3, Vec4};

use super::batch::{Batch, Question, Ways};
use super::lanes::LANES;
use super::occlusion::Darkening;
use super::rays::{Pixels, Rays, Skipping, Space};
use super::sampling::RoleSample;
use super::shading::Lighting;
use super::{RayMarcher, SampleCounts};
use crate::PixelLight;
use crate::frame::Ray;
use crate::scene::OpaquePixel;

/// Pixels along a side of a tile.
pub(super) const TILE: usize = 16;
/// Pixels along a side of the squares whose rays go side by side.
const SQUARE: usize = 4;

/// Rows of pixels, tile by tile: rays beside each other read the same voxels.
pub(super) struct Tiles<'a, S: Simd> {
    marcher: &'a RayMarcher<'a>,
    space: Space<'a>,
    question: Question<'a>,
    rays: Vec<Rays<S>>,
    ways: Ways,
    batch: Batch,
    /// What each ray has gathered.
    lights: Vec<PixelLight>,
}

impl<'a, S: Simd> Tiles<'a, S> {
    pub(super) fn new(marcher: &'a RayMarcher<'a>) -> Self {
        let (occupancy, active) = (marcher.tables.occupancy(), marcher.active.as_ref());
        let keeps_own = marcher.tables.occlusion().is_some() || marcher.frame.plane_count > 0;
        Self {
            marcher,
            space: Space {
                sampler: marcher.sampler(),
                skipping: occupancy.map(|occupancy| Skipping { occupancy, active }),
            },
            question: Question { by_value: marcher.by_value(), keeps_own },
            rays: Vec::new(),
            ways: Ways::default(),
            batch: Batch::default(),
            lights: Vec::new(),
        }
    }

    /// The light of the tile whose left upper pixel is `first` of a picture; of `rows` of its pixels, which begin with the tile's
    /// first row, and opaque geometry in them.
    #[inline(always)]
    pub(super) fn draw(
        &mut self,
        simd: S,
        first: [usize; 2],
        rows: &mut [PixelLight],
        opaque: &[OpaquePixel],
    ) -> SampleCounts {
        let width = self.marcher.frame.image_size[0] as usize;
        let height = rows.len() / width;
        let mut counts = SampleCounts::default();
        self.rays.clear();
        for square in 0..(TILE / SQUARE).pow(2) {
            let mut pixels = Pixels { places: [[0; LANES]; 2], are_there: 0, opaque: [f32::INFINITY; LANES] };
            for lane in 0..LANES {
                let [x, y] = place(square, lane);
                if first[0] + x < width && y < height {
                    pixels.places[0][lane] = (first[0] + x) as u32;
                    pixels.places[1][lane] = (first[1] + y) as u32;
                    pixels.are_there |= 1 << lane;
                    pixels.opaque[lane] = opaque.get(y * width + first[0] + x).unwrap_or(&OpaquePixel::NONE).along;
                }
            }
            let rays = Rays::new(simd, &self.marcher.frame, &pixels, &mut counts.all);
            rays.store(simd, &mut self.ways, square * LANES);
            self.rays.push(rays);
        }
        self.lights.clear();
        self.lights.resize(TILE * TILE, PixelLight::NONE);
        counts.taken = self.follow(simd);
        for (ray, &PixelLight { mut light, mut depth }) in self.lights.iter().enumerate() {
            let [x, y] = place(ray / LANES, ray % LANES);
            if first[0] + x < width && y < height {
                let pixel = y * width + first[0] + x;
                if let Some(opaque) = opaque.get(pixel).filter(|opaque| opaque.is_some()) {
                    light += (1.0 - light.w) * opaque.color.extend(1.0);
                    depth = if depth.is_nan() { opaque.along } else { depth };
                }
                rows[pixel] = PixelLight { light, depth };
            }
        }
        counts
    }

    /// Follows all rays to their ends; how many samples that takes.
    #[inline(always)]
    fn follow(&mut self, simd: S) -> u64 {
        let mut taken = 0;
        loop {
            self.batch.clear();
            for (sixteen, rays) in self.rays.iter_mut().enumerate() {
                if rays.any_goes_on() {
                    taken += rays.advance(simd, &self.space, sixteen * LANES, &mut self.batch);
                }
            }
            if self.batch.len() == 0 {
                return taken;
            }
            self.batch.work_out(simd, &self.space.sampler, &self.question, &self.ways);
            for sample in 0..self.batch.len() {
                self.add(simd, sample);
            }
        }
    }

    /// Adds a sample to its ray.
    #[inline(always)]
    fn add(&mut self, simd: S, sample: usize) {
        let frame = &self.marcher.frame;
        let ray = self.batch.ray(sample);
        let PixelLight { light, depth } = &mut self.lights[ray];
        let mut lit = self.batch.light(sample);
        // Nothing behind would be seen, though some of it may have been worked out.
        if lit.w <= 0.0 || light.w > frame.termination_opacity {
            return;
        }
        let [along, step] = self.batch.step(sample);
        let rays = &mut self.rays[ray / LANES];
        if self.question.keeps_own {
            let [origin, direction] =
                [&self.ways.origins, &self.ways.directions].map(|rows| Vec4::from_array(rows[ray]));
            let way = Ray { origin: origin.truncate(), direction: direction.truncate() };
            let lighting = Lighting::new(-way.direction, frame.light, &frame.shading);
            let RoleSample { mut color, normal, .. } = self.batch.own(sample);
            if let Some(occlusion) = self.marcher.tables.occlusion() {
                color *= Darkening::new(occlusion, frame, &way).light_at(along);
            }
            let mut shaded = lighting.shade(color, normal);
            let cut = rays.cut(ray % LANES);
            if cut != Vec3::ZERO {
                // A face that was cut is lit as such.
                let face = rays.share_of_face(simd, frame, ray % LANES, along, step);
                shaded = shaded.lerp(lighting.shade(color, cut), face);
            }
            lit = shaded.extend(lit.w);
        }
        *light += (1.0 - light.w) * lit.w * lit.truncate().extend(1.0);
        if depth.is_nan() && light.w >= 0.5 {
            *depth = along;
        }
        if light.w > frame.termination_opacity {
            rays.end(simd, 1 << (ray % LANES));
        }
    }
}

/// Where in its tile the pixel of a lane lies.
#[inline(always)]
fn place(square: usize, lane: usize) -> [usize; 2] {
    const ACROSS: usize = TILE / SQUARE;
    [square % ACROSS * SQUARE + lane % SQUARE, square / ACROSS * SQUARE + lane / SQUARE]
}
