//! Units of length by their names and signs.

/// A unit of length in metres; `None` for unknown ones.
pub(super) fn length_in_metres(unit: &str) -> Option<f64> {
    Some(match unit {
        "m" | "meter" => 1.0,
        "cm" | "centimeter" => 1e-2,
        "mm" | "millimeter" => 1e-3,
        "\u{b5}m" | "\u{3bc}m" | "um" | "micrometer" => 1e-6,
        "nm" | "nanometer" => 1e-9,
        "\u{c5}" | "angstrom" => 1e-10,
        "pm" | "picometer" => 1e-12,
        "in" | "inch" => 0.0254,
        _ => return None,
    })
}
