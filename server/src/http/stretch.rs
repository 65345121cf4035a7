//! How long a connection keeps a thread which serves: processor time between two places where it waits.

use std::pin::pin;
use std::time::Duration;

use crate::metrics::Metrics;

/// Runs the work of a connection, and notes each stretch of it.
pub(crate) async fn measured<F: Future>(work: F, metrics: &Metrics) -> F::Output {
    let mut work = pin!(work);
    std::future::poll_fn(|context| {
        let began = processor_time();
        let poll = work.as_mut().poll(context);
        metrics.served(processor_time().saturating_sub(began));
        poll
    })
    .await
}

/// Processor time this thread has had. What other threads take meanwhile is not counted.
#[cfg(unix)]
fn processor_time() -> Duration {
    use rustix::time::{ClockId, clock_gettime};
    clock_gettime(ClockId::ThreadCPUTime).try_into().unwrap_or_default()
}

/// Time since the first call: processor time of threads is not to be had here.
#[cfg(not(unix))]
fn processor_time() -> Duration {
    static FIRST: std::sync::LazyLock<std::time::Instant> = std::sync::LazyLock::new(std::time::Instant::now);
    FIRST.elapsed()
}

#[cfg(test)]
mod tests {
    use std::hint::black_box;

    use super::*;

    #[tokio::test]
    async fn each_stretch_is_noted_and_waiting_is_none() {
        let metrics = Metrics::default();
        let work = async {
            let began = processor_time();
            while processor_time() - began < Duration::from_millis(60) {
                black_box(());
            }
            tokio::time::sleep(Duration::from_millis(300)).await;
        };
        measured(work, &metrics).await;
        let told = metrics.render(&[], &Default::default()).expect("is text");
        assert!(told.contains("manduca_serving_seconds_count 2\n"), "{told}");
        assert!(told.contains("manduca_serving_seconds_bucket{le=\"0.05\"} 1\n"), "{told}");
        assert!(told.contains("manduca_serving_seconds_bucket{le=\"0.25\"} 2\n"), "{told}");
    }
}
