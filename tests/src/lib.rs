//! Helpers of the tests which start `manduca` as real processes: what is tested
//! is what users run, with its signals, its sockets and its files.
//!
//! A helper that cannot do its part panics: no test could go on without it.

pub mod bulk;
pub mod chance;
pub mod client;
pub mod coordinator;
pub mod crowd;
pub mod process;
pub mod program;
pub mod proxy;
#[cfg(target_os = "linux")]
pub mod shim;
pub mod slow;
pub mod studies;
pub mod tls;

pub use manduca_numerics::simulation::SOLVER_VERSION;

use std::time::{Duration, Instant};

/// When a test is given up as hung. No test measures time; this only ends one
/// which would never end by itself.
pub fn deadline() -> Duration {
    Duration::from_secs(if is_long() { 1800 } else { 240 })
}

/// Whether faults are to be tried in their long form (`MANDUCA_FAULTS=long`).
pub fn is_long() -> bool {
    std::env::var("MANDUCA_FAULTS").is_ok_and(|form| form == "long")
}

/// How often something is looked at which cannot be waited for.
const GLANCE: Duration = Duration::from_millis(15);

/// Looks again and again until there is something to see.
///
/// # Panics
/// After [`deadline`], saying what was waited for.
pub fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let (started, deadline) = (Instant::now(), deadline());
    loop {
        if let Some(seen) = look() {
            return seen;
        }
        assert!(started.elapsed() < deadline, "gave up waiting for {what}");
        std::thread::sleep(GLANCE);
    }
}
