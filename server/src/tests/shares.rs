//! Running studies share what workers can do.

use std::collections::BTreeMap;

use manduca_protocol::worker::Lease;
use serde_json::{Value, json};

use super::answers::{completion, result, study};
use super::bench::Bench;

/// A study with samples of its own.
fn another(seed: u32, samples: u32) -> Value {
    let mut study = study(samples, &[]);
    study["seed"] = json!(seed);
    study
}

/// How many of these leases each study has, by path.
fn counts(leases: &[Lease]) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    for lease in leases {
        *counts.entry(format!("/v1/studies/{}", lease.study)).or_default() += 1;
    }
    counts
}

#[tokio::test]
async fn a_small_study_behind_a_large_one_gets_its_share() {
    let bench = Bench::open().await;
    let (worker, other) = (bench.worker("w").await, bench.worker("other").await);
    let large = bench.submit(&another(1, 500)).await;
    assert_eq!(counts(&bench.claim(&worker, 60).await)[&large], 60);
    let small = bench.submit(&another(2, 20)).await;
    // It has none, the large one has 60: all of it comes first.
    let given = bench.claim(&other, 30).await;
    assert_eq!((counts(&given)[&small], counts(&given)[&large]), (20, 10));
    let results: Vec<_> =
        given.iter().filter(|l| small.ends_with(&l.study.to_string())).map(|l| completion(l, result(l))).collect();
    bench.exchange(&other, json!({ "complete": results })).await;
    assert_eq!(bench.view(&small).await["state"], "training");
    // Its training is not behind the samples of the other.
    let given = bench.claim(&other, 1).await;
    assert_eq!(counts(&given), BTreeMap::from([(small, 1)]));
    bench.check_counts().await;
}

#[tokio::test]
async fn three_studies_have_a_third_each_and_take_turns() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let mut studies = Vec::new();
    for seed in 1..=3 {
        studies.push(bench.submit(&another(seed, 100)).await);
    }
    let given = bench.claim(&worker, 30).await;
    assert!(studies.iter().all(|study| counts(&given)[study] == 10), "{:?}", counts(&given));
    let results: Vec<_> = given.iter().map(|l| completion(l, result(l))).collect();
    bench.exchange(&worker, json!({ "complete": results })).await;
    // One at a time, each done before the next is asked for.
    let mut turns = Vec::new();
    for _ in 0..6 {
        let lease = bench.claim(&worker, 1).await.remove(0);
        bench.complete(&worker, &lease, result(&lease)).await;
        turns.push(format!("/v1/studies/{}", lease.study));
    }
    assert_eq!([&turns[..3], &turns[3..]], [&studies[..], &studies[..]]);
    // A paused study leaves its share to the others.
    bench.post(&format!("{}/pause", studies[1]), "").await;
    let given = bench.claim(&worker, 20).await;
    assert_eq!((counts(&given)[&studies[0]], counts(&given)[&studies[2]]), (10, 10));
    let told = bench.get(&format!("{}/jobs?state=ready&limit=1", studies[2])).await.json();
    let told = bench.get(&format!("/v1/jobs/{}/explain", told["items"][0]["id"])).await.json();
    assert_eq!(told["jobs_ahead"], 1, "the first of the other study: {told}");
    bench.check_counts().await;
}
