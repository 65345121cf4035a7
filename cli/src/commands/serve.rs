//! `manduca serve` and the question whether it is well.

use std::net::SocketAddr;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result};
use manduca_server::{Access, Config, Host, Hosts, Secret};
use manduca_worker::http::{self, Http};
use serde::Deserialize;
use tokio::net::{TcpListener, lookup_host};

use super::host;
use crate::args::{HealthcheckArgs, ServeArgs};
use crate::exit::refused;
use crate::output::note;
use crate::{files, signals, token};

/// Name of the database in its folder.
pub const DATABASE: &str = "manduca.db";
/// How long a health check waits.
const HEALTHY_WITHIN: Duration = Duration::from_secs(3);

/// The coordinator's settings for a folder, which is made when missing.
pub fn config(data: &Path) -> Result<Config> {
    std::fs::create_dir_all(data).with_context(|| format!("cannot make the folder {}", data.display()))?;
    Ok(Config::new(data.join(DATABASE)))
}

/// Is the coordinator until told to stop.
pub async fn serve(args: ServeArgs) -> Result<ExitCode> {
    let addresses: Vec<SocketAddr> = match lookup_host(&args.listen).await {
        Ok(addresses) => addresses.collect(),
        Err(error) => return Err(refused(format!("--listen {}: {error}", args.listen))),
    };
    let mut config = config(&args.data)?;
    let reachable = addresses.iter().any(|a| !a.ip().is_loopback());
    config.access = access(&args, reachable).await?;
    config.hosts = hosts(&args, reachable);
    config.run_limits.simulate = Duration::from_secs_f64(args.run_limit);
    config.set_lease(Duration::from_secs_f64(args.lease));
    config.max_attempts = args.max_attempts;
    config.keep = args.keep_days.map(|days| Duration::from_secs_f64(days * 86_400.0));
    config.connections = files::connections(config.connections);
    let listener =
        TcpListener::bind(&addresses[..]).await.with_context(|| format!("cannot listen on {}", args.listen))?;
    note(format_args!("listening on http://{}, database {}", listener.local_addr()?, config.database.display()));
    let shutdown = signals::shutdown();
    tokio::select! {
        ended = manduca_server::run(listener, config, shutdown.drain.cancelled_owned()) => ended.context("the coordinator failed")?,
        () = shutdown.stop.cancelled() => note("stopped at once; whatever was committed is kept"),
    }
    Ok(ExitCode::SUCCESS)
}

/// Whether tokens are asked for: at addresses others can reach, and wherever one is given.
async fn access(args: &ServeArgs, reachable: bool) -> Result<Access> {
    let given = token::given(args.token_file.as_deref())?;
    if args.insecure {
        if given.is_some() {
            note("--insecure: the token given is not asked for");
        }
        return Ok(Access::Open);
    }
    let given: Vec<_> = match given.map(|text| Secret::new(&text)).transpose() {
        Ok(given) => given.iter().map(Secret::hash).collect(),
        Err(why) => return Err(refused(format!("the token given: {why}"))),
    };
    if !reachable && !args.require_tokens && given.is_empty() {
        return Ok(Access::Open);
    }
    if given.is_empty() {
        let mut database = super::token::open(&args.data).await?;
        let none = database.tokens().await?.iter().all(|token| token.revoked_at.is_some());
        database.close().await;
        if none {
            return Err(refused(format!(
                "--listen {}: tokens are to be asked for, and there is none. `manduca token create NAME --scope admin` \
                 makes one, MANDUCA_TOKEN or --token-file gives one; --insecure asks for none, on a network to be trusted",
                args.listen
            )));
        }
    }
    Ok(Access::Tokens(given))
}

/// The hosts under which it answers without tokens: those the operator names, and where others can reach it, the
/// machine's name and every address. No page of another site has one of those.
fn hosts(args: &ServeArgs, reachable: bool) -> Hosts {
    let listening = args.listen.rsplit_once(':').and_then(|(host, _)| host.parse().ok());
    let named = args.allow_host.iter().cloned().chain(listening.filter(|host| matches!(host, Host::Name(_))));
    if reachable { Hosts::new(named.chain(host::name().parse().ok())).with_addresses() } else { Hosts::new(named) }
}

/// The part of a coordinator's health by which it is known.
#[derive(Deserialize)]
struct Health {
    #[serde(rename = "solver_version")]
    _solver_version: String,
}

/// Whether a coordinator is well.
pub async fn healthcheck(args: HealthcheckArgs) -> Result<ExitCode> {
    let http = Http::new(&args.url).map_err(refused)?;
    http::call::<Health>(http.get("").timeout(HEALTHY_WITHIN)).await?;
    Ok(ExitCode::SUCCESS)
}
