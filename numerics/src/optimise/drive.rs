//! The genetic algorithm followed by the simplex.

use super::genetic::{Ga, GaSettings, GaStop, Generation};
use super::problem::{Evaluated, Problem, Score};
use super::simplex::{NelderMead, SimplexSettings, SimplexStop};
use super::{OptimiseError, clamped};
use crate::parameters::Point;
use std::ops::ControlFlow;

/// Which search is at work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The genetic algorithm.
    Genetic,
    /// The simplex.
    Simplex,
}

/// Where the search stands, after each generation and each move of the simplex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Which search is at work.
    pub phase: Phase,
    /// Generations made so far.
    pub generation: usize,
    /// Fitnesses evaluated so far, by both searches.
    pub evaluations: usize,
    /// Best fitness so far.
    pub best: f64,
    /// Mean fitness of the last generation.
    pub mean: f64,
}

/// The best stroke found.
#[derive(Debug, Clone, PartialEq)]
pub struct Optimum {
    /// Its parameters, inside the bounds, in table units.
    pub point: Point,
    /// Its score, evaluated at `point` itself.
    pub score: Score,
    /// Generations made.
    pub generations: usize,
    /// Fitnesses evaluated by both searches together.
    pub evaluations: usize,
    /// Why the genetic algorithm ended.
    pub ga_stop: GaStop,
    /// Best and mean fitness of every generation.
    pub history: Vec<Generation>,
    /// Fitnesses evaluated by the simplex.
    pub simplex_evaluations: usize,
    /// Fitness from which the simplex started: the genetic algorithm's best,
    /// moved into the box.
    pub simplex_start_fitness: f64,
    /// Why the simplex ended; none when it was interrupted or never begun.
    pub simplex_stop: Option<SimplexStop>,
}

/// Searches with the genetic algorithm, then with the simplex from its best.
///
/// The observer may stop either search; what was best by then comes back. The
/// result depends on the problem and the settings alone, not on threads.
///
/// # Errors
/// When bounds or settings are out of range or no fitness is finite.
pub fn optimise(
    problem: &Problem<'_>,
    ga: &GaSettings,
    simplex: &SimplexSettings,
    observe: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
) -> Result<Optimum, OptimiseError> {
    let mut search = Ga::new(problem.bounds, *ga)?;
    let mut evaluations = 0;
    let mut interrupted = false;
    let (mut memory, mut told) = (Evaluated::default(), Vec::new());
    while search.finished().is_none() && !interrupted {
        problem.score_into(search.ask(), &mut memory, &mut told, |score| score.fitness);
        evaluations += told.len();
        search.tell(&told)?;
        interrupted = observe(&progress(Phase::Genetic, &search, evaluations, None)).is_break();
    }
    let (best, _) = search.best().ok_or(OptimiseError::NothingFinite)?;
    let start = inside(problem, &best)?;
    let mut end = None;
    let (mut simplex_evaluations, mut simplex_stop) = (0, None);
    if !interrupted {
        let mut descent = NelderMead::new(problem.bounds, *simplex, &start.0)?;
        while descent.finished().is_none() && !interrupted {
            descent.tell(&fitnesses(problem, descent.ask()))?;
            let all = evaluations + descent.evaluations();
            let now = progress(Phase::Simplex, &search, all, descent.best());
            interrupted = observe(&now).is_break();
        }
        (simplex_evaluations, simplex_stop) = (descent.evaluations(), descent.finished());
        if let Some((point, _)) = descent.best() {
            end = Some(inside(problem, &point)?);
        }
    }
    // Moving into the box can cost more than the simplex gained.
    let better = end.filter(|(_, score)| score.fitness <= start.1.fitness);
    let (point, score) = better.unwrap_or(start);
    Ok(Optimum {
        point,
        score,
        generations: search.history().len(),
        evaluations: evaluations + simplex_evaluations,
        ga_stop: search.finished().unwrap_or(GaStop::Interrupted),
        history: search.history().to_vec(),
        simplex_evaluations,
        simplex_start_fitness: start.1.fitness,
        simplex_stop,
    })
}

fn fitnesses(problem: &Problem<'_>, xs: &[Point]) -> Vec<f64> {
    problem.score(xs).iter().map(|score| score.fitness).collect()
}

/// The nearest point inside the box and its score.
fn inside(problem: &Problem<'_>, x: &Point) -> Result<(Point, Score), OptimiseError> {
    let point = clamped(&problem.bounds, x);
    let score = problem.score(&[point]).pop().ok_or(OptimiseError::NothingFinite)?;
    Ok((point, score))
}

fn progress(phase: Phase, search: &Ga, evaluations: usize, simplex: Option<(Point, f64)>) -> Progress {
    let history = search.history();
    let last = history.last().copied();
    let last = last.unwrap_or(Generation { best: f64::INFINITY, mean: f64::INFINITY });
    let genetic = search.best().map_or(f64::INFINITY, |(_, fitness)| fitness);
    let best = simplex.map_or(genetic, |(_, fitness)| fitness.min(genetic));
    Progress { phase, generation: history.len(), evaluations, best, mean: last.mean }
}
