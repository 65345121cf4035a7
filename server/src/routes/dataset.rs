//! A study's dataset, streamed.

use std::collections::VecDeque;

use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use manduca_protocol::ids::StudyId;
use manduca_protocol::problem::Problem;
use manduca_protocol::view::DatasetRow;
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::dataset::Format;
use crate::error::{ApiError, chain};
use crate::http::parts::{Id, Params};
use crate::state::AppState;
use crate::store::{Store, StoreError};

/// Rows read and sent at once: what a slow client keeps in memory here.
const CHUNK: u32 = 500;

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(dataset))
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct DatasetParams {
    /// `json`, `ndjson` or `csv`; the Accept header decides where left out.
    format: Option<String>,
}

/// The samples flown so far, by index: those which succeeded and those which are infeasible.
#[utoipa::path(get, path = "/v1/studies/{study}/dataset", tag = "studies",
    params(("study" = StudyId, Path), DatasetParams),
    responses(
        (status = 200, content(
            (Vec<DatasetRow> = "application/json"),
            (DatasetRow = "application/x-ndjson"),
            (String = "text/csv"),
        )),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 406, body = Problem, content_type = "application/problem+json"),
    ))]
async fn dataset(
    State(state): State<AppState>,
    Id(study): Id<StudyId>,
    Params(params): Params<DatasetParams>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let format = format(params.format.as_deref(), &headers)?;
    let study = state.store().study_number(study).await?;
    let rows = Rows { store: state.store().clone(), study, format, after: -1, ended: false, said: VecDeque::new() };
    let body = Body::from_stream(stream::try_unfold(rows.begun(), Rows::next));
    Ok(([(header::CONTENT_TYPE, format.media_type())], body).into_response())
}

fn format(asked: Option<&str>, headers: &HeaderMap) -> Result<Format, ApiError> {
    if let Some(name) = asked {
        let refused = || ApiError::query("/format", format!("`{name}` is none of json, ndjson and csv"));
        return Format::named(name).ok_or_else(refused);
    }
    let accept = headers.get(header::ACCEPT).and_then(|value| value.to_str().ok());
    Format::accepted(accept).ok_or(ApiError::NotAcceptable { offered: Format::OFFERED })
}

/// A dataset being sent. No snapshot is held for slow clients: rows never
/// change, so reading on after the last index is enough.
struct Rows {
    store: Store,
    study: i64,
    format: Format,
    after: i64,
    ended: bool,
    said: VecDeque<String>,
}

impl Rows {
    fn begun(mut self) -> Self {
        self.said.push_back(self.format.head());
        self
    }

    async fn next(mut self) -> Result<Option<(String, Self)>, StoreError> {
        loop {
            if let Some(text) = self.said.pop_front() {
                return Ok(Some((text, self)));
            }
            if self.ended {
                return Ok(None);
            }
            let read = self.read().await;
            if let Err(error) = &read {
                // The status is long sent: the broken-off body is all the client sees.
                tracing::error!(error.cause = %chain(error), "A dataset broke off");
            }
            read?;
        }
    }

    async fn read(&mut self) -> Result<(), StoreError> {
        let rows = self.store.samples_after(self.study, self.after, CHUNK).await?;
        let Some(last) = rows.last() else {
            self.ended = true;
            self.said.push_back(self.format.tail().to_owned());
            return Ok(());
        };
        let mut first = self.after < 0;
        self.after = last.ordinal;
        let mut text = String::new();
        for row in rows {
            let row = row.parse()?;
            let appended = self.format.append(&row, first, &mut text);
            appended.map_err(|e| StoreError::Corrupt(e.to_string()))?;
            first = false;
        }
        self.said.push_back(text);
        Ok(())
    }
}
