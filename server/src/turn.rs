//! What the coordinator computes while a client waits, strokes and fronts: one at a time, a few
//! wait, and the last answers are kept.

use std::collections::VecDeque;
use std::error::Error;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use axum::body::Bytes;
use manduca_protocol::flight::WakeChoice;
use manduca_protocol::ids::StudyId;
use tokio_util::sync::CancellationToken;

use crate::error::ApiError;
use crate::fair::{Asker, Fair};

/// How many wait for the one that is computed.
pub(crate) const QUEUE: usize = 8;
/// Answers kept; one has at most some 4 MB.
const KEPT: usize = 16;

/// What an answer is to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Key {
    /// The task's own key, and which wake is shown.
    Flight([u8; 32], Option<WakeChoice>),
    /// Study, optimisation, place of the parameter in the table, points.
    Front(StudyId, Option<String>, usize, u32),
}

/// How long one waits at most: all before it may take half a minute each.
const PATIENCE: Duration = Duration::from_secs(600);

/// Those whose turn it is, those who wait, and what was answered.
#[derive(Debug)]
pub(crate) struct Turns {
    turns: Fair,
    answers: Mutex<VecDeque<(Key, Bytes)>>,
}

impl Default for Turns {
    fn default() -> Self {
        Self { turns: Fair::new(1, QUEUE, PATIENCE), answers: Mutex::default() }
    }
}

impl Turns {
    /// Computes an answer, unless it is known, on a thread of its own; `compute` asks now and then whether to go on,
    /// and gives none where it was not to. A client which hangs up stops it, and so does a coordinator which is
    /// `stopping`. Askers take turns.
    ///
    /// # Errors
    /// When too many wait, the coordinator stops, or `compute` fails.
    pub(crate) async fn take<E: Error + Send + Sync + 'static>(
        &self,
        key: Key,
        asker: Asker,
        stopping: &CancellationToken,
        compute: impl FnOnce(&dyn Fn() -> bool) -> Result<Option<Bytes>, E> + Send + 'static,
    ) -> Result<Bytes, ApiError> {
        if let Some(known) = self.known(&key) {
            return Ok(known);
        }
        let turn = tokio::select! {
            () = stopping.cancelled() => return Err(ApiError::Stopping),
            turn = self.turns.take(asker) => turn?,
        };
        // The same may have been asked for while this one waited.
        if let Some(known) = self.known(&key) {
            return Ok(known);
        }
        let stop = stopping.child_token();
        let hung_up = stop.clone().drop_guard();
        let computing = tokio::task::spawn_blocking(move || {
            let computed = compute(&|| !stop.is_cancelled());
            // Held until it has ended, whoever still waits for it.
            drop(turn);
            computed
        });
        let computed = computing.await.map_err(|e| ApiError::Internal(Box::new(e)))?;
        drop(hung_up);
        let answer = computed.map_err(|e| ApiError::Internal(Box::new(e)))?.ok_or(ApiError::Stopping)?;
        self.keep(key, answer.clone());
        Ok(answer)
    }

    fn known(&self, key: &Key) -> Option<Bytes> {
        let mut answers = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
        let place = answers.iter().position(|(known, _)| known == key)?;
        // What is asked for again is forgotten last.
        let entry = answers.remove(place)?;
        answers.push_back(entry);
        answers.back().map(|(_, answer)| answer.clone())
    }

    fn keep(&self, key: Key, answer: Bytes) {
        let mut answers = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
        answers.push_back((key, answer));
        while answers.len() > KEPT {
            answers.pop_front();
        }
    }
}
