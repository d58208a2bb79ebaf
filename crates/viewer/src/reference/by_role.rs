//! The rule of [`super::sampling`] at sixteen places.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use fearless_simd::{Bytes, Select, Simd, SimdBase, SimdFloat, SimdInt, SimdMask, f32x16, i32x16, mask32x16, u32x16};

use super::corners::{Corners, Places, gradient_bins};
use super::lanes::{Directions, dot, exp_of_negative, splat, unit_or_zero};
use super::roles::{RoleLanes, Roles};
use super::sampling::{Found, Sampler};
use crate::classify::opacity::{GRADIENT_BINS, VALUE_BINS};
use crate::classify::preintegration::SHORTEST;

/// Which roles the voxels around sixteen places have.
struct Numbers<S: Simd> {
    /// Of each corner; 0 where nothing of it is drawn.
    corners: [u32x16<S>; 8],
    /// The largest of a place's.
    largest: u32x16<S>,
    /// Whether that is the number of all of a place's corners that are drawn.
    are_one: mask32x16<S>,
}

impl<S: Simd> Numbers<S> {
    #[inline(always)]
    fn look_up(simd: S, roles: &Roles, corners: &Corners<S>) -> Self {
        let per_value = VALUE_BINS as f32 / 65536.0;
        let value_bins = (corners.value(simd) * per_value).to_int::<i32x16<S>>();
        let value_bins = value_bins.min(i32x16::splat(simd, VALUE_BINS as i32 - 1)).bitcast::<u32x16<S>>();
        let none = u32x16::splat(simd, 0);
        let (mut least, mut most) = (u32x16::splat(simd, u32::MAX), none);
        for corner in 0..8 {
            let (has_hit, gradient) = (corners.have_hit(corner), corners.gradients(corner));
            least = has_hit.select(least.min(gradient), least);
            most = has_hit.select(most.max(gradient), most);
        }
        // Where none has a hit, any will do.
        let least = roles.runs(simd, gradient_bins(simd, least.min(most)));
        let most = roles.runs(simd, gradient_bins(simd, most));
        let mut numbers = [none; 8];
        if (least >> 16).simd_eq(most >> 16).all_true() {
            // All gradient magnitudes between are looked up alike.
            let largest = roles.numbers(simd, most, value_bins);
            for corner in 0..8 {
                numbers[corner] = corners.have_hit(corner).select(largest, none);
            }
            return Self { corners: numbers, largest, are_one: mask32x16::splat(simd, true) };
        }
        let mut largest = none;
        for corner in 0..8 {
            let bins = gradient_bins(simd, corners.gradients(corner));
            let bins = corners.have_hit(corner).select(bins, u32x16::splat(simd, GRADIENT_BINS as u32));
            numbers[corner] = roles.numbers(simd, roles.runs(simd, bins), value_bins);
            largest = largest.max(numbers[corner]);
        }
        let mut are_one = mask32x16::splat(simd, true);
        for corner in 0..8 {
            are_one &= numbers[corner].simd_eq(largest) | numbers[corner].simd_eq(0);
        }
        Self { corners: numbers, largest, are_one }
    }
}

/// What is found at places, over `half_steps` multiples of `L_min` to either side along rays' directions; without those a place
/// counts for all of its step.
#[inline(always)]
pub(super) fn sample<S: Simd>(
    simd: S,
    sampler: &Sampler<'_>,
    places: &Places<S>,
    directions: &Directions<S>,
    half_steps: Option<f32x16<S>>,
) -> Found<S> {
    let (frame, roles) = (sampler.frame, sampler.roles);
    let corners = Corners::read(simd, sampler, places);
    let numbers = Numbers::look_up(simd, roles, &corners);
    let mut found = Found::nothing(simd);
    if numbers.largest.simd_eq(0).all_true() {
        return found;
    }
    let is_one = numbers.are_one.all_true();
    let zero = splat(simd, 0.0);
    let mut role = RoleLanes::look_up(simd, roles, numbers.largest);
    let color_of_largest = role.color();
    for corner in 0..8 {
        let is_drawn = numbers.corners[corner].simd_gt(0);
        if !is_drawn.any_true() {
            continue;
        }
        if !is_one {
            role = RoleLanes::look_up(simd, roles, numbers.corners[corner]);
        }
        let normal = corners.normals(simd, corner);
        let mut distance = corners.distances(corner).to_float::<f32x16<S>>() * frame.distance_scale;
        for axis in 0..3 {
            let fraction = places.fractions[axis];
            let from_corner = if corner >> axis & 1 == 1 { fraction - 1.0 } else { fraction };
            distance += normal[axis] * (from_corner * frame.spacing[axis]);
        }
        let opacity = if let Some(half_steps) = half_steps {
            let half = (dot(&normal, directions).abs() * half_steps).max(splat(simd, 0.5 * SHORTEST));
            let begin = role.integral(simd, roles, distance - half);
            let end = role.integral(simd, roles, distance + half);
            1.0 - exp_of_negative(simd, (begin - end) * (0.5 / half))
        } else {
            role.opacity(simd, roles, distance)
        };
        let share = is_drawn.select(corners.weights[corner] * opacity, zero);
        found.opacity += share;
        for axis in 0..3 {
            found.normal[axis] += share * normal[axis];
        }
        if !is_one {
            let color = role.color();
            for channel in 0..3 {
                found.color[channel] += share * color[channel];
            }
        }
    }
    let is_lit = found.opacity.simd_gt(0.0);
    let per_opacity = is_lit.select(1.0 / found.opacity, zero);
    for axis in 0..3 {
        found.normal[axis] *= per_opacity;
        found.color[axis] *= per_opacity;
    }
    for channel in 0..3 {
        // Whatever the places beside it are: one colour stays as it is.
        let color = numbers.are_one.select(color_of_largest[channel], found.color[channel]);
        found.color[channel] = is_lit.select(color, zero);
    }
    found.normal = unit_or_zero(simd, &found.normal, 1e-8);
    found.opacity = found.opacity.min(splat(simd, 1.0));
    found
}

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;
    use glam::{UVec3, Vec3};
    use proptest::prelude::*;
    use voxrole_preprocess::simd;

    use super::super::RayMarcher;
    use super::super::lanes::{LANES, splat_vector};
    use super::super::naive;
    use super::*;
    use crate::ViewState;
    use crate::state::Integration;

    const DIRECTION: Vec3 = Vec3::new(0.48, -0.6, 0.64);

    /// Opacity, colour and normal at sixteen places in index coordinates.
    fn found(marcher: &RayMarcher<'_>, places: [Vec3; LANES], half_step: Option<f32>) -> [[f32; LANES]; 7] {
        let sampler = marcher.sampler();
        dispatch!(simd::level(), simd => {
            let mut positions = [splat(simd, 0.0); 3];
            for axis in 0..3 {
                let along = places.map(|place| place[axis] * marcher.frame().spacing[axis]);
                positions[axis] = f32x16::from_slice(simd, &along);
            }
            let [cells, fractions] = sampler.cells(simd, &positions);
            let places = sampler.places(&cells, fractions);
            let Found { opacity, color: [red, green, blue], normal: [x, y, z] } =
                sample(simd, &sampler, &places, &splat_vector(simd, DIRECTION), half_step.map(|half| splat(simd, half)));
            [opacity, red, green, blue, x, y, z].map(Into::into)
        })
    }

    proptest! {
        #[test]
        fn every_place_is_on_its_own_and_follows_the_rule(
            seed in any::<u64>(),
            places in prop::array::uniform16(prop::array::uniform3(0.0_f32..4.0)),
            softness in 0.0_f32..0.5,
            is_integrated in any::<bool>(),
        ) {
            let volume = naive::tests::volume([5; 3], seed);
            let mut state = ViewState::default();
            let regions = [format!("0:0.8,0.1:0.7,FF8000,0.7,{softness}"), format!("0.3:1,0.2:1,0080FF,0.4,{softness}")];
            state.transfer_function.regions = regions.iter().map(|region| region.parse().expect("a region")).collect();
            if !is_integrated {
                state.render_settings.integration = Integration::PostClassified;
            }
            let marcher = RayMarcher::new(&volume, &state, [1, 1]).expect("a picture");
            let places = places.map(Vec3::from_array);
            let half_step = is_integrated.then_some(0.2);
            let together = found(&marcher, places, half_step);
            for (lane, &place) in places.iter().enumerate() {
                let alone = found(&marcher, [place; LANES], half_step);
                for (number, alone) in together.iter().zip(alone) {
                    prop_assert_eq!(number[lane].to_bits(), alone[lane].to_bits());
                }
                let cell = place.floor().min(Vec3::splat(3.0));
                let fraction = (place * marcher.frame().spacing) * marcher.frame().spacing.recip() - cell;
                let rule = naive::sample_role(&marcher, UVec3::from_array(cell.to_array().map(|axis| axis as u32)), fraction, DIRECTION, 0.2);
                let [opacity, red, green, blue, x, y, z] = together.map(|number| number[lane]);
                // A value on a bin's end may be in either bin.
                prop_assert!(softness < 0.1 || (opacity - rule.opacity).abs() < 0.03, "{opacity} is not {}", rule.opacity);
                if (opacity - rule.opacity).abs() < 1e-5 && opacity > 0.01 {
                    prop_assert!((Vec3::new(red, green, blue) - rule.color).length() < 1e-3);
                    prop_assert!((Vec3::new(x, y, z) - rule.normal).length() < 1e-2 || rule.normal == Vec3::ZERO);
                }
            }
        }
    }
}
