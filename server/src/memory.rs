//! Memory for the bodies of requests: however many come at once, together they have so much and no more.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

use crate::error::ApiError;
use crate::fair::{Asker, Fair, Turn};

/// Memory of all bodies together but the large ones, bytes.
pub const BODIES: usize = 256 << 20;
/// Bytes a byte of a body may cost until its request is done with it: itself, what is read from it,
/// and what is written of that.
const FACTOR: usize = 4;
/// Bytes of each body outside this account; connections are bounded.
const FREE: usize = 16 << 10;
/// What memory is counted in, bytes.
const UNIT: usize = 16 << 10;
/// Large bodies at once.
pub const LARGE: usize = 2;
/// Large bodies which wait.
const LARGE_WAITING: usize = 32;
/// The memory there is.
#[derive(Debug)]
pub(crate) struct Memory {
    units: Arc<Semaphore>,
    large: Fair,
    parsing: Arc<Semaphore>,
    waits: Waits,
}

/// How long is waited for memory.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Waits {
    /// By a large body for its place.
    large: Duration,
    /// How long a large body may take to arrive while another waits for its place: less than that one waits.
    pressed: Duration,
    /// By others, at least.
    least: Duration,
    /// And where nearly all of them has come: those which hold much go first, and give it back.
    most: Duration,
}

impl Default for Waits {
    fn default() -> Self {
        let seconds = Duration::from_secs;
        Self { large: seconds(10), pressed: seconds(8), least: seconds(1), most: seconds(10) }
    }
}

#[cfg(test)]
impl Waits {
    /// Waits for and of large bodies.
    pub(crate) fn of_large(large: Duration, pressed: Duration) -> Self {
        Self { large, pressed, ..Self::default() }
    }
}

impl Memory {
    /// All of it, with so many bodies parsed at once.
    pub(crate) fn new(parsing: usize, waits: Waits) -> Self {
        Self {
            waits,
            units: Arc::new(Semaphore::new(BODIES / UNIT)),
            large: Fair::new(LARGE, LARGE_WAITING, waits.large),
            parsing: Arc::new(Semaphore::new(parsing)),
        }
    }

    /// A share for a body which has none yet.
    pub(crate) fn none(&self) -> Held {
        Held { units: self.units.clone(), held: None, place: None, waits: self.waits }
    }

    /// One of the few places of large bodies. Askers take turns.
    ///
    /// # Errors
    /// When none becomes free in time.
    pub(crate) async fn large(&self, asker: Asker) -> Result<Held, ApiError> {
        let place = self.large.take(asker).await.map_err(|_| ApiError::Crowded)?;
        Ok(Held { place: Some(place), ..self.none() })
    }

    /// A turn at parsing: more threads at once would only slow each other and those which serve.
    pub(crate) async fn turn(&self) -> Option<OwnedSemaphorePermit> {
        self.parsing.clone().acquire_owned().await.ok()
    }
}

/// Memory one body holds, given back when dropped.
#[derive(Debug)]
pub(crate) struct Held {
    units: Arc<Semaphore>,
    held: Option<OwnedSemaphorePermit>,
    /// The place of a large body, for which all there is room for is set aside.
    place: Option<Turn>,
    waits: Waits,
}

impl Held {
    /// How long its body may take to arrive, if another waits for the place it has.
    pub(crate) fn pressed(&self) -> Option<Duration> {
        self.place.as_ref().filter(|place| place.is_waited_for()).map(|_| self.waits.pressed)
    }

    /// Holds enough for a body of `length` bytes, of at most `limit`.
    ///
    /// # Errors
    /// When there is no memory, and none is given back in time.
    pub(crate) async fn grow(&mut self, length: usize, limit: usize) -> Result<(), ApiError> {
        if self.place.is_some() {
            return Ok(());
        }
        let wanted = (length.saturating_sub(FREE) * FACTOR).div_ceil(UNIT);
        let more = wanted.saturating_sub(self.held.as_ref().map_or(0, OwnedSemaphorePermit::num_permits));
        let Some(more) = u32::try_from(more).ok().filter(|more| *more > 0) else { return Ok(()) };
        let share = length as f64 / limit.max(1) as f64;
        let Waits { least, most, .. } = self.waits;
        let patience = least + (most - least).mul_f64(share.clamp(0.0, 1.0));
        let got = timeout(patience, self.units.clone().acquire_many_owned(more)).await;
        let got = got.ok().and_then(Result::ok).ok_or(ApiError::Crowded)?;
        match &mut self.held {
            Some(held) => held.merge(got),
            none => *none = Some(got),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn memory() -> Memory {
        let short = Duration::from_millis(20);
        Memory::new(1, Waits { large: short, pressed: short, least: short, most: short })
    }

    #[tokio::test]
    async fn bodies_share_what_there_is_and_give_it_back() {
        let memory = memory();
        let limit = BODIES / FACTOR + FREE;
        let (mut first, mut second) = (memory.none(), memory.none());
        first.grow(FREE, limit).await.expect("is outside the account");
        first.grow(limit, limit).await.expect("all there is");
        first.grow(limit, limit).await.expect("has it already");
        second.grow(FREE, limit).await.expect("a small body never waits");
        assert!(matches!(second.grow(FREE + 1, limit).await, Err(ApiError::Crowded)));
        drop(first);
        second.grow(limit, limit).await.expect("was given back");
    }

    #[tokio::test]
    async fn few_large_bodies_are_taken_at_once() {
        let memory = memory();
        let mut held = Vec::new();
        for _ in 0..LARGE {
            held.push(memory.large(Asker::default()).await.expect("a place"));
        }
        assert!(matches!(memory.large(Asker::default()).await, Err(ApiError::Crowded)));
        held.pop();
        memory.large(Asker::default()).await.expect("a place").grow(1 << 30, 1).await.expect("needs no more");
    }
}
