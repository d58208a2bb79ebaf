//! `voxrole slice`.

use anyhow::Context;
use voxrole_preprocess::fields::{Field, read_field};
use voxrole_preprocess::plot::{SliceAxis, SliceShading, slice_png};

use super::args::{AxisArg, SliceArgs, SliceField};

pub fn run(args: &SliceArgs) -> anyhow::Result<()> {
    super::check_output(&args.output, &[&args.file], Some("png"))?;
    let reader = super::open(&args.file)?;
    let named = || args.file.display().to_string();
    let field = match args.field {
        SliceField::Value => Field::Value,
        SliceField::Distance => Field::Distance,
        SliceField::SecondDerivative => Field::SecondDerivative,
        SliceField::HitGradient => Field::HitGradient,
    };
    let axis = match args.axis {
        AxisArg::X => SliceAxis::X,
        AxisArg::Y => SliceAxis::Y,
        AxisArg::Z => SliceAxis::Z,
    };
    let values = read_field(&reader, field).with_context(named)?;
    let shading = match args.field {
        SliceField::Value => SliceShading::value(&values),
        SliceField::Distance => {
            SliceShading::Distance { d_max: reader.distance_quantization().with_context(named)?.d_max }
        }
        SliceField::SecondDerivative => SliceShading::second_derivative(&values),
        SliceField::HitGradient => SliceShading::hit_gradient(&values),
    };
    let picture = slice_png(&values, &reader.header().geometry, axis, args.index, &shading).with_context(named)?;
    super::write(&args.output, &picture)
}
