//! Colour maps.

/// Viridis at ten equally spaced places: van der Walt and Smith's perceptually uniform map, from matplotlib.
const VIRIDIS: [[u8; 3]; 10] = [
    [0x44, 0x01, 0x54],
    [0x48, 0x28, 0x78],
    [0x3e, 0x49, 0x89],
    [0x31, 0x68, 0x8e],
    [0x26, 0x82, 0x8e],
    [0x1f, 0x9e, 0x89],
    [0x35, 0xb7, 0x79],
    [0x6e, 0xce, 0x58],
    [0xb5, 0xde, 0x2b],
    [0xfd, 0xe7, 0x25],
];

/// Red end of [`signed`].
const NEGATIVE: [u8; 3] = [255, 48, 32];
/// Blue end of [`signed`]; lighter than pure blue, which can hardly be told from black.
const POSITIVE: [u8; 3] = [64, 128, 255];

/// Viridis: dark violet at 0, yellow at 1, lightness growing evenly between; clamped, NaN reads as 0.
#[must_use]
pub fn viridis(t: f64) -> [u8; 3] {
    let place = t.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f64;
    let below = (place as usize).min(VIRIDIS.len() - 2);
    mix(VIRIDIS[below], VIRIDIS[below + 1], place - below as f64)
}

/// Black at 0, red towards −1, blue towards 1; clamped, NaN reads as 0.
#[must_use]
pub fn signed(t: f64) -> [u8; 3] {
    mix([0; 3], if t < 0.0 { NEGATIVE } else { POSITIVE }, t.abs().min(1.0))
}

/// Grey, black at 0 and white at 1; clamped, NaN reads as 0.
#[must_use]
pub fn grey(t: f64) -> [u8; 3] {
    [(255.0 * t.clamp(0.0, 1.0)).round() as u8; 3]
}

fn mix(from: [u8; 3], to: [u8; 3], share: f64) -> [u8; 3] {
    std::array::from_fn(|channel| {
        let [low, high] = [from[channel], to[channel]].map(f64::from);
        (high - low).mul_add(share, low).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_and_middle_are_the_published_colours() {
        assert_eq!([viridis(0.0), viridis(1.0)], [VIRIDIS[0], VIRIDIS[9]]);
        assert_eq!(viridis(1.0 / 3.0), VIRIDIS[3]);
        // matplotlib's own table at its middle: #21918c.
        assert!(viridis(0.5).iter().zip([0x21, 0x91, 0x8c]).all(|(a, b)| i32::from(*a).abs_diff(b) <= 3));
        assert_eq!([viridis(-1.0), viridis(2.0)], [VIRIDIS[0], VIRIDIS[9]]);
        assert_eq!([signed(-3.0), signed(0.0), signed(1.0)], [NEGATIVE, [0; 3], POSITIVE]);
        assert_eq!([grey(0.0), grey(0.5), grey(1.5)], [[0; 3], [128; 3], [255; 3]]);
    }

    #[test]
    fn lightness_of_viridis_grows() {
        let lightness = |t| {
            let [red, green, blue] = viridis(t).map(f64::from);
            0.2126 * red + 0.7152 * green + 0.0722 * blue
        };
        assert!((0..100).all(|step| lightness(f64::from(step + 1) / 100.0) > lightness(f64::from(step) / 100.0)));
    }
}
