//! Connections: accepted, bounded in number, and none waited for without end.

use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio_io_timeout::TimeoutStream;

use super::stretch::measured;
use crate::app::app;
use crate::state::AppState;

/// Most headers of a request.
const MOST_HEADERS: usize = 64;
/// After a failed accept, for want of file handles perhaps.
const RECOVERY: Duration = Duration::from_millis(100);

/// What serves the connections of one listener.
pub(crate) struct Connections {
    router: Router,
    http: http1::Builder,
    write_wait: Duration,
    places: Arc<Semaphore>,
    graceful: GracefulShutdown,
    state: AppState,
}

impl Connections {
    pub(crate) fn new(state: &AppState) -> Self {
        let config = state.config();
        let mut http = http1::Builder::new();
        http.timer(TokioTimer::new())
            .header_read_timeout(config.header_wait)
            .max_headers(MOST_HEADERS)
            .max_buf_size(config.header_limit.max(8192));
        Self {
            router: app(state.clone()),
            http,
            write_wait: config.write_wait,
            places: Arc::new(Semaphore::new(config.connections)),
            graceful: GracefulShutdown::new(),
            state: state.clone(),
        }
    }

    /// Accepts for ever.
    pub(crate) async fn accept(&self, listener: TcpListener) -> Infallible {
        loop {
            // Nobody closes the semaphore; without a place the client waits in the system's queue.
            let Ok(place) = self.places.clone().acquire_owned().await else { return std::future::pending().await };
            match listener.accept().await {
                Ok((stream, _)) => self.serve(stream, place),
                Err(error) => {
                    tracing::warn!(error.cause = %error, "A connection could not be accepted");
                    tokio::time::sleep(RECOVERY).await;
                }
            }
        }
    }

    fn serve(&self, stream: TcpStream, place: tokio::sync::OwnedSemaphorePermit) {
        // Answers are small and waited for. Where the option is refused they are late, not wrong.
        let _ = stream.set_nodelay(true);
        let mut stream = TimeoutStream::new(stream);
        stream.set_write_timeout(Some(self.write_wait));
        let io: TokioIo<Pin<Box<_>>> = TokioIo::new(Box::pin(stream));
        let connection = self.http.serve_connection(io, TowerToHyperService::new(self.router.clone()));
        let connection = self.graceful.watch(connection);
        let state = self.state.clone();
        tokio::spawn(async move {
            if let Err(error) = measured(connection, state.metrics()).await {
                tracing::debug!(error.cause = %error, "A connection ended badly");
            }
            drop(place);
        });
    }

    /// Lets open requests finish.
    pub(crate) async fn finish(self) {
        self.graceful.shutdown().await;
    }
}
