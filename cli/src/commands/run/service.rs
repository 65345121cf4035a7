//! What does the work of `manduca run`: a coordinator and a worker of its own, or a worker beside the
//! coordinator that has the folder already.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use manduca_server::{AppState, Config, Duty, Hold, Holder, ServerError};
use manduca_worker::http::{Http, Token};
use manduca_worker::{Shutdown, Summary, WorkerError};
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use crate::api::Api;
use crate::commands::hold::{self, Place};
use crate::commands::worker;
use crate::exit::refused;
use crate::output::note;
use crate::token;

/// Between two looks at the database.
const LOOK: Duration = Duration::from_millis(500);
/// How long the database may take no changes: the disk may be full for a moment only.
const PATIENCE: Duration = Duration::from_secs(30);

/// A worker, and the coordinator it works for.
pub struct Service {
    pub api: Api,
    url: String,
    database: PathBuf,
    slots: Option<usize>,
    shutdown: Shutdown,
    worker: JoinHandle<Result<Summary, WorkerError>>,
    coordinator: Coordinator,
}

enum Coordinator {
    /// In this process.
    Own { state: AppState, server: JoinHandle<Result<(), ServerError>>, ends: CancellationToken },
    /// In another one, which ends when it likes.
    Theirs(Holder),
}

impl Service {
    /// Coordinates the database, or joins the coordinator that does.
    pub async fn start(database: &Path, slots: Option<usize>, shutdown: &Shutdown) -> Result<Self> {
        match hold::take_or_find(database).await? {
            Place::Ours(hold) => {
                let coordinator = own(database, hold, None).await?;
                note(format_args!("watch it at {}/", coordinator.1));
                Self::with(database, slots, shutdown, coordinator, None)
            }
            Place::Theirs(holder) => {
                let (url, process) = (holder.url.clone(), holder.process);
                note(format_args!(
                    "joining the coordinator that has {}: {url}/ (process {process})",
                    database.display()
                ));
                let token = token::given(std::env::var_os("MANDUCA_TOKEN_FILE").as_deref().map(Path::new))?;
                let token = token.map(|text| Token::new(&text)).transpose().map_err(refused)?;
                Self::with(database, slots, shutdown, (Coordinator::Theirs(holder), url), token)
            }
        }
    }

    fn with(
        database: &Path,
        slots: Option<usize>,
        shutdown: &Shutdown,
        (coordinator, url): (Coordinator, String),
        token: Option<Token>,
    ) -> Result<Self> {
        let api = Api::of(Http::with_token(&url, token.as_ref()).map_err(refused)?);
        let mut settings = worker::settings(url.clone(), slots, None)?;
        settings.token = token;
        let worker = tokio::spawn(manduca_worker::run(settings, shutdown.clone()));
        let (database, shutdown) = (database.to_owned(), shutdown.clone());
        Ok(Self { api, url, database, slots, shutdown, worker, coordinator })
    }

    /// Whether another `manduca run` coordinates, which ends with its own study.
    pub fn may_be_left_alone(&self) -> bool {
        matches!(&self.coordinator, Coordinator::Theirs(holder) if holder.duty == Duty::Run)
    }

    /// Waits until the coordinator joined has ended, and gives what it held. One of `manduca serve` is
    /// started again by its operator.
    pub fn left_alone(&self) -> impl Future<Output = Result<Hold>> + use<> {
        let (waits, database) = (self.may_be_left_alone(), self.database.clone());
        async move {
            match waits {
                true => hold::when_free(&database).await,
                false => std::future::pending().await,
            }
        }
    }

    /// Coordinates from now on, at the same address if that is free: then the worker notices little.
    pub async fn take_over(self, hold: Hold) -> Result<Self> {
        let address = self.url.trim_start_matches("http://").parse().ok();
        let coordinator = own(&self.database, hold, address).await?;
        note(format_args!("the coordinator joined has ended; this one goes on: watch it at {}/", coordinator.1));
        if coordinator.1 == self.url && !self.worker.is_finished() {
            return Ok(Self { coordinator: coordinator.0, ..self });
        }
        // Nothing is lost with it but what it was computing.
        self.worker.abort();
        Self::with(&self.database, self.slots, &self.shutdown, coordinator, None)
    }

    /// Waits for something to end that should not.
    pub async fn broken(&mut self) -> anyhow::Error {
        let (database, worker) = (&self.database, &mut self.worker);
        match &mut self.coordinator {
            Coordinator::Own { state, server, .. } => tokio::select! {
                ended = server => match ended {
                    Ok(Ok(())) => anyhow!("the coordinator ended"),
                    Ok(Err(error)) => anyhow::Error::from(error).context("the coordinator failed"),
                    Err(error) => anyhow::Error::from(error).context("the coordinator crashed"),
                },
                error = worker_failed(worker) => error,
                error = troubled(state, database) => error,
            },
            Coordinator::Theirs(_) => {
                // The coordinator has workers of its own: this one is a help.
                let error = worker_failed(worker).await;
                note(format_args!("{error:#}; the study is left to other workers"));
                std::future::pending().await
            }
        }
    }

    /// Whether the database is no longer there.
    pub fn is_gone(&self) -> bool {
        matches!(&self.coordinator, Coordinator::Own { state, .. } if state.is_gone())
    }

    /// The worker first, so that it can deliver what it has.
    pub async fn end(mut self) {
        if !self.worker.is_finished() {
            let _ = (&mut self.worker).await;
        }
        let Coordinator::Own { mut server, ends, .. } = self.coordinator else { return };
        ends.cancel();
        if !server.is_finished() {
            let _ = (&mut server).await;
        }
    }
}

/// A coordinator on a loopback port. It opens the database first, so that a fault of the database is the one reported.
async fn own(database: &Path, hold: Hold, wanted: Option<SocketAddr>) -> Result<(Coordinator, String)> {
    let state = manduca_server::open(Config::new(database), hold).await?;
    let wanted = match wanted {
        Some(address) => TcpListener::bind(address).await.ok(),
        None => None,
    };
    let listener = match wanted {
        Some(listener) => listener,
        None => TcpListener::bind("127.0.0.1:0").await.context("cannot open a loopback port")?,
    };
    let holder = hold::holder(listener.local_addr()?, Duty::Run);
    state.announce(&holder).with_context(|| format!("cannot write beside {}", database.display()))?;
    let ends = CancellationToken::new();
    let server = tokio::spawn(manduca_server::serve(listener, state.clone(), ends.clone().cancelled_owned()));
    Ok((Coordinator::Own { state, server, ends }, holder.url))
}

/// Waits for the worker to fail. One that leaves was told to; the study's follower tells that story.
async fn worker_failed(worker: &mut JoinHandle<Result<Summary, WorkerError>>) -> anyhow::Error {
    match worker.await {
        Ok(Ok(_)) => std::future::pending().await,
        Ok(Err(error)) => anyhow::Error::from(error).context("the worker failed"),
        Err(error) => anyhow::Error::from(error).context("the worker crashed"),
    }
}

/// Waits until the database is of no use any more.
async fn troubled(state: &AppState, database: &Path) -> anyhow::Error {
    let path = database.display();
    loop {
        tokio::time::sleep(LOOK).await;
        if state.is_gone() {
            return gone(database);
        }
        if let Some((_, cause)) = state.failing().filter(|(lasts, _)| *lasts > PATIENCE) {
            let seconds = PATIENCE.as_secs();
            return anyhow!(
                "the database {path} has taken no changes for {seconds} s: {cause}; what it has is kept, and the same \
                 command goes on from there"
            );
        }
    }
}

/// The database is no longer there.
pub fn gone(database: &Path) -> anyhow::Error {
    anyhow!(
        "the database {} is gone: it, or its folder, was removed or replaced while the study ran, and what was \
         computed is stored nowhere",
        database.display()
    )
}
