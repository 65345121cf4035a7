//! All tests of whole processes, in one binary: it links once, and its tests
//! share two cores better than several binaries one after the other.
// A test which cannot go on panics, in its helpers too.
#![allow(clippy::unwrap_used)]

// What a finished study's surrogate is asked.
#[path = "all/analyse.rs"]
mod analyse;
// What one request may cost, whatever is in it.
#[cfg(target_os = "linux")]
#[path = "all/bounded.rs"]
mod bounded;
// Processes killed in mid-study: nothing lost, nothing twice, the same bytes.
#[path = "all/crash.rs"]
mod crash;
// Generations which are flown instead of asked of a network.
#[path = "all/direct.rs"]
mod direct;
// Faults of machines, disks and clocks.
#[cfg(target_os = "linux")]
#[path = "all/faults.rs"]
mod faults;
// The life of a study over HTTP, from submission to answer.
#[path = "all/life.rs"]
mod life;
// Limits of the system and of time: open files, idle workers, answers cut short.
#[cfg(target_os = "linux")]
#[path = "all/limits.rs"]
mod limits;
// Everything a client can get wrong, and how it is told.
#[path = "all/refusals.rs"]
mod refusals;
// What operators see, and what becomes of their files.
#[cfg(target_os = "linux")]
#[path = "all/operators.rs"]
mod operators;
// The commands which talk to a coordinator.
#[path = "all/remote.rs"]
mod remote;
// The commands which need none: `run` and `simulate`.
#[path = "all/run.rs"]
mod run;
// Tokens, and TLS by a reverse proxy.
#[path = "all/secure.rs"]
mod secure;
// Rules of the house, checked on the sources themselves.
#[path = "all/tidy.rs"]
mod tidy;
