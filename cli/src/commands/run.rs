//! `manduca run`: coordinator, worker and client in one process.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result, anyhow, bail};
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::ids::StudyId;
use manduca_protocol::study::StudySpec;
use manduca_protocol::view::{StudyResult, StudyState};
use manduca_server::ServerError;
use manduca_worker::{Shutdown, WorkerError};
use serde::Serialize;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::{serve, worker};
use crate::api::Api;
use crate::args::RunArgs;
use crate::exit::INTERRUPTED;
use crate::follow::{Followed, follow};
use crate::output::{Output, note};
use crate::{render, signals, study_file};

/// Does a whole study.
pub async fn run(args: RunArgs) -> Result<ExitCode> {
    let spec = study_file::load(&args.study)?;
    let shutdown = signals::shutdown();
    let mut service = Service::start(&args.data, args.slots, &shutdown).await?;
    let conducted = tokio::select! {
        conducted = conduct(&service.api, &spec, &shutdown.drain) => conducted,
        // Either of the two ending by itself is the reason why the study does not.
        broken = broken(&mut service.server, &mut service.worker) => Err(broken),
        () = shutdown.stop.cancelled() => Ok(None),
    };
    if shutdown.drain.is_cancelled() {
        note("finishing the running jobs; Ctrl-C again to stop at once");
    }
    shutdown.drain.cancel();
    service.end().await;
    match conducted? {
        Some(result) => {
            tell(&args, &result)?;
            Ok(ExitCode::SUCCESS)
        }
        None => {
            note(format_args!(
                "interrupted; nothing is lost: the same command with --data {} goes on",
                args.data.display()
            ));
            Ok(ExitCode::from(INTERRUPTED))
        }
    }
}

/// A coordinator on a loopback port and a worker which talks HTTP to it.
struct Service {
    api: Api,
    server: JoinHandle<Result<(), ServerError>>,
    worker: JoinHandle<Result<manduca_worker::Summary, WorkerError>>,
    server_ends: CancellationToken,
}

impl Service {
    async fn start(data: &Path, slots: Option<usize>, shutdown: &Shutdown) -> Result<Self> {
        let config = serve::config(data)?;
        let listener = TcpListener::bind("127.0.0.1:0").await.context("cannot open a loopback port")?;
        let url = format!("http://{}", listener.local_addr()?);
        let settings = worker::settings(url.clone(), slots, None)?;
        let api = Api::new(&url)?;
        let server_ends = CancellationToken::new();
        let ends = server_ends.clone().cancelled_owned();
        let server = tokio::spawn(manduca_server::run(listener, config, ends));
        let worker = tokio::spawn(manduca_worker::run(settings, shutdown.clone()));
        Ok(Self { api, server, worker, server_ends })
    }

    /// The worker first, so that it can deliver what it has.
    async fn end(mut self) {
        if !self.worker.is_finished() {
            let _ = (&mut self.worker).await;
        }
        self.server_ends.cancel();
        if !self.server.is_finished() {
            let _ = (&mut self.server).await;
        }
    }
}

/// Waits for a part to end which should not.
async fn broken(
    server: &mut JoinHandle<Result<(), ServerError>>,
    worker: &mut JoinHandle<Result<manduca_worker::Summary, WorkerError>>,
) -> anyhow::Error {
    tokio::select! {
        ended = server => match ended {
            Ok(Ok(())) => anyhow!("the coordinator ended"),
            Ok(Err(error)) => anyhow::Error::from(error).context("the coordinator failed"),
            Err(error) => anyhow::Error::from(error).context("the coordinator crashed"),
        },
        ended = worker => match ended {
            // It left because it was told to; the study's follower tells that story.
            Ok(Ok(_)) => std::future::pending().await,
            Ok(Err(error)) => anyhow::Error::from(error).context("the worker failed"),
            Err(error) => anyhow::Error::from(error).context("the worker crashed"),
        },
    }
}

/// Submits, or takes up again, and follows to the end; none when interrupted.
async fn conduct(api: &Api, spec: &StudySpec, interrupted: &CancellationToken) -> Result<Option<StudyResult>> {
    let id = api.submit(spec, Some(&key(spec)?)).await?;
    take_up(api, id).await?;
    let view = match follow(api, id, interrupted).await? {
        Followed::Ended(view) => view,
        Followed::Interrupted => return Ok(None),
    };
    if view.state != StudyState::Succeeded {
        bail!("the study ended as {:?}: {}", view.state, view.failure.as_deref().unwrap_or("no reason given"));
    }
    Ok(Some(api.result(id).await?))
}

/// Name of a study's content: the same study with the same numbers in the same folder is the same study.
fn key(spec: &StudySpec) -> Result<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(SOLVER_VERSION.as_bytes()).update(&serde_json::to_vec(spec)?);
    Ok(hasher.finalize().to_hex().to_string())
}

/// A study found in the folder may have been left in any state.
async fn take_up(api: &Api, id: StudyId) -> Result<()> {
    let view = api.study(id).await?;
    let done = view.samples.succeeded;
    match view.state {
        StudyState::Succeeded => note(format_args!("study {id} is already done; this is its answer")),
        StudyState::Paused => api.act(id, "resume").await?,
        StudyState::Failed => {
            note(format_args!("study {id} had failed; its dead jobs are tried again"));
            api.act(id, "retry-failed").await?;
        }
        StudyState::Cancelled => bail!("study {id} was cancelled; another --data folder starts it afresh"),
        _ if done > 0 => note(format_args!("going on with study {id}: {done} samples are done")),
        _ => note(format_args!("study {id}")),
    }
    Ok(())
}

/// The answer and where to ask on.
#[derive(Serialize)]
struct Answer<'a> {
    #[serde(flatten)]
    result: &'a StudyResult,
    database: String,
}

fn tell(args: &RunArgs, result: &StudyResult) -> Result<()> {
    let mut out = Output::stdout();
    let database = serve::config(&args.data)?.database.display().to_string();
    if args.json {
        out.json(&Answer { result, database })?;
        return Ok(());
    }
    render::study::result(&mut out, result)?;
    let data = args.data.display();
    out.line(format_args!("database  {database}"))?;
    out.line(format_args!("next      manduca serve --data {data}    and then, beside it:"))?;
    out.line("          manduca dataset latest --format csv -o dataset.csv")?;
    out.line("          manduca optimum latest --json")?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_names_the_content() {
        let quick = study_file::load("quick").unwrap();
        let mut other = quick.clone();
        assert_eq!(key(&quick).unwrap(), key(&other).unwrap());
        other.seed += 1;
        assert_ne!(key(&quick).unwrap(), key(&other).unwrap());
    }
}
