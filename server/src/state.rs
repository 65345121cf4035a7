//! The open coordinator: what every handler shares.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use manduca_protocol::ids::WorkerId;
use manduca_protocol::view::JobRole;
use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;

use crate::auth::{Refusals, Tokens};
use crate::beside::{self, Beside};
use crate::changes::Changes;
use crate::clock::{Clock, SystemClock, rfc3339};
use crate::config::Config;
use crate::event::Event;
use crate::heavy::Heavy;
use crate::hold::{Hold, Holder};
use crate::large::Large;
use crate::memory::{Memory, Waits};
use crate::metrics::Metrics;
use crate::rate::Rates;
use crate::registrations::Registrations;
use crate::serve::ServerError;
use crate::store::{Pace, Prune, Pruned, Recover, Remember, Store, StoreError, Sweep};
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
    hold: Mutex<Option<Hold>>,
    /// Cancelled when the sweep has ended.
    swept: CancellationToken,
    beside: Arc<Beside>,
}

/// Opens the store of a database that is held and starts what runs beside the requests: the writer
/// and the sweep of expired leases.
///
/// # Errors
/// When the database cannot be opened or brought up to date.
pub async fn open(config: Config, hold: Hold) -> Result<AppState, ServerError> {
    let state = open_with_clock(config, Arc::new(SystemClock::start())).await?;
    *state.hold() = Some(hold);
    Ok(state)
}

/// [`open`] with a clock of one's own and without a hold, for tests which move time.
///
/// # Errors
/// When the database cannot be opened or brought up to date.
pub async fn open_with_clock(config: Config, clock: Arc<dyn Clock>) -> Result<AppState, ServerError> {
    let config = Arc::new(config);
    let (rates, ready) = (Arc::new(Rates::default()), Arc::new(Notify::new()));
    let metrics = Arc::new(Metrics::default());
    let changes = Arc::new(Changes::new(config.watchers));
    let beside = Arc::new(Beside::default());
    let observer = {
        let (rates, ready, clock, metrics) = (rates.clone(), ready.clone(), clock.clone(), metrics.clone());
        let (changes, beside) = (changes.clone(), beside.clone());
        Arc::new(move |events: &[Event]| {
            observe(events, &rates, &ready, &metrics, clock.now_ms());
            changes.observe(events);
            events.iter().for_each(|event| beside.observe(event));
        })
    };
    let store = Store::open(config.clone(), clock.clone(), observer, metrics.clone()).await?;
    store.run(Recover).await?;
    let (stopping, swept) = (CancellationToken::new(), CancellationToken::new());
    let refusals = Arc::new(Refusals::default());
    tokio::spawn(forget(store.clone(), clock.clone(), stopping.clone()));
    let registrations = Registrations::new(config.registrations, config.registrations_per_s);
    let ends = swept.clone().drop_guard();
    let (pace, began) = (Pace::start(clock.now_ms()), clock.now_ms());
    let sweeping = sweep(store.clone(), config.clone(), pace, refusals.clone(), began, stopping.clone());
    tokio::spawn(async move {
        let _ends = ends;
        sweeping.await;
    });
    beside::start(&store, &beside, &stopping);
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
            hold: Mutex::default(),
            swept,
            beside,
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
async fn prune(store: &Store, began: i64) {
    loop {
        match store.run(Prune { began }).await {
            Ok(Pruned::One) => {}
            Ok(Pruned::None) | Err(StoreError::Closed) => return,
            Ok(Pruned::Doubtful { last }) => {
                let last = rfc3339(last);
                tracing::error!(
                    last_seen = %last,
                    "No study is removed: the clock is more than a day after the last time at which this database was \
                     in use. If the clock is right, removal begins when the coordinator has run for a day"
                );
                return;
            }
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

/// What is done at the start and every [`PRUNE`].
async fn keep_house(store: &Store, config: &Config, began: i64) {
    if config.keep.is_some() {
        prune(store, began).await;
    }
    match store.run(Remember { began }).await {
        Ok(()) | Err(StoreError::Closed) => {}
        Err(error) => tracing::error!(error.cause = %crate::error::chain(&error), "The time could not be remembered"),
    }
}

/// Looks for expired leases and ended waits until the coordinator stops.
async fn sweep(
    store: Store,
    config: Arc<Config>,
    mut pace: Pace,
    refusals: Arc<Refusals>,
    began: i64,
    stopping: CancellationToken,
) {
    keep_house(&store, &config, began).await;
    let mut kept = Instant::now();
    loop {
        tokio::select! {
            () = stopping.cancelled() => return,
            () = tokio::time::sleep(config.sweep) => {}
        }
        refusals.tell_rest();
        if kept.elapsed() >= PRUNE {
            kept = Instant::now();
            keep_house(&store, &config, began).await;
        }
        // A sweep which fails has not come by: whatever kept it away kept renewals away too.
        match store.run(Sweep { pace }).await {
            Ok(swept) => pace = swept,
            // Of a batch which is not committed the writer tells.
            Err(StoreError::Commit(_)) => {}
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

    /// What is done beside the requests.
    pub(crate) fn beside(&self) -> &Beside {
        &self.inner.beside
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

    fn hold(&self) -> std::sync::MutexGuard<'_, Option<Hold>> {
        self.inner.hold.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes beside the database where this coordinator is reached, for others that would use the same one.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn announce(&self, holder: &Holder) -> std::io::Result<()> {
        self.hold().as_ref().map_or(Ok(()), |hold| hold.announce(holder))
    }

    /// For how long the database has taken no changes, and why.
    pub fn failing(&self) -> Option<(Duration, String)> {
        self.inner.store.failing()
    }

    /// Whether the database was removed or replaced while in use.
    pub fn is_gone(&self) -> bool {
        self.inner.store.is_gone()
    }

    /// Resolves when a part without which the coordinator is of no use has ended; says which.
    pub(crate) async fn broken(&self) -> &'static str {
        tokio::select! {
            () = self.inner.store.ended() => "the writer of the database",
            () = self.inner.swept.cancelled() => "the search for expired leases",
        }
    }

    /// Stops the sweep, has all queued operations committed, closes the database and lets others have it.
    pub async fn close(&self) {
        self.inner.stopping.cancel();
        self.inner.store.close().await;
        *self.hold() = None;
    }
}
