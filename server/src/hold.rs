//! One coordinator per database. An advisory lock beside the file belongs to the process that
//! coordinates; a second file says where that process can be reached.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::store::{OpenError, beside, make_folder, private};

/// What a coordinator is part of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Duty {
    /// `manduca serve`: it stays until it is told to stop.
    Serve,
    /// `manduca run`: it ends with its study.
    Run,
}

/// The coordinator that holds a database.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Holder {
    /// Where it is reached from its own machine.
    pub url: String,
    /// Its process.
    pub process: u32,
    /// Its machine.
    pub host: String,
    /// What it is part of.
    pub duty: Duty,
}

/// Whether the database could be taken.
#[derive(Debug)]
pub enum Taken {
    /// It is this process's now.
    Ours(Hold),
    /// Another process has it. A process that has just started has not said yet where it is reached.
    Theirs(Option<Holder>),
}

/// The right to coordinate a database. Dropped, it passes to the next process that asks.
#[derive(Debug)]
pub struct Hold {
    /// The system releases the lock with the file, whatever becomes of this process.
    _lock: Option<File>,
    address: PathBuf,
}

impl Hold {
    /// Takes a database, whose folder is made when missing. Does not wait.
    ///
    /// # Errors
    /// When the folder or the lock cannot be made or opened.
    pub fn take(database: &Path) -> Result<Taken, OpenError> {
        make_folder(database)?;
        let (path, address) = (beside(database, ".lock"), beside(database, ".address"));
        let lock = private(OpenOptions::new().write(true).create(true).truncate(false)).open(&path);
        let lock = lock.map_err(|cause| OpenError::Folder { path, cause })?;
        let lock = match lock.try_lock() {
            Ok(()) => Some(lock),
            Err(TryLockError::WouldBlock) => return Ok(Taken::Theirs(read(&address))),
            Err(TryLockError::Error(error)) => {
                tracing::warn!(error.cause = %error, "This file system has no locks: nothing keeps a second coordinator from this database");
                None
            }
        };
        // A process that was killed may have left its address.
        remove(&address);
        Ok(Taken::Ours(Self { _lock: lock, address }))
    }

    /// Writes down where this coordinator is reached.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn announce(&self, holder: &Holder) -> io::Result<()> {
        let new = self.address.with_extension("address-new");
        let mut file = private(OpenOptions::new().write(true).create(true).truncate(true)).open(&new)?;
        file.write_all(&serde_json::to_vec(holder)?)?;
        fs::rename(new, &self.address)
    }
}

impl Drop for Hold {
    fn drop(&mut self) {
        // Before the lock goes: afterwards the file may be the next holder's.
        remove(&self.address);
    }
}

fn read(address: &Path) -> Option<Holder> {
    serde_json::from_slice(&fs::read(address).ok()?).ok()
}

fn remove(address: &Path) {
    // It need not be there, and nobody reads it while no process has the lock.
    let _ = fs::remove_file(address);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn holder() -> Holder {
        Holder { url: "http://127.0.0.1:1".into(), process: 7, host: "here".into(), duty: Duty::Run }
    }

    #[test]
    fn a_database_is_held_once_and_its_holder_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let database = folder.path().join("new/manduca.db");
        let Taken::Ours(hold) = Hold::take(&database).unwrap() else { panic!("nobody has it") };
        assert!(matches!(Hold::take(&database).unwrap(), Taken::Theirs(None)));
        hold.announce(&holder()).unwrap();
        let Taken::Theirs(Some(found)) = Hold::take(&database).unwrap() else { panic!("it is held") };
        assert_eq!(found, holder());
        drop(hold);
        assert!(!beside(&database, ".address").exists());
        assert!(matches!(Hold::take(&database).unwrap(), Taken::Ours(_)));
    }

    #[test]
    fn what_a_killed_process_left_names_nobody() {
        let folder = tempfile::tempdir().unwrap();
        let database = folder.path().join("manduca.db");
        fs::write(beside(&database, ".lock"), "").unwrap();
        fs::write(beside(&database, ".address"), serde_json::to_vec(&holder()).unwrap()).unwrap();
        let Taken::Ours(_hold) = Hold::take(&database).unwrap() else { panic!("nobody has it") };
        assert!(matches!(Hold::take(&database).unwrap(), Taken::Theirs(None)));
    }
}
