//! `voxrole info` and `voxrole verify`.

use std::fmt::{Display, LowerExp, Write};

use serde_json::json;
use voxrole_pack::directory::Table;
use voxrole_pack::layer::Quantization;
use voxrole_pack::levels::dims_of_level;
use voxrole_pack::{Layer, LayerKind, Reader, WorldFrame};

use super::args::{FileArgs, InfoArgs};

pub fn run(args: &InfoArgs) -> anyhow::Result<()> {
    let reader = super::open(&args.file)?;
    if args.json {
        super::print(&format!("{}\n", serde_json::to_string_pretty(&as_json(&reader)?)?))
    } else {
        super::print(&as_text(&reader)?)
    }
}

pub fn verify(args: &FileArgs) -> anyhow::Result<()> {
    use anyhow::Context;
    let reader = super::open(&args.file)?;
    let verified = reader.verify().with_context(|| args.file.display().to_string())?;
    let (file, bricks, bytes) = (args.file.display(), verified.bricks, verified.bytes);
    super::print(&format!("{file}: sound; {bricks} bricks and all {bytes} bytes checked\n"))
}

/// Bytes of a table on all levels.
pub fn stored_bytes(reader: &Reader, table: Table) -> voxrole_pack::Result<u64> {
    let directory = reader.directory();
    let mut bytes = 0;
    for level in 0..reader.levels() {
        for place in directory.order().bricks(table, level).into_iter().flatten() {
            bytes += directory.entry(place)?.stored_bytes();
        }
    }
    Ok(bytes)
}

fn as_text(reader: &Reader) -> anyhow::Result<String> {
    let mut text = String::new();
    let header = reader.header();
    let geometry = &header.geometry;
    let statistics = &header.statistics;
    let list = |numbers: [f64; 3]| numbers.map(shown).join(", ");
    let unit = if geometry.unit.is_empty() { String::new() } else { format!(" {}", geometry.unit) };
    let frame = match geometry.frame {
        WorldFrame::Unspecified => "unspecified",
        WorldFrame::LeftPosteriorSuperior => "left-posterior-superior",
    };
    writeln!(text, "input       {}", header.source.name)?;
    writeln!(text, "sha256      {} (voxels)", header.source.voxels_sha256_hex())?;
    writeln!(text, "made by     {}", header.made_by)?;
    writeln!(text, "voxels      {}", geometry.dims.map(|dim| dim.to_string()).join(" x "))?;
    writeln!(text, "spacing     {}{unit}", list(geometry.spacing))?;
    writeln!(text, "origin      {}", list(geometry.origin))?;
    writeln!(text, "direction   {}", geometry.direction.map(list).join("; "))?;
    writeln!(text, "world       {frame}")?;
    writeln!(text, "values      {} to {}", shown(statistics.value_range[0]), shown(statistics.value_range[1]))?;
    writeln!(text, "gradient    up to {}", shown(statistics.max_gradient))?;
    writeln!(
        text,
        "boundary    {} voxels, {} without, {} masked",
        statistics.hits, statistics.misses, statistics.masked
    )?;
    for parameter in &header.parameters {
        writeln!(text, "{:<11} {}", parameter.name, parameter.value)?;
    }
    let voxels = geometry.voxel_count() as f64;
    for (index, layer) in header.layers.iter().enumerate() {
        let bytes = stored_bytes(reader, Table::Layer(index))?;
        writeln!(
            text,
            "layer       {} as {}{}: {bytes} bytes, {:.2} per voxel",
            layer.kind.name(),
            layer.scalar_type.name(),
            precision(layer),
            bytes as f64 / voxels
        )?;
    }
    for shape in &header.histograms {
        let bins = shape.axes.iter().map(|axis| axis.bins.to_string()).collect::<Vec<_>>().join(" x ");
        writeln!(text, "histogram   {} of {bins} bins", shape.kind.name())?;
    }
    if header.layer(LayerKind::Distance).is_ok() {
        let bytes = stored_bytes(reader, Table::Mask)?;
        writeln!(text, "mask        of voxels with a boundary: {bytes} bytes, {:.2} per voxel", bytes as f64 / voxels)?;
    }
    let levels: Vec<_> = (0..reader.levels())
        .map(|level| dims_of_level(geometry.dims_usize(), level).map(|dim| dim.to_string()).join(" x "))
        .collect();
    writeln!(text, "levels      {}", levels.join(", "))?;
    writeln!(text, "file        {} bytes, {:.2} per voxel", reader.file_bytes(), reader.file_bytes() as f64 / voxels)?;
    Ok(text)
}

/// All digits, with an exponent where there would be many zeros.
fn shown<T: Copy + Into<f64> + Display + LowerExp>(number: T) -> String {
    let size = number.into().abs();
    if size == 0.0 || (1e-4..1e9).contains(&size) { number.to_string() } else { format!("{number:e}") }
}

fn precision(layer: &Layer) -> String {
    match layer.quantization {
        Quantization::Linear { slope, intercept } if slope != 1.0 || intercept != 0.0 => {
            format!(" (times {} plus {})", shown(slope), shown(intercept))
        }
        Quantization::Linear { .. } => " (exact)".into(),
        Quantization::Distance(distance) => format!(" (±{:e}, up to {})", layer.error_bound, shown(distance.d_max)),
        Quantization::HitGradient(hit) => {
            format!(" (±{:e}, {} to {})", layer.error_bound, shown(hit.low), shown(hit.high))
        }
        Quantization::Octahedral => " (octahedral, ±0.95°)".into(),
    }
}

fn as_json(reader: &Reader) -> anyhow::Result<serde_json::Value> {
    let header = reader.header();
    let layers: Vec<_> = header
        .layers
        .iter()
        .enumerate()
        .map(|(index, layer)| {
            Ok(json!({
                "kind": layer.kind.name(),
                "type": layer.scalar_type.name(),
                "quantization": layer.quantization,
                "error_bound": layer.error_bound,
                "stored_bytes": stored_bytes(reader, Table::Layer(index))?,
            }))
        })
        .collect::<anyhow::Result<_>>()?;
    let histograms: Vec<_> =
        header.histograms.iter().map(|shape| json!({ "kind": shape.kind.name(), "axes": shape.axes })).collect();
    let parameters: serde_json::Map<_, _> =
        header.parameters.iter().map(|parameter| (parameter.name.clone(), json!(parameter.value))).collect();
    Ok(json!({
        "made_by": header.made_by,
        "source": { "name": header.source.name, "voxels_sha256": header.source.voxels_sha256_hex() },
        "geometry": header.geometry,
        "statistics": header.statistics,
        "parameters": parameters,
        "layers": layers,
        "histograms": histograms,
        "levels": reader.levels(),
        "file_bytes": reader.file_bytes(),
    }))
}
