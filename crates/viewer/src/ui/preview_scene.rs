//! The surfaces of a window's scene, made anew when the scene or the volume changes.

use std::sync::Arc;

use crate::Result;
use crate::scene::Surfaces;
use crate::state::{Isosurface, MeshFile, Scene};
use crate::streaming::PackedVolume;
use crate::volume::{VolumeDescription, VolumeTexels};

/// Most voxels among which isosurfaces are looked for: of a larger volume a coarser level is kept.
const MOST_VOXELS: usize = 1 << 25;

/// Values to find isosurfaces among, and what was found last.
pub struct PreviewScene {
    values: Values,
    /// Whether other surfaces are needed than those below: those of these files and values.
    made_of: Option<(Vec<MeshFile>, Vec<Isosurface>)>,
    surfaces: Arc<Surfaces>,
}

/// Where values are looked up.
enum Values {
    Memory(Box<VolumeDescription>, Vec<u16>),
    File(Arc<PackedVolume>),
}

impl PreviewScene {
    /// Keeps the values of a volume.
    #[must_use]
    pub fn new(volume: &VolumeTexels) -> Self {
        let values = volume.texels.iter().map(|texel| texel[0]).collect();
        Self::of(Values::Memory(Box::new(volume.description.clone()), values))
    }

    /// Reads values out of a file when they are asked for.
    #[must_use]
    pub fn of_file(packed: Arc<PackedVolume>) -> Self {
        Self::of(Values::File(packed))
    }

    fn of(values: Values) -> Self {
        Self { values, made_of: None, surfaces: Arc::default() }
    }

    /// Whether isosurfaces are looked for among all voxels of a volume.
    #[must_use]
    pub fn has_room_for(volume: &VolumeTexels) -> bool {
        volume.texels.len() <= MOST_VOXELS
    }

    /// Takes another level of the volume, unless that is too large.
    pub fn replace_volume(&mut self, volume: &VolumeTexels) {
        if Self::has_room_for(volume) {
            *self = Self::new(volume);
        }
    }

    /// The surfaces of a scene.
    ///
    /// # Errors
    /// As [`Surfaces::new`] and [`Surfaces::of_file`].
    pub fn surfaces(&mut self, scene: &Scene) -> Result<Arc<Surfaces>> {
        let wanted = (&scene.meshes, &scene.isosurfaces);
        if self.made_of.as_ref().is_none_or(|(meshes, isosurfaces)| (meshes, isosurfaces) != wanted) {
            self.surfaces = Arc::new(match &self.values {
                Values::Memory(volume, values) => Surfaces::new(scene, volume, |voxel| values[voxel])?,
                Values::File(packed) => Surfaces::of_file(scene, packed)?,
            });
            self.made_of = Some((scene.meshes.clone(), scene.isosurfaces.clone()));
        }
        Ok(self.surfaces.clone())
    }
}
