//! What a run has done so far, block by block, so that the next one can go on.
//!
//! The file begins with a mark, fingerprints of the whole task and of its input file, how the volume is cut, and what was
//! found out about the input before the first block. One record for each finished block follows: a table, then the block's
//! bricks and numbers. Every byte is under a checksum, so that a record is whole or none: what a run that
//! was killed left behind the last whole one is cut off. The file is locked as long as a run uses it.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use crate::compression::{Packer, Unpacker};
use crate::directory::Extent;
use crate::packed_brick::PackedBrick;
use crate::prologue::checksum_fits;
use crate::value_range::ValueRange;
use crate::{Error, Result, atomic_file, codec};

/// How the file begins; the digit is its version.
const MAGIC: [u8; 8] = *b"VXRPART3";
/// The mark, both fingerprints, the block's edges, the numbers' count, and the CRC-32 of all but the mark.
const HEAD_BYTES: usize = 92;
/// Most numbers that are kept of an input or a block.
const MOST_NUMBERS: usize = 1 << 24;
/// Most bytes of a record's table.
const MAX_TABLE_BYTES: usize = 1 << 26;

/// An output file that is being worked on: no other run works on it as long as this lives.
#[derive(Debug)]
pub struct Claim {
    file: File,
    path: PathBuf,
    /// There as long as there is nothing in the file that the next run could go on from.
    is_idle: Option<atomic_file::Unfinished>,
}

/// Where what is done of an output is kept: its name with `.unfinished` behind it.
#[must_use]
pub fn path_of(output: &Path) -> PathBuf {
    let mut name = output.file_name().unwrap_or_default().to_owned();
    name.push(".unfinished");
    output.with_file_name(name)
}

/// Files from which a run can go on.
static KEPT: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// The files from which a run can go on if this process ends now.
#[must_use]
pub fn kept() -> Vec<PathBuf> {
    KEPT.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

impl Claim {
    /// Claims `output` by a locked file at [`path_of`].
    ///
    /// # Errors
    /// [`Error::Parameter`] when another run has claimed it, [`Error::Io`] when the file cannot be made.
    pub fn new(output: &Path) -> Result<Self> {
        let path = path_of(output);
        let io = || Error::io(format!("claiming {}", path.display()));
        loop {
            let mut options = OpenOptions::new();
            let file = options.read(true).write(true).create(true).truncate(false).open(&path).map_err(io())?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let message = format!("another run is writing {}: wait for it, or stop it", output.display());
                    return Err(Error::Parameter(message));
                }
                Err(TryLockError::Error(error)) => return Err(io()(error)),
            }
            // Whoever had it before may have removed it just now.
            if is_still_there(&file, &path) {
                let is_new = file.metadata().map_err(io())?.len() == 0;
                let mut claim = Self { file, path, is_idle: None };
                claim.keep(!is_new);
                atomic_file::remove_left_overs(output);
                return Ok(claim);
            }
        }
    }

    /// Where the file is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What an earlier run was about, if it was stopped.
    #[must_use]
    pub fn head(&mut self) -> Option<Head> {
        let length = self.file.metadata().ok()?.len();
        read_head(&mut self.file, length).ok()?
    }

    /// Removes the file, whatever is in it.
    pub fn release(mut self) {
        self.keep(false);
    }

    /// Whether the file is to stay when this is dropped or the process ends.
    fn keep(&mut self, keep: bool) {
        let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|path| *path != self.path);
        if keep {
            kept.push(self.path.clone());
            self.is_idle = None;
        } else if self.is_idle.is_none() {
            self.is_idle = Some(atomic_file::Unfinished::new(&self.path));
        }
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        if self.is_idle.is_some() {
            // Whoever cannot remove it can do nothing more about it.
            let _ = std::fs::remove_file(&self.path);
        }
        KEPT.lock().unwrap_or_else(PoisonError::into_inner).retain(|path| *path != self.path);
    }
}

#[cfg(unix)]
fn is_still_there(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |metadata: std::fs::Metadata| (metadata.dev(), metadata.ino());
    file.metadata().ok().map(identity) == std::fs::metadata(path).ok().map(identity)
}

#[cfg(not(unix))]
fn is_still_there(_: &File, path: &Path) -> bool {
    path.exists()
}

/// The finished blocks of a task.
#[derive(Debug)]
pub struct Unfinished {
    claim: Claim,
    file: Mutex<File>,
    position: u64,
    records: BTreeMap<u32, Record>,
    packer: PackerDebug,
    synced: Instant,
}

/// How much work a power cut may cost, beside the block at hand.
const SYNC_INTERVAL: Duration = Duration::from_secs(1);

/// A block's table; offsets are from the start of the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Record {
    block: u32,
    layers: Vec<Vec<BrickEntry>>,
    numbers: Extent,
    /// How many numbers there are.
    count: u32,
}

/// A brick in the file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct BrickEntry {
    extent: Extent,
    range: Option<ValueRange>,
}

/// A packer, of which there is nothing to show.
struct PackerDebug(Packer);

impl std::fmt::Debug for PackerDebug {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Packer")
    }
}

impl Unfinished {
    /// Goes on where the last run of the same task and blocks was stopped; begins anew where there was none, or where it had finished no
    /// block.
    ///
    /// # Errors
    /// [`Error::Parameter`] when there are finished blocks of another task, which are not to be lost; [`Error::Io`].
    pub fn resume(mut claim: Claim, head: &Head) -> Result<Self> {
        let io = |action: &str| Error::io(format!("{action} {}", claim.path.display()));
        let mut file = claim.file.try_clone().map_err(io("opening"))?;
        let (records, position) = match read_content(&mut file).map_err(io("reading"))? {
            Some(found) if found.head.is_of(head) => (found.records, found.end),
            Some(Content { records, .. }) if !records.is_empty() => {
                return Err(Error::Parameter(format!(
                    "{}: holds {} finished blocks of a run on another input, with other settings, or with more memory: finish \
                     that run, or delete the file",
                    claim.path.display(),
                    records.len()
                )));
            }
            _ => {
                file.set_len(0).map_err(io("clearing"))?;
                file.seek(SeekFrom::Start(0)).map_err(io("clearing"))?;
                let head = head.to_bytes();
                file.write_all(&head).map_err(io("writing"))?;
                (BTreeMap::new(), head.len() as u64)
            }
        };
        file.set_len(position).map_err(io("clearing"))?;
        claim.keep(!records.is_empty());
        let packer = PackerDebug(Packer::new()?);
        Ok(Self { claim, file: Mutex::new(file), position, records, packer, synced: Instant::now() })
    }

    /// Whether a block is finished.
    #[must_use]
    pub fn has(&self, block: usize) -> bool {
        u32::try_from(block).is_ok_and(|block| self.records.contains_key(&block))
    }

    /// Number of finished blocks.
    #[must_use]
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// Whether no block is finished.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Adds a finished block; about once a second it waits until the disk has what was added.
    ///
    /// # Errors
    /// [`Error::Io`]; what was added before is still there.
    pub fn append(&mut self, block: usize, layers: &[Vec<PackedBrick>], numbers: &[u64]) -> Result<()> {
        let (encoding, packed) = self.packer.0.pack(numbers, None)?;
        let numbers_crc = crc32fast::hash(&packed);
        let mut record = Record {
            block: block as u32,
            layers: Vec::new(),
            numbers: Extent { offset: 0, stored_bytes: packed.len() as u32, crc32: numbers_crc, encoding },
            count: numbers.len() as u32,
        };
        // Offsets have a fixed width, so that the table's length does not depend on them.
        let entry = |brick: &PackedBrick, offset: u64| BrickEntry {
            extent: Extent {
                offset,
                stored_bytes: brick.bytes.len() as u32,
                crc32: brick.crc32,
                encoding: brick.encoding,
            },
            range: brick.range,
        };
        record.layers = layers.iter().map(|bricks| bricks.iter().map(|brick| entry(brick, 0)).collect()).collect();
        let table_bytes = codec::encode::<_, MAX_TABLE_BYTES>(&record, "a block's table")?.len() as u64;
        let mut offset = self.position + 8 + table_bytes;
        for entries in &mut record.layers {
            for entry in entries {
                entry.extent.offset = offset;
                offset += u64::from(entry.extent.stored_bytes);
            }
        }
        record.numbers.offset = offset;
        offset += u64::from(record.numbers.stored_bytes);
        let table = codec::encode::<_, MAX_TABLE_BYTES>(&record, "a block's table")?;

        let mut bytes = Vec::with_capacity((offset - self.position) as usize);
        bytes.extend_from_slice(&(table.len() as u32).to_le_bytes());
        bytes.extend_from_slice(&crc32fast::hash(&table).to_le_bytes());
        bytes.extend_from_slice(&table);
        layers.iter().flatten().for_each(|brick| bytes.extend_from_slice(&brick.bytes));
        bytes.extend_from_slice(&packed);
        let file = self.file.get_mut().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(self.position))
            .and_then(|_| file.write_all(&bytes))
            .map_err(Error::io(format!("writing {}", self.claim.path.display())))?;
        if self.synced.elapsed() >= SYNC_INTERVAL {
            file.sync_data().map_err(Error::io(format!("writing {}", self.claim.path.display())))?;
            self.synced = Instant::now();
        }
        self.position = offset;
        self.records.insert(record.block, record);
        self.claim.keep(true);
        Ok(())
    }

    /// The numbers that a block was added with.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`], [`Error::Parameter`] for a block that is not finished.
    pub fn numbers(&self, block: usize) -> Result<Vec<u64>> {
        let record = self.record(block)?;
        let (stored, mut numbers) = (self.read(record.numbers)?, Vec::new());
        Unpacker::new()?.unpack(record.numbers.encoding, &stored, record.count as usize, None, &mut numbers)?;
        Ok(numbers)
    }

    /// Brick `brick` of layer `layer` of a block, in the order that they were added in.
    ///
    /// # Errors
    /// As [`Self::numbers`].
    pub fn brick(&self, block: usize, layer: usize, brick: usize) -> Result<PackedBrick> {
        let entry = self.record(block)?.layers.get(layer).and_then(|entries| entries.get(brick)).copied();
        let BrickEntry { extent, range } = entry.ok_or_else(|| {
            Error::Parameter(format!("{}: block {block} has no brick {brick}", self.claim.path.display()))
        })?;
        Ok(PackedBrick { encoding: extent.encoding, bytes: self.read(extent)?, crc32: extent.crc32, range })
    }

    /// Removes the file: the task is done.
    pub fn finish(self) {
        self.claim.release();
    }

    fn record(&self, block: usize) -> Result<&Record> {
        u32::try_from(block)
            .ok()
            .and_then(|block| self.records.get(&block))
            .ok_or_else(|| Error::Parameter(format!("{}: block {block} is not finished", self.claim.path.display())))
    }

    fn read(&self, extent: Extent) -> Result<Vec<u8>> {
        let mut bytes = vec![0; extent.stored_bytes as usize];
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(extent.offset))
            .and_then(|_| file.read_exact(&mut bytes))
            .map_err(Error::io(format!("reading {}", self.claim.path.display())))?;
        if !checksum_fits(extent.crc32, crc32fast::hash(&bytes)) {
            let message = format!("{} was damaged while it was used; delete it", self.claim.path.display());
            return Err(Error::Format(message));
        }
        Ok(bytes)
    }
}

/// What a run is about.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Head {
    /// Fingerprint of all that the finished file depends on.
    pub task: [u8; 32],
    /// Fingerprint of the input file.
    pub input: [u8; 32],
    /// Voxels of a block along x, y, z.
    pub block: [u32; 3],
    /// What was found out about the input.
    pub findings: Vec<u64>,
}

impl Head {
    /// Whether blocks of the one are blocks of the other; the file that they were made from may be another with the same numbers.
    fn is_of(&self, other: &Self) -> bool {
        (self.task, self.block) == (other.task, other.block)
    }

    fn to_bytes(&self) -> Vec<u8> {
        let edges = self.block.map(u32::to_le_bytes).concat();
        let count = (self.findings.len() as u32).to_le_bytes();
        let numbers: Vec<u8> = self.findings.iter().flat_map(|number| number.to_le_bytes()).collect();
        let mut bytes = [&MAGIC[..], &self.task, &self.input, &edges, &count, &[0; 4], &numbers].concat();
        let crc32 = head_crc32(&bytes[..HEAD_BYTES], &numbers).to_le_bytes();
        bytes[HEAD_BYTES - 4..HEAD_BYTES].copy_from_slice(&crc32);
        bytes
    }
}

fn head_crc32(start: &[u8], numbers: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&start[MAGIC.len()..HEAD_BYTES - 4]);
    hasher.update(numbers);
    hasher.finalize()
}

/// The head of a file; none where it is not whole. The file is then read up to its end.
fn read_head(file: &mut File, length: u64) -> std::io::Result<Option<Head>> {
    file.seek(SeekFrom::Start(0))?;
    let mut start = [0; HEAD_BYTES];
    if length < HEAD_BYTES as u64 {
        return Ok(None);
    }
    file.read_exact(&mut start)?;
    let word = |at: usize| u32::from_le_bytes([start[at], start[at + 1], start[at + 2], start[at + 3]]);
    let (count, crc32) = (word(84) as usize, word(88));
    if start[..8] != MAGIC || count > MOST_NUMBERS || length < (HEAD_BYTES + 8 * count) as u64 {
        return Ok(None);
    }
    let mut bytes = vec![0; 8 * count];
    file.read_exact(&mut bytes)?;
    if !checksum_fits(crc32, head_crc32(&start, &bytes)) {
        return Ok(None);
    }
    let part = |at: usize| std::array::from_fn(|index| start[at + index]);
    let findings = bytes.as_chunks::<8>().0.iter().map(|number| u64::from_le_bytes(*number)).collect();
    Ok(Some(Head { task: part(8), input: part(40), block: [72, 76, 80].map(word), findings }))
}

/// What is whole of a file.
struct Content {
    head: Head,
    records: BTreeMap<u32, Record>,
    /// The position behind them.
    end: u64,
}

/// What is whole of a file; none where the head is not.
fn read_content(file: &mut File) -> std::io::Result<Option<Content>> {
    let length = file.metadata()?.len();
    let Some(head) = read_head(file, length)? else { return Ok(None) };
    let (mut records, mut end) = (BTreeMap::new(), (HEAD_BYTES + 8 * head.findings.len()) as u64);
    let mut reader = BufReader::with_capacity(1 << 20, file);
    while let Some((record, behind)) = read_record(&mut reader, end, length)? {
        records.insert(record.block, record);
        end = behind;
    }
    Ok(Some(Content { head, records, end }))
}

/// The record at `position`, and where it ends; none where it is not whole.
fn read_record(reader: &mut impl Read, position: u64, length: u64) -> std::io::Result<Option<(Record, u64)>> {
    let mut start = [0; 8];
    if length < position + 8 {
        return Ok(None);
    }
    reader.read_exact(&mut start)?;
    let [bytes, crc32] = [0, 4].map(|at| u32::from_le_bytes([start[at], start[at + 1], start[at + 2], start[at + 3]]));
    let mut offset = position + 8 + u64::from(bytes);
    if bytes as usize > MAX_TABLE_BYTES || length < offset {
        return Ok(None);
    }
    let mut table = vec![0; bytes as usize];
    reader.read_exact(&mut table)?;
    if !checksum_fits(crc32, crc32fast::hash(&table)) {
        return Ok(None);
    }
    let Ok(record) = codec::decode::<Record, MAX_TABLE_BYTES>(&table, "a block's table") else { return Ok(None) };
    if record.count as usize > MOST_NUMBERS {
        return Ok(None);
    }
    let bricks = record.layers.iter().flatten().map(|entry| entry.extent);
    let mut stored = Vec::new();
    for extent in bricks.chain([record.numbers]) {
        if extent.offset != offset || length < offset + u64::from(extent.stored_bytes) {
            return Ok(None);
        }
        stored.resize(extent.stored_bytes as usize, 0);
        reader.read_exact(&mut stored)?;
        if !checksum_fits(extent.crc32, crc32fast::hash(&stored)) {
            return Ok(None);
        }
        offset += u64::from(extent.stored_bytes);
    }
    Ok(Some((record, offset)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compression::Encoding;

    fn brick(seed: u8) -> PackedBrick {
        let bytes: Vec<u8> = (0..20 + seed).map(|at| at ^ seed).collect();
        PackedBrick { encoding: Encoding::Raw, crc32: crc32fast::hash(&bytes), bytes, range: None }
    }

    fn head(task: u8) -> Head {
        Head { task: [task; 32], input: [9; 32], block: [32, 64, 96], findings: vec![4, 5] }
    }

    fn open(output: &Path) -> Unfinished {
        Unfinished::resume(Claim::new(output).expect("free"), &head(1)).expect("opens")
    }

    #[test]
    fn whole_records_survive_and_torn_ones_do_not() {
        let folder = tempfile::tempdir().expect("a folder");
        let output = folder.path().join("out.vxr");
        let mut unfinished = open(&output);
        let path = unfinished.claim.path().to_owned();
        unfinished.append(3, &[vec![brick(1), brick(2)], vec![brick(3)]], &[7; 9]).expect("writes");
        let first = std::fs::metadata(&path).expect("there").len();
        unfinished.append(0, &[vec![brick(4)], vec![]], &[1, 2, 3]).expect("writes");
        drop(unfinished);
        let whole = std::fs::read(&path).expect("there");
        for length in 0..=whole.len() {
            std::fs::write(&path, &whole[..length]).expect("writes");
            let expected = usize::from(length as u64 >= first) + usize::from(length == whole.len());
            let unfinished = open(&output);
            assert_eq!(unfinished.len(), expected, "{length}");
            if expected > 0 {
                assert!(unfinished.has(3));
                assert_eq!(unfinished.brick(3, 0, 1).expect("there"), brick(2));
                assert_eq!(unfinished.numbers(3).expect("there"), [7; 9]);
            }
        }
        for at in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[at] ^= 16;
            std::fs::write(&path, &damaged).expect("writes");
            assert!(open(&output).len() < 2, "{at}");
        }
        std::fs::write(&path, &whole).expect("writes");
        let mut claim = Claim::new(&output).expect("free");
        assert_eq!(claim.head(), Some(head(1)));
        let refused = Unfinished::resume(claim, &head(2)).expect_err("another task").to_string();
        assert!(refused.contains("holds 2 finished blocks"), "{refused}");
        assert_eq!(open(&output).len(), 2, "still there");
        // Before the first block is finished, there is nothing to be lost.
        std::fs::write(&path, head(2).to_bytes()).expect("writes");
        assert!(open(&output).is_empty());
        assert!(!path.exists(), "nothing to go on from");
    }

    #[test]
    fn an_output_is_claimed_by_one_run() {
        let folder = tempfile::tempdir().expect("a folder");
        let output = folder.path().join("out.vxr");
        let claim = Claim::new(&output).expect("free");
        assert!(Claim::new(&output).expect_err("taken").to_string().contains("another run"));
        drop(claim);
        Claim::new(&output).expect("free again").release();
        assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
        // What a killed run left is taken away by the next one; what others are writing is not.
        std::fs::write(folder.path().join(".voxrole-out.vxr-abc123.partial"), b"rest").expect("writes");
        std::fs::write(folder.path().join(".voxrole-out.vxr-2-abc123.partial"), b"another's").expect("writes");
        Claim::new(&output).expect("free").release();
        assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 1);
    }
}
