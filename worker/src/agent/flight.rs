//! A request under way and what it asked for.

use std::future::Future;
use std::pin::Pin;

use manduca_protocol::worker::{ExchangeRequest, ExchangeResponse};
use tokio::time::Instant;

use crate::http::CallError;

type Answer = Result<ExchangeResponse, CallError>;

/// A request under way.
pub(super) struct Flight {
    answer: Pin<Box<dyn Future<Output = Answer> + Send>>,
    since: Instant,
    /// Jobs it asks for.
    pub(super) want: u32,
    batch: usize,
    renewed: usize,
}

/// A request answered, or not.
pub(super) struct Landed {
    pub(super) answer: Answer,
    /// When it was sent.
    pub(super) since: Instant,
    /// Jobs it asked for.
    pub(super) want: u32,
    /// Reports it carried.
    pub(super) batch: usize,
    /// Renewals it carried.
    pub(super) renewed: usize,
}

impl Flight {
    pub(super) fn new(answer: impl Future<Output = Answer> + Send + 'static, request: &ExchangeRequest) -> Self {
        let batch = request.complete.len() + request.fail.len();
        let (want, renewed) = (request.want, request.renew.len());
        Self { answer: Box::pin(answer), since: Instant::now(), want, batch, renewed }
    }
}

/// Waits for a request; for ever where there is none.
pub(super) async fn landed(flight: &mut Option<Flight>) -> Landed {
    let Some(under_way) = flight else { return std::future::pending().await };
    let answer = under_way.answer.as_mut().await;
    let Flight { since, want, batch, renewed, .. } = *under_way;
    let landed = Landed { answer, since, want, batch, renewed };
    *flight = None;
    landed
}
