//! `voxrole export`.

use std::path::{Path, PathBuf};

use anyhow::Context;
use voxrole_pack::Header;
use voxrole_preprocess::console::tell;
use voxrole_preprocess::export::{Export, ExportFormat, check_replaceable_folder};
use voxrole_preprocess::fields::Field;
use voxrole_preprocess::usage::{UsageError, refuse_if};

use super::args::ExportArgs;

/// One output.
struct Task {
    export: Export,
    path: PathBuf,
}

pub fn run(args: &ExportArgs) -> anyhow::Result<()> {
    let reader = super::open(&args.file)?;
    let named = || args.file.display().to_string();
    let fields = fields(args, reader.header()).with_context(named)?;
    reader.geometry(args.level).with_context(named)?;
    let folder = (args.all || fields.len() > 1 || is_plain_folder(&args.output)).then_some(args.output.as_path());
    let tasks = tasks(args, &fields, folder)?;
    check_outputs(&tasks, &args.file, folder)?;
    for Task { export, path } in &tasks {
        let losses = export.write(&reader, path).with_context(|| format!("{}: {}", named(), export.field.name()))?;
        for loss in losses {
            tell(format!("voxrole: warning: {}: {loss}", path.display()));
        }
        if tasks.len() > 1 {
            tell(format!("voxrole: {} written", path.display()));
        }
    }
    Ok(())
}

/// What to write: what was asked for, or everything that the file has; its layers must be there.
fn fields(args: &ExportArgs, header: &Header) -> anyhow::Result<Vec<Field>> {
    if args.all {
        return Ok(Field::ALL.into_iter().filter(|field| header.layer(field.layer()).is_ok()).collect());
    }
    let mut fields: Vec<Field> = Vec::new();
    for field in args.field.iter().copied().map(Field::from) {
        header.layer(field.layer())?;
        if !fields.contains(&field) {
            fields.push(field);
        }
    }
    Ok(fields)
}

/// A folder to write into, not one that is itself an output.
fn is_plain_folder(path: &Path) -> bool {
    path.is_dir() && !ExportFormat::OmeZarr.is_name_of(path)
}

fn tasks(args: &ExportArgs, fields: &[Field], folder: Option<&Path>) -> Result<Vec<Task>, UsageError> {
    let output = args.output.display();
    let by_name = ExportFormat::from_path(&args.output);
    let names = || ExportFormat::ALL.map(|format| format!(".{}", format.extensions()[0])).join(", ");
    let Some(format) = args.format.map(ExportFormat::from).or(if folder.is_some() { None } else { by_name }) else {
        return Err(UsageError(match folder {
            Some(_) => format!("{output}: say with --format what to write into that folder"),
            None => format!("{output}: name it as what it is to be ({}), or name a folder that exists", names()),
        }));
    };
    refuse_if(
        args.compress && !matches!(format, ExportFormat::Nrrd | ExportFormat::Vti),
        "--compress is for NRRD and VTI; NIfTI is packed if its name ends in .nii.gz, OME-Zarr always, the others never",
    )?;
    let export = |field| Export { field, level: args.level, format, compress: args.compress };
    let Some(folder) = folder else {
        let extension = format.extensions()[0];
        let message = format!("{output}: what is written is {}; name it .{extension}", format.name());
        refuse_if(!format.is_name_of(&args.output), message)?;
        return Ok(fields.iter().map(|&field| Task { export: export(field), path: args.output.clone() }).collect());
    };
    refuse_if(by_name.is_some(), format!("{output}: several fields make several files: name a folder for them"))?;
    let level = if args.level == 0 { String::new() } else { format!("-level{}", args.level) };
    let path = |field: Field| folder.join(format!("{}{level}.{}", field.name(), format.extensions()[0]));
    Ok(fields.iter().map(|&field| Task { export: export(field), path: path(field) }).collect())
}

/// Checks before any work is done that everything can be written.
fn check_outputs(tasks: &[Task], input: &Path, folder: Option<&Path>) -> anyhow::Result<()> {
    let is_made = folder.map_or(Ok(false), super::make_folder)?;
    let checked = tasks.iter().try_for_each(|Task { export, path }| match export.format {
        ExportFormat::OmeZarr => check_replaceable_folder(path).with_context(|| path.display().to_string()),
        _ => super::check_output(path, &[input], None),
    });
    if let (Err(_), true, Some(folder)) = (&checked, is_made, folder) {
        // Whoever cannot remove it can do nothing more about it.
        let _ = std::fs::remove_dir(folder);
    }
    checked
}
