//! Reads which take long: off the threads which serve, a few at once, in fair turns, so that neither
//! the queue nor a health check waits for them.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::body::{Body, Bytes, to_bytes};
use axum::extract::{MatchedPath, Request};
use axum::http::{HeaderValue, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tokio::runtime::Handle;
use tokio_util::sync::CancellationToken;

use crate::error::ApiError;
use crate::fair::{Asker, Fair, Turn};
use crate::state::AppState;

/// Routes which read, compute or write at length. A dataset and the task of a training take a turn for
/// each part they send, predictions and fronts one once they know what is asked.
pub(crate) const HEAVY: [&str; 13] = [
    "/v1/studies",
    "/v1/studies/{study}/jobs",
    "/v1/studies/{study}/points",
    "/v1/studies/{study}/throughput",
    "/v1/studies/{study}/failures",
    "/v1/studies/{study}/optimum",
    "/v1/studies/{study}/optimisations",
    "/v1/studies/{study}/optimisations/{name}",
    "/v1/studies/{study}/surrogate",
    "/v1/studies/{study}/surrogate/model",
    "/v1/jobs/{job}/task",
    "/v1/evidence",
    "/v1/workers",
];
/// Of these, those whose answers are kept while nothing changes: all who watch a study ask the same.
const KEPT: [&str; 2] = ["/v1/studies/{study}/points", "/v1/studies/{study}/throughput"];

/// Most at once; one connection of the store is left to short reads.
const MOST: usize = 3;
/// Most samples of a small study, and most such studies whose samples are drawn at once: together they take 8 MB.
const SKETCH: u32 = 1000;
const SKETCHES: usize = 64;
/// How many wait.
const PLACES: usize = 128;
/// How long one waits.
const PATIENCE: Duration = Duration::from_secs(30);
/// Until a part of an answer asks for its turn again.
const AGAIN: Duration = Duration::from_millis(200);
/// Answers kept, and the largest of them, bytes.
const ANSWERS: usize = 32;
const LARGEST: usize = 512 << 10;
/// How long an answer is kept, though nothing changes.
const FRESH: Duration = Duration::from_secs(30);
/// How old an answer may be that is given to a request which would have to wait.
const STALE: Duration = Duration::from_secs(2);

/// Turns at reading, and the last answers.
#[derive(Debug)]
pub(crate) struct Heavy {
    turns: Fair,
    drawing: Fair,
    sketching: Fair,
    answers: Mutex<VecDeque<Answer>>,
}

#[derive(Debug)]
struct Answer {
    /// What was asked.
    asked: String,
    /// Which state of the study it tells of.
    version: u64,
    at: Instant,
    content_type: HeaderValue,
    body: Bytes,
}

/// What an answer is kept as.
struct Kept {
    asked: String,
    version: u64,
}

impl Heavy {
    /// Turns for a coordinator with so many processors and connections which read.
    pub(crate) fn new(processors: usize, readers: u32) -> Self {
        let most = MOST.min(processors).min(readers.saturating_sub(1) as usize).max(1);
        let drawing = Fair::new(most, PLACES, PATIENCE);
        let sketching = Fair::new(SKETCHES, PLACES, PATIENCE);
        Self { turns: Fair::new(most, PLACES, PATIENCE), drawing, sketching, answers: Mutex::default() }
    }

    /// A turn at what takes long.
    ///
    /// # Errors
    /// When too many wait, or it takes too long.
    pub(crate) async fn turn(&self, asker: Asker) -> Result<Turn, ApiError> {
        self.turns.take(asker).await
    }

    /// A turn for a part of an answer which is being sent: its status is long told, so it is not refused.
    pub(crate) async fn part(&self, asker: Asker) -> Turn {
        loop {
            match self.turns.take(asker).await {
                Ok(turn) => return turn,
                Err(_) => tokio::time::sleep(AGAIN).await,
            }
        }
    }

    /// A turn at drawing so many samples of a study, to be kept until they are stored: those of the largest
    /// take 24 MB, and of small studies many may wait for one commit.
    ///
    /// # Errors
    /// As [`Heavy::turn`].
    pub(crate) async fn drawing(&self, samples: u32, asker: Asker) -> Result<Turn, ApiError> {
        let turns = if samples > SKETCH { &self.drawing } else { &self.sketching };
        turns.take(asker).await
    }

    /// The answer kept to this, if it is good enough.
    fn known(&self, asked: &str, good: impl Fn(&Answer) -> bool) -> Option<Response> {
        let answers = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
        let known = answers.iter().find(|answer| answer.asked == asked && good(answer))?;
        let content_type = (header::CONTENT_TYPE, known.content_type.clone());
        Some(([content_type], known.body.clone()).into_response())
    }

    fn keep(&self, kept: Kept, content_type: HeaderValue, body: Bytes) {
        let Kept { asked, version } = kept;
        let mut answers = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
        answers.retain(|answer| answer.asked != asked && answer.at.elapsed() < FRESH);
        answers.push_back(Answer { asked, version, at: Instant::now(), content_type, body });
        while answers.len() > ANSWERS {
            answers.pop_front();
        }
    }
}

/// Gives requests which take long their turn, on a thread which does not serve.
pub(crate) async fn heavy(state: &AppState, request: Request, next: Next) -> Response {
    let reads = request.method() == Method::GET || request.method() == Method::HEAD;
    let path = request.extensions().get::<MatchedPath>().map(MatchedPath::as_str).unwrap_or_default();
    if !reads || !HEAVY.contains(&path) {
        return next.run(request).await;
    }
    let kept = if KEPT.contains(&path) && request.method() == Method::GET { kept(state, &request) } else { None };
    take(state, request, next, kept).await.unwrap_or_else(IntoResponse::into_response)
}

/// What the answer to a request about a study is kept as.
fn kept(state: &AppState, request: &Request) -> Option<Kept> {
    let study = request.uri().path().split('/').nth(3)?.parse().ok()?;
    let asked = request.uri().path_and_query()?.as_str();
    Some(Kept { asked: asked.to_owned(), version: state.changes().version_of(study) })
}

async fn take(state: &AppState, request: Request, next: Next, kept: Option<Kept>) -> Result<Response, ApiError> {
    let heavy = state.heavy();
    let fresh =
        |kept: &Kept| heavy.known(&kept.asked, |answer| answer.version == kept.version && answer.at.elapsed() < FRESH);
    let recent = |kept: &Kept| heavy.known(&kept.asked, |answer| answer.at.elapsed() < STALE);
    if let Some(known) = kept.as_ref().and_then(fresh) {
        return Ok(known);
    }
    let turn = match heavy.turns.try_take() {
        Some(turn) => turn,
        None => {
            if let Some(known) = kept.as_ref().and_then(recent) {
                return Ok(known);
            }
            let turn = heavy.turn(Asker::of(request.headers())).await?;
            // Another may have asked the same meanwhile.
            if let Some(known) = kept.as_ref().and_then(recent) {
                return Ok(known);
            }
            turn
        }
    };
    let response = apart(turn, next.run(request)).await?;
    match kept {
        Some(kept) if response.status().is_success() => keep(heavy, kept, response).await,
        _ => Ok(response),
    }
}

/// Runs a handler on a thread of its own. A client which hangs up ends it where it next waits.
async fn apart(turn: Turn, handler: impl Future<Output = Response> + Send + 'static) -> Result<Response, ApiError> {
    let (runtime, gone) = (Handle::current(), CancellationToken::new());
    let _hung_up = gone.clone().drop_guard();
    let running = tokio::task::spawn_blocking(move || {
        let response = runtime.block_on(gone.run_until_cancelled_owned(handler));
        drop(turn);
        response
    });
    let response = running.await.map_err(|e| ApiError::Internal(Box::new(e)))?;
    response.ok_or(ApiError::Stopping)
}

async fn keep(heavy: &Heavy, kept: Kept, response: Response) -> Result<Response, ApiError> {
    let (parts, body) = response.into_parts();
    let body = to_bytes(body, usize::MAX).await.map_err(|e| ApiError::Internal(Box::new(e)))?;
    if let Some(content_type) = parts.headers.get(header::CONTENT_TYPE).filter(|_| body.len() <= LARGEST) {
        heavy.keep(kept, content_type.clone(), body.clone());
    }
    Ok(Response::from_parts(parts, Body::from(body)))
}
