//! `manduca serve` and the question whether it is well.

use std::net::SocketAddr;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result};
use manduca_server::{Access, Config, Duty, Host, Hosts, Offline, Secret, TokenHash};
use manduca_worker::http::{self, Http};
use serde::Deserialize;
use tokio::net::{TcpListener, lookup_host};

use super::{hold, host};
use crate::args::{HealthcheckArgs, ServeArgs};
use crate::exit::refused;
use crate::output::note;
use crate::{files, signals, token};

/// Name of the database in its folder.
pub const DATABASE: &str = "manduca.db";
/// How long a health check waits.
const HEALTHY_WITHIN: Duration = Duration::from_secs(3);

/// Is the coordinator until told to stop.
pub async fn serve(args: ServeArgs) -> Result<ExitCode> {
    let addresses: Vec<SocketAddr> = match lookup_host(&args.listen).await {
        Ok(addresses) => addresses.collect(),
        Err(error) => return Err(refused(format!("--listen {}: {error}", args.listen))),
    };
    let listener =
        TcpListener::bind(&addresses[..]).await.with_context(|| format!("cannot listen on {}", args.listen))?;
    let database = args.data.join(DATABASE);
    let given = given(&args)?;
    let is_reachable = addresses.iter().any(|a| !a.ip().is_loopback());
    let asks = asks_for_tokens(&args, is_reachable, &given);
    if asks && given.is_empty() && !database.exists() {
        return Err(without_token(&args));
    }
    let hold = hold::alone(&database).await?;
    if asks && given.is_empty() && !has_tokens(&database).await? {
        return Err(without_token(&args));
    }
    let mut config = Config::new(&database);
    config.access = if asks { Access::Tokens(given) } else { Access::Open };
    config.hosts = hosts(&args, is_reachable);
    config.run_limits.simulate = Duration::from_secs_f64(args.run_limit);
    config.set_lease(Duration::from_secs_f64(args.lease));
    config.max_attempts = args.max_attempts;
    config.keep = args.keep_days.map(|days| Duration::from_secs_f64(days * 86_400.0));
    config.connections = files::connections(config.connections);
    let state = manduca_server::open(config, hold).await?;
    let address = listener.local_addr()?;
    state
        .announce(&hold::holder(address, Duty::Serve))
        .with_context(|| format!("cannot write beside {}", database.display()))?;
    note(format_args!("listening on http://{address}, database {}", database.display()));
    let shutdown = signals::shutdown();
    tokio::select! {
        ended = manduca_server::serve(listener, state, shutdown.drain.cancelled_owned()) => ended.context("the coordinator failed")?,
        () = shutdown.stop.cancelled() => note("stopped at once; whatever was committed is kept"),
    }
    Ok(ExitCode::SUCCESS)
}

/// The token given to this command, if any.
fn given(args: &ServeArgs) -> Result<Vec<TokenHash>> {
    let given = token::given(args.token_file.as_deref())?;
    if args.insecure {
        if given.is_some() {
            note("--insecure: the token given is not asked for");
        }
        return Ok(Vec::new());
    }
    match given.map(|text| Secret::new(&text)).transpose() {
        Ok(given) => Ok(given.iter().map(Secret::hash).collect()),
        Err(why) => Err(refused(format!("the token given: {why}"))),
    }
}

/// Whether tokens are asked for: at addresses others can reach, and wherever one is given.
fn asks_for_tokens(args: &ServeArgs, is_reachable: bool, given: &[TokenHash]) -> bool {
    !args.insecure && (is_reachable || args.require_tokens || !given.is_empty())
}

/// Whether the database has a token that allows something.
async fn has_tokens(database: &Path) -> Result<bool> {
    let mut database = Offline::open(database).await?;
    let tokens = database.tokens().await?;
    database.close().await;
    Ok(tokens.iter().any(|token| token.revoked_at.is_none()))
}

fn without_token(args: &ServeArgs) -> anyhow::Error {
    let data = args.data.display();
    refused(format!(
        "--listen {}: tokens are to be asked for, and there is none. `manduca token create NAME --scope admin --init \
         --data {data}` makes one, MANDUCA_TOKEN or --token-file gives one; --insecure asks for none, on a network to \
         be trusted",
        args.listen
    ))
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
