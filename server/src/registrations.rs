//! How often a token may register workers.

use std::collections::HashMap;
use std::sync::Mutex;

/// What is left to a token, and as of when.
#[derive(Debug, Clone, Copy)]
struct Bucket {
    left: f64,
    at_ms: i64,
}

/// A bucket for each token: it holds a burst and fills again slowly. Whoever asks for no tokens counts nothing.
#[derive(Debug)]
pub(crate) struct Registrations {
    burst: f64,
    per_s: f64,
    buckets: Mutex<HashMap<String, Bucket>>,
}

impl Registrations {
    /// At most so many at once, and so many per second from then on.
    pub(crate) fn new(burst: u32, per_s: f64) -> Self {
        Self { burst: f64::from(burst), per_s, buckets: Mutex::default() }
    }

    /// Counts a registration.
    ///
    /// # Errors
    /// How many seconds to wait where there were too many.
    pub(crate) fn admit(&self, token: &str, now_ms: i64) -> Result<(), u64> {
        let Ok(mut buckets) = self.buckets.lock() else { return Ok(()) };
        let bucket = buckets.entry(token.to_owned()).or_insert(Bucket { left: self.burst, at_ms: now_ms });
        let passed_s = (now_ms - bucket.at_ms).max(0) as f64 / 1000.0;
        bucket.left = (bucket.left + passed_s * self.per_s).min(self.burst);
        bucket.at_ms = now_ms;
        if bucket.left >= 1.0 {
            bucket.left -= 1.0;
            return Ok(());
        }
        Err(((1.0 - bucket.left) / self.per_s).ceil().clamp(1.0, 3600.0) as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_burst_passes_and_then_a_trickle_for_each_token() {
        let registrations = Registrations::new(3, 0.5);
        assert!((0..3).all(|_| registrations.admit("a", 0).is_ok()));
        assert_eq!((registrations.admit("a", 0), registrations.admit("a", 1000)), (Err(2), Err(1)));
        assert!(registrations.admit("b", 0).is_ok());
        assert!(registrations.admit("a", 2000).is_ok() && registrations.admit("a", 2000).is_err());
        assert!((0..3).all(|_| registrations.admit("a", 1_000_000).is_ok()));
    }
}
