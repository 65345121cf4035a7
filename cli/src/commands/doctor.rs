//! `manduca doctor`: what could keep this machine from working.

use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, SystemTime};

use anyhow::Result;
use manduca_numerics::cases::CASES;
use manduca_numerics::simulation::{SOLVER_VERSION, level};
use manduca_protocol::point::ParameterValues;
use manduca_protocol::study::{ModelKind, ModelSpec};
use manduca_protocol::task::{SimulateTask, Task};
use manduca_protocol::worker::PROTOCOL_VERSION;
use manduca_worker::http::{self, Http};
use manduca_worker::slot::{News, Outcome, Slot};
use serde::{Deserialize, Serialize};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use super::bench::syncs_per_s;
use super::host;
use super::serve::DATABASE;
use crate::args::DoctorArgs;
use crate::output::Output;

/// How long the coordinator may take to answer, and a slot for a stroke of blade elements.
const PATIENCE: Duration = Duration::from_secs(20);
/// Files a coordinator of some hundred workers has open.
const FEW_FILES: u64 = 1024;
/// Durable writes per second below which the disk limits the coordinator.
const SLOW_DISK: f64 = 50.0;

/// How a matter stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Verdict {
    Well,
    Note,
    Wrong,
}

/// One matter looked into.
#[derive(Debug, Serialize)]
struct Finding {
    what: &'static str,
    verdict: Verdict,
    detail: String,
}

fn finding(what: &'static str, verdict: Verdict, detail: impl Into<String>) -> Finding {
    Finding { what, verdict, detail: detail.into() }
}

/// Looks, and says what it found.
pub async fn doctor(args: DoctorArgs) -> Result<ExitCode> {
    let mut findings = vec![program(), files(), slot().await];
    findings.extend(folder(&args.data.data).await);
    findings.extend(coordinator(&args).await);
    let mut out = Output::stdout();
    if args.json {
        out.json(&findings)?;
    } else {
        for Finding { what, verdict, detail } in &findings {
            let mark = match verdict {
                Verdict::Well => "ok   ",
                Verdict::Note => "note ",
                Verdict::Wrong => "WRONG",
            };
            out.line(format_args!("{mark} {what}: {detail}"))?;
        }
    }
    let wrong = findings.iter().any(|f| f.verdict == Verdict::Wrong);
    Ok(if wrong { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

fn program() -> Finding {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let version = env!("CARGO_PKG_VERSION");
    finding(
        "program",
        Verdict::Well,
        format!(
            "version {version}, solver {SOLVER_VERSION}, exchange {PROTOCOL_VERSION}, {} instructions, {cores} cores",
            level()
        ),
    )
}

fn files() -> Finding {
    match rlimit::Resource::NOFILE.get() {
        Ok((soft, hard)) if hard < FEW_FILES => finding(
            "open files",
            Verdict::Note,
            format!("{soft} of at most {hard}: a coordinator here serves fewer workers; raise the limit (`ulimit -n`)"),
        ),
        Ok((soft, hard)) => {
            finding("open files", Verdict::Well, format!("{soft}, raised to {hard} by a coordinator as needed"))
        }
        Err(error) => finding("open files", Verdict::Note, format!("the system does not tell: {error}")),
    }
}

/// A compute slot flies a stroke of blade elements.
async fn slot() -> Finding {
    let program = match host::this_program() {
        Ok(program) => program,
        Err(error) => return finding("compute slot", Verdict::Wrong, format!("cannot find this program: {error}")),
    };
    let model = ModelSpec { kind: ModelKind::QuasiSteady, ..ModelSpec::default() };
    let task = Task::Simulate(SimulateTask { model, parameters: ParameterValues(CASES[0].parameters) });
    let (news, _) = watch::channel(News::default());
    let mut slot = Slot::new(program, vec!["slot".into()]);
    match slot.run(&task, PATIENCE, &news, &CancellationToken::new()).await {
        Outcome::Done(_, provenance) => finding(
            "compute slot",
            Verdict::Well,
            format!("starts and flies a stroke in {:.1} ms", provenance.wall_s * 1e3),
        ),
        Outcome::Failed(reason, _) => finding("compute slot", Verdict::Wrong, reason),
        Outcome::Cancelled => finding("compute slot", Verdict::Wrong, "was cancelled"),
    }
}

async fn folder(data: &Path) -> Vec<Finding> {
    if !data.is_dir() {
        return vec![finding(
            "database",
            Verdict::Note,
            format!("no folder {}; `manduca serve` would make it", data.display()),
        )];
    }
    let mut findings = vec![match syncs_per_s(data) {
        Ok(rate) if rate < SLOW_DISK => {
            finding("disk", Verdict::Note, format!("{rate:.0} durable writes/s: it limits the coordinator"))
        }
        Ok(rate) => finding("disk", Verdict::Well, format!("{rate:.0} durable writes/s")),
        Err(error) if is_read_only(&error) => finding(
            "disk",
            Verdict::Note,
            format!("{} may only be read by this user ({error}): a coordinator could not use it", data.display()),
        ),
        Err(error) => finding("disk", Verdict::Wrong, format!("{} takes no files: {error}", data.display())),
    }];
    if !data.join(DATABASE).is_file() {
        findings.push(finding("database", Verdict::Note, "there is none yet; `manduca serve` would make it"));
        return findings;
    }
    let checked = async {
        let mut database = super::token::look(data).await?;
        let checked = database.check().await;
        database.close().await;
        anyhow::Ok(checked?)
    };
    findings.push(match checked.await {
        Ok(found) if found.is_well() => {
            finding("database", Verdict::Well, format!("whole, with {} results", found.results))
        }
        Ok(found) => finding(
            "database",
            Verdict::Wrong,
            found.damage.into_iter().chain(found.breaches).collect::<Vec<_>>().join("; "),
        ),
        Err(error) => finding("database", Verdict::Wrong, manduca_server::chain(error.as_ref())),
    });
    findings
}

/// Whether files cannot be made there because of who asks or where it is.
fn is_read_only(error: &anyhow::Error) -> bool {
    let kinds = [std::io::ErrorKind::PermissionDenied, std::io::ErrorKind::ReadOnlyFilesystem];
    error.chain().any(|c| c.downcast_ref::<std::io::Error>().is_some_and(|e| kinds.contains(&e.kind())))
}

/// The part of a coordinator's health which must fit this program's.
#[derive(Deserialize)]
struct Health {
    solver_version: String,
    oldest_protocol_version: u32,
    protocol_version: u32,
}

async fn coordinator(args: &DoctorArgs) -> Vec<Finding> {
    let http = match args.coordinator.http() {
        Ok(http) => http,
        Err(error) => return vec![finding("coordinator", Verdict::Wrong, format!("{error:#}"))],
    };
    let answer = match http::send(http.get("/readyz").timeout(PATIENCE)).await {
        Ok(answer) => answer,
        Err(error @ http::CallError::Unreachable { .. }) => {
            return vec![finding("coordinator", Verdict::Note, format!("{error}"))];
        }
        Err(error) => {
            let advice = error.advice().map(|advice| format!(": {advice}")).unwrap_or_default();
            return vec![finding("coordinator", Verdict::Wrong, format!("it is not ready: {error}{advice}"))];
        }
    };
    let mut findings = Vec::new();
    let date = answer.headers().get("date").and_then(|v| v.to_str().ok()).map(str::to_owned);
    findings.push(match answer.json::<Health>().await {
        Ok(health) => versions(http.base(), &health),
        Err(error) => {
            finding("coordinator", Verdict::Wrong, format!("{} does not answer as one: {error}", http.base()))
        }
    });
    findings.push(token(&http).await);
    findings.extend(date.and_then(|date| clocks(&date)));
    findings
}

fn versions(base: &str, health: &Health) -> Finding {
    let range = health.oldest_protocol_version..=health.protocol_version;
    if !range.contains(&PROTOCOL_VERSION) {
        let told = format!(
            "{base} speaks versions {} to {} of the exchange, this program {PROTOCOL_VERSION}",
            range.start(),
            range.end()
        );
        return finding("coordinator", Verdict::Wrong, told);
    }
    if health.solver_version != SOLVER_VERSION {
        let told = format!("{base} takes results of solver {}, not {SOLVER_VERSION}", health.solver_version);
        return finding("coordinator", Verdict::Wrong, told);
    }
    finding("coordinator", Verdict::Well, format!("{base} is ready and of this version"))
}

async fn token(http: &Http) -> Finding {
    match http::send(http.get("/v1/scaling").timeout(PATIENCE)).await {
        Ok(_) => finding("token", Verdict::Well, "what is asked for is allowed"),
        Err(error) if error.status() == Some(403) => {
            finding("token", Verdict::Note, "it is known, and does not allow to look")
        }
        Err(error) => finding("token", Verdict::Wrong, format!("{error}")),
    }
}

/// Clocks decide nothing, but logs of two machines are read side by side.
fn clocks(date: &str) -> Option<Finding> {
    let theirs: jiff::Timestamp = jiff::fmt::rfc2822::parse(date).ok()?.timestamp();
    let ours = jiff::Timestamp::try_from(SystemTime::now()).ok()?;
    let apart = ours.duration_since(theirs).as_secs_f64();
    let verdict = if apart.abs() > 5.0 { Verdict::Note } else { Verdict::Well };
    Some(finding("clocks", verdict, format!("{apart:+.0} s apart; nothing depends on it but the reading of logs")))
}
