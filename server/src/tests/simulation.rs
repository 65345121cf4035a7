//! The whole service in simulated time: the real handlers and the real SQL,
//! made-up workers and a network which drops, delays, repeats and reorders
//! messages; workers are killed and stopped, the coordinator is killed and
//! started again from the bytes on its disk, its clock steps meanwhile. All of
//! it follows from one seed. After every run the invariants must hold.
//!
//! `MANDUCA_SIMULATION_SEEDS=100000` runs as many seeds, from the one of
//! `MANDUCA_SIMULATION_FIRST` on; a failing seed is printed.

mod network;
mod witness;
mod worker;
mod world;

use std::env;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use super::answers::study;
use super::bench::Bench;
use world::World;

/// Seeds where nothing else is said.
const SEEDS: u64 = 1000;

/// The study every run is of.
fn spec() -> serde_json::Value {
    study(20, &["free"])
}

/// What one undisturbed worker makes of it.
async fn undisturbed() -> Vec<u8> {
    let bench = Bench::open().await;
    let study = bench.submit(&spec()).await;
    bench.work_off(&bench.worker("calm").await).await;
    bench.get(&format!("{study}/dataset?format=csv")).await.body.to_vec()
}

fn number(name: &str, otherwise: u64) -> u64 {
    env::var(name).ok().map_or(otherwise, |text| text.parse().expect("a number"))
}

fn runtime() -> tokio::runtime::Runtime {
    // One thread: what happens at the same time happens in one order.
    tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime needs no permission")
}

#[test]
fn a_seed_always_does_the_same() {
    let calm = runtime().block_on(undisturbed());
    let template = runtime().block_on(world::empty_database());
    for seed in 1..=10 {
        let courses =
            [(), ()].map(|()| runtime().block_on(async { World::new(seed, &template).await.run(&calm).await }));
        assert_eq!(courses[0], courses[1], "seed {seed}");
    }
}

#[test]
fn every_seed_keeps_the_invariants() {
    static CALM: OnceLock<Vec<u8>> = OnceLock::new();
    let calm = CALM.get_or_init(|| runtime().block_on(undisturbed()));
    let template = runtime().block_on(world::empty_database());
    let (first, seeds) = (number("MANDUCA_SIMULATION_FIRST", 1), number("MANDUCA_SIMULATION_SEEDS", SEEDS));
    let next = AtomicU64::new(first);
    let violations: Vec<String> = std::thread::scope(|scope| {
        // Each waits for the thread of its database half of the time.
        let threads = 4 * std::thread::available_parallelism().map_or(1, usize::from);
        let run = || {
            let (runtime, mut violations) = (runtime(), Vec::new());
            loop {
                let seed = next.fetch_add(1, Ordering::Relaxed);
                if seed >= first + seeds || violations.len() >= 5 {
                    return violations;
                }
                let outcome = runtime.block_on(async { World::new(seed, &template).await.run(calm).await });
                violations.extend(outcome.err().map(|why| format!("seed {seed}: {why}")));
            }
        };
        let threads: Vec<_> = (0..threads).map(|_| scope.spawn(run)).collect();
        threads.into_iter().flat_map(|thread| thread.join().expect("a simulation does not panic")).collect()
    });
    assert!(violations.is_empty(), "\n{}", violations.join("\n"));
}
