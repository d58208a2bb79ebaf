//! The surfaces of a scene: made once, and drawn from every side.

use glam::{DVec3, Vec3};

use super::isosurface::ScalarField;
use super::mesh_file::read_mesh;
use super::triangles::Triangles;
use crate::frame::drawn_box;
use crate::state::{Classification, Isosurface, Scene, ViewState};
use crate::volume::{VolumeDescription, VolumeTexels};
use crate::{Error, Result};

/// All meshes and isosurfaces of a scene, in the frame's space of one volume.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surfaces {
    /// As triangles.
    pub triangles: Triangles,
}

impl Surfaces {
    /// The surfaces of a state's scene in a volume: isosurfaces are of its values, or of its intensities where those
    /// are stored.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of(state: &ViewState, volume: &VolumeTexels) -> Result<Self> {
        let channel = if state.transfer_function.classification == Classification::Stored { 2 } else { 0 };
        Self::new(&state.scene, &volume.description, |voxel| volume.texels[voxel][channel])
    }

    /// Reads the meshes, and finds the isosurfaces among values as a volume's texels hold them, by the texel's number.
    ///
    /// # Errors
    /// [`Error::Mesh`] when a file cannot be read or understood, [`Error::Isosurface`] when no value of the volume's is
    /// reached, and both when there are more than [`Triangles::MOST`] triangles in all.
    pub fn new(scene: &Scene, volume: &VolumeDescription, value: impl Fn(usize) -> u16 + Sync) -> Result<Self> {
        let mut triangles = Triangles::default();
        for mesh in &scene.meshes {
            let room = Triangles::MOST - triangles.indices.len();
            triangles.append(read_mesh(mesh, volume, room)?);
        }
        let spacing = Vec3::from_array(volume.relative_spacing());
        let field = ScalarField {
            dims: volume.texel_dims(),
            spacing: Vec3::from_array(volume.texel_spacing()),
            drawn_box: drawn_box(volume.dims, spacing),
            value: |voxel| f32::from(value(voxel)),
        };
        for isosurface in &scene.isosurfaces {
            let room = Triangles::MOST - triangles.indices.len();
            triangles.append(find(&field, isosurface, volume, room)?);
        }
        Ok(Self { triangles })
    }
}

fn find(
    field: &ScalarField<impl Fn(usize) -> f32 + Sync>,
    &Isosurface { value, color }: &Isosurface,
    volume: &VolumeDescription,
    room: usize,
) -> Result<Triangles> {
    let fail = |reason: String| Error::Isosurface { value, reason };
    let [low, high] = volume.value_range;
    let share = (f64::from(value) - low) / (high - low);
    // NaN where all values are one.
    if !(share > 0.0 && share <= 1.0) {
        return Err(fail(format!("the volume's values are from {low} to {high}")));
    }
    let surface = field.surface((share * 65535.0) as f32, color, room).ok_or_else(|| {
        let most = Triangles::MOST;
        fail(format!(
            "it has too many triangles, as noise has: {most} are drawn at most; draw it on a coarser `--level`"
        ))
    })?;
    if surface.indices.is_empty() {
        return Err(fail("no two neighbouring voxels lie on both sides of it".to_owned()));
    }
    Ok(surface)
}

/// From world coordinates to the frame's space.
#[must_use]
pub fn frame_from_world(volume: &VolumeDescription, world: DVec3) -> Vec3 {
    let from_origin = world - DVec3::from_array(volume.origin);
    (volume.world_from_axes.transpose() * from_origin / volume.smallest_spacing()).as_vec3()
}
