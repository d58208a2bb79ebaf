//! How much memory a volume's texels take, and which level of detail keeps within a bound.

use voxrole_pack::Reader;
use voxrole_preprocess::byte_size::byte_size_text;
use voxrole_preprocess::machine_memory::half_of_memory;

use crate::Error;

/// Bytes of a texel.
pub const BYTES_PER_TEXEL: u64 = 8;

/// The bound that was typed, or else half of the machine's memory, in bytes.
///
/// # Errors
/// [`Error::Preprocess`] when nothing was typed and the operating system does not say how much there is.
pub fn bound(typed: Option<u64>) -> crate::Result<u64> {
    Ok(typed.map_or_else(half_of_memory, Ok)?)
}

/// Bytes that all texels of a level take; more than can be counted is as much as can be.
///
/// # Errors
/// [`Error::Pack`] when there is no such level.
pub fn level_bytes(reader: &Reader, level: usize) -> crate::Result<u64> {
    let dims = reader.geometry(level)?.dims;
    Ok(dims.iter().fold(BYTES_PER_TEXEL, |bytes, &dim| bytes.saturating_mul(dim.into())))
}

/// Refuses a level whose texels do not fit into `memory` bytes where they all have to, for a reason.
///
/// # Errors
/// [`Error::TooMuchMemory`] when they do not fit, [`Error::Pack`] when there is no such level.
pub fn require(reader: &Reader, level: usize, memory: u64, reason: &str) -> crate::Result<()> {
    if level_bytes(reader, level)? <= memory {
        return Ok(());
    }
    Err(too_much(reader, level, memory, reason.to_owned())?)
}

/// The error for a level whose texels do not fit into `memory` bytes where they all have to, with what can be done.
///
/// # Errors
/// [`Error::Pack`] when there is no such level.
pub fn too_much(reader: &Reader, level: usize, memory: u64, reason: String) -> crate::Result<Error> {
    let bytes = level_bytes(reader, level)?;
    let mut advice = String::from("give more `--memory`");
    for coarser in level + 1..reader.levels() {
        let takes = level_bytes(reader, coarser)?;
        if takes <= memory {
            advice = format!("draw `--level {coarser}`, which takes {}, or {advice}", byte_size_text(takes));
            break;
        }
    }
    Ok(Error::TooMuchMemory { level, bytes, memory, reason, advice })
}
