//! The thread of the writer.

use std::thread;

use tokio::runtime::{Handle, RuntimeFlavor};

/// Runs the writer on a thread of its own: among a thousand connections each of its statements would wait for its
/// turn. In a runtime of one thread, as tests have, it stays there, with that runtime's time.
pub(super) fn spawn_apart(writer: impl Future<Output = ()> + Send + 'static) {
    let here = Handle::current();
    if here.runtime_flavor() == RuntimeFlavor::CurrentThread {
        here.spawn(writer);
        return;
    }
    let thread = thread::Builder::new().name("manduca-writer".into());
    // The runtime of the others still moves its timers; this thread does nothing but the writer's work.
    let started = thread.spawn(move || here.block_on(writer));
    if let Err(error) = started {
        // Dropped with the closure, the writer counts as ended, and the coordinator ends with it.
        tracing::error!(error.cause = %error, "The writer's thread could not be started");
    }
}
