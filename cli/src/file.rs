//! Files are written whole: beside their place, and into it when they are complete and on disk. What fails
//! leaves the old file as it was.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// A file on its way. Dropped unfinished, it leaves nothing behind.
#[derive(Debug)]
pub enum Draft {
    /// Written beside its place.
    Beside {
        /// Under a name of its own.
        file: BufWriter<NamedTempFile>,
        /// Its place.
        place: PathBuf,
    },
    /// A pipe or a device, which takes what comes as it comes.
    Direct(BufWriter<File>),
}

impl Draft {
    /// Begins a file that replaces what is at this path. A symbolic link stays, and the file it names is replaced.
    ///
    /// # Errors
    /// When nothing can be written there.
    pub fn begin(path: &Path) -> io::Result<Self> {
        let place = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let old = fs::metadata(&place).ok();
        if old.as_ref().is_some_and(|old| !old.is_file()) {
            return Ok(Self::Direct(BufWriter::new(File::options().write(true).open(&place)?)));
        }
        let file = named(tempfile::Builder::new().prefix(".manduca-"), &place)?;
        if let Some(old) = old {
            file.as_file().set_permissions(old.permissions())?;
        }
        Ok(Self::Beside { file: BufWriter::new(file), place })
    }

    /// Puts the file in its place.
    ///
    /// # Errors
    /// When not all of it could be written; the old file is as it was.
    pub fn finish(self) -> io::Result<()> {
        match self {
            Self::Direct(mut file) => file.flush(),
            Self::Beside { file, place } => {
                let file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
                file.as_file().sync_all()?;
                file.persist(place)?;
                Ok(())
            }
        }
    }
}

impl Write for Draft {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Beside { file, .. } => file.write(bytes),
            Self::Direct(file) => file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Beside { file, .. } => file.flush(),
            Self::Direct(file) => file.flush(),
        }
    }
}

/// The folder of a file.
fn folder(place: &Path) -> &Path {
    place.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Readable as the user's other files are.
fn named(builder: &mut tempfile::Builder<'_, '_>, place: &Path) -> io::Result<NamedTempFile> {
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder(place))
}

/// Writes a whole file.
///
/// # Errors
/// When it cannot be written; the old file is as it was.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut draft = Draft::begin(path)?;
    draft.write_all(bytes)?;
    draft.finish()
}

/// A new file only its owner may read, not yet in its place.
///
/// # Errors
/// When there is a file already, or none can be made.
pub fn begin_secret(path: &Path) -> io::Result<NamedTempFile> {
    if path.symlink_metadata().is_ok() {
        return Err(io::ErrorKind::AlreadyExists.into());
    }
    tempfile::Builder::new().prefix(".manduca-").tempfile_in(folder(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let all = fs::read_dir(folder).unwrap();
        all.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect()
    }

    #[test]
    fn what_is_not_finished_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        write(&path, b"old").unwrap();
        let mut draft = Draft::begin(&path).unwrap();
        draft.write_all(b"half of the new").unwrap();
        drop(draft);
        assert_eq!((fs::read(&path).unwrap(), names(folder.path())), (b"old".to_vec(), vec!["a.csv".to_owned()]));
        write(&path, b"new").unwrap();
        assert_eq!((fs::read(&path).unwrap(), names(folder.path())), (b"new".to_vec(), vec!["a.csv".to_owned()]));
        assert!(write(&folder.path().join("missing/a.csv"), b"x").is_err());
    }

    #[cfg(unix)]
    #[test]
    fn links_permissions_and_devices_stay() {
        use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let (real, link) = (folder.path().join("real"), folder.path().join("link"));
        write(&real, b"old").unwrap();
        fs::set_permissions(&real, PermissionsExt::from_mode(0o640)).unwrap();
        symlink(&real, &link).unwrap();
        write(&link, b"new").unwrap();
        assert!(link.symlink_metadata().unwrap().is_symlink());
        assert_eq!((fs::read(&real).unwrap(), real.metadata().unwrap().mode() & 0o777), (b"new".to_vec(), 0o640));
        write(Path::new("/dev/null"), b"nothing").unwrap();
        assert!(!Path::new("/dev/null").metadata().unwrap().is_file());
        let secret = begin_secret(&folder.path().join("token")).unwrap();
        assert_eq!(secret.as_file().metadata().unwrap().mode() & 0o777, 0o600);
        assert!(begin_secret(&link).is_err());
    }
}
