//! Many descents, and what they find.

use super::clear::cleared;
use super::flight::Flight;
use super::machine::{Sqp, SqpStop};
use crate::optimise::sobol::Sobol;
use crate::optimise::{OptimiseError, check, free};
use crate::parameters::{COUNT, Point};
use rayon::prelude::*;
use std::ops::ControlFlow;

/// Descents which are asked together, so that the surrogate sees batches.
const GROUP: usize = 32;

/// Groups between two reports; a wave is never left half done.
const WAVE: usize = 8;

/// Optima nearer than this in every unit coordinate are one.
const SAME: f64 = 1e-3;

/// Power which makes one of two descents to the same optimum the better one.
const SAVING: f64 = 1e-8;

/// Settings of the search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SqpSettings {
    /// Descents begun, at points of a Sobol sequence shifted by the seed.
    pub starts: usize,
    /// Most iterations of one descent.
    pub iterations: usize,
    /// Largest residual and violation of an optimum, dimensionless.
    pub tolerance: f64,
    /// Seed of the starts.
    pub seed: u64,
}

impl Default for SqpSettings {
    fn default() -> Self {
        Self { starts: 200, iterations: 300, tolerance: 1e-10, seed: 0 }
    }
}

/// A point where no small change within the constraints saves power.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalOptimum {
    /// Its parameters, inside the bounds, in table units.
    pub point: Point,
    /// `[L+, D+, M+, P+]` there.
    pub outputs: [f64; 4],
    /// Clearance there, m; infinite where wings cannot collide.
    pub clearance_m: f64,
    /// Prices: by how much P+ rises per unit of L+, D+ and M+ asked for.
    pub multipliers: [f64; 3],
    /// By how much P+ rises per mm of margin.
    pub clearance_multiplier_per_mm: f64,
    /// By how much P+ rises per width of the box by which a bound is raised; 0 away from bounds.
    pub bound_multipliers: Point,
    /// Residual of the conditions of Karush, Kuhn and Tucker, in unit coordinates.
    pub residual: f64,
    /// Largest violation of trim, or of clearance in cm.
    pub violation: f64,
    /// Descents which ended here.
    pub hits: usize,
}

/// What many descents found.
#[derive(Debug, Clone, PartialEq)]
pub struct SqpOptimum {
    /// Distinct optima, the least power first; not empty.
    pub optima: Vec<LocalOptimum>,
    /// Descents begun.
    pub starts: usize,
    /// Descents which converged.
    pub converged: usize,
    /// Points at which the surrogate and its derivatives were asked for.
    pub evaluations: usize,
    /// Whether the observer stopped the search.
    pub interrupted: bool,
}

impl SqpOptimum {
    /// The optimum of least power.
    pub fn best(&self) -> &LocalOptimum {
        &self.optima[0]
    }
}

/// Where the search stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SqpProgress {
    /// Descents ended.
    pub ended: usize,
    /// Descents of the whole search.
    pub starts: usize,
    /// Least power of those which converged.
    pub best: f64,
}

/// Finds the optima of a flight by descents from many starts.
///
/// The observer hears of each wave of descents and may stop the search. The result
/// depends on flight and settings alone, not on threads.
///
/// # Errors
/// When bounds or settings are out of range, or no descent converges.
pub fn minimise(
    flight: &Flight<'_>,
    settings: &SqpSettings,
    observe: &mut dyn FnMut(&SqpProgress) -> ControlFlow<()>,
) -> Result<SqpOptimum, OptimiseError> {
    check("starts", settings.starts as f64, 1.0..=1e6, "1 to 1e6")?;
    check("iterations", settings.iterations as f64, 1.0..=1e6, "1 to 1e6")?;
    check("tolerance", settings.tolerance, 1e-12..=1e-3, "1e-12 to 1e-3")?;
    let free = free(&flight.bounds)?;
    let Some(sequence) = Sobol::new(free.len(), settings.seed) else {
        return Err(OptimiseError::NothingFree);
    };
    let mut optima: Vec<LocalOptimum> = Vec::new();
    let (mut converged, mut evaluations, mut ended, mut interrupted) = (0, 0, 0, false);
    while ended < settings.starts && !interrupted {
        let until = settings.starts.min(ended + GROUP * WAVE);
        let groups: Vec<usize> = (ended..until).step_by(GROUP).collect();
        let wave: Vec<Vec<Sqp>> = groups
            .into_par_iter()
            .map(|first| {
                let starts = (first..until.min(first + GROUP)).map(|i| start(&sequence, &free, i));
                descend(flight, starts.collect(), settings)
            })
            .collect();
        for machine in wave.into_iter().flatten() {
            evaluations += machine.evaluations();
            if machine.finished() == Some(SqpStop::Converged) {
                converged += 1;
                merge(flight, &mut optima, optimum(flight, &machine));
            }
        }
        ended = until;
        let best = optima.iter().map(|o| o.outputs[3]).fold(f64::INFINITY, f64::min);
        interrupted = observe(&SqpProgress { ended, starts: settings.starts, best }).is_break();
    }
    if optima.is_empty() {
        return Err(OptimiseError::NothingConverged { starts: ended });
    }
    optima.sort_by(|a, b| a.outputs[3].total_cmp(&b.outputs[3]));
    Ok(SqpOptimum { optima, starts: ended, converged, evaluations, interrupted })
}

/// Start `i`: a point of the sequence in the free coordinates.
fn start(sequence: &Sobol, free: &[usize], i: usize) -> Point {
    let (mut dense, mut unit) = ([0.0; COUNT], [0.0; COUNT]);
    sequence.point(i as u32, &mut dense[..free.len()]);
    for (&i, u) in free.iter().zip(dense) {
        unit[i] = u;
    }
    unit
}

/// Descends from several starts at once.
fn descend(flight: &Flight<'_>, starts: Vec<Point>, settings: &SqpSettings) -> Vec<Sqp> {
    let upper = std::array::from_fn(|i| if flight.bounds.is_held(i) { 0.0 } else { 1.0 });
    let machine = |u| Sqp::new([0.0; COUNT], upper, u, settings.tolerance, settings.iterations);
    let mut all: Vec<Sqp> = starts.iter().map(machine).collect();
    loop {
        let mut open: Vec<&mut Sqp> = all.iter_mut().filter(|machine| machine.finished().is_none()).collect();
        if open.is_empty() {
            return all;
        }
        let asked: Vec<Point> = open.iter().map(|machine| *machine.ask()).collect();
        for (machine, linear) in open.iter_mut().zip(flight.linearise(&asked)) {
            machine.tell(linear);
        }
    }
}

fn optimum(flight: &Flight<'_>, machine: &Sqp) -> LocalOptimum {
    let point = flight.table(machine.point());
    let point = flight.clearance.map_or(point, |c| cleared(c, &flight.bounds, &point, flight.margin_m));
    let multipliers = machine.multipliers();
    let outputs = flight.outputs(&point);
    let off_trim = [outputs[0] - 1.0, outputs[1], outputs[2]].into_iter().fold(0.0, |most: f64, c| most.max(c.abs()));
    let price = |k: usize| multipliers.equalities.get(k).copied().unwrap_or(0.0);
    LocalOptimum {
        point,
        outputs,
        clearance_m: flight.clearance.map_or(f64::INFINITY, |c| c.of(&point)),
        multipliers: [price(0), price(1), price(2)],
        clearance_multiplier_per_mm: Flight::price_per_mm(&multipliers.inequalities),
        bound_multipliers: flight.per_width(machine.point(), &multipliers.bounds),
        residual: machine.residual(),
        violation: machine.violation().max(off_trim),
        hits: 1,
    }
}

/// Adds an optimum to those known, or counts it with the one it is.
fn merge(flight: &Flight<'_>, optima: &mut Vec<LocalOptimum>, new: LocalOptimum) {
    let unit = flight.bounds.to_unit(&new.point);
    let same = |o: &&mut LocalOptimum| {
        let other = flight.bounds.to_unit(&o.point);
        unit.iter().zip(other).all(|(a, b)| (a - b).abs() < SAME)
    };
    match optima.iter_mut().find(same) {
        Some(known) => {
            let hits = known.hits + 1;
            let gain = known.outputs[3] - new.outputs[3];
            // Power below rounding and tolerance is bought by violation.
            let balanced = new.residual.max(new.violation) < known.residual.max(known.violation);
            if gain > SAVING || (gain > -SAVING && balanced) {
                *known = new;
            }
            known.hits = hits;
        }
        None => optima.push(new),
    }
}
