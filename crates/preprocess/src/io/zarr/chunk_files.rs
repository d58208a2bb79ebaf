//! A folder as a Zarr store, for reading: every key is a file in it.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use zarrs::storage::byte_range::{ByteRange, ByteRangeIterator};
use zarrs::storage::{Bytes, MaybeBytesIterator, ReadableStorageTraits, StorageError, StoreKey};

/// The folder, and the longest part of a file that is read at once.
#[derive(Debug)]
pub struct ChunkFiles {
    folder: PathBuf,
    pub max_bytes: u64,
}

impl ChunkFiles {
    pub fn new(folder: &Path, max_bytes: u64) -> Self {
        Self { folder: folder.to_owned(), max_bytes }
    }

    /// The file of a key, and its length; `None` where there is no such file.
    fn open(&self, key: &StoreKey) -> Result<Option<(File, u64)>, StorageError> {
        let path = Path::new(key.as_str());
        if !path.components().all(|component| matches!(component, Component::Normal(_))) {
            return Err(StorageError::Other(format!("expected names inside the store, found {key}")));
        }
        let path = self.folder.join(path);
        let metadata = match path.metadata() {
            Ok(metadata) => metadata,
            Err(error) if [io::ErrorKind::NotFound, io::ErrorKind::NotADirectory].contains(&error.kind()) => {
                return Ok(None);
            }
            Err(error) => return Err(Arc::new(error).into()),
        };
        if !metadata.is_file() {
            return Err(StorageError::Other(format!("expected a file, found something else at {key}")));
        }
        Ok(Some((File::open(path).map_err(Arc::new)?, metadata.len())))
    }

    fn read(&self, key: &StoreKey, file: &mut File, length: u64, range: ByteRange) -> Result<Bytes, StorageError> {
        let outside = || StorageError::Other(format!("expected {range:?} in {key}, found a file of {length} bytes"));
        let (start, count) = match range {
            ByteRange::FromStart(start, None) => (start, length.checked_sub(start).ok_or_else(outside)?),
            ByteRange::FromStart(start, Some(count)) => (start, count),
            ByteRange::Suffix(count) => (length.checked_sub(count).ok_or_else(outside)?, count),
        };
        if start.checked_add(count).is_none_or(|end| end > length) {
            return Err(outside());
        }
        if count > self.max_bytes {
            let message = format!("expected at most {} bytes at {key}, found {count}", self.max_bytes);
            return Err(StorageError::Other(message));
        }
        let mut bytes = Vec::new();
        file.seek(SeekFrom::Start(start)).map_err(Arc::new)?;
        file.take(count).read_to_end(&mut bytes).map_err(Arc::new)?;
        Ok(bytes.into())
    }
}

impl ReadableStorageTraits for ChunkFiles {
    fn get_partial_many<'a>(
        &'a self,
        key: &StoreKey,
        byte_ranges: ByteRangeIterator<'a>,
    ) -> Result<MaybeBytesIterator<'a>, StorageError> {
        let Some((mut file, length)) = self.open(key)? else { return Ok(None) };
        let key = key.clone();
        Ok(Some(Box::new(byte_ranges.map(move |range| self.read(&key, &mut file, length, range)))))
    }

    fn size_key(&self, key: &StoreKey) -> Result<Option<u64>, StorageError> {
        Ok(self.open(key)?.map(|(_, length)| length))
    }

    fn supports_get_partial(&self) -> bool {
        true
    }
}
