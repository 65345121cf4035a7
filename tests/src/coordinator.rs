//! A coordinator process with its database, its workers and a client.

use std::fs;
use std::net::TcpListener;
use std::ops::Deref;
use std::path::Path;
use std::process;
use std::sync::atomic::{AtomicU16, Ordering};

use serde_json::Value;
use tempfile::TempDir;

use crate::client::Client;
use crate::process::Process;
use crate::program::{manduca, manduca_within};
use crate::wait_for;

/// Ports are taken from here upwards: below those an outgoing connection gets
/// from the system, so that nobody is given a coordinator's port while it is down.
const FIRST_PORT: u16 = 20_000;
const PORTS: u16 = 12_000;

/// A coordinator in a folder of its own, with a [`Client`] of it.
#[derive(Debug)]
pub struct Coordinator {
    process: Process,
    client: Client,
    address: String,
    folder: TempDir,
    starts: u32,
    arguments: Vec<String>,
    environment: Vec<(String, String)>,
    /// Most address space it may have, bytes.
    space: Option<u64>,
}

impl Deref for Coordinator {
    type Target = Client;

    fn deref(&self) -> &Client {
        &self.client
    }
}

impl Coordinator {
    /// Starts one on a fresh database and waits until it is ready.
    pub fn start() -> Self {
        Self::prepared(&[], None, |_| Vec::new())
    }

    /// [`Coordinator::start`] with so much address space, bytes: a request for more memory ends it.
    pub fn start_within(space: u64) -> Self {
        Self::prepared(&[], Some(space), |_| Vec::new())
    }

    /// [`Coordinator::start`] with further arguments of `serve`.
    pub fn start_serving(arguments: &[&str]) -> Self {
        Self::prepared(arguments, None, |_| Vec::new())
    }

    /// [`Coordinator::start`] with an environment which depends on its folder.
    pub fn start_with(environment: impl Fn(&Path) -> Vec<(String, String)>) -> Self {
        Self::prepared(&[], None, environment)
    }

    /// [`Coordinator::start_serving`] with an environment which depends on its folder.
    pub fn start_serving_with(arguments: &[&str], environment: impl Fn(&Path) -> Vec<(String, String)>) -> Self {
        Self::prepared(arguments, None, environment)
    }

    fn prepared(arguments: &[&str], space: Option<u64>, environment: impl Fn(&Path) -> Vec<(String, String)>) -> Self {
        loop {
            // Another process may take the port first; then the next one is tried.
            let address = format!("127.0.0.1:{}", free_port());
            let folder = tempfile::tempdir().expect("a temporary folder");
            let client = Client::new(&format!("http://{address}"));
            let arguments: Vec<String> = arguments.iter().map(ToString::to_string).collect();
            let environment = environment(folder.path());
            let process = serve(folder.path(), &address, 1, &arguments, &environment, space);
            let mut coordinator = Self { process, client, address, folder, starts: 1, arguments, environment, space };
            if coordinator.becomes_ready() {
                return coordinator;
            }
        }
    }

    /// Whether it answers `/readyz` before it ends.
    fn becomes_ready(&mut self) -> bool {
        let Self { process, client, .. } = self;
        wait_for("a ready coordinator", || {
            if process.ended().is_some() {
                assert!(process.said().contains("in use"), "the coordinator does not start: {}", process.said());
                return Some(false);
            }
            let answer = client.try_send(client.request("GET", "/readyz"));
            answer.is_ok_and(|answer| answer.status == 200).then_some(true)
        })
    }

    /// Kills it with SIGKILL.
    pub fn kill(&mut self) {
        self.process.kill();
    }

    /// Stops it where it is (SIGSTOP), as a paused container is.
    pub fn pause(&self) {
        self.process.stop();
    }

    /// Lets it go on (SIGCONT).
    pub fn resume(&self) {
        self.process.resume();
    }

    /// Starts it again on the same port and database.
    pub fn restart(&mut self) {
        assert!(self.try_restart(), "the coordinator does not start again: {}", self.process.said());
    }

    /// [`Coordinator::restart`]; false when it ends instead.
    pub fn try_restart(&mut self) -> bool {
        self.process.kill();
        self.starts += 1;
        let Self { folder, address, starts, arguments, environment, space, .. } = &*self;
        self.process = serve(folder.path(), address, *starts, arguments, environment, *space);
        let Self { process, client, .. } = self;
        wait_for("a coordinator which is ready again", || {
            if process.ended().is_some() {
                return Some(false);
            }
            let answer = client.try_send(client.request("GET", "/readyz"));
            answer.is_ok_and(|answer| answer.status == 200).then_some(true)
        })
    }

    /// Asks it to leave with SIGTERM and tells its exit code.
    pub fn leave(&mut self) -> Option<i32> {
        self.process.terminate();
        self.process.exit_code()
    }

    /// What it has logged since it was last started.
    pub fn said(&self) -> String {
        self.process.said()
    }

    /// Its address as workers and clients are given it.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Where it listens, as `host:port`.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Most memory it has had since it was last started, bytes.
    pub fn peak_memory(&self) -> u64 {
        self.process.peak_memory()
    }

    /// Memory it has now, bytes.
    pub fn memory(&self) -> u64 {
        self.process.memory()
    }

    /// Lets [`Coordinator::peak_memory`] begin anew.
    pub fn forget_peak(&self) {
        self.process.forget_peak();
    }

    /// Its folder; the database is in `data`.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// The folder of its database, as an argument.
    pub fn data(&self) -> String {
        self.folder().join("data").to_str().expect("a temporary folder has a plain name").to_owned()
    }

    /// Starts a worker with one slot.
    pub fn worker(&self, name: &str) -> Process {
        self.worker_by(&self.url(), name)
    }

    /// [`Coordinator::worker`] which reaches the coordinator by another address, such as a proxy's.
    pub fn worker_by(&self, url: &str, name: &str) -> Process {
        let command = manduca(&["worker", "--coordinator", url, "--slots", "1", "--name", name]);
        Process::start(command, self.folder.path(), name)
    }

    /// Submits a study which must be accepted, and tells its id.
    pub fn submit(&self, study: &Value) -> String {
        text(&self.post("/v1/studies", study).expect(201)["id"])
    }

    /// A study as it is now.
    pub fn study(&self, id: &str) -> Value {
        self.get(&format!("/v1/studies/{id}"))
    }

    /// Pauses, resumes or cancels a study.
    pub fn steer(&self, id: &str, action: &str) -> Value {
        self.send(self.request("POST", &format!("/v1/studies/{id}/{action}"))).expect(200)
    }

    /// Waits until at least so many samples of a study have succeeded.
    pub fn wait_for_samples(&self, id: &str, least: u64) {
        wait_for("samples", || (self.study(id)["samples"]["succeeded"].as_u64()? >= least).then_some(()));
    }

    /// Waits until a study has come to its good end, and fails at a bad one.
    pub fn wait_until_succeeded(&self, id: &str) -> Value {
        wait_for("a study to succeed", || {
            let view = self.study(id);
            assert!(view["state"] != "failed" && view["state"] != "cancelled", "{view}");
            (view["state"] == "succeeded").then_some(view)
        })
    }

    /// A study's dataset in a media type, as text.
    pub fn dataset(&self, id: &str, media_type: &str) -> String {
        let request = self.request("GET", &format!("/v1/studies/{id}/dataset")).header("accept", media_type);
        let answer = self.send(request);
        assert_eq!(answer.status, 200, "{}", answer.body);
        assert!(answer.header("content-type").starts_with(media_type), "{}", answer.header("content-type"));
        answer.body
    }

    /// All jobs of a study, page after page.
    pub fn jobs(&self, id: &str) -> Vec<Value> {
        let mut jobs = Vec::new();
        let mut path = format!("/v1/studies/{id}/jobs?limit=7");
        loop {
            let mut page = self.get(&path);
            jobs.append(page["items"].as_array_mut().expect("a page has items"));
            match page["next_cursor"].as_str() {
                Some(cursor) => path = format!("/v1/studies/{id}/jobs?limit=7&cursor={cursor}"),
                None => return jobs,
            }
        }
    }

    /// The worker of this name as the coordinator sees it.
    pub fn worker_view(&self, name: &str) -> Option<Value> {
        let workers = self.get("/v1/workers");
        workers.as_array().expect("a list").iter().find(|worker| worker["name"] == name).cloned()
    }

    /// The jobs of a study which the worker of this name has.
    pub fn held_by(&self, study: &str, name: &str) -> Vec<Value> {
        let Some(worker) = self.worker_view(name) else { return Vec::new() };
        let page = self.get(&format!("/v1/studies/{study}/jobs?state=leased&limit=1000"));
        let jobs = page["items"].as_array().expect("a page has items");
        jobs.iter().filter(|job| job["worker"] == worker["id"]).cloned().collect()
    }

    /// Waits until the worker of this name has a job.
    pub fn wait_for_lease(&self, name: &str) {
        wait_for("a leased job", || (self.worker_view(name)?["leased"] != 0).then_some(()));
    }
}

/// The text of a JSON string.
pub fn text(value: &Value) -> String {
    value.as_str().unwrap_or_else(|| panic!("{value} is no string")).to_owned()
}

fn serve(
    folder: &Path,
    address: &str,
    start: u32,
    arguments: &[String],
    environment: &[(String, String)],
    space: Option<u64>,
) -> Process {
    let data = folder.join("data");
    fs::create_dir_all(&data).expect("a folder can be made");
    let data = data.to_str().expect("a temporary folder has a plain name");
    let serve = ["serve", "--listen", address, "--data", data];
    let mut command = match space {
        Some(space) => manduca_within(space, &serve),
        None => manduca(&serve),
    };
    command.args(arguments).envs(environment.iter().map(|(name, value)| (name, value)));
    Process::start(command, folder, &format!("serve-{start}"))
}

/// A port nobody listens on. Test processes start at different places, and
/// tests of one process never get the same port.
pub fn free_port() -> u16 {
    static TRIED: AtomicU16 = AtomicU16::new(0);
    let start = process::id().wrapping_mul(37) % u32::from(PORTS);
    loop {
        let offset = (start + u32::from(TRIED.fetch_add(1, Ordering::Relaxed))) % u32::from(PORTS);
        let port = FIRST_PORT + u16::try_from(offset).expect("below the number of ports");
        if TcpListener::bind(("127.0.0.1", port)).is_ok() {
            return port;
        }
    }
}
