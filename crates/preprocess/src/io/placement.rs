//! Where the voxels lie: from the vectors of a header to a checked [`GridGeometry`].

use std::path::Path;

use glam::{DMat3, DVec3};
use voxrole_pack::{GridGeometry, WorldFrame};

use crate::{Error, Result};

/// Deviation from orthonormal axes that is taken for the rounding of a header's decimals. Axes further off are left as
/// they are, for [`GridGeometry::validate`] to refuse.
const ROUNDING_TOLERANCE: f64 = 1e-3;
/// Deviation below which nothing is gained by making axes orthonormal.
const EXACT_TOLERANCE: f64 = 1e-12;
/// Longest name of a unit of length, in bytes.
const MAX_UNIT_BYTES: usize = 32;

/// What a file's world axes mean, x and y being what differs between the conventions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FileFrame {
    Unspecified,
    LeftPosteriorSuperior,
    RightAnteriorSuperior,
    LeftAnteriorSuperior,
}

impl FileFrame {
    /// `vector` in the frame left-posterior-superior; unchanged where nothing is known.
    fn to_lps(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        // `0 − x` and not `−x`, which would make −0 from 0.
        match self {
            Self::Unspecified | Self::LeftPosteriorSuperior => [x, y, z],
            Self::RightAnteriorSuperior => [0.0 - x, 0.0 - y, z],
            Self::LeftAnteriorSuperior => [x, 0.0 - y, z],
        }
    }
}

/// A grid's placement as its header gives it, in the file's frame.
#[derive(Clone, Debug)]
pub(super) struct Placement {
    pub dims: [u32; 3],
    pub spacing: [f64; 3],
    /// World direction of each index axis.
    pub direction: [[f64; 3]; 3],
    pub origin: [f64; 3],
    pub unit: String,
    pub frame: FileFrame,
}

impl Placement {
    /// A grid at the origin, along the axes of a world about which nothing is known.
    pub fn axis_aligned(dims: [u32; 3], spacing: [f64; 3]) -> Self {
        let direction = DMat3::IDENTITY.to_cols_array_2d();
        Self { dims, spacing, direction, origin: [0.0; 3], unit: String::new(), frame: FileFrame::Unspecified }
    }

    /// Takes spacing and direction from the world vectors between neighbouring voxels along each axis.
    pub fn with_steps(self, steps: [[f64; 3]; 3]) -> Self {
        let spacing = steps.map(|step| DVec3::from_array(step).length());
        let direction = [0, 1, 2].map(|axis| steps[axis].map(|component| component / spacing[axis]));
        Self { spacing, direction, ..self }
    }

    /// The checked geometry, in the frame left-posterior-superior where the file's frame is known.
    ///
    /// # Errors
    /// [`Error::Format`], naming `path`, for what [`GridGeometry::validate`] refuses.
    pub fn geometry(self, path: &Path) -> Result<GridGeometry> {
        let geometry = GridGeometry {
            dims: self.dims,
            spacing: self.spacing,
            origin: self.frame.to_lps(self.origin),
            direction: orthonormal(self.direction.map(|axis| self.frame.to_lps(axis))),
            unit: unit_name(&self.unit).map_err(|message| Error::format(path, message))?,
            frame: match self.frame {
                FileFrame::Unspecified => WorldFrame::Unspecified,
                _ => WorldFrame::LeftPosteriorSuperior,
            },
        };
        geometry.validate().map_err(|error| Error::format(path, format!("expected a usable grid, found {error}")))?;
        Ok(geometry)
    }
}

/// The nearest orthonormal axes (the polar factor, by Newton's iteration `X ← (X + X⁻ᵀ)/2`; Higham 1986) of axes that
/// are off by a header's rounding; no axis is preferred over another. Other axes are returned unchanged.
fn orthonormal(direction: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let deviation = |axes: DMat3| {
        let gram = axes.transpose() * axes - DMat3::IDENTITY;
        gram.to_cols_array().iter().fold(0.0, |largest: f64, entry| largest.max(entry.abs()))
    };
    let mut axes = DMat3::from_cols_array_2d(&direction);
    if !axes.is_finite() || deviation(axes) > ROUNDING_TOLERANCE {
        return direction;
    }
    // The error is squared by each step: from 1e-3 two are enough.
    for _ in 0..4 {
        if deviation(axes) <= EXACT_TOLERANCE {
            break;
        }
        axes = (axes + axes.inverse().transpose()) * 0.5;
    }
    axes.to_cols_array_2d()
}

/// One spelling for each of the common units of length; other names are kept.
fn unit_name(name: &str) -> std::result::Result<String, String> {
    let name = name.trim();
    if name.len() > MAX_UNIT_BYTES || name.chars().any(char::is_control) {
        return Err(format!("the unit of length is {} bytes of text: expected a short name such as mm", name.len()));
    }
    Ok(match name {
        "millimeter" | "millimeters" | "millimetre" | "millimetres" => "mm",
        // The micro sign, the Greek letter mu, and the ways around both.
        "um" | "\u{3bc}m" | "micron" | "microns" | "micrometer" | "micrometers" | "micrometre" | "micrometres" => {
            "\u{b5}m"
        }
        "angstrom" | "angstroms" | "\u{212b}" => "\u{c5}",
        "picometer" | "picometers" | "picometre" | "picometres" => "pm",
        "nanometer" | "nanometers" | "nanometre" | "nanometres" => "nm",
        "centimeter" | "centimeters" | "centimetre" | "centimetres" => "cm",
        "inch" | "inches" => "in",
        "meter" | "meters" | "metre" | "metres" => "m",
        "kilometer" | "kilometers" | "kilometre" | "kilometres" => "km",
        "none" | "unknown" | "???" => "",
        other => other,
    }
    .to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn deviation(direction: [[f64; 3]; 3]) -> f64 {
        let axes = DMat3::from_cols_array_2d(&direction);
        let gram = axes.transpose() * axes - DMat3::IDENTITY;
        gram.to_cols_array().iter().fold(0.0, |largest: f64, entry| largest.max(entry.abs()))
    }

    #[test]
    fn rounded_axes_become_orthonormal() {
        // 30° about z, rounded to three digits; the third axis mirrored.
        let rounded = [[0.866, 0.5, 0.0], [-0.5, 0.866, 0.0], [0.0, 0.0, -1.0]];
        assert!(deviation(rounded) > 1e-5);
        let exact = orthonormal(rounded);
        assert!(deviation(exact) < 1e-12, "{exact:?}");
        for (axis, expected) in
            exact.iter().zip([[0.75_f64.sqrt(), 0.5, 0.0], [-0.5, 0.75_f64.sqrt(), 0.0], [0.0, 0.0, -1.0]])
        {
            for (found, expected) in axis.iter().zip(expected) {
                assert!((found - expected).abs() < 3e-5, "{exact:?}");
            }
        }
    }

    #[test]
    fn exact_axes_stay_as_they_are() {
        let axes = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        assert_eq!(orthonormal(axes), axes);
    }

    #[test]
    fn sheared_axes_are_left_for_the_check_to_refuse() {
        let sheared = [[1.0, 0.0, 0.0], [0.002, 1.0, 0.0], [0.0, 0.0, 1.0]];
        assert_eq!(orthonormal(sheared), sheared);
        let placement = Placement { direction: sheared, ..Placement::axis_aligned([4; 3], [1.0; 3]) };
        let message = placement.geometry(Path::new("tilted.nrrd")).expect_err("shear").to_string();
        assert!(message.contains("tilted.nrrd") && message.contains("not at right angles"), "{message}");
    }

    #[test]
    fn frames_differ_in_the_signs_of_x_and_y() {
        for (frame, expected) in [
            (FileFrame::RightAnteriorSuperior, [-1.0, -2.0, 3.0]),
            (FileFrame::LeftAnteriorSuperior, [1.0, -2.0, 3.0]),
            (FileFrame::LeftPosteriorSuperior, [1.0, 2.0, 3.0]),
            (FileFrame::Unspecified, [1.0, 2.0, 3.0]),
        ] {
            assert_eq!(frame.to_lps([1.0, 2.0, 3.0]), expected, "{frame:?}");
        }
        assert!(FileFrame::RightAnteriorSuperior.to_lps([0.0; 3]).iter().all(|zero| zero.is_sign_positive()));
    }

    #[test]
    fn steps_give_spacing_and_direction() {
        let placement =
            Placement::axis_aligned([4; 3], [1.0; 3]).with_steps([[0.0, 2.0, 0.0], [3.0, 4.0, 0.0], [0.0, 0.0, -0.1]]);
        assert_eq!(placement.spacing, [2.0, 5.0, 0.1]);
        assert_eq!(placement.direction, [[0.0, 1.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, -1.0]]);
    }

    #[test]
    fn units_have_one_spelling() {
        assert_eq!(unit_name("um"), Ok("µm".into()));
        assert_eq!(unit_name("micron"), Ok("µm".into()));
        assert_eq!(unit_name(" mm "), Ok("mm".into()));
        for (long, short) in
            [("angstrom", "Å"), ("picometers", "pm"), ("centimetre", "cm"), ("inch", "in"), ("kilometer", "km")]
        {
            assert_eq!(unit_name(long), Ok(short.into()));
        }
        assert_eq!(unit_name("parsec"), Ok("parsec".into()));
        assert!(unit_name(&"m".repeat(33)).is_err());
        assert!(unit_name("m\0m").is_err());
    }
}
