//! What the user set: plain data without window or GPU, so that it can be saved, compared and tested.
//!
//! Lengths that the user sets are multiples of `L_min`, the volume's smallest voxel spacing; values and gradient
//! magnitudes are in the volume's own units.

pub mod boundary_emphasis;
pub mod camera;
pub mod classification;
pub mod clipping;
pub mod color;
pub mod curve;
pub mod painted_map;
pub mod region;
pub mod render_settings;
pub mod saved_volume;
pub mod scene;
pub mod session;
pub mod shape;
pub mod technique;
pub mod transfer_function;

use serde::{Deserialize, Serialize};

pub use boundary_emphasis::{BoundaryEmphasis, EmphasisKind, TwoSidedEmphasis};
pub use camera::{Camera, CameraPreset, Projection, ViewAxes};
pub use classification::Classification;
pub use clipping::{ClipPlane, Clipping, Crop};
pub use curve::{ControlPoint, Curve};
pub use painted_map::PaintedMap;
pub use region::Region;
pub use render_settings::{Integration, Light, RenderSettings, Shading};
pub use saved_volume::SavedVolume;
pub use scene::{Isosurface, MeshFile, Scene};
pub use shape::Shape;
pub use technique::Technique;
pub use transfer_function::TransferFunction;

/// Everything that decides what a picture of one volume looks like.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ViewState {
    /// Where the picture is taken from.
    pub camera: Camera,
    /// What is drawn, and how opaque.
    pub transfer_function: TransferFunction,
    /// What of the volume is drawn at all.
    pub clipping: Clipping,
    /// How it is drawn.
    pub render_settings: RenderSettings,
    /// What is drawn beside the volume.
    pub scene: Scene,
    /// Which volume that is of, as far as it is known; changes no picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume: Option<SavedVolume>,
}

/// A command-line form that could not be understood; says what was expected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct ParseError(pub String);

/// A finite number out of a command-line form.
fn parse_number(text: &str, what: &str) -> Result<f32, ParseError> {
    match text.trim().parse::<f32>() {
        Ok(number) if number.is_finite() => Ok(number),
        _ => Err(ParseError(format!("{what} `{text}` is not a number"))),
    }
}
