//! The one writer. Every change is an operation in a queue; whatever has queued
//! up while the last batch was being committed is committed together, so the
//! cost of one `fsync` is shared by all who wait. Handlers only wait for the
//! reply: one that goes away takes nothing back.

use std::collections::VecDeque;
use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::time::{Duration, Instant};

use futures_util::FutureExt;
use futures_util::future::BoxFuture;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions, Connection};
use tokio::sync::{mpsc, oneshot};

use super::exchange::exchange_all;
use super::health::Health;
use super::shares::Rota;
use super::specs::Specs;
use super::thread::spawn_apart;
use super::{Exchange, Exchanged, Observer, StoreError, Trouble};
use crate::clock::Clock;
use crate::config::Config;
use crate::event::Event;
use crate::metrics::Metrics;

/// Most operations in one commit.
const MOST_PER_COMMIT: usize = 256;
/// Most jobs the exchanges of one commit touch, but for a single larger one.
const MOST_JOBS: usize = 4000;
/// Operations which may queue before callers wait for a place.
const QUEUE: usize = 4096;

/// Between two words about the same trouble.
const BETWEEN_WORDS: Duration = Duration::from_secs(60);

/// What an operation works with. It asks nothing else of the world.
pub(crate) struct Work<'c> {
    /// Inside the operation's savepoint.
    pub(crate) db: &'c mut SqliteConnection,
    /// The time of this batch.
    pub(crate) now: i64,
    /// The coordinator's numbers.
    pub(crate) config: &'c Config,
    /// What was decided, told after the commit.
    pub(crate) events: &'c mut Vec<Event>,
    /// Specifications read before.
    pub(crate) specs: &'c mut Specs,
    /// Whose turn it is to be given jobs.
    pub(crate) rota: &'c mut Rota,
}

/// One change of the store: all of it happens, or nothing.
pub(crate) trait Operation: Send + 'static {
    /// What the caller learns.
    type Output: Send + 'static;

    /// Does it.
    fn apply(self, work: &mut Work<'_>) -> impl Future<Output = Result<Self::Output, StoreError>> + Send;
}

/// An operation whose type is forgotten, with the way back to its caller.
trait Queued: Send {
    /// Runs it; false when it must be rolled back.
    fn apply<'a>(&'a mut self, work: &'a mut Work<'_>) -> BoxFuture<'a, bool>;
    /// Tells the caller, once the fate of the batch is known.
    fn reply(self: Box<Self>, committed: &Result<(), Arc<sqlx::Error>>);
}

struct Call<O: Operation> {
    operation: Option<O>,
    outcome: Option<Result<O::Output, StoreError>>,
    reply: oneshot::Sender<Result<O::Output, StoreError>>,
}

impl<O: Operation> Queued for Call<O> {
    fn apply<'a>(&'a mut self, work: &'a mut Work<'_>) -> BoxFuture<'a, bool> {
        Box::pin(async move {
            let Some(operation) = self.operation.take() else { return false };
            // A panic costs the one operation, not the writer and with it the coordinator.
            let outcome = AssertUnwindSafe(operation.apply(work)).catch_unwind().await;
            let outcome = outcome.unwrap_or(Err(StoreError::Panicked));
            let done = outcome.is_ok();
            self.outcome = Some(outcome);
            done
        })
    }

    fn reply(self: Box<Self>, committed: &Result<(), Arc<sqlx::Error>>) {
        let outcome = match (committed, self.outcome) {
            (Ok(()), Some(outcome)) => outcome,
            // A refusal changed nothing: it stands whatever became of the batch.
            (Err(_), Some(Err(refusal))) => Err(refusal),
            (Err(cause), _) => Err(StoreError::Commit(cause.clone())),
            (Ok(()), None) => Err(StoreError::Closed),
        };
        // The caller may have gone; what is committed stays.
        let _ = self.reply.send(outcome);
    }
}

/// An exchange with the way back to its caller.
struct Asked {
    exchange: Exchange,
    reply: oneshot::Sender<Result<Exchanged, StoreError>>,
}

enum Message {
    Exchange(Asked),
    Apply(Box<dyn Queued>),
    Close(oneshot::Sender<()>),
}

/// The way to the writer.
#[derive(Clone)]
pub(super) struct Writer {
    queue: mpsc::Sender<Message>,
}

impl Writer {
    /// Starts the writer's task on its connection.
    pub(super) fn start(
        connection: SqliteConnection,
        options: SqliteConnectOptions,
        config: Arc<Config>,
        clock: Arc<dyn Clock>,
        observer: Observer,
        metrics: Arc<Metrics>,
        health: Arc<Health>,
    ) -> Self {
        let (queue, messages) = mpsc::channel(QUEUE);
        // Dropped with the task, by a panic too: without a writer the coordinator is of no use.
        let ends = health.ended.clone().drop_guard();
        let task = Task {
            connection: Some(connection),
            options,
            config,
            clock,
            observer,
            specs: Specs::default(),
            rota: Rota::default(),
            metrics,
            health,
            told: None,
            is_noted: false,
        };
        spawn_apart(async move {
            let _ends = ends;
            task.serve(messages).await;
        });
        Self { queue }
    }

    /// Queues an operation and waits until it is committed or refused.
    pub(super) async fn run<O: Operation>(&self, operation: O) -> Result<O::Output, StoreError> {
        let (reply, answer) = oneshot::channel();
        let call = Call { operation: Some(operation), outcome: None, reply };
        self.queue.send(Message::Apply(Box::new(call))).await.map_err(|_| StoreError::Closed)?;
        answer.await.map_err(|_| StoreError::Closed)?
    }

    /// Queues an exchange and waits until it is committed or refused.
    pub(super) async fn exchange(&self, exchange: Exchange) -> Result<Exchanged, StoreError> {
        let (reply, answer) = oneshot::channel();
        self.queue.send(Message::Exchange(Asked { exchange, reply })).await.map_err(|_| StoreError::Closed)?;
        answer.await.map_err(|_| StoreError::Closed)?
    }

    /// Has everything queued so far committed and the connection closed.
    pub(super) async fn close(&self) {
        let (done, closed) = oneshot::channel();
        if self.queue.send(Message::Close(done)).await.is_ok() {
            let _ = closed.await;
        }
    }
}

struct Task {
    /// None after a failed commit, which leaves it in a state nobody knows: the next one opens another.
    connection: Option<SqliteConnection>,
    options: SqliteConnectOptions,
    config: Arc<Config>,
    clock: Arc<dyn Clock>,
    observer: Observer,
    specs: Specs,
    rota: Rota,
    metrics: Arc<Metrics>,
    health: Arc<Health>,
    /// When a refusal was last told: one that lasts is told now and then.
    told: Option<Instant>,
    /// Whether the files beside the database are known.
    is_noted: bool,
}

/// What is committed together.
#[derive(Default)]
struct Batch {
    exchanges: Vec<Exchange>,
    askers: Vec<oneshot::Sender<Result<Exchanged, StoreError>>>,
    calls: Vec<Box<dyn Queued>>,
    closing: Option<oneshot::Sender<()>>,
}

impl Batch {
    /// Takes messages from the front, as many as make a commit.
    fn fill(waiting: &mut VecDeque<Message>) -> Self {
        let (mut batch, mut weight) = (Self::default(), 0);
        while let Some(message) = waiting.pop_front() {
            match message {
                Message::Exchange(asked) => {
                    weight += asked.exchange.weight();
                    if weight > MOST_JOBS && !batch.exchanges.is_empty() {
                        waiting.push_front(Message::Exchange(asked));
                        break;
                    }
                    batch.exchanges.push(asked.exchange);
                    batch.askers.push(asked.reply);
                }
                Message::Apply(call) => batch.calls.push(call),
                // What came after the farewell is dropped, and its caller told the store is closed.
                Message::Close(done) => {
                    batch.closing = Some(done);
                    waiting.clear();
                }
            }
        }
        batch
    }
}

impl Task {
    async fn serve(mut self, mut messages: mpsc::Receiver<Message>) {
        let (mut received, mut waiting) = (Vec::with_capacity(MOST_PER_COMMIT), VecDeque::new());
        while !waiting.is_empty() || messages.recv_many(&mut received, MOST_PER_COMMIT).await > 0 {
            waiting.extend(received.drain(..));
            let mut batch = Batch::fill(&mut waiting);
            let closing = batch.closing.take();
            self.commit_and_reply(batch).await;
            if let Some(done) = closing {
                messages.close();
                if let Some(connection) = self.connection.take()
                    && let Err(error) = connection.close().await
                {
                    tracing::warn!(error.cause = %error, "The database was not closed cleanly; it recovers at the next start");
                }
                let _ = done.send(());
                return;
            }
        }
    }

    async fn commit_and_reply(&mut self, mut batch: Batch) {
        if batch.exchanges.is_empty() && batch.calls.is_empty() {
            return;
        }
        let mut events = Vec::new();
        let (began, operations) = (Instant::now(), batch.calls.len() + batch.exchanges.len());
        let committed = self.commit(&mut batch, &mut events).await.map_err(Arc::new);
        self.metrics.committed(began.elapsed(), operations, committed.is_ok());
        match &committed {
            Ok(told) => {
                if self.health.recover() {
                    tracing::info!("The database takes writes again");
                }
                self.health.note_exchanges(told);
                // A fault of those who listen is not the writer's, on which everything depends.
                let told = std::panic::catch_unwind(AssertUnwindSafe(|| (self.observer)(&events)));
                if told.is_err() {
                    tracing::error!("Decisions could not be told; they are stored");
                }
            }
            Err(error) => self.refuse(error, operations).await,
        }
        let (told, committed) = match committed {
            Ok(told) => (told, Ok(())),
            Err(cause) => (batch.askers.iter().map(|_| Err(StoreError::Commit(cause.clone()))).collect(), Err(cause)),
        };
        for (asker, told) in batch.askers.into_iter().zip(told) {
            // The caller may have gone; what is committed stays.
            let _ = asker.send(told);
        }
        for call in batch.calls {
            call.reply(&committed);
        }
    }

    /// A batch was not committed.
    async fn refuse(&mut self, error: &Arc<sqlx::Error>, operations: usize) {
        self.specs.clear();
        let trouble = Trouble::of(error);
        let is_gone = trouble == Some(Trouble::Gone);
        // With the file gone, a further connection would be one to another file; this one is as it was.
        if !is_gone && let Some(connection) = self.connection.take() {
            self.health.place.forget();
            // Whatever it still had to say was about the batch, whose fate is known.
            let _ = connection.close_hard().await;
        }
        let cause = trouble.map_or_else(|| crate::error::chain(error.as_ref()), |t| t.what().to_owned());
        let is_news = self.health.fail(cause);
        if !is_news && self.told.is_some_and(|told| told.elapsed() < BETWEEN_WORDS) {
            return;
        }
        self.told = Some(Instant::now());
        let cause = crate::error::chain(error.as_ref());
        let advice = trouble.map_or("", Trouble::advice);
        if is_gone {
            let database = self.config.database.display();
            tracing::error!(server.database = %database, advice, "The database was removed, replaced or cut short while in use. No change is taken");
        } else {
            tracing::error!(error.cause = %cause, batch.operations = operations, advice, "A batch of operations was not committed");
        }
    }

    /// Does everything of a batch; gives what the exchanges are told.
    async fn commit(
        &mut self,
        batch: &mut Batch,
        events: &mut Vec<Event>,
    ) -> Result<Vec<Result<Exchanged, StoreError>>, sqlx::Error> {
        let now = self.clock.now_ms();
        self.health.place.check()?;
        let is_new = self.connection.is_none();
        let connection = match &mut self.connection {
            Some(connection) => connection,
            none => none.insert(self.options.connect().await?),
        };
        let mut transaction = connection.begin_with("begin immediate").await?;
        if is_new || !self.is_noted {
            self.health.place.note();
            self.is_noted = true;
        }
        if self.health.is_failing() {
            // A commit which changes nothing would prove nothing.
            beat(&mut transaction, now).await?;
        }
        let (specs, rota) = (&mut self.specs, &mut self.rota);
        let mut scope = Scope { now, config: &self.config, specs, rota, events };
        let told = scope.exchange(&mut transaction, &batch.exchanges).await?;
        for call in &mut batch.calls {
            scope.apply(&mut transaction, call).await?;
        }
        transaction.commit().await?;
        // What is in a file without a name is lost with this process: it is not acknowledged.
        self.health.place.check()?;
        Ok(told)
    }
}

async fn beat(db: &mut SqliteConnection, now: i64) -> Result<(), sqlx::Error> {
    sqlx::query(
        "insert into heartbeat (one, beat_ms) values (1, ?1) on conflict (one) do update set beat_ms = max(?1, beat_ms + 1)",
    )
    .bind(now)
    .execute(db)
    .await?;
    Ok(())
}

/// What a batch's savepoints share.
struct Scope<'s> {
    now: i64,
    config: &'s Config,
    specs: &'s mut Specs,
    rota: &'s mut Rota,
    events: &'s mut Vec<Event>,
}

impl Scope<'_> {
    async fn apply(&mut self, db: &mut SqliteConnection, call: &mut Box<dyn Queued>) -> Result<(), sqlx::Error> {
        let mut savepoint = Connection::begin(db).await?;
        let told = self.events.len();
        let mut work = self.work(&mut savepoint);
        if call.apply(&mut work).await {
            savepoint.commit().await
        } else {
            self.forget(told);
            savepoint.rollback().await
        }
    }

    /// All exchanges together; should that fail, one by one, so that only the culprit does.
    async fn exchange(
        &mut self,
        db: &mut SqliteConnection,
        exchanges: &[Exchange],
    ) -> Result<Vec<Result<Exchanged, StoreError>>, sqlx::Error> {
        if exchanges.is_empty() {
            return Ok(Vec::new());
        }
        let error = match self.exchange_together(db, exchanges).await? {
            Ok(told) => return Ok(told),
            Err(error) if exchanges.len() == 1 => return Ok(vec![Err(error)]),
            Err(error) => error,
        };
        tracing::warn!(error.cause = %crate::error::chain(&error), exchanges.count = exchanges.len(), "Exchanges could not be taken together and are taken one by one");
        let mut all = Vec::with_capacity(exchanges.len());
        for exchange in exchanges {
            match self.exchange_together(db, std::slice::from_ref(exchange)).await? {
                Ok(told) => all.extend(told),
                Err(error) => all.push(Err(error)),
            }
        }
        Ok(all)
    }

    async fn exchange_together(
        &mut self,
        db: &mut SqliteConnection,
        exchanges: &[Exchange],
    ) -> Result<Result<Vec<Result<Exchanged, StoreError>>, StoreError>, sqlx::Error> {
        let mut savepoint = Connection::begin(db).await?;
        let before = self.events.len();
        let mut work = self.work(&mut savepoint);
        let told = AssertUnwindSafe(exchange_all(&mut work, exchanges)).catch_unwind().await;
        let told = told.unwrap_or(Err(StoreError::Panicked));
        if told.is_ok() {
            savepoint.commit().await?;
        } else {
            self.forget(before);
            savepoint.rollback().await?;
        }
        Ok(told)
    }

    fn work<'w>(&'w mut self, db: &'w mut SqliteConnection) -> Work<'w> {
        Work {
            db,
            now: self.now,
            config: self.config,
            events: &mut *self.events,
            specs: &mut *self.specs,
            rota: &mut *self.rota,
        }
    }

    /// Takes back what a failed operation has told and read.
    fn forget(&mut self, told: usize) {
        self.events.truncate(told);
        self.specs.clear();
    }
}
