//! Volumes whose numbers have to be decoded: a file for each slice, compressed blocks, chunks.

use std::fmt;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use voxrole_pack::scalar::Scalar;
use voxrole_pack::{ScalarType, Scalars};

use super::raw::{ByteOrder, StoredType};
use super::stored_voxels::StoredVoxels;
use crate::{Error, Result};

/// Numbers that come part by part, in the order of a volume: x fastest, then y, then z.
pub(super) trait Slabs: fmt::Debug + Send {
    /// The numbers' type.
    fn scalar_type(&self) -> ScalarType;

    /// The files that hold them, the one to complain of first: at least one.
    fn files(&self) -> &[PathBuf];

    /// Whether numbers cannot change unless these files do.
    fn are_all_files(&self) -> bool {
        true
    }

    /// Hands all numbers to `sink`, as little-endian bytes: whole numbers, in as many parts as is convenient, so that no more
    /// than a few slices are in memory.
    ///
    /// # Errors
    /// Those of `sink`; [`Error::Io`] and [`Error::Format`], naming the file.
    fn decode(&self, sink: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()>;
}

/// Reads all numbers of a volume of `dims` voxels.
///
/// # Errors
/// Those of [`Slabs::decode`]; [`Error::Format`] when there are fewer or more than the volume's voxels.
pub(super) fn read(slabs: &dyn Slabs, dims: [usize; 3]) -> Result<Scalars> {
    fn numbers<T: Scalar>(slabs: &dyn Slabs, dims: [usize; 3]) -> Result<Vec<T>> {
        let count: usize = dims.iter().product();
        let mut numbers: Vec<T> = Vec::new();
        counted(slabs, dims, &mut |bytes| {
            let wanted = bytes.len() / T::SIZE;
            if numbers.capacity() - numbers.len() < wanted {
                // Twice as much as before, but never more than is expected, and nothing before the first part is there.
                let growth = (count - numbers.len()).min(wanted.max(numbers.len()));
                numbers.try_reserve_exact(growth).map_err(|_| Error::OutOfMemory {
                    what: format!("the voxels of {}", slabs.files()[0].display()),
                    bytes: (count * T::SIZE) as u128,
                })?;
            }
            numbers.extend(bytes.chunks_exact(T::SIZE).map(T::from_le));
            Ok(())
        })?;
        Ok(numbers)
    }
    Ok(match slabs.scalar_type() {
        ScalarType::U8 => Scalars::U8(numbers(slabs, dims)?),
        ScalarType::I8 => Scalars::I8(numbers(slabs, dims)?),
        ScalarType::U16 => Scalars::U16(numbers(slabs, dims)?),
        ScalarType::I16 => Scalars::I16(numbers(slabs, dims)?),
        ScalarType::U32 => Scalars::U32(numbers(slabs, dims)?),
        ScalarType::I32 => Scalars::I32(numbers(slabs, dims)?),
        ScalarType::F32 => Scalars::F32(numbers(slabs, dims)?),
        ScalarType::F64 => Scalars::F64(numbers(slabs, dims)?),
    })
}

/// Decodes all numbers into a temporary file in `folder`, from where they can be read region by region.
///
/// # Errors
/// As [`read`]; [`Error::Io`] when `folder` cannot be written to.
pub(super) fn stored(slabs: &dyn Slabs, dims: [usize; 3], folder: &Path) -> Result<StoredVoxels> {
    let mut file: File = tempfile::tempfile_in(folder).map_err(Error::io(folder))?;
    let bytes = dims.iter().product::<usize>() as u64 * slabs.scalar_type().size_in_bytes() as u64;
    counted(slabs, dims, &mut |part| file.write_all(part).map_err(|error| no_room(folder, bytes, error)))?;
    let stored = StoredType { scalar_type: slabs.scalar_type(), byte_order: ByteOrder::Little };
    let (paths, are_all_paths) = (slabs.files().to_vec(), slabs.are_all_files());
    Ok(StoredVoxels { file, paths, are_all_paths, offset: 0, dims, stored })
}

/// Where all numbers cannot be put into a temporary file.
pub(super) fn no_room(folder: &Path, bytes: u64, error: std::io::Error) -> Error {
    let reason =
        format!("unpacking the input into a temporary file of {bytes} bytes, as little --memory asks for: {error}");
    Error::io(folder)(std::io::Error::new(error.kind(), reason))
}

/// Decodes, and makes sure that there are as many numbers as voxels.
fn counted(slabs: &dyn Slabs, dims: [usize; 3], sink: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
    let expected = (dims.iter().product::<usize>() * slabs.scalar_type().size_in_bytes()) as u64;
    let fail = |found: &str| {
        let [x, y, z] = dims;
        let type_name = slabs.scalar_type().name();
        let message = format!("expected {expected} bytes ({x} x {y} x {z} of {type_name}), found {found}");
        Error::format(&slabs.files()[0], message)
    };
    let mut found = 0;
    slabs.decode(&mut |bytes| {
        found += bytes.len() as u64;
        if found > expected { Err(fail("more")) } else { sink(bytes) }
    })?;
    if found < expected { Err(fail(&found.to_string())) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::region::Region;

    #[derive(Debug)]
    struct Counting {
        files: [PathBuf; 1],
        parts: Vec<Vec<u16>>,
    }

    impl Slabs for Counting {
        fn scalar_type(&self) -> ScalarType {
            ScalarType::U16
        }
        fn files(&self) -> &[PathBuf] {
            &self.files
        }
        fn decode(&self, sink: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
            self.parts.iter().try_for_each(|part| {
                let bytes: Vec<u8> = part.iter().flat_map(|number| number.to_le_bytes()).collect();
                sink(&bytes)
            })
        }
    }

    fn counting(parts: &[std::ops::Range<u16>]) -> Counting {
        Counting { files: ["series".into()], parts: parts.iter().map(|part| part.clone().collect()).collect() }
    }

    #[test]
    fn parts_of_any_length_make_a_volume_in_memory_and_in_a_file() {
        let (slabs, dims) = (counting(&[0..1, 1..50, 50..53, 53..60]), [3, 4, 5]);
        assert_eq!(read(&slabs, dims).expect("a volume"), Scalars::U16((0..60).collect()));
        let folder = tempfile::tempdir().expect("a folder");
        let volume = stored(&slabs, dims, folder.path()).expect("a file");
        let region = Region { start: [1, 2, 3], end: [3, 3, 5] };
        assert_eq!(volume.read(&region).expect("a region"), Scalars::U16(vec![43, 44, 55, 56]));
    }

    #[test]
    fn too_few_and_too_many_are_refused() {
        for (parts, found) in [(0..59, "found 118"), (0..61, "found more")] {
            let message = read(&counting(&[parts]), [3, 4, 5]).expect_err(found).to_string();
            assert!(message.contains("series") && message.contains(found), "{message}");
        }
    }
}
