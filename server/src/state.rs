//! The open coordinator: what every handler shares.

use std::sync::Arc;
use std::time::{Duration, Instant};

use manduca_protocol::ids::WorkerId;
use manduca_protocol::view::JobRole;
use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;

use crate::auth::{Refusals, Tokens};
use crate::changes::Changes;
use crate::clock::{Clock, SystemClock};
use crate::config::Config;
use crate::event::Event;
use crate::heavy::Heavy;
use crate::large::Large;
use crate::memory::{Memory, Waits};
use crate::metrics::Metrics;
use crate::rate::Rates;
use crate::registrations::Registrations;
use crate::serve::ServerError;
use crate::store::{Pace, Prune, Recover, Store, StoreError, Sweep};
use crate::turn::Turns;

/// An open coordinator. Clones share it; [`AppState::close`] ends it.
#[derive(Clone)]
pub struct AppState {
    inner: Arc<Inner>,
}

struct Inner {
    config: Arc<Config>,
    clock: Arc<dyn Clock>,
    store: Store,
    rates: Arc<Rates>,
    ready: Arc<Notify>,
    changes: Arc<Changes>,
    stopping: CancellationToken,
    tokens: Tokens,
    refusals: Arc<Refusals>,
    registrations: Registrations,
    metrics: Arc<Metrics>,
    turns: Turns,
    memory: Memory,
    large: Large,
    heavy: Heavy,
}

/// Opens the store and starts what runs beside the requests: the writer and the
/// sweep of expired leases.
///
/// # Errors
/// When the database cannot be opened or brought up to date.
pub async fn open(config: Config) -> Result<AppState, ServerError> {
    open_with_clock(config, Arc::new(SystemClock::start())).await
}

/// [`open`] with a clock of one's own, for tests which move time.
///
/// # Errors
/// When the database cannot be opened or brought up to date.
pub async fn open_with_clock(config: Config, clock: Arc<dyn Clock>) -> Result<AppState, ServerError> {
    let config = Arc::new(config);
    let (rates, ready) = (Arc::new(Rates::default()), Arc::new(Notify::new()));
    let metrics = Arc::new(Metrics::default());
    let changes = Arc::new(Changes::new(config.watchers));
    let observer = {
        let (rates, ready, clock, metrics) = (rates.clone(), ready.clone(), clock.clone(), metrics.clone());
        let changes = changes.clone();
        Arc::new(move |events: &[Event]| {
            observe(events, &rates, &ready, &metrics, clock.now_ms());
            changes.observe(events);
        })
    };
    let store = Store::open(config.clone(), clock.clone(), observer, metrics.clone()).await?;
    store.run(Recover).await?;
    let stopping = CancellationToken::new();
    let refusals = Arc::new(Refusals::default());
    let pace = Pace::start(clock.now_ms());
    tokio::spawn(sweep(store.clone(), config.clone(), pace, refusals.clone(), stopping.clone()));
    tokio::spawn(forget(store.clone(), clock.clone(), stopping.clone()));
    let registrations = Registrations::new(config.registrations, config.registrations_per_s);
    Ok(AppState {
        inner: Arc::new(Inner {
            heavy: Heavy::new(processors(), config.readers),
            config,
            clock,
            store,
            rates,
            ready,
            changes,
            stopping,
            tokens: Tokens::default(),
            refusals,
            registrations,
            metrics,
            turns: Turns::default(),
            memory: Memory::new(processors(), Waits::default()),
            large: Large::default(),
        }),
    })
}

/// Processors there are.
fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// What follows a commit outside the store.
fn observe(events: &[Event], rates: &Rates, ready: &Notify, metrics: &Metrics, now_ms: i64) {
    for event in events {
        event.log();
        metrics.observe(event);
        match event {
            Event::Completed { study, role, .. } if *role != JobRole::Audit => rates.completed(*study, now_ms),
            Event::Moved { study, .. } => rates.forget(*study),
            Event::Ready => ready.notify_waiters(),
            _ => {}
        }
    }
}

/// How often studies whose time is over are looked for.
const PRUNE: Duration = Duration::from_secs(600);

/// Removes studies whose time is over, one commit each.
async fn prune(store: &Store) {
    loop {
        match store.run(Prune).await {
            Ok(true) => {}
            Ok(false) | Err(StoreError::Closed) => return,
            Err(error) => {
                tracing::error!(error.cause = %crate::error::chain(&error), "Old studies could not be removed");
                return;
            }
        }
    }
}

/// How often workers which are long gone are looked for.
const FORGET: Duration = Duration::from_secs(6 * 3600);

/// Removes workers which are long gone and which nothing names, until the coordinator stops.
async fn forget(store: Store, clock: Arc<dyn Clock>, stopping: CancellationToken) {
    loop {
        match store.forget_workers(clock.now_ms()).await {
            Ok(0) => {}
            Ok(workers) => tracing::info!(workers.count = workers, "Workers removed which went long ago"),
            Err(error) => {
                tracing::warn!(error.cause = %crate::error::chain(&error), "Workers which went long ago could not be removed");
            }
        }
        tokio::select! {
            () = stopping.cancelled() => return,
            () = tokio::time::sleep(FORGET) => {}
        }
    }
}

/// Looks for expired leases and ended waits until the coordinator stops.
async fn sweep(
    store: Store,
    config: Arc<Config>,
    mut pace: Pace,
    refusals: Arc<Refusals>,
    stopping: CancellationToken,
) {
    prune(&store).await;
    let mut pruned = Instant::now();
    loop {
        tokio::select! {
            () = stopping.cancelled() => return,
            () = tokio::time::sleep(config.sweep) => {}
        }
        refusals.tell_rest();
        if config.keep.is_some() && pruned.elapsed() >= PRUNE {
            pruned = Instant::now();
            prune(&store).await;
        }
        // A sweep which fails has not come by: whatever kept it away kept renewals away too.
        match store.run(Sweep { pace }).await {
            Ok(swept) => pace = swept,
            Err(StoreError::Closed) => return,
            Err(error) => {
                tracing::error!(error.cause = %crate::error::chain(&error), "Expired leases could not be looked for");
            }
        }
    }
}

impl AppState {
    /// The coordinator's numbers.
    pub fn config(&self) -> &Config {
        &self.inner.config
    }

    /// The coordinator's time.
    pub fn now_ms(&self) -> i64 {
        self.inner.clock.now_ms()
    }

    pub(crate) fn store(&self) -> &Store {
        &self.inner.store
    }

    pub(crate) fn rates(&self) -> &Rates {
        &self.inner.rates
    }

    /// The tokens of the database.
    pub(crate) fn tokens(&self) -> &Tokens {
        &self.inner.tokens
    }

    /// Requests refused for their token.
    pub(crate) fn refusals(&self) -> &Refusals {
        &self.inner.refusals
    }

    /// How often tokens register workers.
    pub(crate) fn registrations(&self) -> &Registrations {
        &self.inner.registrations
    }

    /// What is counted.
    pub(crate) fn metrics(&self) -> &Metrics {
        &self.inner.metrics
    }

    /// Strokes flown here.
    pub(crate) fn turns(&self) -> &Turns {
        &self.inner.turns
    }

    /// Memory for the bodies of requests.
    pub(crate) fn memory(&self) -> &Memory {
        &self.inner.memory
    }

    /// Turns at reads which take long.
    pub(crate) fn heavy(&self) -> &Heavy {
        &self.inner.heavy
    }

    /// Notes that a worker has a job whose result may be large.
    pub(crate) fn note_large(&self, worker: WorkerId) {
        self.inner.large.note(worker);
    }

    /// Whether a worker has a job whose result may be large, or had one a short while ago.
    ///
    /// # Errors
    /// When the store cannot tell.
    pub(crate) async fn may_send_large(&self, worker: WorkerId) -> Result<bool, StoreError> {
        if self.store().holds_large(worker).await? {
            self.note_large(worker);
            return Ok(true);
        }
        Ok(self.inner.large.had_lately(worker))
    }

    /// Told whenever jobs become ready.
    pub(crate) fn ready(&self) -> &Notify {
        &self.inner.ready
    }

    /// What changed lately.
    pub(crate) fn changes(&self) -> &Changes {
        &self.inner.changes
    }

    /// Cancelled when the coordinator stops.
    pub fn stopping(&self) -> &CancellationToken {
        &self.inner.stopping
    }

    /// Stops the sweep, has all queued operations committed and closes the database.
    pub async fn close(&self) {
        self.inner.stopping.cancel();
        self.inner.store.close().await;
    }
}
