//! What changed lately, for those who watch. Nothing queues: a watcher who is slow is
//! told of many changes at once, and costs no more memory than a quick one.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use manduca_protocol::ids::StudyId;
use manduca_protocol::overview::ChangeMessage;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use crate::event::Event;

/// Studies whose last change is remembered; then all are forgotten, and watchers look at everything.
const MOST_STUDIES: usize = 1000;

/// When what changed last, in versions.
#[derive(Debug, Default)]
struct Latest {
    version: u64,
    /// Whoever saw no later version has missed something.
    floor: u64,
    studies: HashMap<StudyId, u64>,
    workers: u64,
}

/// The changes, and who may watch them.
#[derive(Debug)]
pub(crate) struct Changes {
    latest: Mutex<Latest>,
    told: watch::Sender<u64>,
    places: Arc<Semaphore>,
}

impl Changes {
    /// No changes yet, to be watched by so many.
    pub(crate) fn new(watchers: usize) -> Self {
        let places = Arc::new(Semaphore::new(watchers.min(Semaphore::MAX_PERMITS)));
        Self { latest: Mutex::default(), told: watch::Sender::new(0), places }
    }

    /// Takes up what was decided.
    pub(crate) fn observe(&self, events: &[Event]) {
        if !events.iter().any(|event| event.study().is_some() || event.is_of_workers()) {
            return;
        }
        let mut latest = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        latest.version += 1;
        let version = latest.version;
        for event in events {
            if let Some(study) = event.study() {
                if latest.studies.len() >= MOST_STUDIES && !latest.studies.contains_key(&study) {
                    latest.studies.clear();
                    latest.floor = version;
                }
                latest.studies.insert(study, version);
            }
            if event.is_of_workers() {
                latest.workers = version;
            }
        }
        drop(latest);
        self.told.send_replace(version);
    }

    /// A place among the watchers, if there is one.
    pub(crate) fn watch(&self) -> Option<Watcher> {
        let place = self.places.clone().try_acquire_owned().ok()?;
        Some(Watcher { told: self.told.subscribe(), seen: None, _place: place })
    }

    /// The version of the last change of a study, or one after it.
    pub(crate) fn version_of(&self, study: StudyId) -> u64 {
        let latest = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        latest.studies.get(&study).copied().unwrap_or(latest.floor)
    }

    /// What changed after a version.
    fn since(&self, seen: u64) -> (u64, ChangeMessage) {
        let latest = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        let mut studies: Vec<_> =
            latest.studies.iter().filter(|(_, at)| **at > seen).map(|(study, _)| *study).collect();
        studies.sort_unstable_by_key(|study| study.0);
        let change = ChangeMessage { studies, workers: latest.workers > seen, everything: latest.floor > seen };
        (latest.version, change)
    }
}

/// One who watches.
pub(crate) struct Watcher {
    told: watch::Receiver<u64>,
    /// The last version seen; none at first.
    seen: Option<u64>,
    _place: OwnedSemaphorePermit,
}

impl Watcher {
    /// The next change, of one study only where that is asked for. The first comes at once:
    /// who begins to watch has seen nothing. None when there will be no more.
    pub(crate) async fn next(&mut self, changes: &Changes, only: Option<StudyId>) -> Option<ChangeMessage> {
        let Some(mut seen) = self.seen else {
            self.seen = Some(*self.told.borrow_and_update());
            return Some(ChangeMessage { everything: true, ..ChangeMessage::default() });
        };
        loop {
            self.told.changed().await.ok()?;
            self.told.mark_unchanged();
            let (version, mut change) = changes.since(seen);
            (seen, self.seen) = (version, Some(version));
            if let Some(only) = only {
                change.studies.retain(|study| *study == only);
            }
            if change != ChangeMessage::default() {
                return Some(change);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn submitted(study: StudyId) -> Event {
        Event::Submitted { study, samples: 20, cached: 0, by: None }
    }

    #[tokio::test]
    async fn a_slow_watcher_is_told_once_of_all() {
        let changes = Changes::new(1);
        let mut watcher = changes.watch().expect("a place");
        assert!(changes.watch().is_none());
        assert!(watcher.next(&changes, None).await.expect("the first").everything);
        let (a, b) = (StudyId::new(), StudyId::new());
        changes.observe(&[Event::Ready]);
        for study in [a, b, a] {
            changes.observe(&[submitted(study)]);
        }
        let mut both = [a, b];
        both.sort_unstable_by_key(|study| study.0);
        let told = watcher.next(&changes, None).await.expect("a change");
        assert_eq!(told, ChangeMessage { studies: both.into(), workers: false, everything: false });
        changes.observe(&[submitted(b), Event::Leased { worker: manduca_protocol::ids::WorkerId::new(), jobs: 1 }]);
        let told = watcher.next(&changes, Some(a)).await.expect("a change");
        assert_eq!(told, ChangeMessage { studies: vec![], workers: true, everything: false });
        drop(watcher);
        assert!(changes.watch().is_some(), "the place is free again");
    }

    #[tokio::test]
    async fn who_missed_too_much_looks_at_everything() {
        let changes = Changes::new(1);
        let mut watcher = changes.watch().expect("a place");
        watcher.next(&changes, None).await;
        for _ in 0..=MOST_STUDIES {
            changes.observe(&[submitted(StudyId::new())]);
        }
        let told = watcher.next(&changes, None).await.expect("a change");
        assert!(told.everything && told.studies.len() == 1);
    }
}
