//! Colour and opacity by value alone, everywhere: the classical transfer function, and its integrals from one value to
//! another.
//!
//! Along a step on which the value goes evenly from `front` to `back`, the optical depth for each `L_min` is `(T(back)
//! − T(front)) / (back − front)` with `T = ∫ τ`, and the colour `∫ τ c / ∫ τ`: a table of one axis, which leaves out
//! that what lies in front hides what lies behind within the step. A table of two axes, for every front and back, has
//! that too. Ends that are all but equal are looked up as one value. After Engel, Kraus and Ertl, High-quality
//! pre-integrated volume rendering using hardware-accelerated pixel shading, 2001.

use glam::{DVec4, Vec3, Vec4};
use rayon::prelude::*;

use crate::frame::Frame;
use crate::state::{Curve, ViewState};
use crate::volume::VolumeDescription;

/// Parts into which the range of values is cut; colour and opacity are linear in each.
pub const PARTS: usize = 1024;
/// Fronts and backs of the table of two axes.
pub const SIDE: usize = 256;
/// Steps that change by less than so many parts are looked up in their middle: differences of integrals would be
/// rounding alone.
pub const NARROW: f32 = 2.0;

/// Parts for each of the stored values.
pub const PER_STORED: f32 = PARTS as f32 / 65535.0;
/// More ranges of values with an opacity are not told apart.
pub const MOST_RANGES: usize = 8;

/// Pieces of a step, at most, of which the first hide the others.
const MOST_PIECES: usize = 8;
/// No opacity is taken to be larger: τ of a path of `L_min` is 14 at most.
const MOST_OPACITY: f32 = 1.0 - 1e-6;

/// A curve of control points, ready to be looked up by stored value.
#[derive(Clone, Debug)]
pub struct ValueTable {
    /// Colour and opacity for a path of `L_min` at the parts' ends, and the last once more.
    ends: Vec<Vec4>,
    /// Integrals over parts of τ times colour, and of τ, at the same places.
    integrals: Vec<Vec4>,
    /// For every front, one back after another, colour times opacity and opacity for each `L_min`; empty where not
    /// asked for.
    front_to_back: Vec<Vec4>,
    /// Where among the parts something may have an opacity: from a place on, up to one that does not belong to it.
    lit: Vec<[f32; 2]>,
}

impl ValueTable {
    /// Of a curve over a volume's range of values; for steps of a length, in multiples of `L_min`, with the table of
    /// two axes. A curve without points has no opacity.
    #[must_use]
    pub fn new(curve: &Curve, value_range: [f64; 2], ordered_step: Option<f32>) -> Self {
        let width = (value_range[1] - value_range[0]) / PARTS as f64;
        let values = (0..=PARTS).map(|end| (end as f64).mul_add(width, value_range[0]) as f32);
        let mut ends: Vec<Vec4> =
            values.map(|value| curve.at(value).map_or(Vec4::ZERO, |([r, g, b], a)| Vec4::new(r, g, b, a))).collect();
        ends.push(ends[PARTS]);
        let depth = |end: &Vec4| -f64::from(1.0 - end.w.min(MOST_OPACITY)).ln();
        let mut sum = DVec4::ZERO;
        let mut sums = vec![sum];
        for pair in ends.windows(2) {
            // Simpson's rule is exact for the product of two that are linear.
            let at = |share: f64| {
                let color = pair[0].truncate().as_dvec3().lerp(pair[1].truncate().as_dvec3(), share);
                let tau = depth(&pair[0]) + share * (depth(&pair[1]) - depth(&pair[0]));
                (tau * color).extend(tau)
            };
            sum += (at(0.0) + 4.0 * at(0.5) + at(1.0)) / 6.0;
            sums.push(sum);
        }
        sums[PARTS + 1] = sums[PARTS];
        let integrals: Vec<Vec4> = sums.iter().map(|sum| sum.as_vec4()).collect();
        let mut table = Self { ends, integrals, front_to_back: Vec::new(), lit: Vec::new() };
        if let Some(step) = ordered_step {
            table.front_to_back = table.ordered(&sums, step);
        }
        table.find_lit();
        table
    }

    /// That of a state's curve, for what is drawn of a volume.
    #[must_use]
    pub fn of(state: &ViewState, volume: &VolumeDescription, frame: &Frame) -> Self {
        Self::new(&state.transfer_function.curve, volume.value_range, frame.is_ordered.then_some(frame.step))
    }

    /// Colour and opacity for a path of `L_min` along which the stored value, 0 to 65535, goes from one to another.
    #[must_use]
    #[inline]
    pub fn look_up(&self, front: f32, back: f32) -> Vec4 {
        let (front, back) = (front * PER_STORED, back * PER_STORED);
        let parts = back - front;
        if parts.abs() < NARROW {
            return between(&self.ends, 0.5 * (front + back));
        }
        if !self.front_to_back.is_empty() {
            return self.look_up_ordered(front, back);
        }
        let difference = between(&self.integrals, back) - between(&self.integrals, front);
        let color = if difference.w == 0.0 { Vec4::ZERO } else { difference / difference.w };
        color.truncate().extend(1.0 - (-difference.w / parts).exp())
    }

    #[inline]
    fn look_up_ordered(&self, front: f32, back: f32) -> Vec4 {
        const PER_PART: f32 = (SIDE - 1) as f32 / PARTS as f32;
        let (front, back) = (front * PER_PART, back * PER_PART);
        let row = (front as usize).min(SIDE - 2);
        let in_row = |row: usize| {
            let entries = &self.front_to_back[row * SIDE..][..SIDE];
            let lower = (back as usize).min(SIDE - 2);
            entries[lower] + (back - lower as f32) * (entries[lower + 1] - entries[lower])
        };
        let (near, far) = (in_row(row), in_row(row + 1));
        let light = near + (front - row as f32) * (far - near);
        if light.w > 0.0 { (light.truncate() / light.w).extend(light.w) } else { Vec4::ZERO }
    }

    /// Whether any value between two stored ones has an opacity.
    #[must_use]
    pub fn any(&self, [low, high]: [u16; 2]) -> bool {
        let part = |stored: u16| f64::from(stored) * PARTS as f64 / 65535.0;
        let first = (part(low).floor() as usize).saturating_sub(self.margin());
        let last = (part(high).ceil() as usize + self.margin()).min(PARTS);
        low <= high && self.ends[first..=last].iter().any(|end| end.w > 0.0)
    }

    /// Where among the parts something may have an opacity, in at most [`MOST_RANGES`] ranges, whose ends do not belong to them.
    #[must_use]
    pub fn lit(&self) -> &[[f32; 2]] {
        &self.lit
    }

    /// The table of two axes has fronts and backs farther apart than a part's ends, between which it is linear: by so many parts.
    fn margin(&self) -> usize {
        if self.front_to_back.is_empty() { 0 } else { PARTS.div_ceil(SIDE - 1) }
    }

    fn find_lit(&mut self) {
        let reach = (1 + self.margin()) as f32;
        for place in (0..=PARTS).filter(|&end| self.ends[end].w > 0.0) {
            let [first, end] = [place as f32 - reach, place as f32 + reach];
            match self.lit.last_mut() {
                Some(last) if first <= last[1] => last[1] = end,
                _ => self.lit.push([first, end]),
            }
        }
        while self.lit.len() > MOST_RANGES {
            // The narrowest gap is closed.
            let gap = |range: &usize| self.lit[range + 1][0] - self.lit[*range][1];
            let nearest = (0..self.lit.len() - 1).min_by(|a, b| gap(a).total_cmp(&gap(b))).unwrap_or_default();
            self.lit[nearest][1] = self.lit[nearest + 1][1];
            self.lit.remove(nearest + 1);
        }
    }

    /// Colours and opacities for a path of `L_min` at the parts' ends, and the last once more.
    #[must_use]
    pub fn ends(&self) -> &[Vec4] {
        &self.ends
    }

    /// Integrals over parts of τ times colour, and of τ, up to the same places.
    #[must_use]
    pub fn integrals(&self) -> &[Vec4] {
        &self.integrals
    }

    /// Colours and opacities at the parts' ends, then the integrals there: what shaders read.
    #[must_use]
    pub fn rows(&self) -> Vec<Vec4> {
        [&self.ends[..], &self.integrals[..]].concat()
    }

    /// The table of two axes, backs fastest; empty where it was not asked for.
    #[must_use]
    pub fn front_to_back(&self) -> &[Vec4] {
        &self.front_to_back
    }

    fn ordered(&self, sums: &[DVec4], step: f32) -> Vec<Vec4> {
        const PARTS_APART: f64 = PARTS as f64 / (SIDE - 1) as f64;
        let sum_at = |place: f64| {
            let lower = (place as usize).min(PARTS - 1);
            sums[lower].lerp(sums[lower + 1], place - lower as f64)
        };
        let mut table = vec![Vec4::ZERO; SIDE * SIDE];
        table.par_chunks_exact_mut(SIDE).enumerate().for_each(|(front, backs)| {
            let start = front as f64 * PARTS_APART;
            for (back, entry) in backs.iter_mut().enumerate() {
                if front == back {
                    let at = between(&self.ends, start as f32);
                    *entry = (at.w * at.truncate()).extend(at.w);
                    continue;
                }
                let pieces = front.abs_diff(back).min(MOST_PIECES);
                let piece = (back as f64 - front as f64) * PARTS_APART / pieces as f64;
                // From integrals over parts to optical depths of pieces of the step.
                let scale = step / (piece as f32 * pieces as f32);
                let (mut before, mut through, mut color) = (sum_at(start), 1.0_f32, Vec3::ZERO);
                for index in 1..=pieces {
                    let after = sum_at(start + index as f64 * piece);
                    let difference = (after - before).as_vec4();
                    before = after;
                    if difference.w != 0.0 {
                        let left = through * (-difference.w * scale).exp();
                        color += (through - left) * difference.truncate() / difference.w;
                        through = left;
                    }
                }
                if through < 1.0 {
                    // For a path of L_min, as all opacities are.
                    let opacity = 1.0 - (through.max(f32::MIN_POSITIVE).ln() / step).exp();
                    *entry = (opacity / (1.0 - through) * color).extend(opacity);
                }
            }
        });
        table
    }
}

/// What lies between the ends of parts.
#[inline]
fn between(ends: &[Vec4], place: f32) -> Vec4 {
    let lower = (place as usize).min(PARTS);
    ends[lower] + (place - lower as f32) * (ends[lower + 1] - ends[lower])
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    /// Composites a step in ten thousand pieces.
    fn naive(curve: &Curve, [front, back]: [f32; 2], step: f32) -> Vec4 {
        const PIECES: usize = 10_000;
        let (mut color, mut through) = (DVec3::ZERO, 1.0_f64);
        for piece in 0..PIECES {
            let value = front + (back - front) * (piece as f32 + 0.5) / PIECES as f32;
            let (at, opacity) = curve.at(value).expect("has points");
            let left = through * (1.0 - f64::from(opacity.min(MOST_OPACITY))).powf(f64::from(step) / PIECES as f64);
            color += (through - left) * DVec3::from_array(at.map(f64::from));
            through = left;
        }
        let opacity = 1.0 - through;
        let color = if opacity > 0.0 { color / opacity } else { color };
        color.extend(1.0 - through.powf(1.0 / f64::from(step))).as_vec4()
    }

    fn curve() -> Curve {
        // The exercise of the lecture that this follows, with a peak that samples miss.
        "64,FF6262,0;128,FFFFB4,0.9;192,FFFFFF,0.2;200,00FF00,0;202,0000FF,0.95;204,FF0000,0;255,FFFFFF,0"
            .parse()
            .expect("a curve")
    }

    #[test]
    fn steps_are_integrated() {
        let (curve, range) = (curve(), [0.0, 255.0]);
        for step in [0.25, 1.0, 2.0] {
            let [one_axis, two_axes] = [None, Some(step)].map(|step| ValueTable::new(&curve, range, step));
            for front in [0.0, 30.0, 64.0, 100.5, 150.0, 201.0, 230.0, 255.0] {
                for back in [0.0, 70.0, 100.6, 128.0, 199.0, 203.0, 210.0, 255.0] {
                    let exact = naive(&curve, [front, back], step);
                    let [one, two] = [&one_axis, &two_axes].map(|table| table.look_up(front * 257.0, back * 257.0));
                    assert!((one.w - exact.w).abs() < 0.01, "{front} to {back}: {one} is not {exact}");
                    assert!((two.w - exact.w).abs() < 0.06, "{front} to {back}: {two} is not {exact}");
                    // What hides what counts in the second alone.
                    let off = exact.w * (two - exact).truncate().abs().max_element();
                    assert!(off < 0.06, "{front} to {back}, {step}: {two} is not {exact}");
                }
            }
        }
    }

    #[test]
    fn equal_ends_are_post_classified() {
        let curve = curve();
        for table in [None, Some(1.0)].map(|step| ValueTable::new(&curve, [0.0, 255.0], step)) {
            for value in [0.0, 63.0, 64.5, 128.0, 170.25, 202.0, 255.0] {
                let (color, opacity) = curve.at(value).expect("has points");
                let found = table.look_up(value * 257.0, value * 257.0 + 1.0);
                assert!((found.w - opacity).abs() < 0.06, "{value}: {found} is not {opacity}");
                assert!(value == 202.0 || (found.truncate() - Vec3::from_array(color)).length() < 0.05, "{value}");
            }
        }
    }

    #[test]
    fn whatever_is_looked_up_with_an_opacity_is_found_to_be_lit() {
        let curve: Curve =
            "0,ff0000,0;120,ff0000,0;121,00ff00,0.9;130,0000ff,0.9;131,ff0000,0".parse().expect("a curve");
        for table in [None, Some(1.0)].map(|step| ValueTable::new(&curve, [0.0, 255.0], step)) {
            let mut dark = 0;
            for (front, back) in
                (28_000..36_000).step_by(23).flat_map(|front| (0..900).step_by(41).map(move |by| (front, front + by)))
            {
                let is_lit = table.any([front, back]);
                let light = table
                    .look_up(f32::from(front), f32::from(back))
                    .max(table.look_up(f32::from(back), f32::from(front)));
                assert!(is_lit || light.w == 0.0, "{front} to {back}: {light}");
                dark += u32::from(!is_lit);
            }
            assert!(dark > 1000, "{dark}");
        }
    }

    #[test]
    fn ranges_beyond_the_most_are_joined() {
        let peaks = |count: u16| -> Curve {
            let peak = |place: u16| format!("{place},ff0000,0;{},ff0000,0.5;{},ff0000,0", place + 1, place + 2);
            // Each a little farther from the one before.
            let peaks: Vec<String> = (0..count).map(|number| peak(8 * number + number * number / 2)).collect();
            peaks.join(";").parse().expect("a curve")
        };
        let table = |count| ValueTable::new(&peaks(count), [0.0, 255.0], None);
        for count in [1, 5, 8] {
            assert_eq!(table(count).lit().len(), usize::from(count));
        }
        let joined = table(12);
        assert_eq!(joined.lit().len(), MOST_RANGES);
        let is_lit = |value: u16| {
            let place = f32::from(257 * value) * PER_STORED;
            joined.lit().iter().any(|&[first, end]| first <= place && place < end)
        };
        // The first ones, which lie nearest to each other; between the last ones, at 130 and 148, nothing is lit.
        assert!((0..42).all(is_lit) && !is_lit(45) && is_lit(131) && !is_lit(140) && is_lit(149) && !is_lit(250));
        assert!(joined.lit().windows(2).all(|pair| pair[0][1] < pair[1][0]));
        // What is leapt over is not joined.
        assert!(!joined.any([257 * 4, 257 * 6]) && joined.any([257 * 9, 257 * 9]));
    }

    #[test]
    fn lit_ranges_are_found() {
        let table = ValueTable::new(&curve(), [0.0, 255.0], None);
        assert!(!table.any([0, 16_000]) && table.any([0, 17_000]) && table.any([51_500, 52_500]));
        assert!(!ValueTable::new(&Curve::default(), [0.0, 255.0], None).any([0, 65_535]));
    }
}
