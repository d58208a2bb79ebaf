//! Folders that appear under their name only when they are complete, and folders that go with the program.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::TempDir;

/// A folder under a temporary name beside its final one; removed again unless [`AtomicFolder::commit`] is reached.
pub struct AtomicFolder {
    folder: ScratchFolder,
    path: PathBuf,
}

/// A folder for what is needed for a while; removed with it.
pub struct ScratchFolder(TempDir);

/// The temporary folders that there are now.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes every temporary folder of this process: for a program that is about to end without unwinding.
pub fn remove_unfinished() {
    for path in UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
        // Whoever cannot remove it can do nothing more about it.
        let _ = fs::remove_dir_all(path);
    }
}

impl ScratchFolder {
    /// Creates it where the system keeps temporary files.
    ///
    /// # Errors
    /// Whatever the operating system says.
    pub fn create() -> io::Result<Self> {
        tempfile::tempdir().map(Self::of)
    }

    fn of(folder: TempDir) -> Self {
        UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).push(folder.path().to_owned());
        Self(folder)
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.0.path()
    }
}

impl Drop for ScratchFolder {
    fn drop(&mut self) {
        UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).retain(|path| path != self.0.path());
    }
}

impl AtomicFolder {
    /// Creates the temporary folder in the folder of `path`.
    ///
    /// # Errors
    /// When there is no such folder, or whatever else the operating system says.
    pub fn create(path: &Path) -> io::Result<Self> {
        let parent = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !parent.is_dir() {
            return Err(io::Error::new(io::ErrorKind::NotFound, format!("there is no folder {}", parent.display())));
        }
        let folder = ScratchFolder::of(temporary(path, parent)?);
        Ok(Self { folder, path: path.to_owned() })
    }

    /// The temporary folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Gives the folder its name; a folder that had it is removed.
    ///
    /// # Errors
    /// Whatever the operating system says; the temporary folder is then removed, and a folder that had the name is back
    /// under it.
    pub fn commit(self) -> io::Result<()> {
        if !self.path.exists() {
            return fs::rename(self.folder.path(), &self.path);
        }
        let parent = self.folder.path().parent().unwrap_or(Path::new("."));
        let former = temporary(&self.path, parent)?;
        let former_path = former.path().join("former");
        fs::rename(&self.path, &former_path)?;
        fs::rename(self.folder.path(), &self.path).inspect_err(|_| {
            // Both were there a moment ago; whoever cannot put one back can do nothing more about it.
            let _ = fs::rename(&former_path, &self.path);
        })
    }
}

fn temporary(path: &Path, parent: &Path) -> io::Result<TempDir> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let mut builder = tempfile::Builder::new();
    let prefix = format!(".voxrole-{name}-");
    builder.prefix(&prefix).suffix(".partial");
    #[cfg(unix)]
    // What any other program would create: readable by all that the umask lets.
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
    builder.tempdir_in(parent).map_err(|error| {
        // Without the temporary folder's name, which says nothing to the user.
        io::Error::new(error.kind(), format!("the folder {} cannot be written to", parent.display()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).expect("lists");
        entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned()).collect()
    }

    #[test]
    fn a_folder_appears_when_it_is_complete() {
        let place = tempfile::tempdir().expect("a folder");
        let path = place.path().join("out");
        for content in ["first", "second"] {
            let folder = AtomicFolder::create(&path).expect("creates");
            fs::write(folder.path().join(content), content).expect("writes");
            folder.commit().expect("renames");
            assert_eq!((names(place.path()), names(&path)), (vec!["out".into()], vec![content.into()]));
        }
    }

    #[test]
    fn nothing_is_left_of_an_unfinished_folder() {
        let place = tempfile::tempdir().expect("a folder");
        let folder = AtomicFolder::create(&place.path().join("out")).expect("creates");
        fs::write(folder.path().join("part"), "part").expect("writes");
        let temporary = folder.path().to_owned();
        assert!(UNFINISHED.lock().expect("is sound").contains(&temporary));
        drop(folder);
        assert!(!UNFINISHED.lock().expect("is sound").contains(&temporary));
        assert!(names(place.path()).is_empty());
        assert!(AtomicFolder::create(&place.path().join("no/such")).is_err());
    }
}
