//! What can go wrong between a packed file and a picture.

use voxrole_preprocess::byte_size::byte_size_text;

/// An error of the viewer. The file's name is added by whoever opened it.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The packed file cannot be read.
    #[error(transparent)]
    Pack(#[from] voxrole_pack::Error),
    /// No adapter that this program can draw with was found.
    #[error("no usable GPU adapter: {0}")]
    NoAdapter(String),
    /// The volume does not fit the device.
    #[error(
        "the volume is too large for {device}: {reason}; give more `--gpu-memory` or `--memory` where they bound it, draw a coarser `--level`, or draw on the CPU (`--cpu`)"
    )]
    VolumeTooLarge {
        /// The device's name.
        device: String,
        /// Which limit, and by how much.
        reason: String,
    },
    /// Normals cannot be held compressed.
    #[error("normals cannot be compressed: {reason}; leave `--normals` out")]
    Normals {
        /// Why not.
        reason: String,
    },
    /// All of a volume is needed in memory, which does not suffice.
    #[error(
        "level {level} of the volume takes {} of memory, of which {} may be taken, and {reason}; {advice}",
        byte_size_text(*bytes),
        byte_size_text(*memory)
    )]
    TooMuchMemory {
        /// The level of detail.
        level: usize,
        /// What all of its texels take.
        bytes: u64,
        /// What may be taken.
        memory: u64,
        /// Why they would all have to be there, or what else takes more.
        reason: String,
        /// What to do.
        advice: String,
    },
    /// A picture size that cannot be drawn.
    #[error("a picture of {width} x {height} pixels cannot be drawn: each side must be 1 to {limit}")]
    PictureSize {
        /// Pixels to the right.
        width: u32,
        /// Pixels down.
        height: u32,
        /// Most pixels along a side.
        limit: u32,
    },
    /// A surface cannot be read out of its file.
    #[error("{path}: {reason}")]
    Mesh {
        /// The file.
        path: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A volume has no surface of a value, or one too large to be drawn.
    #[error("isosurface of {value}: {reason}")]
    Isosurface {
        /// The value asked for.
        value: f32,
        /// Why it cannot be drawn.
        reason: String,
    },
    /// The device refused or lost its work.
    #[error("{action} failed on {device}: {reason}")]
    Device {
        /// What was being done.
        action: &'static str,
        /// The device's name.
        device: String,
        /// What it said.
        reason: String,
    },
    /// What was being done is no longer wanted.
    #[error("it was given up")]
    GivenUp,
    /// A picture cannot be encoded.
    #[error("encoding the picture as PNG: {0}")]
    Encode(#[from] image::ImageError),
    /// What the preprocessor does for the viewer failed: the scale bar's label, or finding out how much memory there is.
    #[error(transparent)]
    Preprocess(#[from] voxrole_preprocess::Error),
    /// Pictures cannot be encoded as an animation.
    #[error("encoding the pictures as an animated PNG: {0}")]
    Animation(#[from] png::EncodingError),
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
