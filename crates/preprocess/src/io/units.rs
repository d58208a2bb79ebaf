//! Units of length by their names and signs.

/// A unit of length in picometres, so that ratios of common units are exact; `None` for unknown ones.
pub(super) fn length_in_picometres(unit: &str) -> Option<f64> {
    Some(match unit {
        "m" | "meter" => 1e12,
        "cm" | "centimeter" => 1e10,
        "mm" | "millimeter" => 1e9,
        "\u{b5}m" | "\u{3bc}m" | "um" | "micrometer" => 1e6,
        "nm" | "nanometer" => 1e3,
        "\u{c5}" | "angstrom" => 1e2,
        "pm" | "picometer" => 1.0,
        "in" | "inch" => 2.54e10,
        _ => return None,
    })
}
