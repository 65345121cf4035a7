//! Changes, told as they happen.

use std::convert::Infallible;
use std::time::Duration;

use axum::extract::State;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures_util::stream::{self, Stream};
use manduca_protocol::ids::StudyId;
use manduca_protocol::overview::{ChangeEvent, ChangeMessage};
use manduca_protocol::problem::Problem;
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::changes::Watcher;
use crate::error::ApiError;
use crate::http::parts::Params;
use crate::state::AppState;

/// Between two events: what changes meanwhile is told together.
const PAUSE: Duration = Duration::from_millis(500);
/// Between two signs of life where nothing changes, so that no proxy takes the stream for dead.
const ALIVE: Duration = Duration::from_secs(15);

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(events))
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct EventParams {
    /// Only changes of this study, and of workers.
    study: Option<StudyId>,
}

struct Watching {
    state: AppState,
    watcher: Watcher,
    only: Option<StudyId>,
    first: bool,
}

/// Tells what changes, as server-sent events named `changed`, at most two a second. They say
/// where to look again, not what is there. The stream ends when the coordinator stops.
#[utoipa::path(get, path = "/v1/events", tag = "watch", params(EventParams), responses(
    (status = 200, body = ChangeEvent, content_type = "text/event-stream"),
    (status = 400, body = Problem, content_type = "application/problem+json"),
    (status = 404, body = Problem, content_type = "application/problem+json"),
    (status = 503, body = Problem, content_type = "application/problem+json"),
))]
async fn events(
    State(state): State<AppState>,
    Params(params): Params<EventParams>,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, ApiError> {
    if let Some(study) = params.study {
        state.store().study_number(study).await?;
    }
    let most = state.config().watchers;
    let watcher = state.changes().watch().ok_or(ApiError::TooManyWatchers { most })?;
    let watching = Watching { state, watcher, only: params.study, first: true };
    Ok(Sse::new(stream::unfold(watching, next)).keep_alive(KeepAlive::new().interval(ALIVE)))
}

async fn next(mut watching: Watching) -> Option<(Result<Event, Infallible>, Watching)> {
    let stopping = watching.state.stopping().clone();
    let first = std::mem::replace(&mut watching.first, false);
    let change = tokio::select! {
        () = stopping.cancelled() => return None,
        change = change(&mut watching, first) => change?,
    };
    // A message of ids and truth values always serialises.
    let event = Event::default().event("changed").json_data(&change).ok()?;
    Some((Ok(event), watching))
}

async fn change(watching: &mut Watching, first: bool) -> Option<ChangeMessage> {
    if !first {
        tokio::time::sleep(PAUSE).await;
    }
    watching.watcher.next(watching.state.changes(), watching.only).await
}
