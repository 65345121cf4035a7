//! The order of events, and the coordinator among them.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use tempfile::TempDir;
use tower::ServiceExt;

use super::network::arrivals;
use super::spec;
use super::witness::Witness;
use super::worker::{Message, Worker};
use crate::store::{Pace, Sweep};
use crate::tests::bench::called;
use crate::{AppState, Clock, Config, Offline, open_with_clock};

/// Time goes in steps, ms: what arrives within one arrives at once.
const STEP: i64 = 50;
/// Between two sweeps, ms: less often than in life, for each costs as much as an exchange.
const SWEEP: i64 = 1000;
/// Until when there are faults, ms.
const FAULTY: i64 = 60_000;
/// When an undone study is taken for stuck, ms.
const STUCK: i64 = 900_000;
const WORKERS: usize = 3;
/// The client which submits, beside the workers.
const CLIENT: usize = WORKERS;

struct SimulatedClock(AtomicI64);

impl Clock for SimulatedClock {
    fn now_ms(&self) -> i64 {
        self.0.load(Ordering::SeqCst)
    }
}

/// What a client sends.
struct Request {
    from: usize,
    life: u64,
    message: u64,
    content: Message,
}

/// Something on its way.
enum Parcel {
    Request(Request),
    Answer { to: usize, life: u64, message: u64, status: u16, body: Vec<u8> },
}

pub(super) struct World {
    rng: ChaCha8Rng,
    now: i64,
    /// Coordinator's time minus simulated time: its wall clock when it was started.
    offset: i64,
    clock: Arc<SimulatedClock>,
    coordinator: Option<(AppState, Router)>,
    pace: Pace,
    starts_at: i64,
    kills: Vec<i64>,
    folder: TempDir,
    incarnation: u32,
    workers: Vec<Worker>,
    parcels: BTreeMap<(i64, u64), Parcel>,
    sent: u64,
    witness: Witness,
}

/// A folder in memory where there is one: what is simulated is no disk.
fn folder() -> TempDir {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
    folder.expect("a folder")
}

/// The bytes of a database without a study.
pub(super) async fn empty_database() -> Vec<u8> {
    let folder = folder();
    let file = folder.path().join("manduca.db");
    Offline::make(&file).await.expect("opens").close().await;
    std::fs::read(&file).expect("is there")
}

impl World {
    pub(super) async fn new(seed: u64, template: &[u8]) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let folder = folder();
        std::fs::create_dir(folder.path().join("0")).expect("a folder");
        std::fs::write(folder.path().join("0/manduca.db"), template).expect("is written");
        let kills = (0..rng.random_range(0..4)).map(|_| rng.random_range(500..FAULTY)).collect();
        let mut world = Self {
            rng,
            now: 0,
            offset: 1_800_000_000_000,
            clock: Arc::new(SimulatedClock(AtomicI64::new(0))),
            coordinator: None,
            pace: Pace::start(0),
            starts_at: 0,
            kills,
            folder,
            incarnation: 0,
            workers: (0..WORKERS).map(|_| Worker::default()).collect(),
            parcels: BTreeMap::new(),
            sent: 0,
            witness: Witness::default(),
        };
        world.start().await.expect("a fresh coordinator starts");
        world
    }

    /// Runs to the end of the study and checks what is left.
    ///
    /// Gives what names the course of events: the same for each run of a seed.
    pub(super) async fn run(mut self, calm: &[u8]) -> Result<u64, String> {
        while !self.is_done().await {
            self.step().await?;
            if self.now > STUCK {
                return Err("the study does not come to its end".into());
            }
        }
        let outcome = self.judge(calm).await;
        if let Some((state, _)) = &self.coordinator {
            state.close().await;
        }
        outcome.map(|()| self.witness.course())
    }

    fn faulty(&self) -> bool {
        self.now < FAULTY
    }

    async fn step(&mut self) -> Result<(), String> {
        self.now += STEP;
        self.clock.0.store(self.now + self.offset, Ordering::SeqCst);
        self.disturb().await?;
        if self.now % SWEEP == 0
            && let Some((state, _)) = &self.coordinator
        {
            let swept = state.store().run(Sweep { pace: self.pace }).await;
            self.pace = swept.map_err(|e| format!("the sweep failed: {e}"))?;
        }
        for who in 0..=CLIENT {
            self.act(who);
        }
        let later = self.parcels.split_off(&(self.now + 1, 0));
        let due = std::mem::replace(&mut self.parcels, later);
        let mut requests = Vec::new();
        for parcel in due.into_values() {
            match parcel {
                Parcel::Request(request) => requests.push(request),
                Parcel::Answer { to, life, message, status, body } => self.deliver(to, life, message, status, &body),
            }
        }
        self.serve(requests).await
    }

    /// Kills and stops whom chance picks.
    async fn disturb(&mut self) -> Result<(), String> {
        if self.coordinator.is_none() && self.now >= self.starts_at {
            self.start().await?;
        }
        if let Some(i) = self.kills.iter().position(|at| *at <= self.now) {
            self.kills.swap_remove(i);
            self.kill().await;
        }
        if self.faulty() && self.rng.random_bool(0.002) {
            let worker = self.rng.random_range(0..WORKERS);
            if self.rng.random_bool(0.5) {
                self.workers[worker].kill();
            } else {
                self.workers[worker].stopped_until = self.now + self.rng.random_range(1000..40_000);
            }
        }
        Ok(())
    }

    /// The coordinator is gone; what is on its disk at this moment stays.
    async fn kill(&mut self) {
        let Some((state, _)) = self.coordinator.take() else { return };
        self.witness.killed(self.now);
        let (before, after) = (self.incarnation.to_string(), (self.incarnation + 1).to_string());
        self.incarnation += 1;
        let (before, after) = (self.folder.path().join(before), self.folder.path().join(after));
        std::fs::create_dir(&after).expect("a folder");
        for name in ["manduca.db", "manduca.db-wal"] {
            if before.join(name).exists() {
                std::fs::copy(before.join(name), after.join(name)).expect("is copied");
            }
        }
        state.close().await;
        self.starts_at = self.now + self.rng.random_range(100..5000);
        // The next one's wall clock may be anywhere.
        self.offset += self.rng.random_range(-600_000..600_000);
    }

    async fn start(&mut self) -> Result<(), String> {
        let file = self.folder.path().join(self.incarnation.to_string()).join("manduca.db");
        // Given up, a sample is replaced by another one: then the dataset would be another.
        let (sweep, check_wait) = (Duration::from_secs(3600), Duration::from_secs(600));
        let config = Config { sweep, check_wait, max_losses: 1000, ..Config::new(file) };
        self.clock.0.store(self.now + self.offset, Ordering::SeqCst);
        let state = open_with_clock(config, self.clock.clone()).await.map_err(|e| format!("it does not start: {e}"))?;
        self.witness.restarted(self.now);
        self.pace = Pace::start(self.clock.now_ms());
        let finished: Vec<i64> = sqlx::query_scalar("select job from jobs where state in ('succeeded', 'infeasible')")
            .fetch_all(state.store().readers())
            .await
            .map_err(|e| e.to_string())?;
        let lost: Vec<_> = self.witness.acknowledged.iter().filter(|job| !finished.contains(job)).collect();
        if !lost.is_empty() {
            return Err(format!("acknowledged results were lost: {lost:?}"));
        }
        let studies: i64 = sqlx::query_scalar("select count(*) from studies")
            .fetch_one(state.store().readers())
            .await
            .map_err(|e| e.to_string())?;
        if self.witness.submitted && studies != 1 {
            return Err(format!("there are {studies} studies after an acknowledged submission"));
        }
        self.coordinator = Some((state.clone(), called(&state)));
        Ok(())
    }

    fn act(&mut self, who: usize) {
        let faulty = self.faulty();
        let message = self.sent + 1;
        let content = if who == CLIENT {
            let again = self.now % 2000 == 0 && !self.witness.submitted;
            again.then(|| Message { path: "/v1/studies".into(), body: spec() })
        } else {
            self.workers[who].act(self.now, message, &mut self.rng, faulty)
        };
        let Some(content) = content else { return };
        self.sent += 1;
        let life = self.workers.get(who).map_or(0, |worker| worker.life);
        for delay in arrivals(&mut self.rng, faulty) {
            self.sent += 1;
            let parcel = Parcel::Request(Request { from: who, life, message, content: content.clone() });
            self.parcels.insert((self.now + delay, self.sent), parcel);
        }
    }

    fn deliver(&mut self, to: usize, life: u64, message: u64, status: u16, body: &[u8]) {
        if to == CLIENT {
            self.witness.submitted |= status == 201 || status == 200;
            return;
        }
        let worker = &mut self.workers[to];
        // A stopped one finds it when it goes on, if it still waits then.
        if worker.life == life {
            worker.hear(self.now, message, status, body, &mut self.rng);
        }
    }

    /// All requests which arrive at once; exchanges share a commit, but for those which carry
    /// something large: the coordinator prepares that on another thread, and nobody knows
    /// when it is done. They come last, one by one, so that a seed always does the same.
    async fn serve(&mut self, requests: Vec<Request>) -> Result<(), String> {
        let Some((_, router)) = self.coordinator.clone() else { return Ok(()) };
        let (exchanges, others): (Vec<_>, Vec<_>) = requests.into_iter().partition(|r| r.content.is_exchange());
        let (large, small): (Vec<_>, Vec<_>) = exchanges.into_iter().partition(|r| r.content.is_large());
        for request in others {
            let answer = ask(&router, &request.content).await;
            self.answer(&request, answer)?;
        }
        for group in std::iter::once(small).chain(large.into_iter().map(|one| vec![one])) {
            self.exchange(&router, group).await?;
        }
        Ok(())
    }

    /// Exchanges of one commit.
    async fn exchange(&mut self, router: &Router, group: Vec<Request>) -> Result<(), String> {
        let answers = futures_util::future::join_all(group.iter().map(|r| ask(router, &r.content))).await;
        let mut told = Vec::new();
        for (request, (status, body)) in group.iter().zip(&answers) {
            if *status == 200 {
                let answer = serde_json::from_slice(body).map_err(|e| e.to_string())?;
                self.witness.see(self.now, &request.content.path, &request.content.body, &answer);
                told.push((request.content.path.clone(), answer));
            }
        }
        for (path, answer) in &told {
            self.witness.see_leases(self.now, path, answer)?;
        }
        group.iter().zip(answers).try_for_each(|(request, answer)| self.answer(request, answer))
    }

    /// Sends an answer on its way.
    fn answer(&mut self, request: &Request, (status, body): (u16, Vec<u8>)) -> Result<(), String> {
        let Request { from: to, life, message, ref content } = *request;
        if status >= 500 || !matches!(status, 200 | 201 | 404) {
            return Err(format!("{} is answered {status}: {}", content.path, String::from_utf8_lossy(&body)));
        }
        for delay in arrivals(&mut self.rng, self.now < FAULTY) {
            self.sent += 1;
            let parcel = Parcel::Answer { to, life, message, status, body: body.clone() };
            self.parcels.insert((self.now + delay, self.sent), parcel);
        }
        Ok(())
    }

    async fn get(&self, path: &str) -> Option<(u16, Vec<u8>)> {
        let (_, router) = self.coordinator.as_ref()?;
        let request = http::Request::get(path).body(Body::empty()).expect("a request");
        Some(answer_of(router, request).await)
    }

    async fn is_done(&self) -> bool {
        // Looked at now and then: it costs as much as an exchange.
        if self.faulty() || self.now % 1000 != 0 {
            return false;
        }
        let Some((200, body)) = self.get("/v1/studies").await else { return false };
        let page: Value = serde_json::from_slice(&body).expect("a page");
        page["items"].as_array().is_some_and(|all| !all.is_empty() && all.iter().all(|s| s["state"] == "succeeded"))
    }

    async fn judge(&self, calm: &[u8]) -> Result<(), String> {
        let (_, body) = self.get("/v1/studies").await.ok_or("nobody is there")?;
        let page: Value = serde_json::from_slice(&body).map_err(|e| e.to_string())?;
        let items = page["items"].as_array().ok_or("no page")?;
        let [study] = items.as_slice() else { return Err(format!("one study became {}", items.len())) };
        let path = format!("/v1/studies/{}/dataset?format=csv", study["id"].as_str().unwrap_or_default());
        let (_, dataset) = self.get(&path).await.ok_or("nobody is there")?;
        if dataset != calm {
            return Err("the dataset is not that of an undisturbed run".into());
        }
        let file = self.folder.path().join(self.incarnation.to_string()).join("manduca.db");
        let mut database = Offline::open(&file).await.map_err(|e| e.to_string())?;
        let findings = database.check().await.map_err(|e| e.to_string())?;
        let open: i64 = sqlx::query_scalar(
            "select count(*) from jobs where state not in ('succeeded', 'infeasible', 'dead', 'cancelled')",
        )
        .fetch_one(database.file.db())
        .await
        .map_err(|e| e.to_string())?;
        database.close().await;
        match (findings.is_well(), open) {
            (true, 0) => Ok(()),
            (_, open) => Err(format!("{open} jobs are open after the end; {findings:?}")),
        }
    }
}

async fn ask(router: &Router, message: &Message) -> (u16, Vec<u8>) {
    let request = http::Request::post(&message.path).header("content-type", "application/json");
    let request = if message.path == "/v1/studies" { request.header("idempotency-key", "once") } else { request };
    answer_of(router, request.body(Body::from(message.body.to_string())).expect("a request")).await
}

async fn answer_of(router: &Router, request: http::Request<Body>) -> (u16, Vec<u8>) {
    let response = router.clone().oneshot(request).await.expect("answers");
    let status = response.status().as_u16();
    let body = axum::body::to_bytes(response.into_body(), usize::MAX).await.expect("a body");
    (status, body.to_vec())
}
