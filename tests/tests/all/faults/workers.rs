//! Workers which stop and go on, and workers which die again and again.

use std::process::Command;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use manduca_tests::chance::Chance;
use manduca_tests::client::Client;
use manduca_tests::coordinator::Coordinator;
use manduca_tests::process::Process;
use manduca_tests::program::manduca;
use manduca_tests::shim::Shim;
use manduca_tests::studies::lattice;
use manduca_tests::wait_for;
use serde_json::{Value, json};

use super::{assert_once, times, undisturbed};

/// What a request already on its way is given to arrive.
const UNDER_WAY: Duration = Duration::from_millis(300);

/// The lease in use: short enough for a test, or the usual one.
fn lease() -> String {
    times(2, 15).to_string()
}

#[test]
fn a_worker_stopped_past_its_lease_is_fenced_off() {
    let study = lattice("stopped", 21, u32::try_from(times(40, 4000)).unwrap());
    let coordinator = Coordinator::start_serving(&["--lease", &lease()]);
    let names: Vec<_> = (0..times(3, 20)).map(|i| format!("sleeper-{i}")).collect();
    let sleepers: Vec<_> = names.iter().map(|name| coordinator.worker(name)).collect();
    names.iter().for_each(|name| drop(wait_for("a worker", || coordinator.worker_view(name))));
    let id = coordinator.submit(&study);
    let mut held = Vec::new();
    for (name, sleeper) in names.iter().zip(&sleepers) {
        // One which is between two jobs when it stops has nothing to be late with.
        let jobs = wait_for("a worker stopped at work", || {
            sleeper.resume();
            coordinator.wait_for_lease(name);
            sleeper.stop();
            sleep(UNDER_WAY);
            Some(coordinator.held_by(&id, name)).filter(|jobs| !jobs.is_empty())
        });
        held.extend(jobs.into_iter().map(|job| (job["id"].clone(), job["attempt"].as_u64().unwrap(), sleeper)));
    }
    let _spare = coordinator.worker("spare");
    coordinator.wait_until_succeeded(&id);
    let done = coordinator.dataset(&id, "text/csv");

    sleepers.iter().for_each(Process::resume);
    let mut late = 0;
    for (job, attempt, sleeper) in &held {
        // Told in time that the job is gone, it does not even return its result.
        late += wait_for("the late result", || {
            let kept = coordinator.get("/v1/evidence?class=refused&limit=1000");
            let is_it = |seen: &&Value| seen["job"] == *job && seen["attempt"] == *attempt;
            let refused = kept.as_array().unwrap().iter().find(is_it).map(|_| 1);
            // One whose request ran out of time as it slept never read that it has the job.
            let said = sleeper.said();
            let unaware = said.contains("job taken away") || said.contains("operation timed out");
            refused.or_else(|| unaware.then_some(0))
        });
        let now = coordinator.get(&format!("/v1/jobs/{job}"));
        assert!(now["attempt"].as_u64().unwrap() > *attempt, "a late result was taken: {now}");
    }
    println!("{} jobs of stopped workers, {late} late results, all refused and kept as evidence", held.len());
    assert!(late > 0, "no worker was late, so nothing was shown");
    assert_eq!(coordinator.get("/v1/evidence?class=nondeterminism"), json!([]));
    assert_once(&coordinator, &id);
    assert_eq!(coordinator.dataset(&id, "text/csv"), done, "a late result changed the dataset");
    assert_eq!([done], *undisturbed(&[study]));
}

#[test]
fn steps_of_a_workers_clock_end_no_lease_and_change_no_duration() {
    let study = lattice("clock", 33, u32::try_from(times(200, 2000)).unwrap());
    let coordinator = Coordinator::start_serving(&["--lease", &lease()]);
    let shim = Shim::new(&coordinator.folder().join("unwatched"), coordinator.folder());
    let url = coordinator.url();
    let mut command = manduca(&["worker", "--coordinator", &url, "--slots", "1", "--name", "jumpy"]);
    command.envs(shim.environment(false));
    let worker = Process::start(command, coordinator.folder(), "jumpy");
    // A process under the shim does see another time.
    shim.set("clock 3600");
    let seen = Command::new("date").arg("+%s").envs(shim.environment(false)).output().unwrap();
    let seen: u64 = String::from_utf8(seen.stdout).unwrap().trim().parse().unwrap();
    assert!(seen > SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs() + 3000);

    let id = coordinator.submit(&study);
    coordinator.wait_for_lease("jumpy");
    let mut steps = 0;
    while coordinator.study(&id)["state"] == "sampling" {
        shim.set(["clock 3600", "clock -3600", ""][steps % 3]);
        steps += 1;
        sleep(Duration::from_millis(times(40, 400)));
    }
    shim.set("");
    coordinator.wait_until_succeeded(&id);
    assert!(steps >= 6, "the clock was set {steps} times only: nothing was shown");
    for job in coordinator.jobs(&id) {
        let wall_s = job["provenance"]["wall_s"].as_f64();
        assert!(wall_s.is_some_and(|s| (0.0..600.0).contains(&s)), "{job}");
        // More attempts are told with the reason of the last one.
        assert!(job["attempt"] == 1, "{job}\n{}", worker.said());
    }
    println!("{steps} steps of a worker's clock by an hour, every job done at its first attempt");
    assert_eq!([coordinator.dataset(&id, "text/csv")], *undisturbed(&[study]));
}

/// A job whose worker was killed.
struct Orphan {
    job: Value,
    attempt: u64,
    since: Instant,
}

/// Looks at orphans until all are leased again and no more come; gives how long each took.
fn watch(url: String, orphans: Receiver<Orphan>) -> JoinHandle<Vec<Duration>> {
    spawn(move || {
        let (client, mut waiting, mut delays, mut more) = (Client::new(&url), Vec::new(), Vec::new(), true);
        while more || !waiting.is_empty() {
            match orphans.recv_timeout(Duration::from_millis(10)) {
                Ok(orphan) => waiting.push(orphan),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => more = false,
            }
            waiting.retain(|orphan: &Orphan| {
                let job = client.get(&format!("/v1/jobs/{}", orphan.job));
                let again = job["attempt"].as_u64().unwrap() > orphan.attempt;
                if again {
                    delays.push(orphan.since.elapsed());
                }
                !again
            });
        }
        delays
    })
}

/// A study which keeps two workers busy for a while.
fn busy(seed: u64) -> Value {
    let mut study = lattice("killed", seed, u32::try_from(times(60, 500)).unwrap());
    if times(0, 1) == 1 {
        study["model"]["solver"]["chordwise_panels"] = json!(6);
        study["model"]["solver"]["spanwise_panels"] = json!(8);
        study["model"]["solver"]["steps_per_stroke"] = json!(40);
    }
    study
}

#[test]
fn workers_killed_again_and_again_change_no_dataset() {
    let coordinator = Coordinator::start_serving(&["--lease", &lease()]);
    let (kills, pause) = (times(3, 120), Duration::from_millis(times(500, 5000)));
    let worker = |i: u64| (format!("mortal-{i}"), coordinator.worker(&format!("mortal-{i}")));
    let mut workers = [worker(0), worker(1)];
    let mut studies = vec![busy(100)];
    let mut ids = vec![coordinator.submit(&studies[0])];
    let (orphans, taken) = channel();
    let (watch, mut chance) = (watch(coordinator.url(), taken), Chance::new(77));
    for kill in 0..kills {
        if coordinator.study(&ids[ids.len() - 1])["state"] != "sampling" {
            studies.push(busy(101 + kill));
            ids.push(coordinator.submit(&studies[studies.len() - 1]));
        }
        let victim = usize::try_from(chance.next() >> 63).unwrap();
        coordinator.wait_for_lease(&workers[victim].0);
        workers[victim].1.kill();
        let since = Instant::now();
        let (name, _dead) = std::mem::replace(&mut workers[victim], worker(2 + kill));
        sleep(UNDER_WAY);
        for job in ids.iter().flat_map(|id| coordinator.held_by(id, &name)) {
            let orphan = Orphan { job: job["id"].clone(), attempt: job["attempt"].as_u64().unwrap(), since };
            orphans.send(orphan).unwrap();
        }
        sleep(pause.saturating_sub(since.elapsed()));
    }
    drop(orphans);
    let mut delays = watch.join().unwrap();
    delays.sort();
    let of = |at: usize| delays.get(at).map_or(f64::NAN, Duration::as_secs_f64);
    println!(
        "{kills} workers killed in {} studies with a lease of {} s; {} jobs leased again after {:.2} s (middle), {:.2} s (longest)",
        ids.len(),
        lease(),
        delays.len(),
        of(delays.len() / 2),
        of(delays.len().saturating_sub(1))
    );
    assert!(!delays.is_empty(), "no kill took a job with it");
    let done: Vec<_> = ids
        .iter()
        .map(|id| {
            coordinator.wait_until_succeeded(id);
            assert_once(&coordinator, id);
            coordinator.dataset(id, "text/csv")
        })
        .collect();
    assert_eq!(done, undisturbed(&studies));
}
