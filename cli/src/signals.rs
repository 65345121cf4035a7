//! Ctrl-C and SIGTERM: the first drains, the second stops.

use manduca_worker::Shutdown;

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
