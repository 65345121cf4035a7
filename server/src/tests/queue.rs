//! Leases, fencing, expiry.

use serde_json::json;

use super::answers::{completion, flown, infeasible, result, study, trained};
use super::bench::Bench;

#[tokio::test]
async fn jobs_are_leased_in_order_and_taken_once() {
    let bench = Bench::open().await;
    let study = bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let leases = bench.claim(&worker, 3).await;
    assert_eq!(leases.iter().map(|l| l.attempt).collect::<Vec<_>>(), [1, 1, 1]);
    assert!(leases.windows(2).all(|pair| pair[0].job < pair[1].job && pair[0].task.is_some()));
    let told = bench.complete(&worker, &leases[0], result(&leases[0])).await;
    assert_eq!((told.accepted, told.rejected), (vec![leases[0].job], vec![]));
    let view = bench.view(&study).await;
    assert_eq!(view["samples"]["succeeded"], 1);
    assert_eq!(view["samples"]["leased"], 2);
    assert_eq!(view["samples"]["ready"], 17);
    assert_eq!(bench.get("/v1/workers").await.json()[0]["completed"], 1);
    bench.check_counts().await;
}

#[tokio::test]
async fn the_same_result_again_is_a_replay_and_another_is_evidence() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let lease = &bench.claim(&worker, 1).await[0];
    for _ in 0..2 {
        assert_eq!(bench.complete(&worker, lease, result(lease)).await.accepted, [lease.job]);
    }
    assert_eq!(bench.evidence("nondeterminism").await, 0);
    let told = bench.complete(&worker, lease, flown(-1.0)).await;
    assert_eq!(told.rejected[0].job, lease.job);
    assert_eq!(bench.evidence("nondeterminism").await, 1);
    assert_eq!(bench.get("/v1/workers").await.json()[0]["completed"], 1);
}

#[tokio::test]
async fn an_expired_lease_goes_to_another_worker_and_fences_off_the_first() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let (slow, quick) = (bench.worker("slow").await, bench.worker("quick").await);
    let lease = bench.claim(&slow, 1).await.remove(0);
    bench.pass(15.0).await;
    let job = format!("/v1/jobs/{}", lease.job);
    let view = bench.get(&job).await.json();
    assert_eq!(view["state"], "ready");
    assert!(view["reason"].as_str().is_some_and(|r| r.contains("lease expired") && r.contains("slow")), "{view}");
    let again = bench.claim(&quick, 1).await.remove(0);
    assert_eq!((again.job, again.attempt), (lease.job, 2));
    let told = bench.complete(&slow, &lease, result(&lease)).await;
    assert_eq!((told.accepted.len(), told.rejected.len()), (0, 1));
    assert_eq!(bench.evidence("refused").await, 1);
    let forged = completion(&again, result(&again));
    let told = bench.exchange(&slow, json!({ "complete": [forged] })).await;
    assert_eq!(told.rejected.len(), 1, "the attempt is another worker's");
    assert_eq!(bench.complete(&quick, &again, result(&again)).await.accepted, [again.job]);
}

#[tokio::test]
async fn a_result_just_after_expiry_is_still_the_present_attempts() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    bench.pass(15.0).await;
    assert_eq!(bench.complete(&worker, &lease, result(&lease)).await.accepted, [lease.job]);
    bench.pass(60.0).await;
    assert_eq!(bench.get(&format!("/v1/jobs/{}", lease.job)).await.json()["state"], "succeeded");
    bench.check_counts().await;
}

#[tokio::test]
async fn three_failures_give_a_job_up_and_each_waits_longer() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let others = bench.claim(&worker, 20).await;
    let mut lease = others[0].clone();
    for (wait, state) in [(1.0, "delayed"), (4.0, "delayed"), (0.0, "dead")] {
        assert_eq!(bench.fail(&worker, &lease, "out of memory").await.accepted, [lease.job]);
        let view = bench.get(&format!("/v1/jobs/{}", lease.job)).await.json();
        assert_eq!((view["state"].as_str(), view["reason"].as_str()), (Some(state), Some("out of memory")));
        if state == "dead" {
            break;
        }
        bench.pass(wait - 0.1).await;
        assert!(bench.claim(&worker, 1).await.is_empty(), "it waits {wait} s");
        bench.pass(0.1).await;
        lease = bench.claim(&worker, 1).await.remove(0);
    }
    let again = bench.fail(&worker, &lease, "out of memory").await;
    assert_eq!(again.accepted, [lease.job], "a report sent twice is known");
    assert_eq!(bench.get("/v1/workers").await.json()[0]["failed"], 3);
    bench.check_counts().await;
}

#[tokio::test]
async fn ten_lost_workers_give_a_job_up_and_a_few_do_not() {
    let bench = Bench::open().await;
    let study = bench.submit(&study(20, &[])).await;
    let first = bench.claim(&bench.worker("w0").await, 1).await.remove(0);
    let job = format!("/v1/jobs/{}", first.job);
    for lost in 1..=10 {
        bench.pass(15.0).await;
        let state = if lost < 10 { "ready" } else { "dead" };
        assert_eq!(bench.get(&job).await.json()["state"], state, "after {lost} workers");
        let told = bench.get(&format!("{job}/explain")).await.json();
        assert_eq!((&told["losses"], &told["failures"]), (&json!(lost), &json!(0)));
        if lost < 10 {
            let again = bench.claim(&bench.worker(&format!("w{lost}")).await, 1).await.remove(0);
            assert_eq!((again.job, again.attempt), (first.job, lost + 1));
        }
    }
    bench.post(&format!("{study}/retry-failed"), "").await;
    let told = bench.get(&format!("{job}/explain")).await.json();
    assert_eq!((&told["state"], &told["losses"]), (&json!("ready"), &json!(0)));
    bench.check_counts().await;
}

#[tokio::test]
async fn renewal_keeps_a_lease_and_tells_of_a_lost_one() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let lease = bench.claim(&worker, 1).await.remove(0);
    let progress = json!({ "done": 1, "total": 2, "note": "half" });
    let renewal = json!({ "renew": [{ "job": lease.job, "attempt": 1, "progress": progress }] });
    for _ in 0..3 {
        bench.pass(10.0).await;
        assert!(bench.exchange(&worker, renewal.clone()).await.cancel.is_empty());
    }
    bench.pass(15.0).await;
    assert_eq!(bench.exchange(&worker, renewal).await.cancel, [lease.job]);
}

#[tokio::test]
async fn a_lease_lost_with_its_answer_is_given_again_as_the_same_attempt() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let (worker, other) = (bench.worker("w").await, bench.worker("other").await);
    let heard = bench.claim(&worker, 1).await.remove(0);
    let others = bench.claim(&other, 3).await;
    // Its answer is lost on the way.
    let lost = bench.claim(&worker, 2).await;
    bench.pass(10.0).await;
    let told = bench.exchange(&worker, json!({ "want": 3, "have": [heard.job] })).await;
    assert_eq!(told.jobs[..2], lost, "the same attempts");
    assert_eq!((told.jobs.len(), told.jobs[2].attempt), (3, 1), "and one more");
    assert!(others.iter().all(|theirs| told.jobs.iter().all(|lease| lease.job != theirs.job)));
    let all: Vec<_> = told.jobs.iter().chain([&heard]).map(|lease| lease.job).collect();
    assert!(bench.exchange(&worker, json!({ "want": 0, "have": [] })).await.jobs.is_empty(), "it wants none");
    assert!(bench.exchange(&worker, json!({ "have": all, "want": 0 })).await.jobs.is_empty());
    // Given again, a lease has a full term.
    bench.pass(14.0).await;
    let results: Vec<_> = lost.iter().map(|lease| completion(lease, result(lease))).collect();
    assert_eq!(bench.exchange(&worker, json!({ "complete": results })).await.accepted.len(), 2);
    bench.check_counts().await;
}

#[tokio::test]
async fn a_worker_that_leaves_gives_its_jobs_back_without_a_failure() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let (leaving, staying) = (bench.worker("leaving").await, bench.worker("staying").await);
    let lease = bench.claim(&leaving, 1).await.remove(0);
    assert_eq!(lease.attempt, 1);
    assert_eq!(bench.delete(&leaving).await.status, 204);
    assert_eq!(bench.delete(&leaving).await.status, 204, "twice is as good as once");
    bench.post(&format!("{leaving}/exchange"), "{}").await.problem(404, "unknown-worker");
    let lease = bench.claim(&staying, 1).await.remove(0);
    assert_eq!(lease.attempt, 2, "attempts go on counting, for they fence");
    bench.fail(&staying, &lease, "first failure").await;
    assert_eq!(bench.get(&format!("/v1/jobs/{}", lease.job)).await.json()["state"], "delayed");
    bench.check_counts().await;
}

#[tokio::test]
async fn an_unusable_result_fails_the_attempt() {
    let bench = Bench::open().await;
    bench.submit(&study(20, &[])).await;
    let worker = bench.worker("w").await;
    let leases = bench.claim(&worker, 2).await;
    let told = bench.complete(&worker, &leases[0], trained()).await;
    assert!(told.rejected[0].reason.contains("another kind"), "{:?}", told.rejected);
    let mut other_numbers = infeasible("x");
    other_numbers["solver_version"] = json!("0");
    let told = bench.complete(&worker, &leases[1], other_numbers).await;
    assert!(told.rejected[0].reason.contains("solver version"), "{:?}", told.rejected);
    for lease in &leases {
        assert_eq!(bench.get(&format!("/v1/jobs/{}", lease.job)).await.json()["state"], "delayed");
    }
}
