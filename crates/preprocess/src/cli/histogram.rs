//! `voxrole histogram`.

use std::path::{Path, PathBuf};

use anyhow::Context;
use voxrole_preprocess::plot::{HistogramLabels, histogram_csv, histogram_npy, histogram_png};
use voxrole_preprocess::usage::UsageError;

use super::args::HistogramArgs;

/// What is written.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Picture,
    Table,
    Arrays,
}

pub fn run(args: &HistogramArgs) -> anyhow::Result<()> {
    let extension = args.output.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let form = match extension.to_ascii_lowercase().as_str() {
        "png" => Form::Picture,
        "csv" => Form::Table,
        "npy" => Form::Arrays,
        _ => {
            let output = args.output.display();
            return Err(
                UsageError(format!("{output}: name a picture (.png), a table (.csv) or an array (.npy)")).into()
            );
        }
    };
    super::check_output(&args.output, &[&args.file], None)?;
    let reader = super::open(&args.file)?;
    let named = || args.file.display().to_string();
    let histogram = reader.read_histogram(args.kind.into()).with_context(named)?;
    let header = reader.header();
    let labels = HistogramLabels { source: &header.source.name, length_unit: &header.geometry.unit };
    match form {
        Form::Picture => super::write(&args.output, &histogram_png(&histogram, &labels).with_context(named)?),
        Form::Table => super::write(&args.output, histogram_csv(&histogram, &labels).with_context(named)?.as_bytes()),
        Form::Arrays => {
            let arrays = histogram_npy(&histogram).with_context(named)?;
            let edges: Vec<PathBuf> = arrays.edges.iter().map(|(name, _)| beside(&args.output, name)).collect();
            for path in &edges {
                super::check_output(path, &[&args.file], None)?;
            }
            for (path, (_, bytes)) in edges.iter().zip(&arrays.edges) {
                super::write(path, bytes)?;
            }
            super::write(&args.output, &arrays.counts)
        }
    }
}

/// `out.npy` with `value` becomes `out_value_edges.npy`.
fn beside(output: &Path, name: &str) -> PathBuf {
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    output.with_file_name(format!("{stem}_{name}_edges.npy"))
}
