//! OME-Zarr's description of an image: axes, the array of full resolution, spacing and origin
//! (versions 0.4 and 0.5, <https://ngff.openmicroscopy.org/specifications/>).

use serde::Deserialize;
use serde_json::{Map, Value};

use super::super::units::length_in_picometres;

/// An image in several resolutions.
#[derive(Debug, Deserialize)]
pub struct Multiscale {
    axes: Vec<Axis>,
    datasets: Vec<Dataset>,
    #[serde(default, rename = "coordinateTransformations")]
    transformations: Vec<Transformation>,
}

#[derive(Debug, Deserialize)]
struct Axis {
    name: String,
    unit: Option<String>,
}

#[derive(Debug, Deserialize)]
struct Dataset {
    path: String,
    #[serde(default, rename = "coordinateTransformations")]
    transformations: Vec<Transformation>,
}

#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum Transformation {
    Identity,
    Scale { scale: Vec<f64> },
    Translation { translation: Vec<f64> },
}

/// Where the voxels of full resolution lie, along x, y and z.
#[derive(Debug, PartialEq)]
pub struct Lattice {
    pub spacing: [f64; 3],
    pub origin: [f64; 3],
    pub unit: String,
}

impl Multiscale {
    /// The one image that a group's attributes describe; `None` when they describe none.
    ///
    /// # Errors
    /// A message, for descriptions that are broken, of several images, or of other versions.
    pub fn of_group(attributes: &Map<String, Value>) -> Result<Option<Self>, String> {
        let described = match attributes.get("ome") {
            Some(Value::Object(ome)) => ome,
            _ => attributes,
        };
        let Some(images) = described.get("multiscales") else { return Ok(None) };
        let images = images.as_array().map(Vec::as_slice).unwrap_or_default();
        let [image] = images else {
            return Err(format!("expected one image in `multiscales`, found {}", images.len()));
        };
        let version = described.get("version").or(image.get("version")).and_then(Value::as_str);
        if let Some(version) = version.filter(|version| !["0.4", "0.5"].contains(version)) {
            return Err(format!("expected OME-Zarr 0.4 or 0.5, found version {version:?}: convert it first"));
        }
        let image = Self::deserialize(image)
            .map_err(|error| format!("expected `multiscales` of OME-Zarr 0.4 or 0.5, found: {error}"));
        image.map(Some)
    }

    /// Names of the axes.
    pub fn axis_names(&self) -> Vec<&str> {
        self.axes.iter().map(|axis| axis.name.as_str()).collect()
    }

    /// The path of the array of full resolution.
    ///
    /// # Errors
    /// A message, when there is none.
    pub fn full_resolution(&self) -> Result<&str, String> {
        let first = self.datasets.first().ok_or("expected `datasets` in `multiscales`, found none")?;
        Ok(first.path.trim_matches('/'))
    }

    /// Spacing and origin along the axes `[x, y, z]`, in the unit of x.
    ///
    /// # Errors
    /// A message, for transformations of other lengths than there are axes, and for units that cannot be converted.
    pub fn lattice(&self, axes: [usize; 3]) -> Result<Lattice, String> {
        let unit_of = |axis: usize| self.axes[axis].unit.as_deref().unwrap_or_default();
        let (mut spacing, mut origin) = ([1.0; 3], [0.0; 3]);
        let of_dataset = self.datasets.first().map(|dataset| dataset.transformations.as_slice()).unwrap_or_default();
        for transformation in of_dataset.iter().chain(&self.transformations) {
            let values = match transformation {
                Transformation::Identity => continue,
                Transformation::Scale { scale: values } | Transformation::Translation { translation: values } => values,
            };
            if values.len() != self.axes.len() {
                let (expected, found) = (self.axes.len(), values.len());
                return Err(format!(
                    "expected transformations of {expected} numbers, one for each axis, found {found}"
                ));
            }
            for (place, &axis) in axes.iter().enumerate() {
                if matches!(transformation, Transformation::Scale { .. }) {
                    spacing[place] *= values[axis];
                    origin[place] *= values[axis];
                } else {
                    origin[place] += values[axis];
                }
            }
        }
        let unit = unit_of(axes[0]);
        for (place, &axis) in axes.iter().enumerate().filter(|(_, axis)| unit_of(**axis) != unit) {
            let (own, first) = (length_in_picometres(unit_of(axis)), length_in_picometres(unit));
            let factor = own
                .zip(first)
                .map(|(own, first)| own / first)
                .ok_or_else(|| format!("expected axes of one unit, found {unit:?} and {:?}", unit_of(axis)))?;
            spacing[place] *= factor;
            origin[place] *= factor;
        }
        Ok(Lattice { spacing, origin, unit: unit.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(json: &str) -> Result<Multiscale, String> {
        let attributes: Map<String, Value> = serde_json::from_str(json).expect("JSON");
        Multiscale::of_group(&attributes).map(|image| image.expect("an image"))
    }

    const GOOD: &str = r#"{"multiscales": [{"version": "0.4",
        "axes": [{"name": "c", "type": "channel"}, {"name": "z", "type": "space", "unit": "micrometer"},
                 {"name": "y", "type": "space", "unit": "nanometer"}, {"name": "x", "type": "space", "unit": "nanometer"}],
        "datasets": [{"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, 2, 250, 500]},
                                                                 {"type": "translation", "translation": [0, 1, 10, 20]}]}],
        "coordinateTransformations": [{"type": "scale", "scale": [1, 2, 2, 2]}]}]}"#;

    #[test]
    fn transformations_follow_each_other() {
        let image = image(GOOD).expect("good");
        assert_eq!((image.full_resolution(), image.axis_names()), (Ok("0"), vec!["c", "z", "y", "x"]));
        let lattice = image.lattice([3, 2, 1]).expect("good");
        assert_eq!((lattice.spacing, lattice.origin), ([1000.0, 500.0, 4000.0], [40.0, 20.0, 2000.0]));
        assert_eq!(lattice.unit, "nanometer");
    }

    #[test]
    fn bad_descriptions_are_refused() {
        for (old, new, expected) in [
            ("\"0.4\"", "\"0.2\"", "0.4 or 0.5"),
            ("[1, 2, 250, 500]", "[1, 2, 250]", "4 numbers"),
            ("\"micrometer\"", "\"second\"", "one unit"),
            ("\"scale\", \"scale\": [1, 2, 2, 2]", "\"affine\"", "affine"),
            ("\"datasets\"", "\"data\"", "datasets"),
        ] {
            let outcome = image(&GOOD.replace(old, new)).and_then(|image| image.lattice([3, 2, 1]));
            let message = outcome.expect_err(expected);
            assert!(message.contains(expected) && message.contains("found"), "{message}");
        }
    }
}
