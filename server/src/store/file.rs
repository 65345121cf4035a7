//! A database opened beside the coordinator, which may run meanwhile: to change something, or only to look.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteLockingMode};
use sqlx::{ConnectOptions, Connection};

use super::open::{check_version, must_exist, prepare, update};
use super::upkeep::{delete_workers, list_forgotten};
use super::{OpenError, Trouble};

/// A database opened for short work.
pub(crate) struct File {
    connection: SqliteConnection,
    database: PathBuf,
    /// How the files were, where they were opened as ones that nobody changes.
    quiet: Option<Stamp>,
}

/// How the files of a database are: length and last change of the file, and of its log.
type Stamp = [Option<(u64, SystemTime)>; 2];

impl File {
    /// Opens a database, which is made when missing, and brings its tables up to date.
    pub(crate) async fn make(database: &Path) -> Result<Self, OpenError> {
        Self::connect(database, prepare(database).await?).await
    }

    /// Opens a database and brings its tables up to date.
    pub(crate) async fn open(database: &Path) -> Result<Self, OpenError> {
        Self::connect(database, update(database).await?).await
    }

    async fn connect(database: &Path, options: SqliteConnectOptions) -> Result<Self, OpenError> {
        let path = database.to_owned();
        let connection = options.connect().await.map_err(|cause| OpenError::Database { path: path.clone(), cause })?;
        Ok(Self { connection, database: path, quiet: None })
    }

    /// Opens a database to look at it. Neither the file nor its folder is changed, so that both may be read-only.
    ///
    /// A database that is open in some process has an index in shared memory, which readers use. Without
    /// one nobody changes the file, and SQLite is told so, for it would make an index.
    pub(crate) async fn look(database: &Path) -> Result<Self, OpenError> {
        let path = || database.to_owned();
        must_exist(database)?;
        let plain = SqliteConnectOptions::new().filename(database).read_only(true).disable_statement_logging();
        let is_shared = beside(database, "-shm").exists();
        let mut cause = None;
        if is_shared {
            match try_out(&plain).await {
                Ok(connection) => return Ok(Self { connection, database: path(), quiet: None }),
                // Left by a process that is gone, and of no use where it may not be written.
                Err(error) if matches!(Trouble::of(&error), Some(Trouble::Closed | Trouble::ReadOnly)) => {
                    cause = Some(error);
                }
                Err(cause) => return Err(OpenError::Database { path: path(), cause }),
            }
        }
        let stamp = stamp(database);
        let has_log = stamp[1].is_some_and(|(length, _)| length > 0);
        let quietly = match has_log {
            false => plain.immutable(true),
            // With the file to itself SQLite needs no index beside it; and a lock, which this takes,
            // would be a change.
            true => plain.vfs("unix-none").locking_mode(SqliteLockingMode::Exclusive),
        };
        match try_out(&quietly).await {
            Ok(connection) => Ok(Self { connection, database: path(), quiet: Some(stamp) }),
            Err(error) => Err(OpenError::Database { path: path(), cause: cause.unwrap_or(error) }),
        }
    }

    /// Whether nobody has changed the files since they were opened as ones that nobody changes.
    pub(crate) fn is_undisturbed(&self) -> bool {
        self.quiet.is_none_or(|then| then == stamp(&self.database))
    }

    /// Opens the files as they are now, again only to look.
    pub(crate) async fn look_again(&mut self) -> Result<(), OpenError> {
        *self = Self::look(&self.database).await?;
        Ok(())
    }

    /// Compares the tables with those of this version.
    ///
    /// # Errors
    /// When they are of another version.
    pub(crate) async fn check_version(&mut self) -> Result<(), OpenError> {
        check_version(&self.database, &mut self.connection).await
    }

    /// The connection.
    pub(crate) fn db(&mut self) -> &mut SqliteConnection {
        &mut self.connection
    }

    /// Removes workers which went long ago and which nothing names; returns how many.
    pub(crate) async fn forget_workers(&mut self, now: i64) -> Result<usize, sqlx::Error> {
        let gone = list_forgotten(&mut self.connection, now).await?;
        sqlx::query("pragma foreign_keys = off").execute(&mut self.connection).await?;
        let removed = delete_workers(&mut self.connection, &gone, now).await;
        sqlx::query("pragma foreign_keys = on").execute(&mut self.connection).await?;
        removed.map(|()| gone.len())
    }

    /// Begins a change.
    pub(crate) async fn begin(&mut self) -> Result<sqlx::Transaction<'_, sqlx::Sqlite>, sqlx::Error> {
        self.connection.begin_with("begin immediate").await
    }

    /// Closes the file.
    pub(crate) async fn close(self) {
        // Nothing is under way: at worst its log is folded in at the next start.
        let _ = self.connection.close().await;
    }
}

/// Opens and reads: SQLite opens the log and the index with the first statement.
async fn try_out(options: &SqliteConnectOptions) -> Result<SqliteConnection, sqlx::Error> {
    let mut connection = options.connect().await?;
    sqlx::query("select count(*) from sqlite_master").fetch_one(&mut connection).await?;
    Ok(connection)
}

/// The path of a database with an ending: what lies beside it.
pub(crate) fn beside(database: &Path, ending: &str) -> PathBuf {
    let mut name = database.as_os_str().to_owned();
    name.push(ending);
    name.into()
}

fn stamp(database: &Path) -> Stamp {
    let of = |path: &Path| fs::metadata(path).ok().and_then(|file| Some((file.len(), file.modified().ok()?)));
    [of(database), of(&beside(database, "-wal"))]
}
