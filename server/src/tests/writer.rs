//! Operations share a commit without sharing their fate.

use manduca_protocol::ids::WorkerId;
use serde_json::json;

use super::answers::{completion, result, study};
use super::bench::Bench;
use crate::store::{Operation, Register, StoreError, Work};

/// Writes, and then fails or panics.
struct WriteAndThen(fn() -> Result<(), StoreError>);

impl Operation for WriteAndThen {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        register("spoilt").apply(work).await?;
        (self.0)()
    }
}

fn register(name: &str) -> Register {
    Register { worker: WorkerId::new(), name: name.into(), slots: 1, level: "test".into(), token: None }
}

#[tokio::test]
async fn one_failing_operation_leaves_its_batch_alone() {
    let bench = Bench::open().await;
    let store = bench.state.store();
    let good = futures_util::future::join_all((0..100).map(|_| store.run(register("good"))));
    let bad = store.run(WriteAndThen(|| Err(StoreError::WrongState("no".into()))));
    let worse = store.run(WriteAndThen(|| panic!("a fault in an operation")));
    let more = futures_util::future::join_all((0..100).map(|_| store.run(register("good"))));
    let (good, bad, worse, more) = tokio::join!(good, bad, worse, more);
    assert!(good.iter().chain(&more).all(Result::is_ok));
    assert!(matches!(bad, Err(StoreError::WrongState(_))));
    assert!(matches!(worse, Err(StoreError::Panicked)));
    let names: Vec<(String, i64)> = sqlx::query_as("select name, count(*) from workers group by name")
        .fetch_all(store.readers())
        .await
        .expect("counts");
    assert_eq!(names, [("good".to_owned(), 200)]);
}

#[tokio::test]
async fn readers_cannot_write() {
    let bench = Bench::open().await;
    let refused = sqlx::query("delete from workers").execute(bench.state.store().readers()).await;
    assert!(refused.is_err());
}

#[tokio::test]
async fn many_workers_at_once_keep_the_counters_right() {
    let bench = Bench::open().await;
    let study = bench.submit(&study(200, &[])).await;
    let crowd = (0..8).map(|i| {
        let bench = &bench;
        async move {
            let worker = bench.worker(&format!("w{i}")).await;
            for _ in 0..5 {
                let leases = bench.claim(&worker, 5).await;
                let (failing, fine) = leases.split_at(1);
                let results: Vec<_> = fine.iter().map(|l| completion(l, result(l))).collect();
                let failures: Vec<_> =
                    failing.iter().map(|l| json!({ "job": l.job, "attempt": l.attempt, "reason": "chance" })).collect();
                bench.exchange(&worker, json!({ "complete": results, "fail": failures })).await;
            }
        }
    });
    futures_util::future::join_all(crowd).await;
    let samples = &bench.view(&study).await["samples"];
    assert_eq!(samples["succeeded"], 160);
    assert_eq!(samples["delayed"], 40);
    bench.check_counts().await;
}
