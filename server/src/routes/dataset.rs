//! A study's dataset, streamed.

use std::collections::VecDeque;

use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use manduca_protocol::ids::StudyId;
use manduca_protocol::problem::Problem;
use manduca_protocol::view::DatasetRow;
use serde::Deserialize;
use tokio::task::spawn_blocking;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::dataset::{Format, WriteError, Writer};
use crate::error::{ApiError, chain};
use crate::fair::Asker;
use crate::http::parts::{Id, Params};
use crate::state::AppState;
use crate::store::StoreError;

/// Rows read and sent at once: what a slow client keeps in memory here.
const CHUNK: u32 = 500;
/// Says how many rows there were when the answer began. A whole answer has at least as many: who reads it
/// over a proxy which ends broken answers as if they were whole can tell by this.
const ROWS: HeaderName = HeaderName::from_static("manduca-rows");

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(dataset))
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct DatasetParams {
    /// `json`, `ndjson`, `csv` or `parquet`; the Accept header decides where left out.
    format: Option<String>,
    /// Also say who computed each row and how: other runs of the study differ in that.
    #[serde(default)]
    provenance: bool,
}

/// The samples flown so far, by index: those which succeeded and those which are infeasible.
#[utoipa::path(get, path = "/v1/studies/{study}/dataset", tag = "studies",
    params(("study" = StudyId, Path), DatasetParams),
    responses(
        (status = 200, content(
            (Vec<DatasetRow> = "application/json"),
            (DatasetRow = "application/x-ndjson"),
            (String = "text/csv"),
            (String = "application/vnd.apache.parquet"),
        )),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 406, body = Problem, content_type = "application/problem+json"),
    ))]
async fn dataset(
    State(state): State<AppState>,
    asker: Asker,
    Id(study): Id<StudyId>,
    Params(params): Params<DatasetParams>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let format = format(params.format.as_deref(), &headers)?;
    let head = state.store().study_head(study).await?;
    let writer = Writer::new(format, params.provenance, study, &head.spec, &head.solver_version)
        .map_err(|e| ApiError::Internal(Box::new(e)))?;
    let expected = state.store().answered_samples(head.study).await?;
    let said = VecDeque::from([writer.head()]);
    let rows = Rows {
        state: state.clone(),
        asker,
        study: (head.study, study),
        provenance: params.provenance,
        expected,
        sent: 0,
        writer: Some(writer),
        after: -1,
        said,
    };
    let body = Body::from_stream(stream::try_unfold(rows, Rows::next));
    let headers = [(header::CONTENT_TYPE, format.media_type().to_owned()), (ROWS, expected.to_string())];
    Ok((headers, body).into_response())
}

fn format(asked: Option<&str>, headers: &HeaderMap) -> Result<Format, ApiError> {
    if let Some(name) = asked {
        let refused = || ApiError::query("/format", format!("`{name}` is none of json, ndjson, csv and parquet"));
        return Format::named(name).ok_or_else(refused);
    }
    let accept = headers.get(header::ACCEPT).and_then(|value| value.to_str().ok());
    Format::accepted(accept).ok_or(ApiError::NotAcceptable { offered: Format::OFFERED })
}

/// A dataset being sent. No snapshot is held for slow clients: rows do not
/// change, so reading on after the last index is enough. A study may be removed
/// meanwhile; then the connection is broken off, for what was sent is not whole.
struct Rows {
    state: AppState,
    asker: Asker,
    study: (i64, StudyId),
    provenance: bool,
    /// Rows which were there at the beginning.
    expected: u64,
    sent: u64,
    writer: Option<Writer>,
    after: i64,
    said: VecDeque<Vec<u8>>,
}

impl Rows {
    async fn next(mut self) -> Result<Option<(Vec<u8>, Self)>, StoreError> {
        loop {
            match self.said.pop_front() {
                Some(part) if part.is_empty() => continue,
                Some(part) => return Ok(Some((part, self))),
                None => {}
            }
            let Some(writer) = self.writer.take() else { return Ok(None) };
            let read = self.read(writer).await;
            if let Err(error) = &read {
                // The status is long sent: the broken-off body is all the client sees.
                tracing::error!(study.id = %self.study.1, error.cause = %chain(error), "A dataset broke off");
            }
            read?;
        }
    }

    async fn read(&mut self, mut writer: Writer) -> Result<(), StoreError> {
        let (number, id) = self.study;
        let turn = self.state.heavy().part(self.asker).await;
        let rows = self.state.store().samples_after(number, Some(id), self.after, CHUNK).await?;
        let (last, provenance) = (rows.last().map(|row| row.ordinal), self.provenance);
        self.sent += rows.len() as u64;
        if last.is_none() && self.sent < self.expected {
            let (sent, of) = (self.sent, self.expected);
            return Err(StoreError::WrongState(format!(
                "rows were removed while they were sent: {sent} of {of} are left"
            )));
        }
        // Not on the threads which serve: rows are unpacked, parsed and written again.
        let written = spawn_blocking(move || {
            let _turn = turn;
            let rows = rows.into_iter().map(|row| row.parse(provenance)).collect::<Result<Vec<_>, _>>()?;
            let corrupt = |e: WriteError| StoreError::Corrupt(chain(&e));
            if last.is_none() {
                return Ok::<_, StoreError>((writer.end().map_err(corrupt)?, None));
            }
            let part = writer.rows(&rows).map_err(corrupt)?;
            Ok((part, Some(writer)))
        });
        let (part, writer) = written.await.map_err(|e| StoreError::Corrupt(e.to_string()))??;
        self.after = last.unwrap_or(self.after);
        self.writer = writer;
        self.said.push_back(part);
        Ok(())
    }
}
