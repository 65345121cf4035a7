//! `manduca serve` and the question whether it is well.

use std::net::SocketAddr;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, Result};
use manduca_server::Config;
use tokio::net::{TcpListener, lookup_host};

use crate::args::{HealthcheckArgs, ServeArgs};
use crate::exit::refused;
use crate::output::note;
use crate::signals;

/// Name of the database in its folder.
const DATABASE: &str = "manduca.db";
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
    if !args.insecure && addresses.iter().any(|a| !a.ip().is_loopback()) {
        return Err(refused(format!(
            "--listen {}: others can reach this address, and there is no authentication yet; \
             add --insecure if the network is to be trusted",
            args.listen
        )));
    }
    let config = config(&args.data)?;
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

/// Whether a coordinator is well.
pub async fn healthcheck(args: HealthcheckArgs) -> Result<ExitCode> {
    let http = manduca_worker::http::Http::new(&args.url).map_err(refused)?;
    manduca_worker::http::send(http.get("").timeout(HEALTHY_WITHIN)).await?;
    Ok(ExitCode::SUCCESS)
}
