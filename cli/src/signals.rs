//! Ctrl-C and SIGTERM: the first drains, the second stops.

use manduca_worker::Shutdown;

/// Lets a write beyond the limit of file sizes (`ulimit -f`) fail as one on a full disk does, instead of
/// ending the program: a handler takes the place of the signal's default action.
#[cfg(unix)]
pub fn ignore_file_size_limit(runtime: &tokio::runtime::Runtime) {
    use tokio::signal::unix::{SignalKind, signal};
    /// SIGXFSZ, on Linux but for MIPS, macOS and the BSDs.
    const FILE_SIZE: i32 = 25;
    let _guard = runtime.enter();
    // Where it cannot be heard, all is as it was.
    drop(signal(SignalKind::from_raw(FILE_SIZE)));
}

#[cfg(not(unix))]
pub fn ignore_file_size_limit(_: &tokio::runtime::Runtime) {}

/// Tokens which the signals of this process cancel.
pub fn shutdown() -> Shutdown {
    let shutdown = Shutdown::default();
    let tokens = shutdown.clone();
    tokio::spawn(async move {
        signal().await;
        tokens.drain.cancel();
        signal().await;
        tokens.stop.cancel();
    });
    shutdown
}

#[cfg(unix)]
async fn signal() {
    use tokio::signal::unix::{SignalKind, signal};
    let Ok(mut terminate) = signal(SignalKind::terminate()) else { return ctrl_c().await };
    tokio::select! {
        () = ctrl_c() => {}
        _ = terminate.recv() => {}
    }
}

#[cfg(not(unix))]
async fn signal() {
    ctrl_c().await;
}

async fn ctrl_c() {
    if tokio::signal::ctrl_c().await.is_err() {
        // No signal can be heard: never drain rather than drain at once.
        std::future::pending::<()>().await;
    }
}
