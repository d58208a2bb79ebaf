//! `voxrole slice`.

use anyhow::Context;
use voxrole_preprocess::plot::{SliceAxis, field_slice_png};

use super::args::{AxisArg, SliceArgs};

pub fn run(args: &SliceArgs) -> anyhow::Result<()> {
    super::check_output(&args.output, &[&args.file], Some("png"))?;
    let reader = super::open(&args.file)?;
    let axis = match args.axis {
        AxisArg::X => SliceAxis::X,
        AxisArg::Y => SliceAxis::Y,
        AxisArg::Z => SliceAxis::Z,
    };
    let picture = field_slice_png(&reader, args.field.into(), axis, args.index);
    super::write(&args.output, &picture.with_context(|| args.file.display().to_string())?)
}
