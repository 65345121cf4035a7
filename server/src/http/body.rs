//! Bodies of requests: read as bytes within the memory there is for them, and parsed off the
//! threads which serve unless they are small.

use std::time::Duration;

use axum::body::{Body, HttpBody};
use axum::extract::{FromRequest, Request};
use axum::http::{HeaderMap, header};
use futures_util::StreamExt;
use manduca_protocol::flight::SimulationRequest;
use manduca_protocol::ids::WorkerId;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::study::{OptimisationSpec, StudySpec};
use manduca_protocol::view::PredictionRequest;
use manduca_protocol::worker::{ExchangeRequest, RegisterRequest};
use serde::de::DeserializeOwned;
use tokio::time::{Instant, timeout};

use super::parse::{Language, parse};
use crate::error::ApiError;
use crate::fair::Asker;
use crate::memory::Held;
use crate::state::AppState;

/// Most values of a study, an optimisation or a stroke.
const VALUES: usize = 16 << 10;
/// Most values of points to predict, or of an exchange: a thousand results of simulations have 60,000.
const MANY_VALUES: usize = 256 << 10;
/// Most values of a large exchange: sixteen networks of 1000 neurons with curves of 10,000 iterations
/// have 1.4 million.
const MOST_VALUES: usize = 2 << 20;
/// Largest body parsed on a thread which serves, bytes: a tenth of a millisecond's work.
const INLINE: usize = 16 << 10;
/// How often is looked whether a body must make room for others.
const LOOK: Duration = Duration::from_millis(500);
/// How much of a body which is too large is read and thrown away, bytes.
const THROWN_AWAY: usize = 64 << 20;

/// How large a body may be.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room {
    bytes: usize,
    values: usize,
    large: bool,
}

/// A body some route takes.
pub(crate) trait Accepted: DeserializeOwned + Send + 'static {
    /// Whether it may be sent as TOML too.
    const TOML: bool = false;

    /// How large one may be which is sent to this path and has so many bytes, where that is told.
    fn room(state: &AppState, _: &str, _: Option<u64>) -> impl Future<Output = Result<Room, ApiError>> + Send {
        let bytes = state.config().study_limit;
        async move { Ok(Room { bytes, values: VALUES, large: false }) }
    }

    /// The refusal of one which does not fit.
    fn refuse(errors: Vec<FieldProblem>) -> ApiError {
        ApiError::InvalidRequest(errors)
    }
}

impl Accepted for StudySpec {
    const TOML: bool = true;

    fn refuse(errors: Vec<FieldProblem>) -> ApiError {
        ApiError::InvalidStudy(errors)
    }
}

impl Accepted for PredictionRequest {
    async fn room(state: &AppState, _: &str, _: Option<u64>) -> Result<Room, ApiError> {
        Ok(Room { bytes: state.config().body_limit, values: MANY_VALUES, large: false })
    }
}

impl Accepted for ExchangeRequest {
    /// Only what is not a simulation has a large result: a worker without such a job needs little.
    async fn room(state: &AppState, path: &str, length: Option<u64>) -> Result<Room, ApiError> {
        let usual = Room { bytes: state.config().exchange_limit, values: MANY_VALUES, large: false };
        if length.is_some_and(|length| length <= usual.bytes as u64) {
            return Ok(usual);
        }
        let Some(worker) = worker(path) else { return Ok(usual) };
        if !state.may_send_large(worker).await? {
            return Ok(usual);
        }
        Ok(Room { bytes: state.config().large_limit, values: MOST_VALUES, large: true })
    }
}

/// The worker whose exchange is at this path.
fn worker(path: &str) -> Option<WorkerId> {
    path.strip_prefix("/v1/workers/")?.split('/').next()?.parse().ok()
}

impl Accepted for RegisterRequest {}
impl Accepted for OptimisationSpec {}
impl Accepted for SimulationRequest {}

/// A JSON body, or one in TOML where the route takes that.
pub(crate) struct JsonBody<T>(pub(crate) T);

impl<T: Accepted> FromRequest<AppState> for JsonBody<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &AppState) -> Result<Self, ApiError> {
        HeldBody::from_request(request, state).await.map(|body| Self(body.value))
    }
}

/// A [`JsonBody`] with its share of the memory for bodies, to be held as long as what was read is.
pub(crate) struct HeldBody<T> {
    pub(crate) value: T,
    pub(crate) held: Held,
}

impl<T: Accepted> FromRequest<AppState> for HeldBody<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &AppState) -> Result<Self, ApiError> {
        let language = match () {
            () if T::TOML && is(request.headers(), "application/toml") => Language::Toml,
            () if is(request.headers(), "application/json") => Language::Json,
            () => return Err(ApiError::UnsupportedMediaType),
        };
        let (path, length) = (request.uri().path().to_owned(), request.body().size_hint().upper());
        let room = T::room(state, &path, length).await?;
        let mut held = if room.large {
            let asker = worker(&path).map_or_else(|| Asker::of(request.headers()), Asker::of_worker);
            state.memory().large(asker).await?
        } else {
            state.memory().none()
        };
        let bytes = read(request, room.bytes, state, &mut held).await?;
        if bytes.len() <= INLINE && language == Language::Json {
            return parse(&bytes, language, room.values).map(|value| Self { value, held });
        }
        let turn = state.memory().turn().await;
        let parsing = tokio::task::spawn_blocking(move || {
            let parsed = parse(&bytes, language, room.values);
            drop(turn);
            parsed
        });
        let parsed = parsing.await.map_err(|e| ApiError::Internal(Box::new(e)))?;
        parsed.map(|value| Self { value, held })
    }
}

fn is(headers: &HeaderMap, media_type: &str) -> bool {
    let declared = headers.get(header::CONTENT_TYPE).and_then(|v| v.to_str().ok()).unwrap_or_default();
    let essence = declared.split(';').next().unwrap_or_default().trim();
    essence.eq_ignore_ascii_case(media_type)
}

async fn read(request: Request, limit: usize, state: &AppState, held: &mut Held) -> Result<Vec<u8>, ApiError> {
    let wait = state.config().body_wait;
    let timeout = ApiError::BodyTimeout { seconds: wait.as_secs() };
    tokio::time::timeout(wait, collect(request.into_body(), limit, held)).await.map_err(|_| timeout)?
}

/// All of a body, copied as it comes: a part of one byte, kept, would keep the buffer of some KiB
/// which it was received into.
///
/// One which is too large is read on for a while and thrown away: a client which still sends when its
/// answer comes finds a broken connection and no reason.
async fn collect(body: Body, limit: usize, held: &mut Held) -> Result<Vec<u8>, ApiError> {
    let too_large = ApiError::BodyTooLarge { limit };
    let patience = limit + THROWN_AWAY;
    if body.size_hint().lower() > patience as u64 {
        return Err(too_large);
    }
    let fits = body.size_hint().lower() <= limit as u64;
    let (mut all, mut length, mut parts) = (Vec::new(), 0, body.into_data_stream());
    let began = Instant::now();
    loop {
        let part = match timeout(LOOK, parts.next()).await {
            Ok(None) => break,
            Ok(part) => part,
            Err(_) => None,
        };
        if let Some(most) = held.pressed().filter(|most| began.elapsed() > *most) {
            return Err(ApiError::BodyTimeout { seconds: most.as_secs() });
        }
        let Some(part) = part else { continue };
        let part = part.map_err(|_| ApiError::MalformedJson(vec![FieldProblem::new("", "the body broke off")]))?;
        length += part.len();
        if length > patience {
            return Err(too_large);
        }
        if length <= limit && fits {
            held.grow(length, limit).await?;
            reserve(&mut all, length, limit);
            all.extend_from_slice(&part);
        } else {
            all = Vec::new();
        }
    }
    if length > limit { Err(too_large) } else { Ok(all) }
}

/// Makes room for `length` bytes: twice as much as before, but never more than the limit.
fn reserve(all: &mut Vec<u8>, length: usize, limit: usize) {
    if length > all.capacity() {
        let room = (2 * all.capacity()).clamp(length, limit.max(length));
        all.reserve_exact(room - all.len());
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use axum::body::Bytes;
    use futures_util::stream;

    use super::*;
    use crate::memory::{LARGE, Memory, Waits};

    /// Bodies of which one byte comes, and then nothing.
    fn endless() -> Body {
        let first = stream::once(async { Ok::<_, Infallible>(Bytes::from_static(b" ")) });
        Body::from_stream(first.chain(stream::pending()))
    }

    #[tokio::test]
    async fn who_sends_slowly_holds_no_place_that_another_waits_for() {
        let memory = Memory::new(1, Waits::of_large(Duration::from_secs(5), Duration::ZERO));
        let mut slow = Vec::new();
        for _ in 0..LARGE {
            let mut held = memory.large(Asker::default()).await.expect("a place");
            slow.push(tokio::spawn(async move { collect(endless(), 1 << 20, &mut held).await.map(drop) }));
        }
        tokio::time::sleep(2 * LOOK).await;
        assert!(slow.iter().all(|one| !one.is_finished()), "nobody waits for their places");
        memory.large(Asker::default()).await.expect("a place is given up in time");
        let ended = slow.iter().filter(|one| one.is_finished()).count();
        assert!(ended > 0);
        for one in slow.into_iter().filter(tokio::task::JoinHandle::is_finished) {
            assert!(matches!(one.await.expect("ends"), Err(ApiError::BodyTimeout { .. })));
        }
    }
}
