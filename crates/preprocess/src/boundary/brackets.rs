//! Crossings bisected side by side: each waits for its own last halving, so one alone leaves the processor idle.

use fearless_simd::{Simd, dispatch, f32x16, prelude::*};
use glam::Vec3;

use crate::root_finder::HALVINGS;
use crate::sampler::Span;
use crate::simd;

/// Brackets that are bisected together, a multiple of the processor's lanes.
pub(crate) const LANES: usize = 16;

/// Where on a ray, within one cell, trilinear f'' changes its sign.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bracket {
    /// The cell, and what f'' has at its corners times the sign that makes it positive at the bracket's begin.
    pub(crate) span: Span,
    /// Voxels per unit of the ray's parameter.
    pub(crate) direction: Vec3,
    /// The parameters between which f'' changes its sign.
    pub(crate) ends: [f32; 2],
    /// Halvings left to do, [`HALVINGS`] at most.
    pub(crate) halvings: u32,
}

impl Bracket {
    /// Where f'' changes its sign.
    pub(crate) fn bisect(&self) -> f32 {
        let mut brackets = Brackets::default();
        brackets.set(0, self);
        dispatch!(simd::level(), simd => brackets.bisect(simd))[0]
    }
}

/// [`Bracket`]s, lane by lane.
#[derive(Default)]
pub(crate) struct Brackets {
    inside: [f32; LANES],
    outside: [f32; LANES],
    halvings: [f32; LANES],
    direction: [[f32; LANES]; 3],
    cell: [[f32; LANES]; 3],
    corners: [[f32; LANES]; 8],
}

impl Brackets {
    /// Puts a bracket into a lane.
    #[inline(always)]
    pub(crate) fn set(&mut self, lane: usize, bracket: &Bracket) {
        [self.inside[lane], self.outside[lane]] = bracket.ends;
        self.halvings[lane] = bracket.halvings as f32;
        for axis in 0..3 {
            self.direction[axis][lane] = bracket.direction[axis];
            self.cell[axis][lane] = bracket.span.cell[axis];
        }
        for (corners, corner) in self.corners.iter_mut().zip(bracket.span.corners.as_array()) {
            corners[lane] = corner;
        }
    }

    /// Where f'' changes its sign, as [`crate::root_finder::bisect`] finds it. Lanes that were not set mean nothing.
    ///
    /// Per lane and halving about 35 operations; 16 lanes at a time keep AVX2 busy, whose result one lane would wait for.
    #[inline(always)]
    pub(crate) fn bisect<S: Simd>(&self, simd: S) -> [f32; LANES] {
        let load = |lanes: &[f32; LANES]| f32x16::from_slice(simd, lanes);
        let (halvings, half, one) = (load(&self.halvings), f32x16::splat(simd, 0.5), f32x16::splat(simd, 1.0));
        let [mut inside, mut outside] = [load(&self.inside), load(&self.outside)];
        for halving in 0..HALVINGS {
            let middle = half * (inside + outside);
            let [x, y, z] = std::array::from_fn(|axis| load(&self.direction[axis]) * middle - load(&self.cell[axis]));
            let between = |low, high, share| low * (one - share) + high * share;
            let along_x = |pair: usize| between(load(&self.corners[2 * pair]), load(&self.corners[2 * pair + 1]), x);
            let rise = between(between(along_x(0), along_x(1), y), between(along_x(2), along_x(3), y), z);
            let rises = rise.simd_gt(f32x16::splat(simd, 0.0));
            let open = halvings.simd_gt(f32x16::splat(simd, halving as f32));
            inside = (open & rises).select(middle, inside);
            outside = (open & !rises).select(middle, outside);
        }
        (half * (inside + outside)).into()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::root_finder::bisect;
    use crate::sampler::Sampler;

    proptest! {
        #[test]
        fn many_at_once_are_the_same_as_one_after_another(
            fields in prop::collection::vec(prop::collection::vec(-1.0_f32..1.0, 27), LANES),
            directions in prop::collection::vec(prop::array::uniform3(-1.0_f32..1.0), LANES),
            ends in prop::collection::vec(prop::array::uniform2(0.0_f32..1.0), LANES),
        ) {
            let sampler = Sampler::new([3; 3]);
            let mut brackets = Brackets::default();
            let mut expected = [None; LANES];
            for (lane, ((field, direction), ends)) in fields.iter().zip(directions).zip(ends).enumerate() {
                let ray = sampler.ray([1; 3], Vec3::from_array(direction));
                let Some(span) = sampler.span(field, &ray, ends) else { continue };
                brackets.set(lane, &Bracket { span, direction: ray.direction(), ends, halvings: HALVINGS });
                let rises = |t: f32| sampler.trilinear(field, &sampler.place(&ray, t).expect("inside")) > 0.0;
                expected[lane] = Some(bisect(ends[0], ends[1], rises));
            }
            let found = dispatch!(simd::level(), simd => brackets.bisect(simd));
            for (found, expected) in found.into_iter().zip(expected) {
                prop_assert!(expected.is_none_or(|expected| found.to_bits() == expected.to_bits()));
            }
        }
    }
}
