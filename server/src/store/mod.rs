//! The store: all SQL there is, in one place. Changes are operations queued to
//! the one writer ([`writer`]); reads go to a pool which cannot write.
//!
//! Statements which run often say `limit 0 + ?`: SQLite looks at the value of a plain `limit ?`
//! while it plans, and so prepares the statement again each time another value is bound.

mod add;
mod advance;
mod audits;
mod blame;
mod body;
mod checkpoint;
mod claim;
mod complete;
mod control;
mod count;
mod decide;
mod disown;
mod dispute;
mod evidence;
mod exchange;
mod fail;
mod file;
mod health;
pub(crate) mod inspect;
mod last_use;
mod limits;
mod names;
mod open;
mod pace;
mod place;
mod read_dataset;
mod read_explain;
mod read_jobs;
mod read_overview;
mod read_studies;
mod read_sums;
mod read_trust;
mod read_workers;
mod recover;
mod search;
mod shares;
mod specs;
mod stock;
mod submit;
mod sweep;
mod thread;
mod tokens;
mod trouble;
mod unchecked;
mod unreadable;
mod upkeep;
mod workers;
mod writer;

use std::sync::Arc;
use std::time::Duration;

use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use sqlx::sqlite::{SqliteConnectOptions, SqlitePool, SqlitePoolOptions};
use sqlx::{ConnectOptions, Connection};

use crate::clock::Clock;
use crate::config::Config;
use crate::event::Event;
use crate::metrics::Metrics;

pub(crate) use add::AddOptimisation;
pub(crate) use body::{Packed, pack, pack_large, parse as parse_body, unpack};
pub(crate) use checkpoint::PreparedRenewal;
pub(crate) use claim::Leased;
pub(crate) use complete::{Outcome, Prepared};
pub(crate) use control::{Action, Control};
pub(crate) use count::open_jobs;
pub(crate) use disown::{Disown, Readmit, disown_in};
pub(crate) use dispute::{BeginDispute, Dispute, Settle, Truth};
pub(crate) use exchange::{Exchange, Exchanged};
pub(crate) use file::{File, beside};
pub(crate) use last_use::{Remember, find_last_use, is_ahead};
pub(crate) use names::{Condition, Stage, kind_of, named, role_name, state_name};
pub use open::OpenError;
pub(crate) use open::{make_folder, private};
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
pub(crate) use trouble::Trouble;
pub(crate) use unchecked::{Checked, Unchecked};
pub(crate) use upkeep::{
    Prune, Pruned, check_file, copy_to, delete_study, find_ended_before, list_breaches, list_ended_before,
};
use upkeep::{delete_workers, list_forgotten};
pub(crate) use workers::{Deregister, Drain, Register};
pub(crate) use writer::{Operation, Work};

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
    #[error("study number {0} cannot be read: {1}")]
    Unreadable(i64, String),
    #[error("an operation panicked")]
    Panicked,
    #[error("the store is closed")]
    Closed,
    #[error("the batch was not committed")]
    Commit(#[source] Arc<sqlx::Error>),
    #[error("the database takes no changes: {0}")]
    Failing(String),
    #[error("the database failed")]
    Sql(#[source] sqlx::Error),
}

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        match error {
            // The value is not what its column is for: the row is at fault, not the database.
            sqlx::Error::ColumnDecode { .. } | sqlx::Error::Decode(_) => Self::Corrupt(error.to_string()),
            sqlx::Error::Database(cause) if cause.message().contains("malformed JSON") => {
                Self::Corrupt(cause.message().to_owned())
            }
            error => Self::Sql(error),
        }
    }
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
    health: Arc<health::Health>,
}

impl Store {
    /// Opens the file, brings its tables up to date and starts the writer.
    pub(crate) async fn open(
        config: Arc<Config>,
        clock: Arc<dyn Clock>,
        observer: Observer,
        metrics: Arc<Metrics>,
    ) -> Result<Self, OpenError> {
        let options = open::prepare(&config.database).await?;
        let place = place::Place::of(&config.database);
        let refused = |cause| OpenError::Database { path: config.database.clone(), cause };
        // Room for the inner pages of the indexes of some million jobs, 16 MiB, and no more: when a
        // commit has split a page, SQLite walks through all of its cache. With 64 MiB and a million
        // jobs stored, that took a tenth of the writer's time.
        let writing = options.clone().pragma("cache_size", "-16384");
        let connection = writing.connect().await.map_err(refused)?;
        let reading = options.clone().pragma("query_only", "on");
        let pool = |connections| SqlitePoolOptions::new().max_connections(connections).connect_with(reading.clone());
        let readers = pool(config.readers).await.map_err(refused)?;
        let quick = pool(QUICK_READERS).await.map_err(refused)?;
        let health = Arc::new(health::Health::new(place));
        let writer =
            writer::Writer::start(connection, writing, config.clone(), clock, observer, metrics, health.clone());
        Ok(Self { writer, readers, quick, options, health })
    }

    /// Queues an operation and waits for the commit which contains it.
    pub(crate) async fn run<O: Operation>(&self, operation: O) -> Result<O::Output, StoreError> {
        self.writer.run(operation).await
    }

    /// Takes what a worker brings and gives it what it wants, with whatever other exchanges wait.
    pub(crate) async fn exchange(&self, exchange: Exchange) -> Result<Exchanged, StoreError> {
        self.writer.exchange(exchange).await
    }

    /// Looks whether changes are taken: the last one was, and the files are still there.
    ///
    /// # Errors
    /// When they are not.
    pub(crate) fn check(&self) -> Result<(), StoreError> {
        self.health.check()
    }

    /// For how long no change was taken, and why.
    pub(crate) fn failing(&self) -> Option<(Duration, String)> {
        self.health.failing()
    }

    /// Whether the files of the database are no longer there.
    pub(crate) fn is_gone(&self) -> bool {
        self.health.is_gone()
    }

    /// Resolves when the writer has ended, for whatever reason.
    pub(crate) async fn ended(&self) {
        self.health.ended.cancelled().await;
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
            self.health.place.check()?;
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
