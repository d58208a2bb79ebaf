//! `voxrole export`.

use std::io::{BufWriter, Write};

use anyhow::Context;
use voxrole_pack::atomic_file::AtomicFile;
use voxrole_preprocess::fields::{Field, read_field, read_normals};
use voxrole_preprocess::io::nrrd_writer::{write_f32, write_vectors};

use super::args::{ExportArgs, ExportField};

pub fn run(args: &ExportArgs) -> anyhow::Result<()> {
    super::check_output(&args.output, &[&args.file], Some("nrrd"))?;
    let reader = super::open(&args.file)?;
    let geometry = &reader.header().geometry;
    let named = || args.file.display().to_string();
    let writing = || format!("writing {}", args.output.display());
    let field = match args.field {
        ExportField::Value => Field::Value,
        ExportField::Distance => Field::Distance,
        ExportField::HitGradient => Field::HitGradient,
        ExportField::Role => Field::Role,
        ExportField::GradientMagnitude => Field::GradientMagnitude,
        ExportField::SecondDerivative => Field::SecondDerivative,
        ExportField::Normal => {
            let normals = read_normals(&reader).with_context(named)?;
            let mut out = create(args)?;
            write_vectors(&mut out, geometry, &normals, "normal").with_context(writing)?;
            return commit(out).with_context(writing);
        }
    };
    let values = read_field(&reader, field).with_context(named)?;
    let content = match args.field {
        ExportField::Role => "role: 0 no boundary, 1 on it, 2 high-value side, 3 low-value side, -1 masked",
        ExportField::Distance => "signed distance to the boundary, positive on the high-value side",
        ExportField::HitGradient => "gradient magnitude at the hit",
        ExportField::GradientMagnitude => "gradient magnitude",
        ExportField::SecondDerivative => "second directional derivative",
        ExportField::Value | ExportField::Normal => "value",
    };
    let mut out = create(args)?;
    write_f32(&mut out, geometry, &values, content).with_context(writing)?;
    commit(out).with_context(writing)
}

fn create(args: &ExportArgs) -> anyhow::Result<BufWriter<AtomicFile>> {
    let file = AtomicFile::create(&args.output).with_context(|| format!("writing {}", args.output.display()))?;
    Ok(BufWriter::with_capacity(1 << 20, file))
}

fn commit(mut out: BufWriter<AtomicFile>) -> anyhow::Result<()> {
    out.flush()?;
    Ok(out.into_inner().map_err(|error| error.into_error())?.commit()?)
}
