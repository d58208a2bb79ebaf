//! Files that appear under their name only when they are complete.

use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::NamedTempFile;

/// A file under a temporary name beside its final one; removed again unless [`AtomicFile::commit`] is reached.
pub struct AtomicFile {
    file: NamedTempFile,
    path: PathBuf,
    _unfinished: Unfinished,
}

/// The temporary files that there are now.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes every temporary file of this process: for a program that is about to end without unwinding.
pub fn remove_unfinished() {
    for path in UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
        // Whoever cannot remove it can do nothing more about it.
        let _ = std::fs::remove_file(path);
    }
}

/// One entry of [`UNFINISHED`].
#[derive(Debug)]
pub(crate) struct Unfinished(PathBuf);

impl Unfinished {
    pub(crate) fn new(path: &Path) -> Self {
        UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).push(path.to_owned());
        Self(path.to_owned())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).retain(|path| *path != self.0);
    }
}

/// Checks, before any work is done, that `output` can be written and is none of `inputs`.
///
/// # Errors
/// [`io::ErrorKind::InvalidInput`] when `output` is one of `inputs`, by whatever name; else as [`AtomicFile::create`].
pub fn check_output(output: &Path, inputs: &[&Path]) -> io::Result<()> {
    if let Ok(existing) = output.canonicalize()
        && inputs.iter().any(|input| input.canonicalize().is_ok_and(|input| input == existing))
    {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "the input itself would be overwritten"));
    }
    AtomicFile::create(output).map(drop)
}

impl AtomicFile {
    /// Creates the temporary file in the folder of `path`, or of the file that `path` links to.
    ///
    /// # Errors
    /// When there is no such folder, when `path` names something that is not a regular file (a folder, a device, a link to
    /// nowhere), or whatever else the operating system says.
    pub fn create(path: &Path) -> io::Result<Self> {
        let path = if path.is_symlink() { path.canonicalize()? } else { path.to_owned() };
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(io::Error::new(io::ErrorKind::NotFound, format!("there is no folder {}", folder.display())));
        }
        if path.exists() && !path.is_file() {
            let message = format!("{} is not a regular file", path.display());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
        }
        let mut builder = tempfile::Builder::new();
        let prefix = prefix(&path);
        builder.prefix(&prefix).suffix(SUFFIX);
        #[cfg(unix)]
        // What any other program would create: readable by all that the umask lets.
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let file = builder.tempfile_in(folder).map_err(|error| {
            // Without the temporary file's name, which says nothing to the user.
            io::Error::new(error.kind(), format!("the folder {} cannot be written to", folder.display()))
        })?;
        let unfinished = Unfinished::new(file.path());
        Ok(Self { file, path, _unfinished: unfinished })
    }

    /// The open file.
    pub fn file_mut(&mut self) -> &mut File {
        self.file.as_file_mut()
    }

    /// Makes sure that the content is on disk, and gives the file its name, replacing any file that had it.
    ///
    /// # Errors
    /// Whatever the operating system says; the temporary file is then removed.
    pub fn commit(self) -> io::Result<()> {
        self.file.as_file().sync_all()?;
        self.file.persist(&self.path).map(drop).map_err(|error| error.error)
    }
}

/// How temporary files end.
const SUFFIX: &str = ".partial";

/// How temporary files of an output begin.
fn prefix(path: &Path) -> OsString {
    let mut prefix = OsString::from(".voxrole-");
    prefix.push(path.file_name().unwrap_or_default());
    prefix.push("-");
    prefix
}

/// Removes the temporary files that killed runs left of `path`, which no other run may be writing.
pub(crate) fn remove_left_overs(path: &Path) {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let prefix = prefix(path);
    let is_left_over = |name: &OsStr| {
        let (name, prefix) = (name.as_encoded_bytes(), prefix.as_encoded_bytes());
        // As many letters as tempfile draws.
        name.len() == prefix.len() + 6 + SUFFIX.len() && name.starts_with(prefix) && name.ends_with(SUFFIX.as_bytes())
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries.filter(|entry| is_left_over(&entry.file_name())) {
        // Whoever cannot remove it can do nothing more about it.
        let _ = std::fs::remove_file(entry.path());
    }
}

/// Writes `bytes` as the whole content of `path`.
///
/// # Errors
/// Whatever the operating system says; no file is then left under that name that was not there before.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.file_mut().write_all(bytes)?;
    file.commit()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_that_would_do_harm_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        write(&path("input"), b"precious").expect("writes");
        assert!(check_output(&path("input"), &[&path("input")]).is_err());
        assert!(check_output(folder.path(), &[]).is_err());
        assert!(check_output(&path("no/such"), &[]).is_err());
        assert!(check_output(&path("output"), &[&path("input")]).is_ok());
        assert!(!path("output").exists());
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_devices_left_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        write(&path("target"), b"old").expect("writes");
        std::os::unix::fs::symlink(path("target"), path("link")).expect("links");
        std::os::unix::fs::symlink(path("nowhere"), path("dangling")).expect("links");
        write(&path("link"), b"new").expect("writes");
        assert!(path("link").is_symlink());
        assert_eq!(std::fs::read(path("target")).expect("reads"), b"new");
        assert!(check_output(&path("link"), &[&path("target")]).is_err());
        assert!(AtomicFile::create(&path("dangling")).is_err());
        assert!(AtomicFile::create(Path::new("/dev/null")).is_err());
    }

    #[test]
    fn unfinished_files_can_be_removed_at_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = AtomicFile::create(&folder.path().join("output")).expect("creates");
        let temporary = file.file.path().to_owned();
        assert!(UNFINISHED.lock().expect("is sound").contains(&temporary));
        drop(file);
        assert!(!UNFINISHED.lock().expect("is sound").contains(&temporary) && !temporary.exists());
    }
}
