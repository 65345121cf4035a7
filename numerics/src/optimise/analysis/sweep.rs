//! The genetic algorithm's dependence on its own settings.

use crate::optimise::{GaSettings, OptimiseError, Problem, SimplexSettings, optimise};
use std::ops::ControlFlow;

/// Which weight of the fitness (paper Eq. 8) is swept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weight {
    /// r, of violated trim (paper Table 3).
    Trim,
    /// s, of leaving the box.
    Bounds,
}

/// One row of a sweep of a weight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PenaltyRow {
    /// The weight.
    pub weight: f64,
    /// Fitness found.
    pub fitness: f64,
    /// Its penalty part.
    pub penalty: f64,
    /// Fitness over that of the exact optimum: what the search left lying.
    pub excess: f64,
}

/// Searches once per weight (paper Table 3), beside the exact optimum's `power`.
///
/// Above the largest multiplier the penalty is exact, so every row would have fitness
/// `power` if the search succeeded; below it a row may be less, at the price of trim.
///
/// # Errors
/// When settings are out of range or no fitness is finite.
pub fn penalty_sweep(
    problem: &Problem<'_>,
    ga: &GaSettings,
    simplex: &SimplexSettings,
    (which, weights): (Weight, &[f64]),
    power: f64,
) -> Result<Vec<PenaltyRow>, OptimiseError> {
    let row = |&weight: &f64| {
        let mut problem = *problem;
        match which {
            Weight::Trim => problem.penalty_r = weight,
            Weight::Bounds => problem.penalty_s = weight,
        }
        let score = optimise(&problem, ga, simplex, &mut |_| ControlFlow::Continue(()))?.score;
        let (fitness, penalty) = (score.fitness, score.penalty);
        Ok(PenaltyRow { weight, fitness, penalty, excess: fitness - power })
    };
    weights.iter().map(row).collect()
}

/// One row of a sweep of the population.
#[derive(Debug, Clone, PartialEq)]
pub struct PopulationRow {
    /// Individuals of a generation.
    pub population: usize,
    /// Fitness found with each seed, in their order.
    pub fitnesses: Vec<f64>,
}

/// Searches with each population from each seed (paper Fig. 7: 1e3 to 5e5, five runs each).
///
/// # Errors
/// When settings are out of range or no fitness is finite.
pub fn population_sweep(
    problem: &Problem<'_>,
    ga: &GaSettings,
    simplex: &SimplexSettings,
    populations: &[usize],
    seeds: &[u64],
) -> Result<Vec<PopulationRow>, OptimiseError> {
    let run = |population, seed| {
        let ga = GaSettings { population, seed, ..*ga };
        Ok(optimise(problem, &ga, simplex, &mut |_| ControlFlow::Continue(()))?.score.fitness)
    };
    let row = |&population: &usize| {
        let fitnesses = seeds.iter().map(|seed| run(population, *seed)).collect::<Result<_, _>>()?;
        Ok(PopulationRow { population, fitnesses })
    };
    populations.iter().map(row).collect()
}
