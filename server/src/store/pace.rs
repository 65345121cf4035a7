//! Time in which the coordinator could take no renewals does not count against leases: it was stopped
//! (a paused container, a virtual machine which moves, a machine which swaps), or its disk held up a
//! commit. The sweep notices by when it last came by.

use super::{StoreError, Work};
use crate::config::{Config, millis};
use crate::event::Event;

/// When the sweep last came by.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pace {
    swept_ms: i64,
    /// Time in which renewals could be taken since all leases last had a full term.
    heard_ms: i64,
}

/// A time in which no renewals could be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Absence {
    missed_ms: i64,
    /// Whether every lease is given a full term, and not just the time missed.
    is_full: bool,
}

impl Pace {
    /// From now on, all leases just having been given a full term.
    pub(crate) fn start(now: i64) -> Self {
        Self { swept_ms: now, heard_ms: 0 }
    }

    /// The sweep comes by again.
    ///
    /// A coordinator which is away again and again gives a full term only after two terms of hearing in
    /// between: a worker which is gone would otherwise keep its jobs for as long as that goes on.
    pub(super) fn next(self, now: i64, config: &Config) -> (Self, Option<Absence>) {
        let (gap, away) = ((now - self.swept_ms).max(0), millis(config.away));
        if gap <= away {
            return (Self { swept_ms: now, heard_ms: self.heard_ms.saturating_add(gap) }, None);
        }
        // Of a gap, what is usual between two sweeps was heard.
        let usual = away.min(millis(config.sweep));
        let heard_ms = self.heard_ms.saturating_add(usual);
        let is_full = heard_ms >= 2 * config.lease_ms();
        let next = Self { swept_ms: now, heard_ms: if is_full { 0 } else { heard_ms } };
        (next, Some(Absence { missed_ms: gap - usual, is_full }))
    }
}

/// Gives leases the time which the coordinator has missed; attempts have not used it up either.
pub(super) async fn make_up(work: &mut Work<'_>, absence: Absence) -> Result<(), StoreError> {
    let Absence { missed_ms, is_full } = absence;
    let leases = sqlx::query(
        "update jobs set lease_until_ms = iif(?1, ?2, min(?2, lease_until_ms + ?3)), leased_ms = min(?4, leased_ms + ?3)
         where state = 'leased'",
    )
    .bind(is_full)
    .bind(work.now + work.config.lease_ms())
    .bind(missed_ms)
    .bind(work.now)
    .execute(&mut *work.db)
    .await?;
    work.events.push(Event::Resumed { leases: leases.rows_affected(), missed_s: missed_ms as f64 * 1e-3 });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a sweep at each of these times finds missing, ms.
    fn missed(times: &[i64]) -> Vec<Option<(i64, bool)>> {
        let config = Config::new("x");
        let mut pace = Pace::start(0);
        let mut look = |&now: &i64| {
            let (next, absence) = pace.next(now, &config);
            pace = next;
            absence.map(|a| (a.missed_ms, a.is_full))
        };
        times.iter().map(&mut look).collect()
    }

    #[test]
    fn an_absence_gives_a_full_term_and_the_next_one_what_it_took() {
        // Half a minute of hearing, away for 20 s, and again a second later.
        let usual: Vec<i64> = (1..=60).map(|i| 500 * i).collect();
        let times: Vec<i64> = usual.iter().copied().chain([50_000, 50_500, 51_000, 71_000]).collect();
        let found = missed(&times);
        assert!(found[..60].iter().all(Option::is_none));
        assert_eq!(found[60..], [Some((19_500, true)), None, None, Some((19_500, false))]);
    }

    #[test]
    fn a_coordinator_which_is_always_late_still_lets_leases_end() {
        // Each sweep is 4 s after the last: half a second of each is counted.
        let times: Vec<i64> = (1..=58).map(|i| 4000 * i).collect();
        let found = missed(&times);
        let counted: i64 = times.len() as i64 * 4000 - found.iter().flatten().map(|(missed, _)| missed).sum::<i64>();
        assert!(counted > 15_000 && found.iter().flatten().all(|(_, full)| !full), "{counted}");
    }

    #[test]
    fn a_clock_which_stands_still_is_no_absence() {
        assert_eq!(missed(&[0, 0, 400, 4000]), [None; 4]);
    }
}
