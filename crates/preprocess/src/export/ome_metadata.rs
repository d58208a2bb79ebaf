//! What an OME-Zarr 0.5 group says of its arrays: <https://ngff.openmicroscopy.org/0.5/>.

use serde_json::{Map, Value, json};
use voxrole_pack::{GridGeometry, Header, WorldFrame};

use crate::field_volume::FieldVolume;

/// The arrays' axes, slowest first.
pub(super) fn axis_names(components: usize) -> &'static [&'static str] {
    if components == 1 { &["z", "y", "x"] } else { &["c", "z", "y", "x"] }
}

/// The group's attributes: `ome`, and under `voxrole` what that cannot hold. `finest` is the level of path 0, and `geometries`
/// those of all levels.
pub(super) fn attributes(header: &Header, finest: &FieldVolume, geometries: &[GridGeometry]) -> Map<String, Value> {
    let geometry = finest.geometry();
    let names = axis_names(finest.components());
    let axes: Vec<_> = names.iter().map(|name| axis(name, &geometry.unit)).collect();
    let datasets: Vec<_> = geometries.iter().enumerate().map(|(path, level)| dataset(path, names, level)).collect();
    let ome = json!({
        "version": "0.5",
        "multiscales": [{
            "name": finest.field().name(),
            "axes": axes,
            "datasets": datasets,
            "type": "nearest",
            "metadata": {
                "description": "each level has every second voxel of the one before along each axis, from the first on",
            },
        }],
        "omero": { "channels": channels(finest) },
    });
    let matrix = geometry.world_from_index();
    let rows: Vec<Vec<f64>> = (0..4)
        .map(|row| match row {
            3 => vec![0.0, 0.0, 0.0, 1.0],
            _ => [matrix.x_axis[row], matrix.y_axis[row], matrix.z_axis[row], matrix.translation[row]].to_vec(),
        })
        .collect();
    let voxrole = json!({
        "field": finest.field().name(),
        "description": finest.field().description(),
        "world_from_index": rows,
        "index": ["x", "y", "z"],
        "world": match geometry.frame {
            WorldFrame::Unspecified => "unspecified",
            WorldFrame::LeftPosteriorSuperior => "left-posterior-superior",
        },
        "unit": geometry.unit,
        "source": header.source.name,
        "voxels_sha256": header.source.voxels_sha256_hex(),
        "made_by": header.made_by,
    });
    Map::from_iter([("ome".into(), ome), ("voxrole".into(), voxrole)])
}

fn axis(name: &str, unit: &str) -> Value {
    if name == "c" {
        return json!({ "name": name, "type": "channel" });
    }
    match unit_name(unit) {
        Some(unit) => json!({ "name": name, "type": "space", "unit": unit }),
        None => json!({ "name": name, "type": "space" }),
    }
}

/// A level's scale and translation; those of channels are 1 and 0.
fn dataset(path: usize, names: &[&str], level: &GridGeometry) -> Value {
    let of_axes = |[x, y, z]: [f64; 3], of_channels: f64| -> Vec<f64> {
        [of_channels, z, y, x][4 - names.len()..].iter().map(|number| number + 0.0).collect()
    };
    json!({
        "path": path.to_string(),
        "coordinateTransformations": [
            { "type": "scale", "scale": of_axes(level.spacing, 1.0) },
            { "type": "translation", "translation": of_axes(level.origin, 0.0) },
        ],
    })
}

/// What viewers show at first: the finite range, in grey.
fn channels(volume: &FieldVolume) -> Vec<Value> {
    let [low, high] = volume.finite_range().unwrap_or([0.0, 1.0]);
    let high = if high > low { high } else { low + 1.0 };
    let labels = if volume.components() == 1 { vec![volume.field().name()] } else { vec!["x", "y", "z"] };
    let window = json!({ "min": low, "max": high, "start": low, "end": high });
    labels
        .into_iter()
        .map(|label| json!({ "label": label, "color": "FFFFFF", "active": true, "window": window.clone() }))
        .collect()
}

/// The names of UDUNITS-2 that the specification lists.
pub(super) fn unit_name(unit: &str) -> Option<&'static str> {
    Some(match unit {
        "km" => "kilometer",
        "m" => "meter",
        "cm" => "centimeter",
        "mm" => "millimeter",
        "\u{b5}m" => "micrometer",
        "nm" => "nanometer",
        "pm" => "picometer",
        "\u{c5}" | "\u{212b}" => "angstrom",
        "in" | "inch" => "inch",
        _ => return None,
    })
}
