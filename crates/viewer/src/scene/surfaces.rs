//! The surfaces of a scene: made once, and drawn from every side.

use glam::{DVec3, Vec3};
use voxrole_pack::brick::BRICK_EDGE;

use super::isosurface::{ScalarField, SurfaceNet};
use super::mesh_file::read_mesh;
use super::triangles::Triangles;
use crate::frame::drawn_box;
use crate::state::{Classification, Isosurface, Scene, ViewState};
use crate::streaming::{PackedVolume, TexelSource};
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

    /// As [`Self::of`], whether the volume is in memory or not.
    ///
    /// # Errors
    /// As [`Self::new`]; for a volume in a file [`Error::Pack`], naming the brick, when one is damaged, and
    /// [`Error::TooMuchMemory`] when there is not even room for some slices of values.
    pub fn of_source(state: &ViewState, source: &TexelSource) -> Result<Self> {
        match source {
            TexelSource::Memory(volume) => Self::of(state, volume),
            TexelSource::File(packed) => Self::of_file(&state.scene, packed),
        }
    }

    /// The surfaces of a scene in a volume whose texels are in a file.
    ///
    /// # Errors
    /// As [`Self::of_source`].
    pub fn of_file(scene: &Scene, packed: &PackedVolume) -> Result<Self> {
        let volume = packed.description();
        Self::gather(scene, volume, |isosurface, room| {
            find_in_file(packed, isosurface, level_of(isosurface, volume)?, room)
        })
    }

    /// Reads the meshes, and finds the isosurfaces among values as a volume's texels hold them, by the texel's number.
    ///
    /// # Errors
    /// [`Error::Mesh`] when a file cannot be read or understood, [`Error::Isosurface`] when no value of the volume's is
    /// reached, and both when there are more than [`Triangles::MOST`] triangles in all.
    pub fn new(scene: &Scene, volume: &VolumeDescription, value: impl Fn(usize) -> u16 + Sync) -> Result<Self> {
        let field = field(volume, |voxel| f32::from(value(voxel)));
        Self::gather(scene, volume, |isosurface, room| {
            Ok(field.surface(level_of(isosurface, volume)?, isosurface.color, room))
        })
    }

    /// `find` gives an isosurface, or `None` where it has more triangles than there is room for.
    fn gather(
        scene: &Scene,
        volume: &VolumeDescription,
        find: impl Fn(&Isosurface, usize) -> Result<Option<Triangles>>,
    ) -> Result<Self> {
        let mut triangles = Triangles::default();
        for mesh in &scene.meshes {
            let room = Triangles::MOST - triangles.indices.len();
            triangles.append(read_mesh(mesh, volume, room)?);
        }
        for isosurface in &scene.isosurfaces {
            let fail = |reason: String| Error::Isosurface { value: isosurface.value, reason };
            let surface = find(isosurface, Triangles::MOST - triangles.indices.len())?.ok_or_else(|| {
                let most = Triangles::MOST;
                fail(format!(
                    "it has too many triangles, as noise has: {most} are drawn at most; draw it on a coarser `--level`"
                ))
            })?;
            if surface.indices.is_empty() {
                return Err(fail("no two neighbouring voxels lie on both sides of it".to_owned()));
            }
            triangles.append(surface);
        }
        Ok(Self { triangles })
    }
}

/// A volume's values in the frame's space.
fn field<F>(volume: &VolumeDescription, value: F) -> ScalarField<F> {
    ScalarField {
        dims: volume.texel_dims(),
        spacing: Vec3::from_array(volume.texel_spacing()),
        drawn_box: drawn_box(volume.dims, Vec3::from_array(volume.relative_spacing())),
        value,
    }
}

/// The value of an isosurface as texels hold it.
fn level_of(isosurface: &Isosurface, volume: &VolumeDescription) -> Result<f32> {
    let value = isosurface.value;
    let [low, high] = volume.value_range;
    let share = (f64::from(value) - low) / (high - low);
    // NaN where all values are one.
    if share > 0.0 && share <= 1.0 {
        return Ok((share * 65535.0) as f32);
    }
    Err(Error::Isosurface { value, reason: format!("the volume's values are from {low} to {high}") })
}

/// Goes through a file by rows of bricks, with the values of a few slices more in memory.
fn find_in_file(packed: &PackedVolume, isosurface: &Isosurface, level: f32, room: usize) -> Result<Option<Triangles>> {
    const NAME: &str = "`--isosurface`";
    let [slice, _] = packed.slices();
    // Those that are kept for the next row are three.
    let bytes = slice as u64 * size_of::<u16>() as u64 * (BRICK_EDGE as u64 + 3);
    packed.claim(NAME, bytes)?;
    let found = find_by_rows(packed, isosurface, level, room);
    packed.release(NAME);
    found
}

fn find_by_rows(packed: &PackedVolume, isosurface: &Isosurface, level: f32, room: usize) -> Result<Option<Triangles>> {
    let [slice, depth] = packed.slices();
    let mut net = SurfaceNet::new(level, isosurface.color, room);
    let (mut values, mut kept, mut done) = (Vec::<u16>::new(), 0..0, 0);
    while done < depth {
        let read = kept.end..(kept.end + BRICK_EDGE).min(depth);
        kept.end = read.end;
        values.extend(packed.values(read)?);
        let ready = if kept.end == depth { depth } else { (kept.end - 2).max(done) };
        let first = kept.start * slice;
        let field = field(packed.description(), |voxel| f32::from(values[voxel - first]));
        if net.extend(&field, done..ready).is_none() {
            return Ok(None);
        }
        done = ready;
        let needed = SurfaceNet::needed(&(done..depth), depth).start;
        values.drain(..(needed - kept.start) * slice);
        kept.start = needed;
    }
    Ok(net.finish())
}

/// From world coordinates to the frame's space.
#[must_use]
pub fn frame_from_world(volume: &VolumeDescription, world: DVec3) -> Vec3 {
    let from_origin = world - DVec3::from_array(volume.origin);
    (volume.world_from_axes.transpose() * from_origin / volume.smallest_spacing()).as_vec3()
}
