//! What the command line says of geometry beside the volume.

use clap::Args;

use crate::state::{Isosurface, MeshFile, Scene};

/// Lines and surfaces, by `render` and `bench`.
#[derive(Clone, Debug, Default, Args)]
pub struct SceneArgs {
    /// Draw the edges of the volume's box, and those of the box that --crop keeps.
    #[arg(long)]
    pub bounding_box: bool,
    /// Draw arrows along the world's axes, x red, y green, z blue, from the corner of the box where x + y + z is least.
    #[arg(long)]
    pub axes: bool,
    /// Draw a bar of a round length in world units into the lower right corner; in perspective it holds in the volume's
    /// middle.
    #[arg(long)]
    pub scale_bar: bool,
    /// Draw the opaque surface in a file, STL or OBJ, in the volume's world coordinates; may be given several times.
    #[arg(long = "mesh", value_name = "FILE[,RRGGBB]")]
    pub meshes: Vec<MeshFile>,
    /// Draw the opaque surface on which the value is this number; may be given several times.
    #[arg(long = "isosurface", value_name = "VALUE[,RRGGBB]", allow_hyphen_values = true)]
    pub isosurfaces: Vec<Isosurface>,
}

impl SceneArgs {
    /// Puts what was typed in the place of what a session says.
    pub fn apply(&self, scene: &mut Scene) {
        scene.bounding_box |= self.bounding_box;
        scene.axes |= self.axes;
        scene.scale_bar |= self.scale_bar;
        if !self.meshes.is_empty() {
            scene.meshes.clone_from(&self.meshes);
        }
        if !self.isosurfaces.is_empty() {
            scene.isosurfaces.clone_from(&self.isosurfaces);
        }
    }
}
