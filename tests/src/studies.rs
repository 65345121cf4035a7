//! Studies small enough for tests.

use serde_json::{Value, json};

/// A study on a tiny vortex lattice. One sample takes some tens of milliseconds,
/// so that a test can still do something while the study runs.
pub fn lattice(name: &str, seed: u64, samples: u32) -> Value {
    json!({
        "name": name,
        "seed": seed,
        "model": { "solver": {
            "chordwise_panels": 3, "spanwise_panels": 4, "steps_per_stroke": 12,
            "strokes": 3, "strokes_dropped": 1, "wake_strokes": 0.75,
        }},
        "sampling": { "samples": samples },
        "surrogate": { "neurons": 6, "max_iterations": 30 },
        "optimisations": [
            { "name": "free", "population": 200, "generations": 20, "verify_strokes": 4, "refine_simulations": 30 },
        ],
    })
}

/// A study of blade elements: a sample takes no time worth mentioning.
pub fn blades(name: &str, seed: u64, samples: u32) -> Value {
    let mut study = lattice(name, seed, samples);
    study["model"] = json!({ "kind": "quasi-steady" });
    study
}

/// A direct search on a tiny vortex lattice: no samples, three generations of eight.
pub fn direct(name: &str, seed: u64) -> Value {
    let mut study = lattice(name, seed, 0);
    study["parameters"] = json!({
        "stroke_plane_deg": 0.0, "elevation_mean_deg": 0.0, "elevation_amplitude_deg": 0.0,
        "sweep_shape": 0.0, "rotation_shape": 0.0,
    });
    study["optimisations"] = json!([{
        "name": "five-direct", "method": "direct", "population": 8, "generations": 3, "verify_strokes": 4,
        "refine_simulations": 20,
    }]);
    study
}

/// A study whose samples take so long that none ends by itself during a test.
pub fn endless(name: &str) -> Value {
    let mut study = lattice(name, 1, 20);
    study["model"] = json!({ "solver": {
        "chordwise_panels": 16, "spanwise_panels": 24, "steps_per_stroke": 200, "strokes": 100,
    }});
    study
}
