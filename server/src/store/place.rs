//! Whether the files of an open database are still those that were opened, with all they had. A program that holds a
//! file open can write to it after its name is gone, and what it writes is lost with the program.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::file::beside;
use super::trouble::gone;

/// What makes a file this file and no other: device and inode.
#[cfg(unix)]
type Identity = (u64, u64);
#[cfg(not(unix))]
type Identity = ();

/// A file as it was last seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Seen {
    identity: Identity,
    length: u64,
}

/// Bytes before the frames of a log, and before the page in each.
const LOG_HEAD: u64 = 32;
const FRAME_HEAD: u64 = 24;

/// Where a database lies, and its file, its log and its index as they were when the writer last used them.
#[derive(Debug)]
pub(super) struct Place {
    database: PathBuf,
    seen: Mutex<[Option<Seen>; 3]>,
}

impl Place {
    /// The place of a database that has just been opened.
    pub(super) fn of(database: &Path) -> Self {
        Self { database: database.to_owned(), seen: Mutex::new([look(database), None, None]) }
    }

    fn now(&self) -> [Option<Seen>; 3] {
        ["", "-wal", "-shm"].map(|ending| look(&beside(&self.database, ending)))
    }

    /// Notes log and index; the writer has them open.
    pub(super) fn note(&self) {
        let [_, log, index] = self.now();
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        *seen = [seen[0], log, index];
    }

    /// Forgets log and index: without the writer's connection SQLite may remove and make them.
    pub(super) fn forget(&self) {
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        *seen = [seen[0], None, None];
    }

    /// Looks whether the files are the ones that were opened, and none was cut short.
    ///
    /// # Errors
    /// When one was removed, replaced or cut.
    pub(super) fn check(&self) -> Result<(), sqlx::Error> {
        let now = self.now();
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        for (i, (then, now)) in seen.iter_mut().zip(now).enumerate() {
            let Some(then) = then else { continue };
            let now = now.filter(|now| now.identity == then.identity).ok_or_else(gone)?;
            // SQLite shortens nothing while it is open but a log of which nothing is needed any more.
            if now.length < then.length && (i != 1 || lacks_frames(&beside(&self.database, "-shm"), now.length)) {
                return Err(gone());
            }
            *then = now;
        }
        Ok(())
    }
}

/// Whether the index of a log (https://sqlite.org/walformat.html) has more frames than fit into so many bytes.
fn lacks_frames(index: &Path, length: u64) -> bool {
    let mut head = [0; 20];
    if File::open(index).and_then(|mut file| file.read_exact(&mut head)).is_err() {
        return false;
    }
    let page = match u16::from_ne_bytes([head[14], head[15]]) {
        1 => 65_536,
        page => u64::from(page),
    };
    let frames = u64::from(u32::from_ne_bytes([head[16], head[17], head[18], head[19]]));
    frames > 0 && length < LOG_HEAD + frames * (FRAME_HEAD + page)
}

fn look(path: &Path) -> Option<Seen> {
    let file = fs::metadata(path).ok()?;
    Some(Seen { identity: identity(&file), length: file.len() })
}

#[cfg(unix)]
fn identity(file: &fs::Metadata) -> Identity {
    use std::os::unix::fs::MetadataExt;
    (file.dev(), file.ino())
}

#[cfg(not(unix))]
fn identity(_: &fs::Metadata) -> Identity {}

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

    #[test]
    fn a_file_cut_short_is_noticed_and_a_log_of_which_all_is_stored_is_not_missed() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::write(path("d"), [0; 8192]).unwrap();
        fs::write(path("d-wal"), [0; 32 + 2 * 4120]).unwrap();
        let index = |frames: u32| {
            let mut index = vec![0; 136];
            index[14..16].copy_from_slice(&4096_u16.to_ne_bytes());
            index[16..20].copy_from_slice(&frames.to_ne_bytes());
            fs::write(path("d-shm"), index).unwrap();
        };
        index(2);
        let place = Place::of(&path("d"));
        place.note();
        assert!(place.check().is_ok());
        let cut =
            |name: &str, length: u64| File::options().write(true).open(path(name)).unwrap().set_len(length).unwrap();
        cut("d-wal", 0);
        assert!(place.check().is_err(), "two frames are missing");
        index(0);
        assert!(place.check().is_ok(), "all was stored before");
        cut("d", 16_384);
        assert!(place.check().is_ok());
        cut("d", 0);
        assert!(place.check().is_err());
    }
}
