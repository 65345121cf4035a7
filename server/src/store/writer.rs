//! The one writer. Every change is an operation in a queue; whatever has queued
//! up while the last batch was being committed is committed together, so the
//! cost of one `fsync` is shared by all who wait. Handlers only wait for the
//! reply: one that goes away takes nothing back.

use std::panic::AssertUnwindSafe;
use std::sync::Arc;

use futures_util::FutureExt;
use futures_util::future::BoxFuture;
use sqlx::sqlite::SqliteConnection;
use sqlx::{Acquire, Connection};
use tokio::sync::{mpsc, oneshot};

use super::{Observer, StoreError};
use crate::clock::Clock;
use crate::config::Config;
use crate::event::Event;

/// Most operations in one commit.
const MOST_PER_COMMIT: usize = 256;
/// Operations which may queue before callers wait for a place.
const QUEUE: usize = 4096;

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

enum Message {
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
        config: Arc<Config>,
        clock: Arc<dyn Clock>,
        observer: Observer,
    ) -> Self {
        let (queue, messages) = mpsc::channel(QUEUE);
        tokio::spawn(Task { connection, config, clock, observer }.serve(messages));
        Self { queue }
    }

    /// Queues an operation and waits until it is committed or refused.
    pub(super) async fn run<O: Operation>(&self, operation: O) -> Result<O::Output, StoreError> {
        let (reply, answer) = oneshot::channel();
        let call = Call { operation: Some(operation), outcome: None, reply };
        self.queue.send(Message::Apply(Box::new(call))).await.map_err(|_| StoreError::Closed)?;
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
    connection: SqliteConnection,
    config: Arc<Config>,
    clock: Arc<dyn Clock>,
    observer: Observer,
}

impl Task {
    async fn serve(mut self, mut messages: mpsc::Receiver<Message>) {
        let mut received = Vec::with_capacity(MOST_PER_COMMIT);
        while messages.recv_many(&mut received, MOST_PER_COMMIT).await > 0 {
            let mut batch = Vec::with_capacity(received.len());
            let mut closing = None;
            for message in received.drain(..) {
                match message {
                    // What came after the farewell is dropped, and its caller told the store is closed.
                    Message::Apply(call) if closing.is_none() => batch.push(call),
                    Message::Apply(_) => {}
                    Message::Close(done) => closing = Some(done),
                }
            }
            self.commit_and_reply(batch).await;
            if let Some(done) = closing {
                messages.close();
                if let Err(error) = self.connection.close().await {
                    tracing::warn!(error.cause = %error, "The database was not closed cleanly; it recovers at the next start");
                }
                let _ = done.send(());
                return;
            }
        }
    }

    async fn commit_and_reply(&mut self, mut batch: Vec<Box<dyn Queued>>) {
        if batch.is_empty() {
            return;
        }
        let mut events = Vec::new();
        let committed = self.commit(&mut batch, &mut events).await.map_err(Arc::new);
        match &committed {
            Ok(()) => (self.observer)(&events),
            Err(error) => {
                tracing::error!(error.cause = %error, batch.operations = batch.len(), "A batch of operations was not committed");
            }
        }
        for call in batch {
            call.reply(&committed);
        }
    }

    async fn commit(&mut self, batch: &mut [Box<dyn Queued>], events: &mut Vec<Event>) -> Result<(), sqlx::Error> {
        let now = self.clock.now_ms();
        let mut transaction = self.connection.begin_with("begin immediate").await?;
        for call in batch {
            let mut savepoint = transaction.begin().await?;
            let told = events.len();
            let mut work = Work { db: &mut savepoint, now, config: &self.config, events };
            if call.apply(&mut work).await {
                savepoint.commit().await?;
            } else {
                events.truncate(told);
                savepoint.rollback().await?;
            }
        }
        transaction.commit().await
    }
}
