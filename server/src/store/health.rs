//! Whether the store takes changes, told to those who ask beside the writer.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;

use super::place::Place;
use super::{Exchanged, StoreError};

/// What the writer and those who ask share.
#[derive(Debug)]
pub(super) struct Health {
    pub(super) place: Place,
    failing: Mutex<Option<Failing>>,
    /// Why workers are given no answer, though changes are taken.
    exchanges: Mutex<Option<String>>,
    /// Cancelled when the writer has ended.
    pub(super) ended: CancellationToken,
}

/// Since when changes have been refused.
#[derive(Debug)]
struct Failing {
    since: Instant,
    cause: String,
}

impl Health {
    pub(super) fn new(place: Place) -> Self {
        Self { place, failing: Mutex::default(), exchanges: Mutex::default(), ended: CancellationToken::new() }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Option<Failing>> {
        self.failing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes that changes were refused. Returns whether that is news.
    pub(super) fn fail(&self, cause: String) -> bool {
        let mut failing = self.lock();
        let since = failing.as_ref().map_or_else(Instant::now, |f| f.since);
        let is_news = failing.as_ref().is_none_or(|f| f.cause != cause);
        *failing = Some(Failing { since, cause });
        is_news
    }

    /// Notes that changes were taken. Returns whether that is news.
    pub(super) fn recover(&self) -> bool {
        self.lock().take().is_some()
    }

    /// Notes whether the exchanges of a batch could be answered: rows that cannot be read fail them.
    pub(super) fn note_exchanges(&self, told: &[Result<Exchanged, StoreError>]) {
        let trouble = |told: &Result<_, StoreError>| match told {
            Err(
                error @ (StoreError::Corrupt(_)
                | StoreError::Unreadable(..)
                | StoreError::Sql(_)
                | StoreError::Panicked),
            ) => Some(crate::error::chain(error)),
            _ => None,
        };
        let Some(first) = told.first() else { return };
        let cause = trouble(first).filter(|_| told.iter().all(|told| trouble(told).is_some()));
        *self.exchanges.lock().unwrap_or_else(PoisonError::into_inner) = cause;
    }

    /// Whether the last change was refused.
    pub(super) fn is_failing(&self) -> bool {
        self.lock().is_some()
    }

    /// For how long changes have been refused, and why.
    pub(super) fn failing(&self) -> Option<(Duration, String)> {
        self.lock().as_ref().map(|f| (f.since.elapsed(), f.cause.clone()))
    }

    /// Whether the files of the database were removed or replaced.
    pub(super) fn is_gone(&self) -> bool {
        self.place.check().is_err()
    }

    /// Looks whether changes are taken.
    ///
    /// # Errors
    /// When they are not, with the reason.
    pub(super) fn check(&self) -> Result<(), StoreError> {
        if self.ended.is_cancelled() {
            return Err(StoreError::Closed);
        }
        self.place.check()?;
        let exchanges = self.exchanges.lock().unwrap_or_else(PoisonError::into_inner).clone();
        match self.failing().map(|(_, cause)| cause).or(exchanges) {
            Some(cause) => Err(StoreError::Failing(cause)),
            None => Ok(()),
        }
    }
}
