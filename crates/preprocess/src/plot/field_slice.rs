//! A slice of a packed file's field as a picture.

use glam::DMat3;
use voxrole_pack::quantization::decode_normal;
use voxrole_pack::{LayerKind, Reader};

use super::png_from_image;
use super::slice::{NO_BOUNDARY, SliceAxis, SliceShading, slice_image};
use crate::Result;
use crate::fields::{Field, read_field};

/// Slice `index` across `axis` of a field as the bytes of a PNG file, in the colours of [`SliceShading`]; normals as the
/// magnitudes of their components along the world's axes: x red, y green, z blue.
///
/// # Errors
/// [`crate::Error::Parameter`] for an index outside the volume; [`crate::Error::Pack`] when the file is damaged or has no
/// such layer, or memory runs out.
pub fn field_slice_png(reader: &Reader, field: Field, axis: SliceAxis, index: u32) -> Result<Vec<u8>> {
    let geometry = &reader.header().geometry;
    if field == Field::Normal {
        let stored: Vec<u16> = reader.read_layer(LayerKind::Normal)?;
        let world_from_axes = geometry.world_from_axes();
        let picture = slice_image(geometry, axis, index, |voxel| direction_colour(stored[voxel], world_from_axes))?;
        return png_from_image(&picture);
    }
    let values = read_field(reader, field)?;
    let shading = match field {
        Field::Distance => SliceShading::Distance { d_max: reader.distance_quantization()?.d_max },
        Field::HitGradient => SliceShading::hit_gradient(&values),
        Field::Role => SliceShading::Role,
        Field::GradientMagnitude => SliceShading::gradient_magnitude(&values),
        Field::SecondDerivative => SliceShading::second_derivative(&values),
        Field::Value | Field::Normal => SliceShading::value(&values),
    };
    png_from_image(&slice_image(geometry, axis, index, |voxel| shading.colour(values[voxel]))?)
}

fn direction_colour(stored: u16, world_from_axes: DMat3) -> [u8; 3] {
    let direction = decode_normal(stored).map(|normal| world_from_axes * normal.as_dvec3());
    direction
        .map_or(NO_BOUNDARY, |direction| direction.abs().to_array().map(|share| (255.0 * share.min(1.0)).round() as u8))
}
