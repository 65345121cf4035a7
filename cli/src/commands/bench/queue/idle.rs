//! Many workers and nothing to do.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use manduca_worker::http::Http;
use serde::Serialize;
use serde_json::json;
use tokio::sync::mpsc;
use tokio::task::JoinSet;

use super::exchange::{exchange, register};
use super::process::Coordinator;
use crate::exit::refused;
use crate::output::note;

/// How long a worker of this program waits for work in one request, s.
const WAIT_S: u32 = 10;
/// How long the coordinator is watched.
const WATCHED: Duration = Duration::from_secs(30);
/// Jobs submitted to them at the end.
const SAMPLES: u64 = 20;

/// What idle workers cost the coordinator.
#[derive(Debug, Serialize)]
pub struct Idle {
    workers: usize,
    cpu_cores: Option<f64>,
    resident_mb: Option<f64>,
    /// From the submission of 20 jobs to the last of them in a worker's hands.
    all_leased_ms: f64,
    /// Processor time of the coordinator for that.
    lease_cpu_ms: Option<f64>,
}

impl Idle {
    /// As rows of the table.
    pub fn rows(&self) -> Vec<Vec<String>> {
        let number = |value: Option<f64>, digits: usize| value.map_or_else(|| "-".into(), |v| format!("{v:.digits$}"));
        let row = |what: String, value: String| vec![what, value];
        vec![
            row(format!("{} idle workers: cores used", self.workers), number(self.cpu_cores, 3)),
            row(format!("{} idle workers: memory, MB", self.workers), number(self.resident_mb, 0)),
            row(
                format!("{SAMPLES} jobs submitted to them: all leased after, ms"),
                format!("{:.0}", self.all_leased_ms),
            ),
            row("CPU of the coordinator for that, ms".into(), number(self.lease_cpu_ms, 0)),
        ]
    }
}

/// Lets so many workers wait for work.
pub async fn measure(below: &Path, workers: usize) -> Result<Idle> {
    let coordinator = Coordinator::start(below)?;
    note(format_args!("registering {workers} idle workers"));
    let (leased, mut leases) = mpsc::unbounded_channel();
    let mut waiting = JoinSet::new();
    for chunk in 0..workers.div_ceil(100) {
        let mut registering = JoinSet::new();
        for i in chunk * 100..((chunk + 1) * 100).min(workers) {
            let url = coordinator.url().to_owned();
            registering.spawn(async move {
                let http = Http::new(&url).map_err(refused)?;
                let path = register(&http, &format!("idle-{i}"), 1).await?;
                anyhow::Ok((http, path))
            });
        }
        while let Some(registered) = registering.join_next().await {
            let (http, path) = registered??;
            waiting.spawn(wait(http, path, leased.clone()));
        }
    }
    // The last of them have sent their first request by then.
    tokio::time::sleep(Duration::from_secs(2)).await;
    let (start, cpu) = (Instant::now(), coordinator.cpu_s());
    tokio::time::sleep(WATCHED).await;
    let cpu_cores =
        coordinator.cpu_s().zip(cpu).map(|(after, before)| (after - before) / start.elapsed().as_secs_f64());
    let resident_mb = coordinator.resident_mb();
    let (start, cpu) = (Instant::now(), coordinator.cpu_s());
    submit(coordinator.url()).await?;
    let mut got = 0;
    while got < SAMPLES {
        match tokio::time::timeout(Duration::from_secs(60), leases.recv()).await {
            Ok(Some(jobs)) => got += jobs,
            _ => bail!("only {got} of {SAMPLES} jobs were leased to idle workers within a minute"),
        }
    }
    let all_leased_ms = start.elapsed().as_secs_f64() * 1000.0;
    // What the workers which came away empty-handed cost is seen a moment later.
    tokio::time::sleep(Duration::from_secs(2)).await;
    let lease_cpu_ms = coordinator.cpu_s().zip(cpu).map(|(after, before)| (after - before) * 1000.0);
    waiting.abort_all();
    Ok(Idle { workers, cpu_cores, resident_mb, all_leased_ms, lease_cpu_ms })
}

/// Waits for work again and again; tells what it is given, and ends with it.
async fn wait(http: Http, path: String, leased: mpsc::UnboundedSender<u64>) -> Result<()> {
    loop {
        let answer = exchange(&http, &path, &[], 1, WAIT_S).await?;
        if !answer.jobs.is_empty() {
            leased.send(answer.jobs.len() as u64)?;
            return Ok(());
        }
    }
}

async fn submit(url: &str) -> Result<()> {
    let study = json!({ "name": "idle", "model": { "kind": "quasi-steady" }, "sampling": { "samples": SAMPLES } });
    let http = Http::new(url).map_err(refused)?;
    manduca_worker::http::send(http.post("/v1/studies").json(&study)).await?;
    Ok(())
}
