//! What a study costs on this machine: a few of its samples, flown and timed.

use std::time::{Duration, Instant};

use manduca_numerics::kinematics::Clearance;
use manduca_numerics::parameters::{Bounds, Point};
use manduca_numerics::sampling::sample;
use manduca_numerics::simulation::{Model, simulate};
use manduca_numerics::uvlm;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::resolve::ResolvedModel;
use serde::Serialize;

/// Strokes timed, each once: they differ more than a flight from the same again, for each is flown
/// until its own standard errors are small.
pub const STROKES: u64 = 9;
/// The strokes are the same on every machine.
const SEED: u64 = 1;
/// All flights together take about this long at most, unless one stroke of one takes longer.
const PATIENCE: Duration = Duration::from_secs(40);

/// Time of the samples of a study.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cost {
    /// One sample on one core, s.
    pub production_sample_s: f64,
    /// Whether that follows from the first stroke of a sample instead of whole samples.
    pub extrapolated: bool,
    /// Samples of the study.
    pub study_samples: u32,
    /// Strokes which generations ask for at most.
    pub study_individuals: u64,
    /// Cores of this machine.
    pub cores: usize,
    /// Samples and individuals x time of a sample / cores, s.
    pub study_estimate_s: f64,
}

/// Measures it for so many samples and individuals; none when no stroke of the box keeps the
/// wings apart.
pub fn measure(
    model: &ResolvedModel,
    bounds: &Bounds,
    margin_mm: f64,
    (samples, individuals): (u32, u64),
) -> Option<Cost> {
    let strokes = strokes(model, bounds, margin_mm);
    let (production_sample_s, extrapolated) = match one_stroke(model, strokes.first()?) {
        Some(long) if long > PATIENCE.as_secs_f64() / STROKES as f64 => {
            // One whole flight is worth waiting for, all are not.
            let whole = long <= PATIENCE.as_secs_f64();
            (if whole { flight(model, &strokes[0]) } else { long }, !whole)
        }
        _ => (whole_samples(model, &strokes), false),
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    Some(Cost {
        production_sample_s,
        extrapolated,
        study_samples: samples,
        study_individuals: individuals,
        cores,
        study_estimate_s: (f64::from(samples) + individuals as f64) * production_sample_s / cores as f64,
    })
}

/// Strokes of the box which are flown to their end.
fn strokes(model: &ResolvedModel, bounds: &Bounds, margin_mm: f64) -> Vec<Point> {
    let clearance = Clearance::new(&model.insect, model.elevation_phase);
    let apart = |x: &Point| clearance.of(x) >= 1e-3 * margin_mm.max(0.0);
    (0..STROKES).filter_map(|i| sample(bounds, SEED, i, &apart)).collect()
}

/// Wall time of a flight, s.
fn flight(model: &ResolvedModel, stroke: &Point) -> f64 {
    let simulation = model.simulation(&ParameterValues(*stroke));
    let start = Instant::now();
    std::hint::black_box(simulate(&simulation).is_ok());
    start.elapsed().as_secs_f64()
}

/// Mean over the strokes, s.
fn whole_samples(model: &ResolvedModel, strokes: &[Point]) -> f64 {
    strokes.iter().map(|x| flight(model, x)).sum::<f64>() / strokes.len() as f64
}

/// About the time of a sample, from its first stroke; none for blade elements, which take none.
fn one_stroke(model: &ResolvedModel, stroke: &Point) -> Option<f64> {
    let Model::Uvlm(settings) = &model.model else { return None };
    let first = uvlm::Settings { strokes: 1, strokes_most: 1, strokes_dropped: 0, ..*settings };
    let taken = flight(&ResolvedModel { model: Model::Uvlm(first), ..*model }, stroke);
    Some(taken * settings.interactions(settings.strokes) / first.interactions(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use manduca_numerics::simulation::simulate_watched;
    use manduca_protocol::resolve;
    use manduca_protocol::study::ModelSpec;

    fn model(solver: &[(&str, f64)]) -> ResolvedModel {
        let solver = solver.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
        resolve::model(&ModelSpec { solver, ..ModelSpec::default() }, "").unwrap()
    }

    #[test]
    fn the_estimate_is_samples_times_time_over_cores() {
        let tiny =
            [("chordwise_panels", 2.0), ("spanwise_panels", 3.0), ("steps_per_stroke", 12.0), ("strokes_dropped", 2.0)];
        let cost = measure(&model(&tiny), &Bounds::default(), 0.0, (700, 50)).unwrap();
        assert!(cost.production_sample_s > 0.0 && !cost.extrapolated && cost.cores > 0);
        assert_eq!(cost.study_estimate_s, 750.0 * cost.production_sample_s / cost.cores as f64);
        assert_eq!(measure(&model(&tiny), &Bounds::default(), 900.0, (700, 0)), None);
    }

    #[test]
    fn the_strokes_are_feasible_and_always_the_same() {
        let model = model(&[]);
        let drawn = strokes(&model, &Bounds::default(), 2.0);
        assert_eq!(drawn.len() as u64, STROKES);
        assert_eq!(drawn, strokes(&model, &Bounds::default(), 2.0));
        let clearance = Clearance::new(&model.insect, model.elevation_phase);
        assert!(drawn.iter().all(|x| clearance.of(x) >= 2e-3));
    }

    #[test]
    fn work_grows_as_the_solver_counts_it() {
        let interactions = |settings: &uvlm::Settings| {
            let model = ResolvedModel { model: Model::Uvlm(*settings), ..model(&[]) };
            let mut count = 0;
            let stroke = ParameterValues(manduca_numerics::cases::CASES[2].parameters);
            let flown = simulate_watched(&model.simulation(&stroke), &mut |_, solver| {
                count = solver.map_or(0, uvlm::Solver::interactions);
            });
            assert!(flown.is_ok());
            count as f64
        };
        let first = uvlm::Settings { strokes: 1, strokes_most: 1, strokes_dropped: 0, ..uvlm::Settings::default() };
        let whole = uvlm::Settings { strokes: 5, strokes_most: 5, ..first };
        let (counted, modelled) =
            (interactions(&whole) / interactions(&first), whole.interactions(5) / first.interactions(1));
        assert!((counted / modelled - 1.0).abs() < 0.15, "{counted} {modelled}");
    }
}
