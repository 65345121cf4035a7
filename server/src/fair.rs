//! Turns at what takes long. A few run at once, a few wait, and askers take turns however much
//! each of them asks for.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};
use manduca_protocol::ids::WorkerId;
use tokio::sync::oneshot;

use crate::error::ApiError;

/// Among whom turns are shared: requests with the same token. All without one are one asker.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Asker(Option<blake3::Hash>);

impl Asker {
    /// The asker of a request with these headers, whose token was checked before.
    pub(crate) fn of(headers: &HeaderMap) -> Self {
        Self(headers.get(header::AUTHORIZATION).map(|value| blake3::hash(value.as_bytes())))
    }

    /// A worker, whatever its token: those of a cluster share one.
    pub(crate) fn of_worker(worker: WorkerId) -> Self {
        Self(Some(blake3::hash(worker.0.as_bytes())))
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Asker {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(Self::of(&parts.headers))
    }
}

/// Those who wait, by asker; the asker whose turn is next stands first.
#[derive(Debug, Default)]
struct Queue {
    running: usize,
    count: usize,
    waiting: VecDeque<(Asker, VecDeque<oneshot::Sender<()>>)>,
}

impl Queue {
    /// The next to have a turn: the first of the first asker, who then stands last.
    fn next(&mut self) -> Option<oneshot::Sender<()>> {
        let (asker, mut requests) = self.waiting.pop_front()?;
        let next = requests.pop_front();
        self.count -= usize::from(next.is_some());
        if !requests.is_empty() {
            self.waiting.push_back((asker, requests));
        }
        next
    }

    /// Adds a request, in the place of another asker's newest where all are taken and he has more.
    fn add(&mut self, asker: Asker, most: usize) -> Option<oneshot::Receiver<()>> {
        let own = self.waiting.iter().position(|(other, _)| *other == asker);
        if self.count >= most {
            let longest = self.waiting.iter().enumerate().max_by_key(|(_, (_, requests))| requests.len());
            let (longest, length) = longest.map(|(i, (_, requests))| (i, requests.len()))?;
            if length <= own.map_or(0, |i| self.waiting[i].1.len()) + 1 {
                return None;
            }
            self.waiting[longest].1.pop_back();
            self.count -= 1;
        }
        let (turn, told) = oneshot::channel();
        match own {
            Some(i) => self.waiting[i].1.push_back(turn),
            None => self.waiting.push_back((asker, VecDeque::from([turn]))),
        }
        self.count += 1;
        Some(told)
    }
}

/// Turns of one kind.
#[derive(Debug, Clone)]
pub(crate) struct Fair {
    queue: Arc<Mutex<Queue>>,
    most: usize,
    places: usize,
    patience: Duration,
}

impl Fair {
    /// So many turns at once, and so many who wait, none longer than `patience`.
    pub(crate) fn new(most: usize, places: usize, patience: Duration) -> Self {
        Self { queue: Arc::default(), most, places, patience }
    }

    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A turn, where there is one now.
    pub(crate) fn try_take(&self) -> Option<Turn> {
        let mut queue = self.lock();
        if queue.running >= self.most || queue.count > 0 {
            return None;
        }
        queue.running += 1;
        Some(Turn(self.clone()))
    }

    /// A turn, waited for if need be.
    ///
    /// # Errors
    /// When too many wait, or it takes too long.
    pub(crate) async fn take(&self, asker: Asker) -> Result<Turn, ApiError> {
        if let Some(turn) = self.try_take() {
            return Ok(turn);
        }
        let told = self.lock().add(asker, self.places).ok_or(ApiError::Busy)?;
        let mut waiting = Waiting { fair: self, told: Some(told) };
        let told = tokio::time::timeout(self.patience, waiting.told()).await;
        if !told.unwrap_or(false) {
            return Err(ApiError::Busy);
        }
        waiting.told = None;
        Ok(Turn(self.clone()))
    }

    /// Hands a turn which has ended on.
    fn give(&self) {
        loop {
            let next = {
                let mut queue = self.lock();
                let next = queue.next();
                if next.is_none() && queue.waiting.is_empty() {
                    queue.running -= 1;
                    return;
                }
                next
            };
            // One which has gone away meanwhile is passed over.
            if next.is_some_and(|next| next.send(()).is_ok()) {
                return;
            }
        }
    }
}

/// One who waits. Gone away after having been given a turn, he hands it on.
struct Waiting<'f> {
    fair: &'f Fair,
    told: Option<oneshot::Receiver<()>>,
}

impl Waiting<'_> {
    /// Whether his turn has come; false where another took his place.
    async fn told(&mut self) -> bool {
        match &mut self.told {
            Some(told) => told.await.is_ok(),
            None => false,
        }
    }
}

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        let Some(mut told) = self.told.take() else { return };
        told.close();
        if told.try_recv().is_ok() {
            self.fair.give();
        }
    }
}

/// A turn, which ends when dropped.
#[derive(Debug)]
pub(crate) struct Turn(Fair);

impl Turn {
    /// Whether somebody waits for one like it.
    pub(crate) fn is_waited_for(&self) -> bool {
        self.0.lock().count > 0
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        self.0.give();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    fn asker(name: &str) -> Asker {
        Asker(Some(blake3::hash(name.as_bytes())))
    }

    /// Lets everything go on until it waits.
    async fn settle() {
        for _ in 0..50 {
            tokio::task::yield_now().await;
        }
    }

    #[tokio::test]
    async fn askers_take_turns_however_much_each_asks_for() {
        let fair = Fair::new(1, 8, Duration::from_secs(60));
        let first = fair.take(asker("greedy")).await.expect("is free");
        let order = Arc::new(Mutex::new(Vec::new()));
        let mut asked = Vec::new();
        for name in ["greedy", "greedy", "greedy", "modest", "shy"] {
            let (fair, order) = (fair.clone(), order.clone());
            asked.push(tokio::spawn(async move {
                let turn = fair.take(asker(name)).await.expect("a turn");
                order.lock().expect("not poisoned").push(name);
                drop(turn);
            }));
            settle().await;
        }
        assert!(fair.try_take().is_none());
        drop(first);
        for task in asked {
            task.await.expect("ends");
        }
        assert_eq!(*order.lock().expect("not poisoned"), ["greedy", "modest", "shy", "greedy", "greedy"]);
        assert!(fair.try_take().is_some(), "all turns were given back");
    }

    #[tokio::test]
    async fn who_has_most_places_makes_room_and_is_told_to_come_again() {
        let fair = Fair::new(1, 4, Duration::from_secs(60));
        let running = fair.take(asker("greedy")).await.expect("is free");
        let refused = Arc::new(AtomicUsize::new(0));
        let ask = |name: &'static str| {
            let (fair, refused) = (fair.clone(), refused.clone());
            tokio::spawn(async move {
                let taken = fair.take(asker(name)).await;
                refused.fetch_add(usize::from(matches!(taken, Err(ApiError::Busy))), Ordering::SeqCst);
                taken.is_ok()
            })
        };
        let greedy: Vec<_> = (0..4).map(|_| ask("greedy")).collect();
        settle().await;
        assert!(matches!(fair.take(asker("greedy")).await, Err(ApiError::Busy)), "all places are his own");
        let modest = ask("modest");
        settle().await;
        assert_eq!(refused.load(Ordering::SeqCst), 1);
        drop(running);
        assert!(modest.await.expect("ends"));
        let mut served = 0;
        for task in greedy {
            served += usize::from(task.await.expect("ends"));
        }
        assert_eq!(served, 3);
    }

    #[tokio::test]
    async fn a_turn_given_to_one_who_left_goes_to_the_next() {
        let fair = Fair::new(1, 8, Duration::from_millis(50));
        let running = fair.take(Asker::default()).await.expect("is free");
        let gone = tokio::spawn({
            let fair = fair.clone();
            async move { fair.take(asker("gone")).await.is_ok() }
        });
        settle().await;
        gone.abort();
        settle().await;
        drop(running);
        assert!(fair.take(asker("next")).await.is_ok());
        // Nobody gives the turn back in time.
        let running = fair.take(Asker::default()).await.expect("is free");
        assert!(matches!(fair.take(asker("late")).await, Err(ApiError::Busy)));
        drop(running);
        assert!(fair.try_take().is_some());
    }
}
