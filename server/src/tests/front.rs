//! Fronts of a surrogate whose answers are known.

use manduca_numerics::parameters::Bounds;
use serde_json::{Value, json};

use super::answers::{completion, result, study, trained};
use super::bench::Bench;

/// P+ = tanh f, L+ = 1 + tanh beta, D+ = tanh phi0, M+ = tanh theta0 of parameters scaled to [-1, 1].
fn known_network() -> Value {
    let (mut hidden, mut output) = (vec![0.0; 40], vec![0.0; 16]);
    for (neuron, place) in [3, 0, 1, 2].into_iter().enumerate() {
        hidden[10 * neuron + neuron] = 1.0;
        output[4 * place + neuron] = 1.0;
    }
    let Bounds { lower, upper } = Bounds::default();
    let mut answer = trained();
    answer["surrogate"]["networks"][0] = json!({
        "bounds": { "lower": lower, "upper": upper }, "hidden_weights": hidden, "hidden_biases": vec![0.0; 4],
        "output_weights": output, "output_biases": [1.0, 0.0, 0.0, 0.0]
    });
    answer
}

/// A study whose network is this.
async fn with_network(bench: &Bench, network: Value) -> String {
    let worker = bench.worker("w").await;
    let study = bench.submit(&study(20, &[])).await;
    bench.get(&format!("{study}/surrogate/front?quantity=frequency_hz")).await.problem(404, "not-yet");
    let leases = bench.claim(&worker, 100).await;
    let results: Vec<_> = leases.iter().map(|lease| completion(lease, result(lease))).collect();
    bench.exchange(&worker, json!({ "complete": results })).await;
    let training = bench.claim(&worker, 100).await;
    assert_eq!(training.len(), 1);
    bench.complete(&worker, &training[0], trained()).await;
    bench.plant(&training[0], &network).await;
    study
}

#[tokio::test(flavor = "multi_thread")]
async fn a_front_has_the_least_power_under_each_limit() {
    let bench = Bench::open().await;
    let study = with_network(&bench, known_network()).await;
    let front = bench.get(&format!("{study}/surrogate/front?quantity=frequency_hz&points=3")).await.json();
    let near = |found: &Value, expected: f64| {
        assert!(found.as_f64().is_some_and(|v| (v - expected).abs() < 1e-6), "{found} is not {expected} in {front}");
    };
    assert_eq!(front["test_rmse"]["power"], 0.0);
    assert!(front["by"].as_str().is_some_and(|by| by.contains("surrogate as it was trained")), "{front}");
    near(&front["free"], 15.0);
    near(&front["least_power"], (-1_f64).tanh());
    for (i, (limit, scaled)) in [(15.0, -1.0), (27.5, 0.0), (40.0, 1.0_f64)].into_iter().enumerate() {
        let point = &front["points"][i];
        near(&point["limit"], limit);
        near(&point["power"], scaled.tanh());
        near(&point["parameters"]["frequency_hz"], limit);
        assert_eq!(point["side"], "at-least");
    }
    // dP+/df = (1 - tanh²)·2/25 at the middle.
    near(&front["points"][1]["price"], 2.0 / 25.0);
    let again = bench.get(&format!("{study}/surrogate/front?quantity=frequency_hz&points=3")).await;
    assert_eq!(again.json(), front);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_has_no_front_is_refused_or_empty() {
    let bench = Bench::open().await;
    let mut alike = trained();
    let network = &mut alike["surrogate"]["networks"][0];
    (network["output_weights"], network["output_biases"]) = (json!(vec![0.2; 8]), json!(vec![0.2; 4]));
    let study = with_network(&bench, alike).await;
    let of = async |query: &str| bench.get(&format!("{study}/surrogate/front?{query}")).await;
    assert_eq!(of("quantity=lift").await.problem(400, "invalid-query"), ["/quantity"]);
    assert_eq!(of("quantity=sweep_shape&points=1").await.problem(400, "invalid-query"), ["/points"]);
    assert_eq!(of("quantity=sweep_shape&optimisation=x").await.problem(400, "invalid-query"), ["/optimisation"]);
    // All four means of this network are alike: no stroke has lift and no drag.
    let none = of("quantity=sweep_shape").await.json();
    assert_eq!((&none["free"], &none["points"]), (&Value::Null, &json!([])));
}
