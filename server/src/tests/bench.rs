//! A coordinator under test.

use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::Router;
use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, HeaderValue, Request, StatusCode, header};
use axum::middleware::map_request;
use manduca_protocol::task::JobKind;
use manduca_protocol::worker::{ExchangeResponse, Lease};
use serde_json::{Value, json};
use sqlx::ConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;
use tempfile::TempDir;
use tower::ServiceExt;

use super::answers;
use crate::store::{Pace, Sweep};
use crate::{AppState, Clock, Config, app, open_with_clock};

/// A clock moved by hand.
pub(super) struct HandClock(AtomicI64);

impl Clock for HandClock {
    fn now_ms(&self) -> i64 {
        self.0.load(Ordering::SeqCst)
    }
}

/// An answer, body and all.
pub(super) struct Answer {
    pub(super) status: StatusCode,
    pub(super) headers: HeaderMap,
    pub(super) body: Bytes,
}

impl Answer {
    pub(super) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {:?}", self.body))
    }

    pub(super) fn header(&self, name: &str) -> &str {
        self.headers.get(name).and_then(|v| v.to_str().ok()).unwrap_or_default()
    }

    /// Checks that this is a problem of this status and type, and gives the pointers at fault.
    pub(super) fn problem(&self, status: u16, slug: &str) -> Vec<String> {
        assert_eq!(self.status, status, "{:?}", self.body);
        assert_eq!(self.header("content-type"), "application/problem+json");
        let problem = self.json();
        assert_eq!(problem["type"], format!("urn:manduca:problem:{slug}"));
        assert_eq!(problem["status"], status);
        assert!(problem["title"].is_string() && problem["detail"].is_string());
        let errors = problem["errors"].as_array().cloned().unwrap_or_default();
        errors.iter().map(|e| e["pointer"].as_str().expect("a pointer").to_owned()).collect()
    }
}

/// All routes of a coordinator, each asked by the name of this machine where a test does not name another.
pub(super) fn called(state: &AppState) -> Router {
    app(state.clone()).layer(map_request(|mut request: Request<Body>| async {
        request.headers_mut().entry(header::HOST).or_insert(HeaderValue::from_static("localhost"));
        request
    }))
}

/// A coordinator, its clock and its folder.
pub(super) struct Bench {
    pub(super) state: AppState,
    /// All its routes: made once, for most of the making is that of their document.
    pub(super) router: Router,
    clock: Arc<HandClock>,
    folder: TempDir,
    pace: Mutex<Pace>,
}

impl Bench {
    pub(super) async fn open() -> Self {
        Self::open_with(|_| {}).await
    }

    /// A coordinator some of whose numbers are changed.
    pub(super) async fn open_with(change: impl FnOnce(&mut Config)) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let clock = Arc::new(HandClock(AtomicI64::new(1_800_000_000_000)));
        let mut config = config(&folder);
        change(&mut config);
        let state = open_with_clock(config, clock.clone()).await.expect("opens");
        Self { router: called(&state), state, pace: pace(&clock), clock, folder }
    }

    /// Where its database is.
    pub(super) fn database(&self) -> std::path::PathBuf {
        self.folder.path().join("manduca.db")
    }

    /// Stops the coordinator, lets time pass and starts it on the same file.
    pub(super) async fn restart(self, after: Duration) -> Self {
        self.state.close().await;
        let Self { clock, folder, .. } = self;
        clock.0.fetch_add(after.as_millis() as i64, Ordering::SeqCst);
        let state = open_with_clock(config(&folder), clock.clone()).await.expect("opens again");
        Self { router: called(&state), state, pace: pace(&clock), clock, folder }
    }

    /// Lets time pass and what is due happen.
    pub(super) async fn pass(&self, seconds: f64) {
        self.clock.0.fetch_add((seconds * 1000.0) as i64, Ordering::SeqCst);
        let pace = *self.pace.lock().expect("no holder panics");
        let swept = self.state.store().run(Sweep { pace }).await.expect("sweeps");
        *self.pace.lock().expect("no holder panics") = swept;
    }

    pub(super) async fn send(&self, request: Request<Body>) -> Answer {
        self.send_to(self.router.clone(), request).await
    }

    /// [`Bench::send`] to these routes.
    pub(super) async fn send_to(&self, router: Router, request: Request<Body>) -> Answer {
        let response = router.oneshot(request).await.expect("answers");
        let (parts, body) = response.into_parts();
        let body = axum::body::to_bytes(body, usize::MAX).await.expect("a body");
        Answer { status: parts.status, headers: parts.headers, body }
    }

    pub(super) async fn get(&self, path: &str) -> Answer {
        self.send(Request::get(path).body(Body::empty()).expect("a request")).await
    }

    pub(super) async fn delete(&self, path: &str) -> Answer {
        self.send(Request::delete(path).body(Body::empty()).expect("a request")).await
    }

    pub(super) async fn post(&self, path: &str, body: impl Into<Body>) -> Answer {
        let request = Request::post(path).header("content-type", "application/json").body(body.into());
        self.send(request.expect("a request")).await
    }

    /// Submits a study and gives its path.
    pub(super) async fn submit(&self, spec: &Value) -> String {
        let answer = self.post("/v1/studies", spec.to_string()).await;
        assert_eq!(answer.status, 201, "{:?}", answer.body);
        answer.header("location").to_owned()
    }

    pub(super) async fn view(&self, study: &str) -> Value {
        let answer = self.get(study).await;
        assert_eq!(answer.status, 200, "{:?}", answer.body);
        answer.json()
    }

    /// Registers a worker and gives its path.
    pub(super) async fn worker(&self, name: &str) -> String {
        let answer = self.post("/v1/workers", answers::registration(name).to_string()).await;
        assert_eq!(answer.status, 201, "{:?}", answer.body);
        format!("/v1/workers/{}", answer.json()["worker"].as_str().expect("an id"))
    }

    pub(super) async fn exchange(&self, worker: &str, request: Value) -> ExchangeResponse {
        let answer = self.post(&format!("{worker}/exchange"), request.to_string()).await;
        assert_eq!(answer.status, 200, "{:?}", answer.body);
        serde_json::from_slice(&answer.body).expect("an exchange")
    }

    pub(super) async fn claim(&self, worker: &str, want: u32) -> Vec<Lease> {
        self.exchange(worker, json!({ "want": want })).await.jobs
    }

    pub(super) async fn complete(&self, worker: &str, lease: &Lease, result: Value) -> ExchangeResponse {
        self.exchange(worker, json!({ "complete": [answers::completion(lease, result)] })).await
    }

    pub(super) async fn fail(&self, worker: &str, lease: &Lease, reason: &str) -> ExchangeResponse {
        let failure = json!({ "job": lease.job, "attempt": lease.attempt, "reason": reason });
        self.exchange(worker, json!({ "fail": [failure] })).await
    }

    /// Leases and completes jobs until none is ready; gives how many.
    pub(super) async fn work_off(&self, worker: &str) -> usize {
        self.work_off_by(worker, 100).await
    }

    /// [`Bench::work_off`], so many jobs at a time.
    pub(super) async fn work_off_by(&self, worker: &str, want: u32) -> usize {
        let mut done = 0;
        loop {
            let leases = self.claim(worker, want).await;
            if leases.is_empty() {
                return done;
            }
            done += leases.len();
            let mut results = Vec::new();
            for lease in &leases {
                results.push(answers::completion(lease, self.result(lease).await));
            }
            let told = self.exchange(worker, json!({ "complete": results })).await;
            assert_eq!(told.accepted.len(), leases.len(), "{:?}", told.rejected);
        }
    }

    /// A result that fits a lease; a training's counts the samples of its study.
    pub(super) async fn result(&self, lease: &Lease) -> Value {
        if lease.kind != JobKind::Train {
            return answers::result(lease);
        }
        let task = self.get(&format!("/v1/jobs/{}/task", lease.job)).await.json();
        // Of a study that cannot be read there is no task.
        answers::trained_on(task["dataset"].as_array().map_or(20, Vec::len))
    }

    /// Puts another network in the place of the one a study has.
    pub(super) async fn plant(&self, lease: &Lease, training: &Value) {
        let mut training = training.clone();
        training.as_object_mut().expect("an object").remove("kind");
        let options = SqliteConnectOptions::new().filename(self.database());
        let mut database = options.connect().await.expect("opens beside the coordinator");
        sqlx::query("update results set body = ? where job = ?")
            .bind(training.to_string().into_bytes())
            .bind(lease.job.0)
            .execute(&mut database)
            .await
            .expect("is planted");
    }

    /// Rows of the evidence table, by class.
    pub(super) async fn evidence(&self, class: &str) -> i64 {
        let count = sqlx::query_scalar("select count(*) from refused_results where class = ?").bind(class);
        count.fetch_one(self.state.store().readers()).await.expect("counts")
    }

    /// Compares the counters with the jobs themselves.
    pub(super) async fn check_counts(&self) {
        let wrong: i64 = sqlx::query_scalar(
            "select count(*) from (
                 select study, role, state, n from study_counts where n > 0
                 except select study, role, state, count(*) from jobs group by study, role, state)",
        )
        .fetch_one(self.state.store().readers())
        .await
        .expect("compares");
        let (jobs, counted): (i64, i64) =
            sqlx::query_as("select (select count(*) from jobs), (select coalesce(sum(n), 0) from study_counts)")
                .fetch_one(self.state.store().readers())
                .await
                .expect("counts");
        assert_eq!((wrong, jobs), (0, counted));
    }
}

fn pace(clock: &HandClock) -> Mutex<Pace> {
    Mutex::new(Pace::start(clock.now_ms()))
}

fn config(folder: &TempDir) -> Config {
    // Time passes by hand here, and so does what time brings. A jump of it is no absence.
    let (sweep, away) = (Duration::from_secs(3600), Duration::MAX);
    // However slow the machine is, the outcome of a check is told.
    let check_wait = Duration::from_secs(600);
    // Workers of two slots take as many jobs as a test wants to look at.
    let (leases_per_slot, probation) = (1000, 1000);
    let database = folder.path().join("manduca.db");
    Config { sweep, away, check_wait, leases_per_slot, probation, ..Config::new(database) }
}
