//! The task of a training, streamed: its dataset may be of 200,000 samples.

use axum::body::{Body, Bytes};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use manduca_protocol::task::Task;
use tokio::task::spawn_blocking;

use crate::error::{ApiError, chain};
use crate::fair::Asker;
use crate::state::AppState;
use crate::store::StoreError;

/// The place of the samples in a task without any.
const PLACE: &[u8] = b"\"dataset\":[]";

/// A training's samples being sent, with what stands before and after them.
struct Samples {
    state: AppState,
    asker: Asker,
    study: i64,
    /// Samples there are: a study removed meanwhile must not look like one with fewer.
    expected: u64,
    sent: u64,
    after: i64,
    head: Option<Vec<u8>>,
    tail: Option<Vec<u8>>,
}

/// Answers with a task which lacks its dataset, and the samples of a study in their place.
///
/// # Errors
/// When the task cannot be written.
pub(super) async fn respond(state: &AppState, asker: Asker, study: i64, task: &Task) -> Result<Response, ApiError> {
    let json = serde_json::to_vec(task).map_err(|e| ApiError::Internal(Box::new(e)))?;
    let place = json.windows(PLACE.len()).position(|part| part == PLACE);
    let place = place.ok_or_else(|| StoreError::Corrupt("a training's task has no place for samples".into()))?;
    let (head, tail) = json.split_at(place + PLACE.len() - 1);
    let samples = Samples {
        state: state.clone(),
        asker,
        study,
        expected: state.store().sample_counts(study).await?.succeeded,
        sent: 0,
        after: -1,
        head: Some(head.to_vec()),
        tail: Some(tail.to_vec()),
    };
    let body = Body::from_stream(stream::try_unfold(samples, Samples::next));
    Ok(([(header::CONTENT_TYPE, "application/json")], body).into_response())
}

impl Samples {
    async fn next(mut self) -> Result<Option<(Bytes, Self)>, ApiError> {
        if let Some(head) = self.head.take() {
            return Ok(Some((head.into(), self)));
        }
        loop {
            match self.part().await {
                // A part may be of strokes none of which could be flown.
                Ok(Some(part)) if part.is_empty() => {}
                Ok(part) => return Ok(part.map(|part| (part, self))),
                Err(error) => {
                    // The status is long sent: the broken-off body is all the worker sees, and it asks again.
                    tracing::warn!(error.cause = %chain(&error), "The task of a training broke off");
                    return Err(error);
                }
            }
        }
    }

    /// The next samples, then what stands after them, then nothing.
    async fn part(&mut self) -> Result<Option<Bytes>, ApiError> {
        if self.tail.is_none() {
            return Ok(None);
        }
        let turn = self.state.heavy().part(self.asker).await;
        let rows = self.state.store().train_samples_after(self.study, self.after).await?;
        let Some((samples, last)) = rows else {
            if self.sent != self.expected {
                return Err(StoreError::Corrupt("samples of a training are gone".into()).into());
            }
            return Ok(self.tail.take().map(Bytes::from));
        };
        let begins = self.sent == 0;
        (self.after, self.sent) = (last, self.sent + samples.len() as u64);
        if samples.is_empty() {
            return Ok(Some(Bytes::new()));
        }
        let written = spawn_blocking(move || {
            let json = serde_json::to_vec(&samples);
            drop(turn);
            json
        });
        let written = written.await.map_err(|e| ApiError::Internal(Box::new(e)))?;
        let mut json = written.map_err(|e| ApiError::Internal(Box::new(e)))?;
        // A list without its brackets, and with a comma before it where others have been sent.
        json.pop();
        match json.first_mut() {
            Some(first) if !begins => *first = b',',
            _ => drop(json.drain(..1)),
        }
        Ok(Some(json.into()))
    }
}
