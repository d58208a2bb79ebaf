//! Rays beside each other: each goes on by a few places, then all samples that wait are worked out side by side.

use fearless_simd::Simd;
use glam::{Vec3, Vec4};

use super::batch::{Batch, Question, Ways};
use super::lanes::LANES;
use super::occlusion::Darkening;
use super::rays::{Pixels, Rays, Skipping, Space};
use super::shading::Lighting;
use super::{RayMarcher, SampleCounts};
use crate::PixelLight;
use crate::frame::Ray;
use crate::scene::OpaquePixel;

/// Pixels along a side of a tile.
pub(super) const TILE: usize = 16;
/// Pixels along a side of the squares whose rays go side by side.
pub(super) const SQUARE: usize = 4;
/// Squares along a side of a tile.
const ACROSS: usize = TILE / SQUARE;

/// Rows of pixels, tile by tile: rays beside each other read the same voxels.
pub(super) struct Tiles<'a, S: Simd> {
    marcher: &'a RayMarcher<'a>,
    space: Space<'a>,
    question: Question<'a>,
    rays: Vec<Rays<S>>,
    ways: Ways,
    batch: Batch,
    /// What each ray has gathered: colour times opacity, and opacity; and where half of the light was stopped.
    lights: Vec<Vec4>,
    depths: Vec<f32>,
}

impl<'a, S: Simd> Tiles<'a, S> {
    pub(super) fn new(marcher: &'a RayMarcher<'a>) -> Self {
        let (occupancy, active) = (marcher.tables.occupancy(), marcher.active.as_ref());
        let keeps_own = marcher.tables.occlusion().is_some() || marcher.frame.plane_count > 0;
        Self {
            marcher,
            space: Space {
                planes: marcher.planes.as_ref(),
                sampler: marcher.sampler(),
                skipping: occupancy.map(|occupancy| Skipping { occupancy, active }),
            },
            question: Question { by_value: marcher.by_value(), keeps_own },
            rays: Vec::new(),
            ways: Ways::default(),
            batch: Batch::new(),
            lights: Vec::new(),
            depths: Vec::new(),
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
        for square in 0..ACROSS * ACROSS {
            let pixels = pixels(square, first, [width, height], opaque);
            let rays = Rays::new(simd, &self.marcher.frame, &pixels, &mut counts.all);
            rays.store(simd, &mut self.ways, square * LANES);
            self.rays.push(rays);
        }
        self.lights.clear();
        self.lights.resize(TILE * TILE, PixelLight::NONE.light);
        self.depths.clear();
        self.depths.resize(TILE * TILE, PixelLight::NONE.depth);
        counts.taken = self.follow(simd);
        for (y, row) in rows.chunks_exact_mut(width).enumerate() {
            for (side, pixels) in row[first[0]..width.min(first[0] + TILE)].chunks_mut(SQUARE).enumerate() {
                let ray = (y / SQUARE * ACROSS + side) * LANES + y % SQUARE * SQUARE;
                let gathered = self.lights[ray..].iter().zip(&self.depths[ray..]);
                for (pixel, (&light, &depth)) in pixels.iter_mut().zip(gathered) {
                    *pixel = PixelLight { light, depth };
                }
            }
            if let Some(opaque) = opaque.get(y * width..(y + 1) * width) {
                for (pixel, opaque) in row.iter_mut().zip(opaque).skip(first[0]).take(TILE) {
                    pixel.lie_over(opaque);
                }
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
            let mut any_goes_on = false;
            for (number, pair) in self.rays.chunks_mut(2).enumerate() {
                if pair.iter().any(Rays::any_goes_on) {
                    any_goes_on = true;
                    taken += Rays::advance(pair, simd, &self.space, 2 * number * LANES, &mut self.batch);
                }
            }
            if !any_goes_on {
                return taken;
            }
            self.batch.work_out(simd, &self.space.sampler, &self.question, &self.ways);
            self.gather(simd);
        }
    }

    /// Adds what was worked out to its rays.
    #[inline(always)]
    fn gather(&mut self, simd: S) {
        let Self { marcher, question, rays, ways, batch, lights, depths, .. } = self;
        let most = marcher.frame.termination_opacity;
        for (sample, (ray, along, mut light)) in batch.lights().enumerate() {
            let gathered = &mut lights[ray];
            let before = gathered.w;
            // Nothing behind would be seen, though some of it may have been worked out.
            if before > most {
                continue;
            }
            let rays = &mut rays[ray / LANES];
            if question.keeps_own {
                light = light.w * shaded(simd, marcher, ways, (ray, along), rays, batch.own(sample)).extend(1.0);
            }
            *gathered += (1.0 - before) * light;
            if before < 0.5 && gathered.w >= 0.5 {
                depths[ray] = along;
            }
            if gathered.w > most {
                rays.end(simd, 1 << (ray % LANES));
            }
        }
    }
}

/// The colour of a sample, with what stands in its light, and lit as a cut's face where its ray enters through one.
fn shaded<S: Simd>(
    simd: S,
    marcher: &RayMarcher<'_>,
    ways: &Ways,
    (ray, along): (usize, f32),
    rays: &Rays<S>,
    (step, [mut color, normal]): (f32, [Vec3; 2]),
) -> Vec3 {
    let frame = &marcher.frame;
    let [origin, direction] = [&ways.origins, &ways.directions].map(|rows| Vec4::from_array(rows[ray]).truncate());
    let lighting = Lighting::new(-direction, frame.light, &frame.shading);
    if let Some(occlusion) = marcher.tables.occlusion() {
        color *= Darkening::new(occlusion, frame, &Ray { origin, direction }).light_at(along);
    }
    let (lane, lit) = (ray % LANES, lighting.shade(color, normal));
    let cut = rays.cut(lane);
    if cut == Vec3::ZERO {
        return lit;
    }
    // A face that was cut is lit as such.
    lit.lerp(lighting.shade(color, cut), rays.share_of_face(simd, frame, lane, along, step))
}

/// The pixels of a square of the tile whose left upper pixel is `first` of a picture so wide, of whose rows so many are left.
#[inline(always)]
fn pixels(square: usize, first: [usize; 2], [width, height]: [usize; 2], opaque: &[OpaquePixel]) -> Pixels {
    let corner = [square % ACROSS * SQUARE, square / ACROSS * SQUARE];
    let places = [first[0] + corner[0], first[1] + corner[1]].map(|place| place as u32);
    let mut pixels = Pixels { first: places, are_there: u16::MAX, opaque: [f32::INFINITY; LANES] };
    let [columns, rows] = [width.saturating_sub(first[0] + corner[0]), height.saturating_sub(corner[1])];
    if columns < SQUARE || rows < SQUARE || !opaque.is_empty() {
        for lane in 0..LANES {
            let [x, y] = [lane % SQUARE, lane / SQUARE];
            if x >= columns || y >= rows {
                pixels.are_there &= !(1 << lane);
            } else if let Some(opaque) = opaque.get((corner[1] + y) * width + first[0] + corner[0] + x) {
                pixels.opaque[lane] = opaque.along;
            }
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;
    use voxrole_preprocess::simd;

    use super::super::naive::tests::volume;
    use super::*;
    use crate::ViewState;
    use crate::state::Projection;

    #[test]
    fn few_samples_wait_however_short_the_steps() {
        // One cell, which is cut into 2048 pieces.
        let mut volume = volume([2; 3], 3);
        volume.description.spacing = [1.0, 1.0, 32.0];
        let mut state = ViewState::default();
        state.transfer_function.regions = vec!["0:1,0:1,FF8000,0.01".parse().expect("a region")];
        state.transfer_function.emphasis = "linear,1,100".parse().expect("an emphasis");
        (state.camera.elevation, state.camera.zoom, state.camera.projection) = (90.0, 60.0, Projection::Orthographic);
        state.render_settings.step = 1.0 / 64.0;
        let marcher = RayMarcher::new(&volume, &state, [TILE as u32; 2]).expect("a picture");
        let (taken, room) = dispatch!(simd::level(), simd => {
            let mut tiles = Tiles::new(&marcher);
            let counts = tiles.draw(simd, [0, 0], &mut [PixelLight::NONE; TILE * TILE], &[]);
            (counts.taken, tiles.batch.room())
        });
        assert_eq!(taken, (TILE * TILE) as u64);
        assert!(room <= 4 * 4096, "{room}");
    }
}
