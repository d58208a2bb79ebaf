//! Numbers on a plot: ticks, and how they are written.

/// More ticks than this are never given.
const MOST_TICKS: usize = 20;

/// At most `most` intervals between round numbers (1, 2 or 5 times a power of ten) from `low` to `high`: the numbers and
/// their labels. None where the range has no length.
#[must_use]
pub fn ticks([low, high]: [f64; 2], most: usize) -> Vec<(f64, String)> {
    let step = round_step((high - low) / most.clamp(1, MOST_TICKS) as f64);
    if !(step.is_finite() && step > 0.0) {
        return Vec::new();
    }
    let largest = low.abs().max(high.abs());
    // A multiple of the step may miss the range's end by its rounding.
    let slack = 1e-6 * step;
    let first = ((low - slack) / step).ceil();
    (0..=MOST_TICKS)
        .map(|count| (first + count as f64) * step)
        .take_while(|tick| *tick <= high + slack)
        .map(|tick| (tick, tick_label(tick, step, largest)))
        .collect()
}

/// The smallest of 1, 2 and 5 times a power of ten that is at least `step`.
fn round_step(step: f64) -> f64 {
    let power = 10_f64.powf(step.log10().floor());
    [1.0, 2.0, 5.0].into_iter().map(|factor| factor * power).find(|round| *round >= step).unwrap_or(10.0 * power)
}

/// A tick's number with just the digits that `step` needs; as a power of ten where the axis reaches a million or stays
/// below a thousandth.
fn tick_label(tick: f64, step: f64, largest: f64) -> String {
    if tick.abs() < 0.5 * step {
        return "0".to_owned();
    }
    let step_exponent = (step.log10() + 1e-9).floor();
    if !(1e-3..1e6).contains(&largest) {
        let digits = (tick.abs().log10() + 1e-9).floor() - step_exponent;
        return format!("{tick:.*e}", digits.clamp(0.0, 15.0) as usize);
    }
    format!("{tick:.*}", (-step_exponent).clamp(0.0, 15.0) as usize)
}

/// A number with four significant digits, without needless zeros; as a power of ten where it is very large or small.
#[must_use]
pub fn short_number(number: f64) -> String {
    if number == 0.0 || !number.is_finite() {
        return format!("{number:.0}");
    }
    let exponent = number.abs().log10().floor();
    if !(-4.0..7.0).contains(&exponent) {
        return format!("{number:.3e}");
    }
    let decimals = (3.0 - exponent).max(0.0) as usize;
    let text = format!("{number:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// A whole number in groups of three digits.
#[must_use]
pub fn group_thousands(number: u64) -> String {
    let digits = number.to_string();
    let mut grouped = String::with_capacity(digits.len() + digits.len() / 3);
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            grouped.push(',');
        }
        grouped.push(digit);
    }
    grouped
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(range: [f64; 2], most: usize) -> Vec<String> {
        ticks(range, most).into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round() {
        assert_eq!(labels([0.0, 1.0], 9), ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels([0.0, 0.3], 9).last().map(String::as_str), Some("0.30"));
        assert_eq!(labels([-0.1, 0.3], 4), ["-0.1", "0", "0.1", "0.2", "0.3"]);
        assert_eq!(labels([-15.0, 15.0], 9), ["-15", "-10", "-5", "0", "5", "10", "15"]);
        assert_eq!(labels([0.0, 255.0], 6), ["0", "50", "100", "150", "200", "250"]);
        assert_eq!(labels([0.0, 4e6], 9), ["0", "5e5", "1.0e6", "1.5e6", "2.0e6", "2.5e6", "3.0e6", "3.5e6", "4.0e6"]);
        assert_eq!(labels([3e-7, 5.1e-7], 9), ["3.0e-7", "3.5e-7", "4.0e-7", "4.5e-7", "5.0e-7"]);
    }

    #[test]
    fn extreme_ranges_end_and_have_few_ticks() {
        for range in
            [[1e16, 1e16 + 2.0], [-1e300, 1e300], [0.0, 1e-300], [1.0, 1.0 + f64::EPSILON], [5.0, 5.0], [f64::NAN, 1.0]]
        {
            assert!(ticks(range, 9).len() <= 10, "{range:?}");
        }
    }

    #[test]
    fn numbers_are_short() {
        let texts = [0.0, 255.0, -1024.4, 0.123_456, 1.5, 12_345.6, 3e9, 2e-7].map(short_number);
        assert_eq!(texts, ["0", "255", "-1024", "0.1235", "1.5", "12346", "3.000e9", "2.000e-7"]);
        assert_eq!([7, 1234, 1_234_567].map(group_thousands), ["7", "1,234", "1,234,567"]);
    }
}
