//! The coordinator's one clock.

use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// Milliseconds since 1970. Whatever decides on time is given one of these, so
/// that tests move time by hand.
pub trait Clock: Send + Sync + 'static {
    /// Now.
    fn now_ms(&self) -> i64;
}

/// The wall clock as it was at the start, carried on by the monotonic clock: a
/// step of the system's clock neither expires a lease nor keeps one alive.
#[derive(Debug, Clone, Copy)]
pub struct SystemClock {
    wall_ms: i64,
    since: Instant,
}

impl SystemClock {
    /// Starts from the wall clock of this moment.
    pub fn start() -> Self {
        let wall = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { wall_ms: crate::config::millis(wall), since: Instant::now() }
    }
}

impl Clock for SystemClock {
    fn now_ms(&self) -> i64 {
        self.wall_ms.saturating_add(crate::config::millis(self.since.elapsed()))
    }
}

/// A time of the store as RFC 3339 in UTC.
pub(crate) fn rfc3339(ms: i64) -> String {
    jiff::Timestamp::from_millisecond(ms).map(|t| t.to_string()).unwrap_or_default()
}
