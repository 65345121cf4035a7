//! Clients which take and return jobs as fast as they are answered.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Instant;

use anyhow::Result;
use manduca_worker::http::{self, Http};
use serde::Serialize;
use serde_json::{Value, json};
use tokio::task::JoinSet;

use super::exchange::{exchange, register};
use super::process::Coordinator;
use crate::exit::refused;

/// Most samples of a study.
const LARGEST_STUDY: u64 = 200_000;
/// Small studies submitted, and clients which do so.
const SMALL_STUDIES: u64 = 400;
const SUBMITTERS: u64 = 8;

/// One run.
#[derive(Debug, Clone, Serialize)]
pub struct Run {
    /// Jobs per exchange.
    pub batch: u32,
    /// Clients at the same time.
    pub clients: usize,
    /// Jobs leased, returned and acknowledged, per second.
    pub jobs_s: f64,
    /// An exchange which returns results and takes jobs, median.
    pub claim_p50_ms: f64,
    /// Its 99th percentile.
    pub claim_p99_ms: f64,
    /// Processor time of the coordinator.
    pub cpu_us_per_job: Option<f64>,
}

impl Run {
    /// As a row of the table.
    pub fn row(&self) -> Vec<String> {
        vec![
            self.batch.to_string(),
            self.clients.to_string(),
            format!("{:.0}", self.jobs_s),
            format!("{:.1}", self.claim_p50_ms),
            format!("{:.1}", self.claim_p99_ms),
            self.cpu_us_per_job.map_or_else(|| "-".into(), |us| format!("{us:.0}")),
        ]
    }
}

/// The clients take and return `jobs` jobs together.
pub async fn run(coordinator: &Coordinator, batch: u32, clients: usize, jobs: u64) -> Result<Run> {
    let left = Arc::new(AtomicI64::new(i64::try_from(jobs)?));
    let mut ready = Vec::new();
    for i in 0..clients {
        let http = client(coordinator.url())?;
        let path = register(&http, &format!("bench-{batch}-{i}"), batch).await?;
        ready.push((http, path));
    }
    let (start, cpu) = (Instant::now(), coordinator.cpu_s());
    let mut tasks = JoinSet::new();
    for (http, path) in ready {
        tasks.spawn(work(http, path, batch, left.clone()));
    }
    let (mut latencies, mut done) = (Vec::new(), 0_u64);
    while let Some(ended) = tasks.join_next().await {
        let (its, completed) = ended??;
        latencies.extend(its);
        done += completed;
    }
    let elapsed = start.elapsed().as_secs_f64();
    latencies.sort_by(f64::total_cmp);
    let at = |share: f64| latencies[((latencies.len() - 1) as f64 * share).round() as usize] * 1000.0;
    let used = coordinator.cpu_s().zip(cpu).map(|(after, before)| after - before);
    Ok(Run {
        batch,
        clients,
        jobs_s: done as f64 / elapsed,
        claim_p50_ms: at(0.5),
        claim_p99_ms: at(0.99),
        cpu_us_per_job: used.map(|s| s * 1e6 / done as f64),
    })
}

/// A client: what it took last it returns with the next wish. Its last exchange wants nothing.
async fn work(http: Http, path: String, batch: u32, left: Arc<AtomicI64>) -> Result<(Vec<f64>, u64)> {
    let (mut latencies, mut done, mut held) = (Vec::new(), 0, Vec::new());
    loop {
        let want = u32::try_from(left.fetch_sub(batch.into(), Ordering::Relaxed).clamp(0, batch.into()))?;
        if want == 0 && held.is_empty() {
            return Ok((latencies, done));
        }
        let start = Instant::now();
        let answer = exchange(&http, &path, &held, want, 0).await?;
        if want > 0 {
            latencies.push(start.elapsed().as_secs_f64());
        }
        done += answer.accepted.len() as u64;
        held = answer.jobs;
        if want > 0 && held.is_empty() {
            return Err(refused("the coordinator ran out of jobs"));
        }
    }
}

/// A connection of its own, as workers have.
fn client(url: &str) -> Result<Http> {
    Http::new(url).map_err(refused)
}

fn study(samples: u64, seed: u64) -> Value {
    // Blade elements: never flown here, and the same row in the store.
    json!({ "name": "bench", "seed": seed, "model": { "kind": "quasi-steady" }, "sampling": { "samples": samples } })
}

/// Submits studies until so many jobs are queued; jobs per second taken.
pub async fn fill(url: &str, jobs: u64, seed: &mut u64) -> Result<f64> {
    let (http, start, mut left) = (client(url)?, Instant::now(), jobs);
    while left > 0 {
        let samples = left.clamp(20, LARGEST_STUDY);
        *seed += 1;
        let request = http.post("/v1/studies").timeout(http::CALL * 20).json(&study(samples, *seed));
        http::send(request).await?;
        left -= samples.min(left);
    }
    Ok(jobs as f64 / start.elapsed().as_secs_f64())
}

/// Small studies per second.
pub async fn small_studies(url: &str) -> Result<f64> {
    let (start, mut tasks) = (Instant::now(), JoinSet::new());
    for i in 0..SUBMITTERS {
        let http = client(url)?;
        tasks.spawn(async move {
            for k in 0..SMALL_STUDIES / SUBMITTERS {
                let seed = 1_000_000 + i * SMALL_STUDIES + k;
                http::send(http.post("/v1/studies").json(&study(20, seed))).await?;
            }
            anyhow::Ok(())
        });
    }
    while let Some(ended) = tasks.join_next().await {
        ended??;
    }
    Ok(SMALL_STUDIES as f64 / start.elapsed().as_secs_f64())
}
