//! `voxrole histogram`.

use anyhow::{Context, bail};
use voxrole_preprocess::plot::{HistogramLabels, histogram_csv, histogram_png};

use super::args::HistogramArgs;

pub fn run(args: &HistogramArgs) -> anyhow::Result<()> {
    let extension = args.output.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let draw = match extension.to_ascii_lowercase().as_str() {
        "png" => true,
        "csv" => false,
        _ => bail!("{}: name a picture (.png) or a table (.csv)", args.output.display()),
    };
    super::check_output(&args.output, &[&args.file], None)?;
    let reader = super::open(&args.file)?;
    let named = || args.file.display().to_string();
    let histogram = reader.read_histogram(args.kind.into()).with_context(named)?;
    let header = reader.header();
    let labels = HistogramLabels { source: &header.source.name, length_unit: &header.geometry.unit };
    let bytes = if draw {
        histogram_png(&histogram, &labels).with_context(named)?
    } else {
        histogram_csv(&histogram, &labels).with_context(named)?.into_bytes()
    };
    super::write(&args.output, &bytes)
}
