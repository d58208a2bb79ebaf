//! How samples lie in a volume: along rays, or on slices through it.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

/// Where the volume is sampled. The opacity of a sample is always that of the way along its own pixel's ray, so that
/// pictures differ by sampling alone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Technique {
    /// Along each pixel's ray, from where that enters the volume.
    #[default]
    Rays,
    /// On planes across the viewing direction. After Ikits, Kniss, Lefohn and Hansen, Volume rendering techniques, in
    /// GPU Gems, 2004.
    Slices,
    /// On the voxels' own planes across the grid's axis that is nearest to the viewing direction, and on planes between
    /// them. After Rezk-Salama, Engel, Bauer, Greiner and Ertl, Interactive volume rendering on standard PC graphics
    /// hardware using multi-textures and multi-stage rasterization, 2000.
    Stacks,
}

impl Technique {
    /// All of them, in the order of a menu.
    pub const ALL: [Self; 3] = [Self::Rays, Self::Slices, Self::Stacks];

    /// Its name on the command line and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rays => "rays",
            Self::Slices => "slices",
            Self::Stacks => "stacks",
        }
    }
}
