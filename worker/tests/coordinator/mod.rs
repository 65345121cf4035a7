//! A coordinator of a few lines, which loses answers and forgets workers on demand.

use std::collections::{HashMap, HashSet, VecDeque};
use std::ops::RangeInclusive;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::extract::{Path, Request, State};
use axum::http::{StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{delete, get, post};
use axum::{Json, Router};
use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::problem::Problem;
use manduca_protocol::task::{JobKind, Task};
use manduca_protocol::worker::{ExchangeRequest, ExchangeResponse, Lease, RegisterRequest, RegisterResponse};
use tokio::net::TcpListener;
use tokio::sync::Notify;

/// What a slot says of a task it has done.
pub const DONE: &str = r#"{"message":"done","result":{"kind":"simulate","outcome":"infeasible","reason":"no","solver_version":"1"},"provenance":{"wall_s":0.1,"level":"avx2"}}"#;
/// What a slot says of a task it refuses.
pub const FAILED: &str = r#"{"message":"failed","reason":"no such wing","fault":"refused"}"#;

/// What the coordinator knows and what a test may change.
#[derive(Default)]
pub struct Book {
    pub worker: Option<WorkerId>,
    pub registered: u32,
    pub refuse: bool,
    pub inline: bool,
    pub queue: VecDeque<i64>,
    pub leased: HashSet<i64>,
    pub completed: HashMap<i64, u32>,
    pub failed: Vec<String>,
    pub renewed: u32,
    pub cancel: Vec<i64>,
    pub lose_reports: u32,
    /// Answers with jobs in them which are lost.
    pub lose_grants: u32,
    /// Jobs given again to a worker which said what it had.
    pub given_again: u32,
    pub fetched: u32,
    pub left: u32,
    /// Status, media type and body of an answer which something on the way gives to every call.
    pub stranger: Option<(u16, &'static str, &'static str)>,
    /// The same for tasks alone.
    pub stranger_of_tasks: Option<(u16, &'static str, &'static str)>,
    /// Calls which it has answered.
    pub intercepted: u32,
    /// Requests with results which the coordinator says it cannot read.
    pub unreadable: u32,
    /// Whether it cannot read checkpoints.
    pub unreadable_checkpoints: bool,
    /// Whether answers leave out what became of results.
    pub silent: bool,
    /// Notes of checkpoints which came.
    pub checkpoints: u32,
}

type Shared = Arc<(Mutex<Book>, Notify)>;

pub struct Coordinator {
    pub url: String,
    shared: Shared,
}

impl Coordinator {
    pub async fn start() -> Self {
        let shared: Shared = Arc::new((Mutex::new(Book { inline: true, ..Book::default() }), Notify::new()));
        let app = Router::new()
            .route("/v1/workers", post(register))
            .route("/v1/workers/{worker}/exchange", post(exchange))
            .route("/v1/workers/{worker}", delete(leave))
            .route("/v1/jobs/{job}/task", get(fetch))
            .layer(from_fn_with_state(shared.clone(), intercept))
            .with_state(shared.clone());
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        tokio::spawn(async move { axum::serve(listener, app).await.unwrap() });
        Self { url, shared }
    }

    pub fn see<T>(&self, look: impl FnOnce(&Book) -> T) -> T {
        look(&self.shared.0.lock().unwrap())
    }

    pub fn change(&self, change: impl FnOnce(&mut Book)) {
        change(&mut self.shared.0.lock().unwrap());
        self.shared.1.notify_waiters();
    }

    pub fn queue(&self, jobs: RangeInclusive<i64>) {
        self.change(|book| book.queue.extend(jobs));
    }
}

/// Something on the way answers instead of the coordinator.
async fn intercept(State(shared): State<Shared>, request: Request, next: Next) -> Response {
    let stranger = {
        let mut book = shared.0.lock().unwrap();
        let of_tasks = book.stranger_of_tasks.filter(|_| request.uri().path().ends_with("/task"));
        let stranger = book.stranger.or(of_tasks);
        book.intercepted += u32::from(stranger.is_some());
        stranger
    };
    match stranger {
        Some((status, media_type, body)) => {
            (StatusCode::from_u16(status).unwrap(), [(header::CONTENT_TYPE, media_type)], body).into_response()
        }
        None => next.run(request).await,
    }
}

fn problem(status: StatusCode, slug: &str, detail: &str) -> Response {
    let problem = Problem {
        kind: format!("urn:manduca:problem:{slug}"),
        title: "no".into(),
        status: status.as_u16(),
        detail: detail.into(),
        errors: Vec::new(),
    };
    (status, Json(problem)).into_response()
}

async fn register(State(shared): State<Shared>, Json(_): Json<RegisterRequest>) -> Response {
    let mut book = shared.0.lock().unwrap();
    if book.refuse {
        return problem(StatusCode::CONFLICT, "solver-version", "another solver version");
    }
    let worker = WorkerId::new();
    book.worker = Some(worker);
    book.registered += 1;
    Json(RegisterResponse { worker, lease_s: 1.0, renew_s: 0.1 }).into_response()
}

async fn leave(State(shared): State<Shared>, Path(_): Path<WorkerId>) -> StatusCode {
    shared.0.lock().unwrap().left += 1;
    StatusCode::NO_CONTENT
}

fn task() -> Task {
    serde_json::from_str(
        r#"{"kind":"train","surrogate":{},"seed":1,"bounds":{"lower":[0,0,0,0,0,0,0,0,0,0],
            "upper":[1,1,1,1,1,1,1,1,1,1]},"dataset":[]}"#,
    )
    .unwrap()
}

async fn fetch(State(shared): State<Shared>, Path(_): Path<JobId>) -> Json<Task> {
    shared.0.lock().unwrap().fetched += 1;
    Json(task())
}

async fn exchange(
    State(shared): State<Shared>,
    Path(worker): Path<WorkerId>,
    Json(request): Json<ExchangeRequest>,
) -> Response {
    let mut response = ExchangeResponse::default();
    {
        let mut book = shared.0.lock().unwrap();
        if book.worker != Some(worker) {
            return problem(StatusCode::NOT_FOUND, "unknown-worker", "unknown worker");
        }
        let report = !request.complete.is_empty() || !request.fail.is_empty();
        let tells = request.renew.iter().any(|renewal| renewal.checkpoint.is_some());
        let is_unreadable = book.unreadable > 0 && !request.complete.is_empty();
        if is_unreadable || (book.unreadable_checkpoints && tells) {
            book.unreadable -= u32::from(is_unreadable);
            return problem(StatusCode::UNPROCESSABLE_ENTITY, "invalid-request", "cannot be read");
        }
        take(&mut book, &request, &mut response);
        if report && book.lose_reports > 0 {
            book.lose_reports -= 1;
            return problem(StatusCode::BAD_GATEWAY, "unavailable", "lost");
        }
    }
    let wait = tokio::time::sleep(Duration::from_secs_f64(request.wait_s));
    tokio::pin!(wait);
    loop {
        let changed = shared.1.notified();
        {
            let mut book = shared.0.lock().unwrap();
            if book.worker != Some(worker) {
                return problem(StatusCode::NOT_FOUND, "unknown-worker", "unknown worker");
            }
            grant(&mut book, &request, &mut response);
            if !response.jobs.is_empty() && book.lose_grants > 0 {
                book.lose_grants -= 1;
                return problem(StatusCode::BAD_GATEWAY, "unavailable", "lost");
            }
        }
        if !response.jobs.is_empty() || request.wait_s == 0.0 {
            return Json(response).into_response();
        }
        tokio::select! {
            () = &mut wait => return Json(response).into_response(),
            () = changed => {}
        }
    }
}

fn take(book: &mut Book, request: &ExchangeRequest, response: &mut ExchangeResponse) {
    for completion in &request.complete {
        book.leased.remove(&completion.job.0);
        *book.completed.entry(completion.job.0).or_default() += 1;
        response.accepted.push(completion.job);
    }
    for failure in &request.fail {
        if book.leased.remove(&failure.job.0) {
            book.failed.push(failure.reason.clone());
        }
        response.accepted.push(failure.job);
    }
    if book.silent {
        response.accepted.clear();
    }
    for renewal in &request.renew {
        book.renewed += 1;
        book.checkpoints += u32::from(renewal.checkpoint.is_some());
        if book.cancel.contains(&renewal.job.0) {
            book.leased.remove(&renewal.job.0);
            response.cancel.push(renewal.job);
        }
    }
}

fn grant(book: &mut Book, request: &ExchangeRequest, response: &mut ExchangeResponse) {
    let is_missed = |job: &i64| request.have.as_ref().is_some_and(|have| !have.contains(&JobId(*job)));
    let missed: Vec<i64> = book.leased.iter().copied().filter(is_missed).collect();
    book.given_again += missed.len() as u32;
    let mut ready = missed.into_iter().chain(std::iter::from_fn(|| book.queue.pop_front())).take(request.want as usize);
    for job in ready.by_ref().collect::<Vec<_>>() {
        book.leased.insert(job);
        let task = book.inline.then(task);
        let kind = if book.inline { JobKind::Simulate } else { JobKind::Train };
        response.jobs.push(Lease { job: JobId(job), attempt: 1, study: StudyId::new(), kind, run_limit_s: 30.0, task });
    }
}
