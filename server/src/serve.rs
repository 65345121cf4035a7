//! The coordinator on a socket, from start to a clean end.

use tokio::net::TcpListener;

use crate::config::Config;
use crate::http::connection::Connections;
use crate::state::{AppState, open};
use crate::store::{OpenError, StoreError};

/// Why the coordinator could not start, or had to end.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The database could not be opened.
    #[error("the store could not be opened")]
    Open(#[from] OpenError),
    /// The database could not be made ready.
    #[error("the store could not be made ready: {0}")]
    Recover(String),
    /// The socket failed.
    #[error("the listener failed")]
    Listen(#[source] std::io::Error),
}

impl From<StoreError> for ServerError {
    fn from(error: StoreError) -> Self {
        Self::Recover(crate::error::chain(&error))
    }
}

/// Serves until `shutdown` resolves. Then nothing new is accepted, waiting
/// workers are answered, open requests get a while to finish, and the store is
/// closed with everything committed that was asked for.
///
/// # Errors
/// When the store cannot be opened or the socket fails.
pub async fn run(
    listener: TcpListener,
    config: Config,
    shutdown: impl Future<Output = ()> + Send,
) -> Result<(), ServerError> {
    let state = open(config).await?;
    if let Ok(address) = listener.local_addr() {
        tracing::info!(server.address = %address, server.database = %state.config().database.display(), "Coordinator listening");
    }
    let served = serve(listener, &state, shutdown).await;
    state.close().await;
    tracing::info!("Coordinator stopped");
    served.map_err(ServerError::Listen)
}

async fn serve(
    listener: TcpListener,
    state: &AppState,
    shutdown: impl Future<Output = ()> + Send,
) -> Result<(), std::io::Error> {
    let stopping = state.stopping().clone();
    let connections = Connections::new(state);
    tokio::select! {
        never = connections.accept(listener) => match never {},
        () = shutdown => {}
    }
    tracing::info!("Coordinator stopping; open requests are finished first");
    stopping.cancel();
    if tokio::time::timeout(state.config().shutdown, connections.finish()).await.is_err() {
        let waited_s = state.config().shutdown.as_secs_f64();
        tracing::warn!(server.waited_s = waited_s, "Some requests did not finish in time");
    }
    Ok(())
}
