//! How fast jobs finish, from the last minute.

use std::collections::{HashMap, VecDeque};
use std::sync::Mutex;

use manduca_protocol::ids::StudyId;

/// How far back is looked, ms.
const WINDOW_MS: i64 = 60_000;

/// Completions of one study's present stage, summed by second.
#[derive(Debug, Default)]
struct Recent {
    /// When the stage began as seen here, ms.
    since_ms: i64,
    /// Second and completions in it, oldest first, at most a window of them.
    seconds: VecDeque<(i64, u32)>,
}

/// Completions per study. In memory only: after a restart it fills again.
#[derive(Debug, Default)]
pub(crate) struct Rates {
    studies: Mutex<HashMap<StudyId, Recent>>,
}

impl Rates {
    /// Notes that a job of the study was computed.
    pub(crate) fn completed(&self, study: StudyId, now_ms: i64) {
        let Ok(mut studies) = self.studies.lock() else { return };
        let recent = studies.entry(study).or_insert_with(|| Recent { since_ms: now_ms - 1000, ..Recent::default() });
        let second = now_ms / 1000;
        match recent.seconds.back_mut() {
            Some((last, n)) if *last == second => *n += 1,
            _ => recent.seconds.push_back((second, 1)),
        }
        while recent.seconds.front().is_some_and(|&(s, _)| s * 1000 < now_ms - WINDOW_MS) {
            recent.seconds.pop_front();
        }
    }

    /// Forgets a study: its stage changed, and the next one's jobs take another time.
    pub(crate) fn forget(&self, study: StudyId) {
        if let Ok(mut studies) = self.studies.lock() {
            studies.remove(&study);
        }
    }

    /// Jobs per second over the window, or since the stage's first completion.
    pub(crate) fn per_second(&self, study: StudyId, now_ms: i64) -> Option<f64> {
        let studies = self.studies.lock().ok()?;
        let recent = studies.get(&study)?;
        let from_ms = recent.since_ms.max(now_ms - WINDOW_MS);
        let jobs: u32 = recent.seconds.iter().filter(|(s, _)| (s + 1) * 1000 > from_ms).map(|(_, n)| n).sum();
        let span_s = (now_ms - from_ms).max(1000) as f64 / 1000.0;
        (jobs > 0).then(|| f64::from(jobs) / span_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_of_the_last_minute() {
        let (rates, study) = (Rates::default(), StudyId::new());
        assert_eq!(rates.per_second(study, 0), None);
        for second in 0..120 {
            rates.completed(study, second * 1000);
            rates.completed(study, second * 1000 + 500);
        }
        let rate = rates.per_second(study, 120_000).expect("jobs were completed");
        assert!((rate - 2.0).abs() < 0.1, "{rate}");
        assert_eq!(rates.per_second(study, 300_000), None);
        rates.forget(study);
        assert_eq!(rates.per_second(study, 120_000), None);
    }
}
