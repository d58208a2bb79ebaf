//! Sizes on the command line, shared by both programs.

/// Bytes from a number and a unit, such as 900MiB.
///
/// # Errors
/// Says what is expected.
pub fn byte_size(text: &str) -> Result<u64, String> {
    let digits = text.find(|letter: char| !letter.is_ascii_digit() && letter != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let factor = match unit.trim().to_ascii_lowercase().as_str() {
        "kib" | "k" => Some(1024.0),
        "mib" | "m" => Some(1024.0 * 1024.0),
        "gib" | "g" => Some(1024.0 * 1024.0 * 1024.0),
        "tib" | "t" => Some(1024.0 * 1024.0 * 1024.0 * 1024.0),
        "kb" => Some(1e3),
        "mb" => Some(1e6),
        "gb" => Some(1e9),
        "tb" => Some(1e12),
        _ => None,
    };
    let size = number.parse::<f64>().ok().zip(factor).map(|(number, factor)| number * factor);
    // What is more than any number of bytes is as good as no limit.
    size.filter(|size| *size >= 1.0)
        .map(|size| size as u64)
        .ok_or_else(|| "expected a number and a unit, such as 900MiB or 8GiB".into())
}

/// A number of bytes in words, in the largest unit of which there is one at least.
#[must_use]
pub fn byte_size_text(bytes: u64) -> String {
    let units = [("TiB", 40), ("GiB", 30), ("MiB", 20), ("KiB", 10)];
    let unit = units.into_iter().find(|(_, bits)| bytes >> bits > 0);
    unit.map_or_else(
        || format!("{bytes} bytes"),
        |(name, bits)| {
            let number = bytes as f64 / (1_u64 << bits) as f64;
            let decimals = usize::from(number < 9.95 && number.fract() != 0.0);
            format!("{number:.decimals$} {name}")
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_units() {
        assert_eq!(byte_size("64MiB"), Ok(64 << 20));
        assert_eq!(byte_size("1.5 GiB"), Ok(3 << 29));
        assert_eq!(byte_size("2g"), Ok(2 << 30));
        assert_eq!(byte_size("10MB"), Ok(10_000_000));
        for wrong in ["", "64", "MiB", "-1GiB", "1e3MiB", "1PiB", "0GiB", "NaNMiB"] {
            assert!(byte_size(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn sizes_are_said_in_the_unit_that_fits() {
        for (bytes, text) in [
            (0, "0 bytes"),
            (1023, "1023 bytes"),
            (1 << 10, "1 KiB"),
            (3 << 19, "1.5 MiB"),
            (256 << 20, "256 MiB"),
            (64 << 30, "64 GiB"),
            (u64::MAX, "16777216 TiB"),
        ] {
            assert_eq!(byte_size_text(bytes), text);
        }
    }
}
