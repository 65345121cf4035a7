//! Calls which fail, one after the other: when to try again, and when to say so.

use std::collections::HashSet;
use std::time::Duration;

use tokio::time::Instant;

use crate::backoff::Backoff;
use crate::http::{CallError, Class};

/// How often the same trouble is told.
const AGAIN: Duration = Duration::from_secs(60);

/// Failures in a row.
#[derive(Debug, Default)]
pub(crate) struct Trouble {
    backoff: Backoff,
    told: HashSet<Class>,
    told_at: Option<Instant>,
}

impl Trouble {
    /// Notes one more failure; gives the wait before the next try, and whether there is something to
    /// tell: failures of a new kind are told at once, others every minute.
    pub(crate) fn add(&mut self, error: &CallError, now: Instant) -> (Duration, bool) {
        if self.told_at.is_none_or(|at| now.duration_since(at) >= AGAIN) {
            self.told.clear();
            self.told_at = Some(now);
        }
        (self.backoff.next(), self.told.insert(error.class()))
    }

    /// Forgets the failures; says whether there were any.
    pub(crate) fn is_over(&mut self) -> bool {
        self.told.clear();
        self.told_at = None;
        self.backoff.reset()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_told_once_for_each_kind_and_again_after_a_while() {
        let foreign = |status| CallError::Foreign { url: "x".into(), status, what: String::new() };
        let (mut trouble, now) = (Trouble::default(), Instant::now());
        let told = [404, 404, 502, 404, 502].map(|status| trouble.add(&foreign(status), now).1);
        assert_eq!(told, [true, false, true, false, false]);
        let later = now + AGAIN;
        assert_eq!([404, 404].map(|status| trouble.add(&foreign(status), later).1), [true, false]);
        assert!(trouble.is_over() && !trouble.is_over());
        assert!(trouble.add(&foreign(404), later).1);
    }
}
