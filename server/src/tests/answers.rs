//! What made-up workers say.

use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::task::{JobKind, Task};
use manduca_protocol::worker::{Lease, PROTOCOL_VERSION};
use serde_json::{Value, json};

/// A small study.
pub(super) fn study(samples: u32, optimisations: &[&str]) -> Value {
    let optimisations: Vec<_> =
        optimisations.iter().map(|name| json!({ "name": name, "refine_simulations": 0 })).collect();
    json!({ "name": "small", "seed": 5, "sampling": { "samples": samples }, "optimisations": optimisations })
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
            flown(task.parameters.0[0])
        }
        JobKind::Train => trained(),
        JobKind::Optimise => optimised(),
        JobKind::Search => search_ended(),
    }
}

/// Numbers which depend on the stroke.
pub(super) fn flown(x: f64) -> Value {
    let e = |mean: f64| json!({ "mean": mean, "se": 0.001 });
    let joint = json!({ "aerodynamic_w": 0.1, "inertial_w": 0.0, "required_w": 0.1 });
    json!({
        "kind": "simulate", "outcome": "ok",
        "means": { "lift_n": e(x / 1000.0), "drag_n": e(0.0), "pitch_moment_nm": e(1e-7), "power_w": e(0.08) },
        "scaled": { "lift": e(x / 25.0), "drag": e(0.0), "pitch_moment": e(0.1), "power": e(1.1) },
        "joints": { "sweep": joint, "elevation": joint, "rotation": joint },
        "power_per_lift_w_per_n": 5.0, "strokes_averaged": 6, "solver_version": SOLVER_VERSION
    })
}

pub(super) fn infeasible(reason: &str) -> Value {
    json!({ "kind": "simulate", "outcome": "infeasible", "reason": reason, "solver_version": SOLVER_VERSION })
}

pub(super) fn trained() -> Value {
    let four = json!({ "lift": 0.01, "drag": 0.01, "pitch_moment": 0.01, "power": 0.01 });
    let errors = json!({ "rmse": four, "correlation": four, "count": 3 });
    json!({
        "kind": "train",
        "surrogate": { "frame": { "features": "paper" }, "networks": [{
            "bounds": { "lower": vec![0.0; 10], "upper": vec![50.0; 10] },
            "hidden_weights": vec![0.1; 20], "hidden_biases": [0.0, 0.1],
            "output_weights": vec![0.2; 8], "output_biases": [0.1, 0.2, 0.3, 0.4]
        }] },
        "curve": [{ "iteration": 0, "train_mse": 1.0, "validation_mse": 1.0, "test_mse": 1.0 }],
        "best_iterations": [0], "stops": ["patience"], "train": errors, "validation": errors, "test": errors,
        "solver_version": SOLVER_VERSION
    })
}

/// A round which asks for strokes of these frequencies.
pub(super) fn search_asks(round: u32, frequencies: &[f64]) -> Value {
    let strokes: Vec<Value> = frequencies.iter().map(|f| parameters(*f)).collect();
    let state = json!({ "search": "refine", "round": round, "radius": 0.1, "candidate": 1,
        "predicted": [1.0, 0.0, 0.0, 1.0], "weight": 2.0, "prices": null, "flown": [] });
    json!({
        "kind": "search", "next": { "next": "fly", "state": state, "strokes": strokes }, "standing": standing(round),
        "solver_version": SOLVER_VERSION
    })
}

/// A generation which asks for strokes of these frequencies.
pub(super) fn generation_asks(told: u32, frequencies: &[f64]) -> Value {
    let strokes: Vec<Value> = frequencies.iter().map(|f| parameters(*f)).collect();
    let state = json!({ "search": "breed", "genes": [vec![0.5; 10]], "elite": [null], "history": [[1.5, null]],
        "best": null, "champion": null, "simulations": told });
    json!({
        "kind": "search", "next": { "next": "fly", "state": state, "strokes": strokes }, "standing": standing(told),
        "solver_version": SOLVER_VERSION
    })
}

/// The last generation's result.
pub(super) fn generations_found() -> Value {
    let mut optimum = optimised();
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
        "power_per_lift_w_per_n": 4.4, "fitness": 1.25, "history": [[0.1, 1.0]] })
}

fn parameters(frequency_hz: f64) -> Value {
    let mut parameters = optimised()["parameters"].clone();
    parameters["frequency_hz"] = frequency_hz.into();
    parameters
}

pub(super) fn optimised() -> Value {
    json!({
        "kind": "optimise",
        "parameters": {
            "frequency_hz": 25.5, "stroke_plane_deg": 15.0, "sweep_mean_deg": 5.0, "elevation_mean_deg": 0.0,
            "rotation_mean_deg": 0.0, "sweep_amplitude_deg": 50.0, "elevation_amplitude_deg": 5.0,
            "rotation_amplitude_deg": 45.0, "sweep_shape": 0.5, "rotation_shape": 1.0
        },
        "predicted": { "lift": 1.0, "drag": 0.0, "pitch_moment": 0.0, "power": 1.0 },
        "fitness": 1.0, "penalty": 0.0, "clearance_mm": 2.0,
        "history": [{ "generation": 0, "best": 1.0, "mean": 2.0 }], "stopped": "tolerance", "evaluations": 100,
        "solver_version": SOLVER_VERSION
    })
}
