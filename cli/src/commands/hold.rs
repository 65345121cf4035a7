//! Who coordinates the database of a folder.

use std::net::SocketAddr;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Result;
use manduca_server::{Duty, Hold, Holder, OpenError, Taken};
use manduca_worker::http::{self, Http};

use super::host;

/// How long the coordinator before this one may take to end: a restart is no second coordinator.
const RESTART: Duration = Duration::from_secs(3);
/// How long one that has just started may take to say where it is reached.
const START: Duration = Duration::from_secs(60);
/// How long it may take to answer.
const ANSWER: Duration = Duration::from_secs(2);
/// Between two looks.
const GLANCE: Duration = Duration::from_millis(100);

/// Takes a database for this process alone.
pub async fn alone(database: &Path) -> Result<Hold> {
    let began = Instant::now();
    loop {
        match Hold::take(database)? {
            Taken::Ours(hold) => return Ok(hold),
            Taken::Theirs(holder) if began.elapsed() >= RESTART => return Err(held(database, holder).into()),
            Taken::Theirs(_) => tokio::time::sleep(GLANCE).await,
        }
    }
}

/// A database that is this process's, or the coordinator to whom it belongs.
pub enum Place {
    /// It is ours.
    Ours(Hold),
    /// Another coordinator has it, and answers.
    Theirs(Holder),
}

/// Takes a database, or finds the coordinator that has it.
pub async fn take_or_find(database: &Path) -> Result<Place> {
    let began = Instant::now();
    loop {
        match Hold::take(database)? {
            Taken::Ours(hold) => return Ok(Place::Ours(hold)),
            Taken::Theirs(Some(holder)) if is_within_reach(&holder) && answers(&holder.url).await => {
                return Ok(Place::Theirs(holder));
            }
            Taken::Theirs(holder)
                if began.elapsed() >= START || holder.as_ref().is_some_and(|h| !is_within_reach(h)) =>
            {
                return Err(held(database, holder).into());
            }
            Taken::Theirs(_) => tokio::time::sleep(GLANCE).await,
        }
    }
}

/// Waits until a database is free, and takes it.
pub async fn when_free(database: &Path) -> Result<Hold> {
    loop {
        if let Taken::Ours(hold) = Hold::take(database)? {
            return Ok(hold);
        }
        tokio::time::sleep(GLANCE).await;
    }
}

fn held(path: &Path, holder: Option<Holder>) -> OpenError {
    OpenError::Held { path: path.to_owned(), holder: holder.map(Box::new) }
}

/// A loopback address means another machine there, where a file system is shared.
fn is_within_reach(holder: &Holder) -> bool {
    holder.host == host::name() || !["//127.", "//[::1]", "//localhost"].iter().any(|local| holder.url.contains(local))
}

async fn answers(url: &str) -> bool {
    let Ok(http) = Http::new(url) else { return false };
    http::send(http.get("/healthz").timeout(ANSWER)).await.is_ok()
}

/// This process, as others find it.
pub fn holder(address: SocketAddr, duty: Duty) -> Holder {
    let mut near = address;
    if address.ip().is_unspecified() {
        near.set_ip(if address.is_ipv4() { [127, 0, 0, 1].into() } else { std::net::Ipv6Addr::LOCALHOST.into() });
    }
    Holder { url: format!("http://{near}"), process: std::process::id(), host: host::name(), duty }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_for_all_is_reached_on_loopback() {
        let url = |text: &str| holder(text.parse().unwrap(), Duty::Serve).url;
        assert_eq!(url("0.0.0.0:80"), "http://127.0.0.1:80");
        assert_eq!(url("[::]:80"), "http://[::1]:80");
        assert_eq!(url("10.1.2.3:80"), "http://10.1.2.3:80");
    }

    #[test]
    fn loopback_is_within_reach_on_its_own_machine_only() {
        let on = |host: &str, url: &str| {
            is_within_reach(&Holder { url: url.into(), process: 1, host: host.into(), duty: Duty::Run })
        };
        assert!(on(&host::name(), "http://127.0.0.1:1"));
        assert!(!on("elsewhere", "http://127.0.0.1:1") && !on("elsewhere", "http://[::1]:1"));
        assert!(on("elsewhere", "http://10.1.2.3:1"));
    }
}
