//! Requests refused at the door: counted, and logged now and then.

use std::sync::Mutex;
use std::time::{Duration, Instant};

/// At most one line in this time, however many are refused.
const BETWEEN: Duration = Duration::from_secs(1);

/// Counts what happens and says when it is time to tell of it.
#[derive(Debug, Default)]
pub(crate) struct Throttle {
    seen: Mutex<(Option<Instant>, u64)>,
}

impl Throttle {
    /// Counts one more; returns how many there were since the last line if it is time for another.
    pub(crate) fn count(&self, now: Instant) -> Option<u64> {
        self.told(now, 1)
    }

    /// Returns how many were counted after the last line, once it is time for another.
    pub(crate) fn rest(&self, now: Instant) -> Option<u64> {
        self.told(now, 0)
    }

    fn told(&self, now: Instant, more: u64) -> Option<u64> {
        let Ok(mut seen) = self.seen.lock() else { return None };
        seen.1 = seen.1.saturating_add(more);
        let early = seen.0.is_some_and(|last| now.duration_since(last) < BETWEEN);
        if early || seen.1 == 0 {
            return None;
        }
        seen.0 = Some(now);
        Some(std::mem::take(&mut seen.1))
    }
}

/// Lines about requests refused for their token.
#[derive(Debug, Default)]
pub(crate) struct Refusals {
    /// No token, or an unknown one.
    unknown: Throttle,
    /// A token that does not allow what was asked.
    forbidden: Throttle,
}

impl Refusals {
    /// Notes a request without a valid token.
    pub(crate) fn unknown(&self, method: &str, path: &str) {
        if let Some(count) = self.unknown.count(Instant::now()) {
            tracing::warn!(
                request.count = count,
                request.method = method,
                request.path = shortened(path),
                "Requests without a valid token refused"
            );
        }
    }

    /// Notes a request that its token does not allow.
    pub(crate) fn forbidden(&self, token: Option<&str>, method: &str, path: &str) {
        if let Some(count) = self.forbidden.count(Instant::now()) {
            tracing::warn!(
                request.count = count,
                request.method = method,
                request.path = shortened(path),
                by = token,
                "Requests refused which their token does not allow"
            );
        }
    }

    /// Tells of those that came after the last lines.
    pub(crate) fn tell_rest(&self) {
        let now = Instant::now();
        if let Some(count) = self.unknown.rest(now) {
            tracing::warn!(request.count = count, "Further requests without a valid token refused");
        }
        if let Some(count) = self.forbidden.rest(now) {
            tracing::warn!(request.count = count, "Further requests refused which their token does not allow");
        }
    }
}

/// A path as a log line has it.
fn shortened(path: &str) -> &str {
    path.char_indices().nth(200).map_or(path, |(end, _)| &path[..end])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_makes_one_line_a_second_and_each_is_counted() {
        let (throttle, start) = (Throttle::default(), Instant::now());
        let at = |ms| start + Duration::from_millis(ms);
        assert_eq!(throttle.rest(at(0)), None);
        assert_eq!(throttle.count(at(0)), Some(1), "the first is told at once");
        assert!((1..1000).all(|i| throttle.count(at(i % 900)).is_none()));
        assert_eq!(throttle.rest(at(1000)), Some(999));
        assert_eq!((throttle.rest(at(2500)), throttle.count(at(2500))), (None, Some(1)));
        assert_eq!(shortened(&"ä".repeat(300)).chars().count(), 200);
    }
}
