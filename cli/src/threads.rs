//! The threads of a command: those which serve, and those which compute beside them.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{available_parallelism, sleep};
use std::time::Duration;

use tokio::runtime::{Builder, Runtime};

/// Starts the runtime of a coordinator. Its threads for long work give way to those which serve, so that a
/// health check or a renewal does not wait while predictions are computed.
///
/// # Errors
/// When the system gives no threads.
pub fn of_a_coordinator() -> io::Result<Runtime> {
    let serving = available_parallelism().map_or(1, usize::from);
    let started = Arc::new(AtomicUsize::new(0));
    let counted = started.clone();
    let runtime = Builder::new_multi_thread()
        .worker_threads(serving)
        .enable_all()
        .on_thread_start(move || {
            if counted.fetch_add(1, Ordering::Relaxed) >= serving {
                give_way();
            }
        })
        .build()?;
    // Those which serve are started first: none of the others may be taken for one of them.
    while started.load(Ordering::Relaxed) < serving {
        sleep(Duration::from_millis(1));
    }
    Ok(runtime)
}

/// Starts the runtime of any other command.
///
/// # Errors
/// When the system gives no threads.
pub fn of_a_command() -> io::Result<Runtime> {
    Builder::new_multi_thread().enable_all().build()
}

/// Lowers the priority of this thread. Where it cannot be, all is only slower under load.
#[cfg(target_os = "linux")]
fn give_way() {
    /// A tenth of the share of a thread which serves, where both want a processor.
    const NICE: i32 = 10;
    // On Linux a priority belongs to a thread, and none means the calling one.
    let _ = rustix::process::setpriority_process(None, NICE);
}

#[cfg(not(target_os = "linux"))]
fn give_way() {}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn threads_for_long_work_give_way_and_those_which_serve_do_not() {
        let nice = || rustix::process::getpriority_process(None).expect("a thread has a priority");
        let before = nice();
        let runtime = of_a_coordinator().expect("threads");
        let (serving, working) = runtime.block_on(async {
            let serving = tokio::spawn(async move { nice() }).await.expect("runs");
            let working = tokio::task::spawn_blocking(nice).await.expect("runs");
            (serving, working)
        });
        assert_eq!((serving, working), (before, (before + 10).min(19)));
    }
}
