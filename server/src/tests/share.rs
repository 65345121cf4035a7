//! The same simulation is not flown twice.

use serde_json::json;

use super::answers::{result, study};
use super::bench::Bench;

#[tokio::test]
async fn a_study_flown_before_is_finished_at_once() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let first = bench.submit(&study(20, &[])).await;
    // 20 samples and one training.
    assert_eq!(bench.work_off(&worker).await, 21);
    let second = bench.submit(&study(20, &[])).await;
    let view = bench.view(&second).await;
    assert_eq!((view["state"].as_str(), view["samples"]["succeeded"].as_u64()), (Some("training"), Some(20)));
    let job = &bench.get(&format!("{second}/jobs?kind=simulate&limit=1")).await.json()["items"][0];
    assert_eq!(job["cached"], true);
    assert_eq!(job["provenance"]["wall_s"], 0.25);
    let datasets = [bench.get(&format!("{first}/dataset")).await, bench.get(&format!("{second}/dataset")).await];
    assert_eq!(datasets[0].body, datasets[1].body);
    bench.check_counts().await;
}

#[tokio::test]
async fn equal_simulations_that_wait_share_a_result_when_it_comes() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    let first = bench.submit(&study(20, &[])).await;
    let second = bench.submit(&study(20, &[])).await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    bench.complete(&worker, &lease, result(&lease)).await;
    for study in [&first, &second] {
        assert_eq!(bench.view(study).await["samples"]["succeeded"], 1);
    }
    // The rest, each flown once, then two trainings.
    assert_eq!(bench.work_off_by(&worker, 1).await, 19 + 2);
    assert_eq!(bench.view(&second).await["state"], "succeeded");
    bench.check_counts().await;
}

#[tokio::test]
async fn a_fresh_study_takes_no_results_of_others() {
    let bench = Bench::open().await;
    let worker = bench.worker("w").await;
    bench.submit(&study(20, &[])).await;
    bench.work_off(&worker).await;
    let mut spec = study(20, &[]);
    spec["fresh"] = json!(true);
    let fresh = bench.submit(&spec).await;
    assert_eq!(bench.view(&fresh).await["samples"]["ready"], 20);
    // Neither what is there already, nor what comes in meanwhile for a study of other samples.
    let more = bench.submit(&study(30, &[])).await;
    assert_eq!(bench.view(&more).await["samples"]["ready"], 10);
    let leases = bench.claim(&worker, 100).await;
    assert_eq!(leases.len(), 30);
    let (own, others): (Vec<_>, Vec<_>) = leases.iter().partition(|lease| fresh.ends_with(&lease.study.to_string()));
    assert_eq!((own.len(), others.len()), (20, 10));
    for lease in others {
        bench.complete(&worker, lease, result(lease)).await;
    }
    let view = bench.view(&fresh).await;
    assert_eq!((&view["samples"]["leased"], &view["spec"]["fresh"]), (&json!(20), &json!(true)));
    for lease in own {
        bench.complete(&worker, lease, result(lease)).await;
    }
    bench.work_off(&worker).await;
    assert_eq!(bench.view(&fresh).await["state"], "succeeded");
    bench.check_counts().await;
}
