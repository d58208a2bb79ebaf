//! Colour and opacity by value, or as stored, at sixteen places: no boundary is asked for.

// No iterators and closures in vector code: what std calls might be compiled without the level's instructions.
#![allow(clippy::needless_range_loop, reason = "see above")]

use fearless_simd::{Bytes, Select, Simd, SimdBase, SimdFloat, SimdInt, SimdMask, f32x16, i32x16, mask32x16, u32x16};

use super::corners::{Corners, Places};
use super::gathers::columns;
use super::lanes::{Directions, exp_of_negative, splat};
use super::planes::Planes;
use super::sampling::{Found, Sampler};
use crate::classify::ValueTable;
use crate::classify::value_table::{NARROW, PARTS, PER_STORED, SIDE};

/// What decides on colour and opacity where roles do not.
#[derive(Clone, Copy)]
pub(super) enum ByValue<'a> {
    /// A curve.
    Curve(&'a ValueTable, &'a Planes),
    /// The voxels' own intensity and opacity.
    Stored,
}

/// What samples stand for along sixteen rays.
pub(super) struct Stretches<S: Simd> {
    pub(super) origins: Directions<S>,
    pub(super) directions: Directions<S>,
    /// Where along the rays their middles lie.
    pub(super) alongs: f32x16<S>,
    /// Half of what opacity is integrated along.
    pub(super) half_steps: f32x16<S>,
}

/// The values at the ends of stretches.
#[inline(always)]
pub(super) fn ends<S: Simd>(
    simd: S,
    planes: &Planes,
    sampler: &Sampler<'_>,
    stretches: &Stretches<S>,
) -> [f32x16<S>; 2] {
    let alongs = [stretches.alongs - stretches.half_steps, stretches.alongs + stretches.half_steps];
    let mut ends = alongs;
    for end in 0..2 {
        let mut positions = stretches.origins;
        for axis in 0..3 {
            positions[axis] += alongs[end] * stretches.directions[axis];
        }
        let [cells, fractions] = sampler.cells(simd, &positions);
        let firsts = sampler.firsts(&sampler.places(&cells, fractions));
        ends[end] = planes.value(simd, sampler, &firsts, fractions);
    }
    ends
}

/// Whether anything may have an opacity between two values.
#[inline(always)]
pub(super) fn can_show<S: Simd>(simd: S, table: &ValueTable, [front, back]: [f32x16<S>; 2]) -> mask32x16<S> {
    let (low, high) = (front.min(back) * PER_STORED, front.max(back) * PER_STORED);
    let mut can_show = mask32x16::splat(simd, false);
    for &[first, end] in table.lit() {
        can_show |= high.simd_ge(first) & low.simd_lt(end);
    }
    can_show
}

/// What is found along steps in whose middles `places` lie, and on which the value goes from one to another.
#[inline(always)]
pub(super) fn sample<S: Simd>(
    simd: S,
    table: &ValueTable,
    planes: &Planes,
    sampler: &Sampler<'_>,
    places: &Places<S>,
    [front, back]: [f32x16<S>; 2],
) -> Found<S> {
    let [red, green, blue, opacity] = look_up(simd, table, front, back);
    Found { opacity, color: [red, green, blue], normal: planes.normal(simd, sampler, places) }
}

/// Intensity and opacity as they are stored.
#[inline(always)]
pub(super) fn stored<S: Simd>(simd: S, sampler: &Sampler<'_>, places: &Places<S>) -> Found<S> {
    let corners = Corners::read(simd, sampler, places);
    let mut intensity = splat(simd, 0.0);
    for corner in 0..8 {
        intensity += corners.weights[corner] * corners.gradients(corner).to_float::<f32x16<S>>();
    }
    Found { opacity: corners.value(simd) / 65535.0, color: [intensity / 65535.0; 3], ..Found::nothing(simd) }
}

/// As [`ValueTable::look_up`].
#[inline(always)]
fn look_up<S: Simd>(simd: S, table: &ValueTable, front: f32x16<S>, back: f32x16<S>) -> [f32x16<S>; 4] {
    let (front, back) = (front * PER_STORED, back * PER_STORED);
    let parts = back - front;
    let is_narrow = parts.abs().simd_lt(NARROW);
    let zero = splat(simd, 0.0);
    let mut light = [zero; 4];
    if is_narrow.any_true() {
        light = between(simd, bytemuck::cast_slice(table.ends()), 0.5 * (front + back));
    }
    if is_narrow.all_true() {
        return light;
    }
    let wide = if table.front_to_back().is_empty() {
        let integrals = bytemuck::cast_slice(table.integrals());
        let (before, after) = (between(simd, integrals, front), between(simd, integrals, back));
        let depth = after[3] - before[3];
        let per_depth = depth.simd_eq(0.0).select(zero, 1.0 / depth);
        let mut wide = [zero; 4];
        for channel in 0..3 {
            wide[channel] = (after[channel] - before[channel]) * per_depth;
        }
        // 0 over 0 is not kept.
        wide[3] = 1.0 - exp_of_negative(simd, -(depth / parts).max(zero));
        wide
    } else {
        ordered(simd, bytemuck::cast_slice(table.front_to_back()), front, back)
    };
    for channel in 0..4 {
        light[channel] = is_narrow.select(light[channel], wide[channel]);
    }
    light
}

/// Out of the table of two axes.
#[inline(always)]
fn ordered<S: Simd>(simd: S, table: &[[f32; 4]], front: f32x16<S>, back: f32x16<S>) -> [f32x16<S>; 4] {
    const PER_PART: f32 = (SIDE - 1) as f32 / PARTS as f32;
    let (front, back) = (front * PER_PART, back * PER_PART);
    let most = i32x16::splat(simd, SIDE as i32 - 2);
    let [row, lower] = [front.to_int::<i32x16<S>>().min(most), back.to_int::<i32x16<S>>().min(most)];
    let (along_row, across) = (back - lower.to_float::<f32x16<S>>(), front - row.to_float::<f32x16<S>>());
    let first = row.bitcast::<u32x16<S>>() * SIDE as u32 + lower.bitcast::<u32x16<S>>();
    let [near_low, near_high] = [columns(simd, table, first), columns(simd, table, first + 1)];
    let first = first + SIDE as u32;
    let [far_low, far_high] = [columns(simd, table, first), columns(simd, table, first + 1)];
    let mut light = [splat(simd, 0.0); 4];
    for channel in 0..4 {
        let near = near_low[channel] + along_row * (near_high[channel] - near_low[channel]);
        let far = far_low[channel] + along_row * (far_high[channel] - far_low[channel]);
        light[channel] = near + across * (far - near);
    }
    let is_lit = light[3].simd_gt(0.0);
    let per_opacity = is_lit.select(1.0 / light[3], splat(simd, 0.0));
    [light[0] * per_opacity, light[1] * per_opacity, light[2] * per_opacity, is_lit.select(light[3], splat(simd, 0.0))]
}

/// What lies between the ends of parts.
#[inline(always)]
fn between<S: Simd>(simd: S, ends: &[[f32; 4]], place: f32x16<S>) -> [f32x16<S>; 4] {
    let lower = place.to_int::<i32x16<S>>().min(i32x16::splat(simd, PARTS as i32));
    let along = place - lower.to_float::<f32x16<S>>();
    let first = lower.bitcast::<u32x16<S>>();
    let (low, high) = (columns(simd, ends, first), columns(simd, ends, first + 1));
    let mut light = low;
    for channel in 0..4 {
        light[channel] += along * (high[channel] - low[channel]);
    }
    light
}

#[cfg(test)]
mod tests {
    use fearless_simd::dispatch;
    use voxrole_preprocess::simd;

    use super::super::lanes::LANES;
    use super::*;

    #[test]
    fn whatever_has_an_opacity_can_show() {
        let many: Vec<String> =
            (0..20).map(|peak| format!("{0}.1,FF0000,0;{0}.2,00FF00,0.9;{0}.3,0000FF,0", peak)).collect();
        let curves = [
            "0,FF0000,0.2;3,FF0000,0",
            "8,FF0000,0;8.02,00FF00,1;8.04,0000FF,0",
            "19,FF0000,0;20,FF0000,0.5",
            &many.join(";"),
        ];
        for curve in curves.map(|curve| curve.parse().expect("a curve")) {
            for step in [None, Some(1.0)] {
                let table = ValueTable::new(&curve, [0.0, 20.0], step);
                let mut dark = 0;
                for front in (0..=u16::MAX).step_by(51).map(f32::from) {
                    let near = |lane: usize| front + 37.3 * (lane as f32 - 7.5);
                    // Some of them far away.
                    let back = |lane: usize| if lane.is_multiple_of(5) { 65_535.0 - near(lane) } else { near(lane) };
                    let backs: [f32; LANES] = std::array::from_fn(|lane| back(lane).clamp(0.0, 65_535.0));
                    let (lit, can_show): ([f32; LANES], u64) = dispatch!(simd::level(), simd => {
                        let ends = [splat(simd, front), f32x16::from_slice(simd, &backs)];
                        let [_, _, _, opacity] = look_up(simd, &table, ends[0], ends[1]);
                        (opacity.into(), can_show(simd, &table, ends).to_bitmask())
                    });
                    for lane in 0..LANES {
                        let can_show = can_show >> lane & 1 == 1;
                        assert!(can_show || lit[lane] == 0.0, "{front} to {}: {}", backs[lane], lit[lane]);
                        dark += u32::from(!can_show);
                    }
                }
                assert!(dark > 1000, "{dark}");
            }
        }
    }
}
