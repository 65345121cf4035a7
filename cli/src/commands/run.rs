//! `manduca run`: coordinator, worker and client in one process.

mod service;

use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Result, bail};
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::ids::StudyId;
use manduca_protocol::study::StudySpec;
use manduca_protocol::view::{StudyResult, StudyState};
use manduca_worker::Shutdown;
use manduca_worker::http::CallError;
use serde::Serialize;
use tokio_util::sync::CancellationToken;

use super::serve::DATABASE;
use crate::api::Api;
use crate::args::RunArgs;
use crate::exit::INTERRUPTED;
use crate::follow::{Followed, follow};
use crate::output::{Output, note};
use crate::{render, signals, study_file};
use service::{Service, gone};

/// How long a coordinator that does not answer may take to let its database go.
const LAST_BREATH: Duration = Duration::from_secs(15);

/// Does a whole study.
pub async fn run(args: RunArgs) -> Result<ExitCode> {
    let spec = study_file::load(&args.study)?;
    // Before anything is made.
    super::worker::settings(String::new(), args.slots, None)?;
    let shutdown = signals::shutdown();
    let database = args.data.join(DATABASE);
    let service = tokio::select! {
        service = Service::start(&database, args.slots, &shutdown) => service?,
        () = shutdown.drain.cancelled() => return Ok(interrupted(&args)),
    };
    let (service, conducted) = conduct(service, &spec, &shutdown).await;
    if shutdown.drain.is_cancelled() {
        note("finishing the running jobs; Ctrl-C again to stop at once");
    }
    shutdown.drain.cancel();
    if conducted.is_err() {
        // Nobody waits for what still runs, and it may have nowhere to go.
        shutdown.stop.cancel();
    }
    let is_gone = service.as_ref().is_some_and(Service::is_gone);
    if let Some(service) = service {
        service.end().await;
    }
    match conducted? {
        Some(result) => {
            tell(&args, &database, &result, is_gone)?;
            if is_gone { Err(gone(&database)) } else { Ok(ExitCode::SUCCESS) }
        }
        None => Ok(interrupted(&args)),
    }
}

fn interrupted(args: &RunArgs) -> ExitCode {
    note(format_args!("interrupted; nothing is lost: the same command with --data {} goes on", args.data.display()));
    ExitCode::from(INTERRUPTED)
}

/// Has the study done, whoever coordinates; none when interrupted.
async fn conduct(
    mut service: Service,
    spec: &StudySpec,
    shutdown: &Shutdown,
) -> (Option<Service>, Result<Option<StudyResult>>) {
    loop {
        let (api, left_alone) = (service.api.clone(), service.left_alone());
        let hold = tokio::select! {
            done = follow_through(&api, spec, &shutdown.drain) => match done {
                // The coordinator joined may be about to end: then this one goes on.
                Err(error) if service.may_be_left_alone() && is_unanswered(&error) => {
                    match tokio::time::timeout(LAST_BREATH, service.left_alone()).await {
                        Ok(hold) => hold,
                        Err(_) => return (Some(service), Err(error)),
                    }
                }
                done => return (Some(service), done),
            },
            hold = left_alone => hold,
            // A part that ends by itself is the reason why the study does not.
            error = service.broken() => return (Some(service), Err(error)),
            () = shutdown.stop.cancelled() => return (Some(service), Ok(None)),
        };
        let taken = match hold {
            Ok(hold) => service.take_over(hold).await,
            Err(error) => Err(error),
        };
        service = match taken {
            Ok(service) => service,
            Err(error) => return (None, Err(error)),
        };
    }
}

fn is_unanswered(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| cause.downcast_ref::<CallError>().is_some_and(CallError::is_passing))
}

/// Submits, or takes up again, and follows to the end; none when interrupted.
async fn follow_through(api: &Api, spec: &StudySpec, interrupted: &CancellationToken) -> Result<Option<StudyResult>> {
    let (id, is_new) = api.submit_new(spec, Some(&key(spec)?)).await?;
    if is_new {
        note(format_args!("study {id}"));
    } else {
        take_up(api, id).await?;
    }
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

fn tell(args: &RunArgs, database: &Path, result: &StudyResult, is_gone: bool) -> Result<()> {
    let mut out = Output::stdout();
    let database = database.display().to_string();
    if args.json {
        out.json(&Answer { result, database })?;
        return Ok(());
    }
    render::study::result(&mut out, result)?;
    if is_gone {
        return Ok(());
    }
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
