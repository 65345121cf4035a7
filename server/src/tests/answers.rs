//! What made-up workers say.

use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::{Clearance, ElevationPhase};
use manduca_numerics::optimise::{Fitness, Score};
use manduca_numerics::parameters::Bounds;
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_numerics::surrogate::Split;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::task::{JobKind, Task};
use manduca_protocol::worker::{Lease, PROTOCOL_VERSION};
use serde_json::{Value, json};

/// A small study.
pub(super) fn study(samples: u32, optimisations: &[&str]) -> Value {
    let optimisations: Vec<_> =
        optimisations.iter().map(|name| json!({ "name": name, "refine_simulations": 0 })).collect();
    json!({ "name": "small", "seed": 5, "sampling": { "samples": samples },
            "surrogate": { "neurons": 2, "features": "paper" }, "optimisations": optimisations })
}

pub(super) fn registration(name: &str) -> Value {
    json!({
        "name": name, "slots": 2, "protocol_version": PROTOCOL_VERSION,
        "solver_version": SOLVER_VERSION, "level": "test"
    })
}

pub(super) fn completion(lease: &Lease, result: Value) -> Value {
    json!({
        "job": lease.job, "attempt": lease.attempt, "result": result,
        "provenance": { "wall_s": 0.25, "level": "test" }
    })
}

/// A result that fits a lease, the same whenever it is asked for.
pub(super) fn result(lease: &Lease) -> Value {
    match lease.kind {
        JobKind::Simulate => {
            let Some(Task::Simulate(task)) = &lease.task else { panic!("a simulation comes with its task") };
            let mut result = flown(task.parameters.0[0]);
            // The first four of those it asks for are dropped.
            if let Some(strokes) = task.model.solver.get("strokes") {
                result["strokes_averaged"] = json!(*strokes as u32 - 4);
            }
            result
        }
        JobKind::Train => trained(),
        JobKind::Optimise => optimised(),
        JobKind::Search => search_ended(),
    }
}

/// L+, D+, M+, P+ of a made-up stroke, which depends on its frequency alone.
fn means(x: f64) -> [f64; 4] {
    [x / 25.0, 0.0, 0.1, 1.1]
}

/// Numbers which depend on the stroke.
pub(super) fn flown(x: f64) -> Value {
    let e = |mean: f64, scale: f64| json!({ "mean": mean * scale, "se": 0.001 * scale });
    let (scaled, scales) = (means(x), Insect::default().scales());
    let si = |i: usize| e(scaled[i], scales[i]);
    let over = |i: usize| e(scaled[i], 1.0);
    let [lift, .., power] = std::array::from_fn::<f64, 4, _>(|i| scaled[i] * scales[i]);
    let joint = json!({ "aerodynamic_w": power / 3.0, "inertial_w": 0.0, "required_w": power / 3.0 });
    json!({
        "kind": "simulate", "outcome": "ok",
        "means": { "lift_n": si(0), "drag_n": si(1), "pitch_moment_nm": si(2), "power_w": si(3) },
        "scaled": { "lift": over(0), "drag": over(1), "pitch_moment": over(2), "power": over(3) },
        "joints": { "sweep": joint, "elevation": joint, "rotation": joint },
        "power_per_lift_w_per_n": (lift > 0.0).then(|| power / lift), "strokes_averaged": 6,
        "solver_version": SOLVER_VERSION
    })
}

pub(super) fn infeasible(reason: &str) -> Value {
    json!({ "kind": "simulate", "outcome": "infeasible", "reason": reason, "solver_version": SOLVER_VERSION })
}

/// [`trained_on`] as many samples as [`study`]s mostly have.
pub(super) fn trained() -> Value {
    trained_on(20)
}

/// A network of 2 neurons that predicts made-up strokes as they are: the sigmoid of a small number is that number.
pub(super) fn trained_on(samples: usize) -> Value {
    const SMALL: f64 = 1e-5;
    let Bounds { lower, upper } = Bounds::default();
    let (middle, half) = (0.5 * (lower[0] + upper[0]), 0.5 * (upper[0] - lower[0]));
    let (mut hidden, mut output) = (vec![0.0; 20], vec![0.0; 8]);
    (hidden[0], output[0]) = (SMALL, half / 25.0 / SMALL);
    let [zero, one] = [0.0, 1.0].map(|x| json!({ "lift": x, "drag": x, "pitch_moment": x, "power": x }));
    let split = Split::new(samples, 0.8, 0.1, 5);
    let errors = |share: &[usize]| json!({ "rmse": zero, "correlation": one, "count": share.len() });
    json!({
        "kind": "train",
        "surrogate": { "frame": { "features": "paper" }, "networks": [{
            "bounds": { "lower": lower, "upper": upper },
            "hidden_weights": hidden, "hidden_biases": [0.0, 0.0],
            "output_weights": output, "output_biases": means(middle)
        }] },
        "curve": [{ "iteration": 0, "train_mse": 1.0, "validation_mse": 1.0, "test_mse": 1.0 }],
        "best_iterations": [0], "stops": ["patience"], "train": errors(&split.train),
        "validation": errors(&split.validation), "test": errors(&split.test), "solver_version": SOLVER_VERSION
    })
}

/// A round which asks for strokes of these frequencies, after these were flown.
pub(super) fn search_asks(round: u32, flown: &Value, frequencies: &[f64]) -> Value {
    let strokes: Vec<Value> = frequencies.iter().map(|f| parameters(*f)).collect();
    let state = json!({ "search": "refine", "round": round, "radius": 0.1, "candidate": 1,
        "predicted": [1.0, 0.0, 0.0, 1.0], "weight": 2.0, "prices": null, "flown": flown });
    json!({
        "kind": "search", "next": { "next": "fly", "state": state, "strokes": strokes }, "standing": standing(round),
        "solver_version": SOLVER_VERSION
    })
}

/// A generation of 8 which asks for strokes of these frequencies: the first, or the one after it.
pub(super) fn generation_asks(told: u32, frequencies: &[f64]) -> Value {
    let strokes: Vec<Value> = frequencies.iter().map(|f| parameters(*f)).collect();
    // None of them is an individual's, so that after the first generation none has a fitness.
    let (elite, history) = if told == 0 { (json!([]), json!([])) } else { (json!([null]), json!([[null, null]])) };
    let state = json!({ "search": "breed", "genes": vec![[0.5; 10]; 8], "elite": elite, "history": history,
        "best": null, "champion": null, "simulations": told });
    json!({
        "kind": "search", "next": { "next": "fly", "state": state, "strokes": strokes }, "standing": standing(told),
        "solver_version": SOLVER_VERSION
    })
}

/// The last generation's result: a stroke of this frequency, which was flown.
pub(super) fn generations_found(frequency_hz: f64) -> Value {
    let mut optimum = optimum_at(frequency_hz);
    optimum.as_object_mut().expect("an object").remove("kind");
    json!({
        "kind": "search", "next": { "next": "found", "optimum": optimum }, "standing": standing(2),
        "solver_version": SOLVER_VERSION
    })
}

pub(super) fn search_ended() -> Value {
    json!({
        "kind": "search", "next": { "next": "done", "reason": "they agree", "converged": true },
        "standing": standing(2), "solver_version": SOLVER_VERSION
    })
}

fn standing(rounds: u32) -> Value {
    json!({ "rounds": rounds, "simulations": 4, "radius": 0.1, "best": null, "predicted": null,
        "power_per_lift_w_per_n": null, "fitness": 1.25, "history": [[0.1, 1.0]] })
}

fn parameters(frequency_hz: f64) -> Value {
    let mut parameters = optimised()["parameters"].clone();
    parameters["frequency_hz"] = frequency_hz.into();
    parameters
}

pub(super) fn optimised() -> Value {
    optimum_at(25.5)
}

/// An optimum of this frequency on a [`trained`] network.
fn optimum_at(frequency_hz: f64) -> Value {
    let point = [frequency_hz, 15.0, 5.0, 0.0, 0.0, 50.0, 5.0, 45.0, 0.5, 1.0];
    let clearance_m = Clearance::new(&Insect::default(), ElevationPhase::Plus).of(&point);
    let fitness = Fitness { bounds: Bounds::default(), margin_m: 0.0, penalty_r: 2.0, penalty_s: 5.0 };
    let Score { fitness, penalty, outputs: [lift, drag, pitch_moment, power], .. } =
        fitness.judge(&point, means(frequency_hz), clearance_m);
    json!({
        "kind": "optimise", "parameters": ParameterValues(point),
        "predicted": { "lift": lift, "drag": drag, "pitch_moment": pitch_moment, "power": power },
        "fitness": fitness, "penalty": penalty, "clearance_mm": clearance_m * 1e3,
        "history": [{ "generation": 0, "best": 1.0, "mean": 2.0 }], "stopped": "tolerance", "evaluations": 100,
        "solver_version": SOLVER_VERSION
    })
}
