//! Whether the files of an open database are still those that were opened. A program that holds a
//! file open can write to it after its name is gone, and what it writes is lost with the program.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::trouble::gone;

/// What makes a file this file and no other: device and inode.
#[cfg(unix)]
type Identity = (u64, u64);
#[cfg(not(unix))]
type Identity = ();

/// Where a database lies, and which files were there when it was opened.
#[derive(Debug)]
pub(super) struct Place {
    database: PathBuf,
    opened: Option<Identity>,
    /// Log and index, while the writer's connection keeps SQLite from removing them.
    companions: Mutex<[Option<Identity>; 2]>,
}

impl Place {
    /// The place of a database that has just been opened.
    pub(super) fn of(database: &Path) -> Self {
        Self { database: database.to_owned(), opened: identity(database), companions: Mutex::default() }
    }

    fn companions(&self) -> [Option<Identity>; 2] {
        ["-wal", "-shm"].map(|ending| {
            let mut name = self.database.as_os_str().to_owned();
            name.push(ending);
            identity(Path::new(&name))
        })
    }

    /// Notes log and index; the writer has them open.
    pub(super) fn note(&self) {
        *self.companions.lock().unwrap_or_else(PoisonError::into_inner) = self.companions();
    }

    /// Forgets log and index: without the writer's connection SQLite may remove and make them.
    pub(super) fn forget(&self) {
        *self.companions.lock().unwrap_or_else(PoisonError::into_inner) = [None; 2];
    }

    /// Looks whether the files are the ones that were opened.
    ///
    /// # Errors
    /// When one was removed or replaced.
    pub(super) fn check(&self) -> Result<(), sqlx::Error> {
        let noted = *self.companions.lock().unwrap_or_else(PoisonError::into_inner);
        let same = |noted: Option<Identity>, found: Option<Identity>| noted.is_none() || noted == found;
        let whole = same(self.opened, identity(&self.database))
            && noted.into_iter().zip(self.companions()).all(|(noted, found)| same(noted, found));
        if whole { Ok(()) } else { Err(gone()) }
    }
}

#[cfg(unix)]
fn identity(path: &Path) -> Option<Identity> {
    use std::os::unix::fs::MetadataExt;
    fs::metadata(path).ok().map(|file| (file.dev(), file.ino()))
}

#[cfg(not(unix))]
fn identity(path: &Path) -> Option<Identity> {
    fs::metadata(path).ok().map(drop)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_file_removed_or_replaced_is_noticed_until_it_is_back() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["d", "d-wal", "d-shm"] {
            fs::write(folder.path().join(name), name).unwrap();
        }
        let place = Place::of(&folder.path().join("d"));
        place.note();
        assert!(place.check().is_ok());
        for name in ["d", "d-wal", "d-shm"] {
            let (path, away) = (folder.path().join(name), folder.path().join("away"));
            fs::rename(&path, &away).unwrap();
            assert!(place.check().is_err(), "{name} is removed");
            fs::write(&path, name).unwrap();
            assert!(place.check().is_err(), "{name} is another file");
            fs::rename(&away, &path).unwrap();
            assert!(place.check().is_ok(), "{name} is back");
        }
        place.forget();
        fs::remove_file(folder.path().join("d-wal")).unwrap();
        assert!(place.check().is_ok(), "SQLite removes its log when the last connection closes");
    }
}
