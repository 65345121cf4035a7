//! How fast a network is asked and optimised on.

use std::ops::ControlFlow;
use std::time::Instant;

use anyhow::Result;
use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::{Clearance, ElevationPhase};
use manduca_numerics::optimise::sqp::{Flight, SqpSettings, minimise};
use manduca_numerics::optimise::{GaSettings, Problem, optimise};
use manduca_numerics::parameters::{Bounds, Point};
use manduca_numerics::sampling::sample;
use manduca_numerics::surrogate::Surrogate;
use serde::Serialize;

/// Rates and times of the searches.
#[derive(Debug, Serialize)]
pub(super) struct Search {
    /// Predictions on one core, 1/s.
    pub(super) inference_f64_evals_s: f64,
    /// Population 100000, 100 generations, then the simplex, on every core, s.
    pub(super) ga_1e5x100_s: f64,
    /// Sequential quadratic programming from 1000 starts, on every core, s.
    pub(super) sqp_1000_starts_s: f64,
    /// Of which converged.
    pub(super) sqp_converged: usize,
}

/// Measures on a surrogate.
pub(super) fn measure(surrogate: &Surrogate) -> Result<Search> {
    let clearance = Clearance::new(&Insect::default(), ElevationPhase::Plus);
    let bounds = Bounds::default();
    let problem = Problem {
        predict: &|points, values| surrogate.predict_into(points, values),
        clearance: &|points, values| clearance.of_each(points, values),
        margin_m: 0.0,
        bounds,
        penalty_r: 2.0,
        penalty_s: 5.0,
    };
    // All hundred, however early the best no longer changes.
    let ga = GaSettings { generations: 100, stall_generations: 100, ..GaSettings::default() };
    let start = Instant::now();
    optimise(&problem, &ga, &Default::default(), &mut |_| ControlFlow::Continue(()))?;
    let ga_1e5x100_s = start.elapsed().as_secs_f64();
    let flight = Flight { surrogate, clearance: Some(&clearance), margin_m: 0.0, bounds };
    let settings = SqpSettings { starts: 1000, ..SqpSettings::default() };
    let start = Instant::now();
    let found = minimise(&flight, &settings, &mut |_| ControlFlow::Continue(()))?;
    let sqp_1000_starts_s = start.elapsed().as_secs_f64();
    Ok(Search {
        inference_f64_evals_s: inference(surrogate, &bounds)?,
        ga_1e5x100_s,
        sqp_1000_starts_s,
        sqp_converged: found.converged,
    })
}

/// Predictions per second on one core, the median of several batches.
fn inference(surrogate: &Surrogate, bounds: &Bounds) -> Result<f64> {
    let points: Vec<Point> = (0..1 << 14).filter_map(|i| sample(bounds, 2, i, &|_| true)).collect();
    let mut values = vec![[0.0; 4]; points.len()];
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let mut rates: Vec<f64> = (0..21)
        .map(|_| {
            let start = Instant::now();
            one.install(|| surrogate.predict_into(&points, &mut values));
            points.len() as f64 / start.elapsed().as_secs_f64()
        })
        .collect();
    rates.sort_by(f64::total_cmp);
    Ok(rates[rates.len() / 2])
}
