//! Jobs which wait although nobody is there to take them.

use std::time::{Duration, Instant};

use manduca_protocol::view::{StudyState, StudyView};
use manduca_protocol::watch::ScalingView;

/// How long jobs may wait without a worker before that is said: one may be about to come.
const PATIENCE: Duration = Duration::from_secs(5);
/// Until it is said again.
const AGAIN: Duration = Duration::from_secs(300);

/// When to say that no worker is there.
#[derive(Debug, Default)]
pub struct Workless {
    /// Since when jobs have waited for a worker.
    since: Option<Instant>,
    said: Option<Instant>,
}

/// Whether jobs of a study wait and none of them runs.
pub fn waits(view: &StudyView) -> bool {
    let jobs = &view.stage_jobs;
    let may_run = !matches!(view.state, StudyState::Paused) && !super::is_over(view.state);
    may_run && jobs.leased == 0 && view.progress.is_none()
}

impl Workless {
    /// Whether it is worth a question whether a worker is there.
    pub fn asks(&mut self, waits: bool, now: Instant) -> bool {
        if !waits {
            self.since = None;
            return false;
        }
        let since = *self.since.get_or_insert(now);
        let said = self.said.is_none_or(|said| now.duration_since(said) >= AGAIN);
        now.duration_since(since) >= PATIENCE && said
    }

    /// What to say, if no slot is there which may be given jobs.
    pub fn says(&mut self, there: &ScalingView, address: &str, now: Instant) -> Option<String> {
        if there.slots > 0 {
            // Others' jobs may be before these: the next question after as long a wait.
            self.since = Some(now);
            return None;
        }
        self.said = Some(now);
        let kept =
            if there.workers > 0 { " which may be given jobs; `manduca workers list` says why, and" } else { ":" };
        Some(format!(
            "{} jobs wait and there is no worker{kept} `manduca worker --coordinator {address}` starts one",
            there.ready_jobs + there.delayed_jobs
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn there(workers: u64, slots: u64) -> ScalingView {
        ScalingView {
            ready_jobs: 60,
            delayed_jobs: 0,
            leased_jobs: 0,
            workers,
            slots,
            idle_slots: slots,
            wanted_slots: 60,
        }
    }

    #[test]
    fn it_is_said_after_some_seconds_and_rarely_again() {
        let begin = Instant::now();
        let at = |s: u64| begin + Duration::from_secs(s);
        let mut workless = Workless::default();
        assert!(!workless.asks(true, at(0)) && !workless.asks(true, at(4)) && workless.asks(true, at(5)));
        let said = workless.says(&there(0, 0), "http://x:1", at(5)).unwrap();
        assert!(said.contains("60 jobs wait") && said.contains("manduca worker --coordinator http://x:1"), "{said}");
        assert!(!workless.asks(true, at(6)) && !workless.asks(true, at(304)) && workless.asks(true, at(305)));
        // A job runs: the wait begins anew.
        assert!(!workless.asks(false, at(306)) && !workless.asks(true, at(700)) && workless.asks(true, at(705)));
        assert!(workless.says(&there(2, 0), "http://x:1", at(705)).unwrap().contains("may be given jobs"));
    }

    #[test]
    fn where_a_worker_is_nothing_is_said() {
        let begin = Instant::now();
        let at = |s: u64| begin + Duration::from_secs(s);
        let mut workless = Workless::default();
        workless.asks(true, at(0));
        assert!(workless.asks(true, at(9)) && workless.says(&there(1, 4), "http://x", at(9)).is_none());
        assert!(!workless.asks(true, at(10)) && workless.asks(true, at(14)));
    }
}
