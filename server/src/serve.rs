//! The coordinator on a socket, from start to a clean end.

use tokio::net::TcpListener;

use crate::http::connection::Connections;
use crate::state::AppState;
use crate::store::{OpenError, StoreError};

/// Why the coordinator could not start, or had to end.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The database could not be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The database could not be made ready.
    #[error("the store could not be made ready: {0}")]
    Recover(String),
    /// A part has ended that should not have.
    #[error("{0} ended: what was acknowledged is kept, and a start of the coordinator goes on from there")]
    Broken(&'static str),
}

impl From<StoreError> for ServerError {
    fn from(error: StoreError) -> Self {
        Self::Recover(crate::error::chain(&error))
    }
}

/// Serves an open coordinator until `shutdown` resolves. Then nothing new is accepted, waiting
/// workers are answered, open requests get a while to finish, and the store is
/// closed with everything committed that was asked for.
///
/// # Errors
/// When a part without which the coordinator is of no use has ended.
pub async fn serve(
    listener: TcpListener,
    state: AppState,
    shutdown: impl Future<Output = ()> + Send,
) -> Result<(), ServerError> {
    if let Ok(address) = listener.local_addr() {
        tracing::info!(server.address = %address, server.database = %state.config().database.display(), "Coordinator listening");
    }
    let served = accept(listener, &state, shutdown).await;
    state.close().await;
    tracing::info!("Coordinator stopped");
    served
}

async fn accept(
    listener: TcpListener,
    state: &AppState,
    shutdown: impl Future<Output = ()> + Send,
) -> Result<(), ServerError> {
    let stopping = state.stopping().clone();
    let connections = Connections::new(state);
    let served = tokio::select! {
        never = connections.accept(listener) => match never {},
        () = shutdown => Ok(()),
        part = state.broken() => Err(ServerError::Broken(part)),
    };
    tracing::info!("Coordinator stopping; open requests are finished first");
    stopping.cancel();
    if tokio::time::timeout(state.config().shutdown, connections.finish()).await.is_err() {
        let waited_s = state.config().shutdown.as_secs_f64();
        tracing::warn!(server.waited_s = waited_s, "Some requests did not finish in time");
    }
    served
}
