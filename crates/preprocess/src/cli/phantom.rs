//! `voxrole phantom`.

use std::path::Path;

use anyhow::{Context, bail};
use voxrole_pack::{GridGeometry, Scalars, atomic_file::AtomicFile};
use voxrole_preprocess::io::nrrd_writer::write_scalars;
use voxrole_preprocess::phantom::{Phantom, PhantomSettings};

use super::args::PhantomArgs;

pub fn run(args: &PhantomArgs) -> anyhow::Result<()> {
    if args.list {
        for phantom in Phantom::ALL {
            println!("{:<12} {}", phantom.name(), phantom.description());
        }
        return Ok(());
    }
    let (Some(phantom), Some(dims), Some(output)) = (args.name, args.dims, &args.output) else {
        bail!("name a phantom, its --dims and the file to write (-o)");
    };
    let settings = PhantomSettings {
        dims,
        spacing: args.spacing,
        blur: args.blur,
        noise: args.noise,
        seed: args.seed,
        scalar_type: args.dtype,
        ..PhantomSettings::default()
    };
    let grid = phantom.generate(&settings)?;
    write(output, &grid.geometry, &grid.scalars, phantom.description())?;
    if let Some(path) = &args.truth {
        let truth = Scalars::F32(phantom.truth(&settings)?);
        write(
            path,
            &grid.geometry,
            &truth,
            "exact signed distance to the nearest boundary, positive on the high side",
        )?;
    }
    Ok(())
}

fn write(path: &Path, geometry: &GridGeometry, scalars: &Scalars, content: &str) -> anyhow::Result<()> {
    let writing = || format!("writing {}", path.display());
    let mut file = AtomicFile::create(path).with_context(writing)?;
    write_scalars(&mut file, geometry, scalars, content).with_context(writing)?;
    file.commit().with_context(writing)
}
