//! Colours as typed: six hexadecimal digits. They are display values (sRGB), and are blended as such.

use super::ParseError;

/// Red, green, blue in 0..=1 from `RRGGBB`, with or without a leading `#`.
///
/// # Errors
/// [`ParseError`] for anything else.
pub fn parse_color(text: &str) -> Result<[f32; 3], ParseError> {
    let digits = text.trim().trim_start_matches('#');
    let fail = || ParseError(format!("colour `{text}` is not six hexadecimal digits such as E69F00"));
    if digits.len() != 6 || !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return Err(fail());
    }
    let number = u32::from_str_radix(digits, 16).map_err(|_| fail())?;
    let [_, red, green, blue] = number.to_be_bytes();
    Ok([red, green, blue].map(|channel| f32::from(channel) / 255.0))
}

/// `RRGGBB`, each channel rounded to 8 bits.
#[must_use]
pub fn format_color(color: [f32; 3]) -> String {
    let [red, green, blue] = color.map(|channel| (channel.clamp(0.0, 1.0) * 255.0).round() as u8);
    format!("{red:02X}{green:02X}{blue:02X}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hexadecimal_forms_survive_the_round_trip() {
        for text in ["000000", "FFFFFF", "E69F00", "0072B2"] {
            assert_eq!(format_color(parse_color(text).expect("a colour")), text);
        }
        assert_eq!(parse_color("#ff0000"), Ok([1.0, 0.0, 0.0]));
    }

    #[test]
    fn anything_else_is_refused() {
        for text in ["", "12345", "1234567", "+12345", "gg0000", "ä00000"] {
            assert!(parse_color(text).is_err(), "{text}");
        }
    }
}
