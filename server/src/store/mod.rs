//! The store: all SQL there is, in one place. Changes are operations queued to
//! the one writer ([`writer`]); reads go to a pool which cannot write.
//!
//! Statements which run often say `limit 0 + ?`: SQLite looks at the value of a plain `limit ?`
//! while it plans, and so prepares the statement again each time another value is bound.

mod add;
mod advance;
mod blame;
mod body;
mod checkpoint;
mod claim;
mod complete;
mod control;
mod count;
mod decide;
mod evidence;
mod exchange;
mod fail;
mod names;
mod pace;
mod read_dataset;
mod read_explain;
mod read_jobs;
mod read_overview;
mod read_studies;
mod read_sums;
mod read_workers;
mod recover;
mod search;
mod shares;
mod specs;
mod stock;
mod submit;
mod sweep;
mod tokens;
mod upkeep;
mod workers;
mod writer;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use sqlx::migrate::{MigrateError, Migrator};
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous,
};
use sqlx::{ConnectOptions, Connection};

use crate::clock::Clock;
use crate::config::Config;
use crate::event::Event;
use crate::metrics::Metrics;

pub(crate) use add::AddOptimisation;
pub(crate) use body::{pack, unpack};
pub(crate) use checkpoint::PreparedRenewal;
pub(crate) use claim::Leased;
pub(crate) use complete::{Outcome, Prepared};
pub(crate) use control::{Action, Control};
pub(crate) use count::open_jobs;
pub(crate) use exchange::{Exchange, Exchanged};
pub(crate) use names::{Condition, kind_of, role_name, state_name};
pub(crate) use pace::Pace;
pub(crate) use read_explain::Circumstances;
pub(crate) use read_jobs::JobFilter;
pub(crate) use read_studies::StudyHead;
pub(crate) use read_sums::{Depth, WorkerSums};
pub(crate) use read_workers::WorkerFilter;
pub(crate) use recover::Recover;
pub(crate) use search::{STROKES, optimisation_of_stroke, round_of};
pub(crate) use submit::{Submit, Submitted};
pub(crate) use sweep::Sweep;
pub(crate) use tokens::{TokenRow, insert_token, list_tokens, revoke_token};
pub(crate) use upkeep::{Prune, check, copy_to, delete_study, find_ended_before, list_digests};
use upkeep::{delete_workers, list_forgotten};
pub(crate) use workers::{Deregister, Drain, Register};
pub(crate) use writer::{Operation, Work};

static MIGRATIONS: Migrator = sqlx::migrate!("../migrations/sqlite");

/// How long SQLite waits for another process which has the file.
const BUSY: Duration = Duration::from_secs(5);

/// Connections of [`Store::quick`].
const QUICK_READERS: u32 = 2;

/// Why the store did not do something.
#[derive(Debug, thiserror::Error)]
pub(crate) enum StoreError {
    #[error("no study {0}")]
    UnknownStudy(StudyId),
    #[error("no worker {0}")]
    UnknownWorker(WorkerId),
    #[error("no job {0}")]
    UnknownJob(JobId),
    #[error("{0}")]
    WrongState(String),
    #[error("{0}")]
    AnotherToken(String),
    #[error("Idempotency-Key reused")]
    IdempotencyKeyReused,
    #[error("the store holds what it should not: {0}")]
    Corrupt(String),
    #[error("an operation panicked")]
    Panicked,
    #[error("the store is closed")]
    Closed,
    #[error("the batch was not committed")]
    Commit(#[source] Arc<sqlx::Error>),
    #[error("the database failed")]
    Sql(#[from] sqlx::Error),
}

/// What is done with the decisions of committed operations.
pub(crate) type Observer = Arc<dyn Fn(&[Event]) + Send + Sync>;

/// The open store. Clones share it.
#[derive(Clone)]
pub(crate) struct Store {
    writer: writer::Writer,
    readers: SqlitePool,
    /// For what every request needs, and renewals above all: nothing which takes long is read here.
    quick: SqlitePool,
    options: SqliteConnectOptions,
}

impl Store {
    /// Opens the file, brings its tables up to date and starts the writer.
    pub(crate) async fn open(
        config: Arc<Config>,
        clock: Arc<dyn Clock>,
        observer: Observer,
        metrics: Arc<Metrics>,
    ) -> Result<Self, OpenError> {
        make_folder(&config.database).await?;
        let options = options(&config.database);
        migrate(&options).await?;
        // Room for the inner pages of the indexes of some million jobs, 16 MiB, and no more: when a
        // commit has split a page, SQLite walks through all of its cache. With 64 MiB and a million
        // jobs stored, that took a tenth of the writer's time.
        let writing = options.clone().pragma("cache_size", "-16384");
        let connection = writing.connect().await?;
        let reading = options.clone().pragma("query_only", "on");
        let pool = |connections| SqlitePoolOptions::new().max_connections(connections).connect_with(reading.clone());
        let (readers, quick) = (pool(config.readers).await?, pool(QUICK_READERS).await?);
        let writer = writer::Writer::start(connection, writing, config, clock, observer, metrics);
        Ok(Self { writer, readers, quick, options })
    }

    /// Queues an operation and waits for the commit which contains it.
    pub(crate) async fn run<O: Operation>(&self, operation: O) -> Result<O::Output, StoreError> {
        self.writer.run(operation).await
    }

    /// Takes what a worker brings and gives it what it wants, with whatever other exchanges wait.
    pub(crate) async fn exchange(&self, exchange: Exchange) -> Result<Exchanged, StoreError> {
        self.writer.exchange(exchange).await
    }

    /// Whether the last commit failed: until one succeeds, nothing new is taken.
    pub(crate) fn is_failing(&self) -> bool {
        self.writer.is_failing()
    }

    /// The pool which cannot write.
    pub(crate) fn readers(&self) -> &SqlitePool {
        &self.readers
    }

    /// The pool of its own for tokens, exchanges and health, which no long read delays.
    pub(crate) fn quick(&self) -> &SqlitePool {
        &self.quick
    }

    /// Removes workers which went long ago and which nothing names; returns how many. They are looked
    /// for beside the writer, since that reads all jobs.
    pub(crate) async fn forget_workers(&self, now: i64) -> Result<usize, StoreError> {
        let mut reader = self.readers.acquire().await?;
        let gone = list_forgotten(&mut reader, now).await?;
        drop(reader);
        if !gone.is_empty() {
            let mut connection = self.options.clone().foreign_keys(false).connect().await?;
            delete_workers(&mut connection, &gone, now).await?;
            connection.close().await?;
        }
        Ok(gone.len())
    }

    /// Whether the database answers.
    pub(crate) async fn ping(&self) -> Result<(), StoreError> {
        sqlx::query_scalar::<_, i64>("select 1").fetch_one(&self.quick).await?;
        Ok(())
    }

    /// Commits what is queued, then closes the file.
    pub(crate) async fn close(&self) {
        self.writer.close().await;
        self.readers.close().await;
        self.quick.close().await;
    }
}

async fn make_folder(database: &Path) -> Result<(), OpenError> {
    if let Some(folder) = database.parent().filter(|f| !f.as_os_str().is_empty()) {
        tokio::fs::create_dir_all(folder).await?;
    }
    Ok(())
}

/// How a database is opened, by whomever.
fn options(database: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(database)
        .create_if_missing(true)
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        .foreign_keys(true)
        .busy_timeout(BUSY)
        // Decisions are logged by what they mean, not as statements.
        .disable_statement_logging()
}

/// A database opened beside the coordinator, for short work.
pub(crate) struct File {
    connection: SqliteConnection,
}

impl File {
    /// Opens a database and brings its tables up to date.
    pub(crate) async fn open(database: &Path) -> Result<Self, OpenError> {
        make_folder(database).await?;
        let options = options(database);
        migrate(&options).await?;
        Ok(Self { connection: options.connect().await? })
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

/// Brings the tables up to date. A migration which copies a table needs foreign
/// keys off; whether all still lead somewhere is checked afterwards.
async fn migrate(options: &SqliteConnectOptions) -> Result<(), OpenError> {
    let mut connection = options.clone().foreign_keys(false).connect().await?;
    // Not `run`, whose future the compiler cannot prove to be free to move between threads.
    MIGRATIONS.run_direct(None, &mut connection, false).await?;
    let loose = sqlx::query("pragma foreign_key_check").fetch_all(&mut connection).await?;
    connection.close().await?;
    if loose.is_empty() { Ok(()) } else { Err(OpenError::Loose(loose.len())) }
}

/// Why the store could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The folder could not be made.
    #[error("the folder of the database could not be made")]
    Folder(#[from] std::io::Error),
    /// SQLite refused.
    #[error("the database could not be opened")]
    Database(#[from] sqlx::Error),
    /// The tables could not be brought up to date.
    #[error("the tables of the database could not be brought up to date")]
    Migration(#[from] MigrateError),
    /// Rows refer to others which are not there.
    #[error("the database is damaged: {0} rows refer to others which are not there")]
    Loose(usize),
}
