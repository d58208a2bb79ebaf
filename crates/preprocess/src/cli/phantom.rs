//! `voxrole phantom`.

use std::path::Path;

use anyhow::Context;
use voxrole_pack::atomic_file::AtomicFile;
use voxrole_pack::{GridGeometry, Scalars};
use voxrole_preprocess::io::nrrd_writer::write_scalars;
use voxrole_preprocess::phantom::{Phantom, PhantomSettings};
use voxrole_preprocess::usage::{UsageError, refuse_if};

use super::args::PhantomArgs;

pub fn run(args: &PhantomArgs) -> anyhow::Result<()> {
    if args.list {
        return super::print(&list());
    }
    let (Some(phantom), Some(dims), Some(output)) = (args.name, args.dims, &args.output) else {
        return Err(UsageError("name a phantom, its --dims and the file to write (-o)".into()).into());
    };
    let settings = settings(args, phantom, dims)?;
    phantom.scene(&settings).map_err(UsageError::from)?;
    let outputs = [Some(output), args.truth.as_ref(), args.crossing.as_ref()];
    check_outputs(&outputs.into_iter().flatten().map(|path| path.as_path()).collect::<Vec<_>>())?;

    // All is computed before anything is written, so that an error leaves no part of it behind.
    let truth = args.truth.as_ref().map(|path| anyhow::Ok((path, phantom.truth(&settings)?))).transpose()?;
    let crossing =
        args.crossing.as_ref().map(|path| anyhow::Ok((path, phantom.crossing_distances(&settings)?))).transpose()?;
    let grid = phantom.generate(&settings)?;
    write(output, &grid.geometry, &grid.scalars, phantom.description())?;
    if let Some((path, distances)) = truth {
        let content = "exact signed distance to the nearest boundary, positive on the high side";
        write(path, &grid.geometry, &Scalars::F32(distances), content)?;
    }
    if let Some((path, distances)) = crossing {
        let content =
            "signed distance along the gradient to the formula's zero crossing of f'', positive on the high side";
        write(path, &grid.geometry, &Scalars::F32(distances), content)?;
    }
    Ok(())
}

fn list() -> String {
    Phantom::ALL.into_iter().map(|phantom| format!("{:<15} {}\n", phantom.name(), phantom.description())).collect()
}

fn settings(args: &PhantomArgs, phantom: Phantom, dims: [u32; 3]) -> Result<PhantomSettings, UsageError> {
    refuse_if(
        args.thickness.is_some() && phantom != Phantom::SlabPair,
        format!("--thickness is for slab-pair; {} has a shape of its own", phantom.name()),
    )?;
    refuse_if(
        args.blur.is_some() && phantom == Phantom::MarschnerLobb,
        "marschner-lobb has no --blur: its formula is as smooth as it is",
    )?;
    let default = PhantomSettings::default();
    Ok(PhantomSettings {
        dims,
        spacing: args.spacing,
        blur: args.blur.unwrap_or(default.blur),
        thickness: args.thickness.unwrap_or(default.thickness),
        rotation: args.rotation,
        offset: args.offset,
        noise: args.noise,
        noise_kind: args.noise_kind,
        seed: args.seed,
        scalar_type: args.dtype.scalar_type,
        value_scale: args.value_scale,
        value_offset: args.value_offset,
        quantization: args.dtype.quantization,
    })
}

/// Checks before any work is done that every output can be written and no two are the same file.
fn check_outputs(outputs: &[&Path]) -> anyhow::Result<()> {
    for (index, output) in outputs.iter().enumerate() {
        let others = &outputs[..index];
        let is_taken = others.iter().any(|other| super::is_same_file(other, output));
        refuse_if(is_taken, format!("{}: two outputs cannot be one file", output.display()))?;
        super::check_output(output, others, None)?;
    }
    Ok(())
}

fn write(path: &Path, geometry: &GridGeometry, scalars: &Scalars, content: &str) -> anyhow::Result<()> {
    let writing = || format!("writing {}", path.display());
    let mut file = AtomicFile::create(path).with_context(writing)?;
    write_scalars(&mut file, geometry, scalars, content).with_context(writing)?;
    file.commit().with_context(writing)
}
