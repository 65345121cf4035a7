//! A database is made, brought up to date, opened.

use std::fs::{DirBuilder, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use sqlx::migrate::{MigrateError, Migrator};
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqliteSynchronous};
use sqlx::{ConnectOptions, Connection};

use super::trouble::Trouble;
use crate::hold::Holder;

pub(super) static MIGRATIONS: Migrator = sqlx::migrate!("../migrations/sqlite");

/// How long SQLite waits for another process which has the file.
const BUSY: Duration = Duration::from_secs(5);
/// How long another process may take to bring the tables up to date.
const PATIENCE: Duration = Duration::from_secs(60);
/// Between two looks whether it has.
const GLANCE: Duration = Duration::from_millis(50);

/// Why a database could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// A folder or file could not be made.
    #[error("{} cannot be made or written", .path.display())]
    Folder {
        /// Which.
        path: PathBuf,
        /// Why.
        #[source]
        cause: io::Error,
    },
    /// There is none.
    #[error("there is no database {}", .0.display())]
    Missing(PathBuf),
    /// SQLite refused.
    #[error("the database {} cannot be opened", .path.display())]
    Database {
        /// Which.
        path: PathBuf,
        /// Why.
        #[source]
        cause: sqlx::Error,
    },
    /// The tables could not be brought up to date.
    #[error("the tables of the database {} cannot be brought up to date", .path.display())]
    Migration {
        /// Which.
        path: PathBuf,
        /// Why.
        #[source]
        cause: MigrateError,
    },
    /// A newer version has made it, or brought it up to date.
    #[error("the database {} was made by a newer version of manduca: it has migration {version}", .path.display())]
    Newer {
        /// Which.
        path: PathBuf,
        /// Its first migration that this version does not know.
        version: i64,
    },
    /// An older version has made it, and it may not be brought up to date now.
    #[error("the database {} was made by an older version of manduca: it lacks migration {version}", .path.display())]
    Older {
        /// Which.
        path: PathBuf,
        /// The first migration it lacks.
        version: i64,
    },
    /// Another build has made it.
    #[error("the database {} was made by another build of manduca: its migration {version} differs", .path.display())]
    Other {
        /// Which.
        path: PathBuf,
        /// The migration.
        version: i64,
    },
    /// Rows refer to others which are not there.
    #[error("the database {} is damaged: {rows} rows refer to others which are not there", .path.display())]
    Loose {
        /// Which.
        path: PathBuf,
        /// How many rows.
        rows: usize,
    },
    /// Another coordinator has it.
    #[error("the database {} belongs to another coordinator{}", .path.display(), named(.holder.as_deref()))]
    Held {
        /// Which.
        path: PathBuf,
        /// Who.
        holder: Option<Box<Holder>>,
    },
}

fn named(holder: Option<&Holder>) -> String {
    holder.map_or_else(String::new, |h| format!(": {} (process {} on {})", h.url, h.process, h.host))
}

impl OpenError {
    /// What to do about it.
    pub fn advice(&self) -> &'static str {
        match self {
            Self::Folder { .. } => Trouble::Closed.advice(),
            Self::Missing(_) => {
                "--data DIR or MANDUCA_DATA names the folder of the database; `manduca serve` makes one, and so does \
                 `manduca token create --init`"
            }
            Self::Database { cause, .. } => Trouble::of(cause).map_or("see `manduca doctor`", Trouble::advice),
            Self::Migration { cause, .. } => Trouble::of(cause).map_or("see `manduca doctor`", Trouble::advice),
            Self::Newer { .. } => "use that version, or restore a copy made before the update",
            Self::Older { .. } => {
                "look at it with the version that made it, or let `manduca serve` of this version bring it up to date"
            }
            Self::Other { .. } => "use the build that made it",
            Self::Loose { .. } => Trouble::Damaged.advice(),
            Self::Held { .. } => {
                "ask that one (--coordinator URL) or stop it first; `manduca run` joins a coordinator of its folder"
            }
        }
    }
}

/// Files only their owner may read: results are nobody else's business, and a database is a way to tokens.
pub(crate) fn private(options: &mut OpenOptions) -> &mut OpenOptions {
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(options, 0o600);
    options
}

/// Makes the folder of a database, for its owner only.
pub(crate) fn make_folder(database: &Path) -> Result<(), OpenError> {
    let Some(folder) = database.parent().filter(|folder| !folder.as_os_str().is_empty()) else { return Ok(()) };
    let mut builder = DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.recursive(true).create(folder).map_err(|cause| OpenError::Folder { path: folder.to_owned(), cause })
}

/// Makes the file of a database when there is none: SQLite gives its other files the same permissions.
fn make_file(database: &Path) -> Result<(), OpenError> {
    match private(OpenOptions::new().write(true).create_new(true)).open(database) {
        Ok(_) => Ok(()),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(()),
        Err(cause) => Err(OpenError::Folder { path: database.to_owned(), cause }),
    }
}

/// How a database is opened to be changed.
fn options(database: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(database)
        // Were the file gone, a new one would take its place without a word.
        .create_if_missing(false)
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        .foreign_keys(true)
        .busy_timeout(BUSY)
        // Decisions are logged by what they mean, not as statements.
        .disable_statement_logging()
}

/// Makes a database when there is none and brings its tables up to date; returns how to open it.
pub(super) async fn prepare(database: &Path) -> Result<SqliteConnectOptions, OpenError> {
    make_folder(database)?;
    make_file(database)?;
    update(database).await
}

/// Tells a database that is not there from one that may not be looked for.
pub(super) fn must_exist(database: &Path) -> Result<(), OpenError> {
    match database.try_exists() {
        Ok(true) => Ok(()),
        Ok(false) => Err(OpenError::Missing(database.to_owned())),
        Err(cause) => Err(OpenError::Database { path: database.to_owned(), cause: sqlx::Error::Io(cause) }),
    }
}

/// Brings the tables of a database up to date; returns how to open it.
pub(super) async fn update(database: &Path) -> Result<SqliteConnectOptions, OpenError> {
    must_exist(database)?;
    let (options, began) = (options(database), Instant::now());
    loop {
        match migrate(database, &options).await {
            Ok(()) => return Ok(options),
            // Another process may be at it.
            Err(error) if Trouble::of(&error) == Some(Trouble::Locked) && began.elapsed() < PATIENCE => {
                tokio::time::sleep(GLANCE).await;
            }
            Err(error) => return Err(error),
        }
    }
}

/// Brings the tables up to date in one transaction, so that of several processes one does. A
/// migration which copies a table needs foreign keys off; whether all still lead somewhere is
/// checked afterwards.
async fn migrate(database: &Path, options: &SqliteConnectOptions) -> Result<(), OpenError> {
    let path = || database.to_owned();
    let refused = |cause| OpenError::Database { path: path(), cause };
    let mut connection = options.clone().foreign_keys(false).connect().await.map_err(refused)?;
    let mut transaction = connection.begin_with("begin immediate").await.map_err(refused)?;
    // Not `run`, whose future the compiler cannot prove to be free to move between threads.
    let migrated = MIGRATIONS.run_direct(None, &mut *transaction, false).await;
    migrated.map_err(|cause| match cause {
        MigrateError::VersionMissing(version) => OpenError::Newer { path: path(), version },
        MigrateError::VersionMismatch(version) => OpenError::Other { path: path(), version },
        cause => OpenError::Migration { path: path(), cause },
    })?;
    let loose = sqlx::query("pragma foreign_key_check").fetch_all(&mut *transaction).await.map_err(refused)?;
    transaction.commit().await.map_err(refused)?;
    connection.close().await.map_err(refused)?;
    if loose.is_empty() { Ok(()) } else { Err(OpenError::Loose { path: path(), rows: loose.len() }) }
}

/// Compares the tables of a database with those of this version.
///
/// # Errors
/// When they are of another version.
pub(super) async fn check_version(database: &Path, db: &mut SqliteConnection) -> Result<(), OpenError> {
    let path = || database.to_owned();
    let applied: Vec<(i64, Vec<u8>)> =
        sqlx::query_as("select version, checksum from _sqlx_migrations order by version")
            .fetch_all(db)
            .await
            .map_err(|cause| OpenError::Database { path: path(), cause })?;
    for migration in MIGRATIONS.iter() {
        match applied.iter().find(|(version, _)| *version == migration.version) {
            None => return Err(OpenError::Older { path: path(), version: migration.version }),
            Some((version, checksum)) if *checksum != *migration.checksum => {
                return Err(OpenError::Other { path: path(), version: *version });
            }
            Some(_) => {}
        }
    }
    match applied.iter().find(|(version, _)| MIGRATIONS.iter().all(|m| m.version != *version)) {
        Some((version, _)) => Err(OpenError::Newer { path: path(), version: *version }),
        None => Ok(()),
    }
}
