//! The fitness of a stroke.

use super::clamped;
use crate::parameters::{Bounds, COUNT, Point};
use rayon::prelude::*;

/// One millimetre, the unit in which a lacking clearance is counted.
const MILLIMETRE: f64 = 1e-3;

/// A batch predictor: scaled means `[L+, D+, M+, P+]` of each point in table units.
pub type Predict<'a> = dyn Fn(&[Point], &mut [[f64; 4]]) + Sync + 'a;

/// A batch of clearances: least distance of any wing point from the plane of symmetry
/// over each stroke, in metres. It is called from many threads, each with a part.
pub type Clearances<'a> = dyn Fn(&[Point], &mut [f64]) + Sync + 'a;

/// Points whose clearances are asked for together.
const TASK: usize = 512;

/// A surrogate and what is asked of it: [`Fitness`] on its predictions.
///
/// A point outside the box is judged by the surrogate at the nearest point inside, since
/// a network knows nothing beyond the samples it was fitted to; the excess itself costs s.
#[derive(Clone, Copy)]
pub struct Problem<'a> {
    /// Scaled means `[L+, D+, M+, P+]` of a batch of points in table units.
    pub predict: &'a Predict<'a>,
    /// Clearances of a batch of points in table units, metres.
    pub clearance: &'a Clearances<'a>,
    /// Clearance asked for, in metres.
    pub margin_m: f64,
    /// The box searched; `lower == upper` holds a parameter.
    pub bounds: Bounds,
    /// Factor r of the violated trim.
    pub penalty_r: f64,
    /// Factor s of what lies outside the box or too near to the other wing.
    pub penalty_s: f64,
}

/// The penalised fitness of a stroke.
///
/// ```text
/// F = P+ + r (|1 - L+| + |D+| + |M+|)
///        + s sum_i zeta_i / (Max_i - Min_i)
///        + s max(0, margin - clearance) / 1 mm
/// ```
///
/// The first two rows are the paper's Eq. 8; zeta_i is the distance by which
/// parameter i lies outside its bounds. Every penalty is of the first power:
/// exact once its factor exceeds the largest multiplier.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fitness {
    /// The box searched; `lower == upper` holds a parameter.
    pub bounds: Bounds,
    /// Clearance asked for, in metres.
    pub margin_m: f64,
    /// Factor r of the violated trim.
    pub penalty_r: f64,
    /// Factor s of what lies outside the box or too near to the other wing.
    pub penalty_s: f64,
}

impl Fitness {
    /// Judges a point in table units by `[L+, D+, M+, P+]` and the clearance in metres at
    /// the nearest point of the box.
    pub fn judge(&self, x: &Point, outputs: [f64; 4], clearance_m: f64) -> Score {
        let [lift, drag, moment, power] = outputs;
        let trim = (1.0 - lift).abs() + drag.abs() + moment.abs();
        let lack = self.margin_m - clearance_m;
        // NaN must not pass for enough clearance.
        let lack = if lack <= 0.0 { 0.0 } else { lack / MILLIMETRE };
        let beyond = self.penalty_s * (self.excess(x) + lack);
        let penalty = self.penalty_r.mul_add(trim, beyond);
        Score { fitness: power + penalty, penalty, outputs, clearance_m }
    }

    /// Sum over the free parameters of the distance outside the box over its width.
    fn excess(&self, x: &Point) -> f64 {
        let (lower, upper) = (&self.bounds.lower, &self.bounds.upper);
        let zeta = |i: usize| (lower[i] - x[i]).max(x[i] - upper[i]).max(0.0);
        (0..COUNT).filter(|&i| !self.bounds.is_held(i)).map(|i| zeta(i) / (upper[i] - lower[i])).sum()
    }
}

/// How a stroke fares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// The fitness F, smaller is better.
    pub fitness: f64,
    /// The fitness without P+: all penalties.
    pub penalty: f64,
    /// `[L+, D+, M+, P+]` at the point, moved into the box.
    pub outputs: [f64; 4],
    /// Clearance at the point, moved into the box, in metres.
    pub clearance_m: f64,
}

impl Problem<'_> {
    /// Scores a batch of points in table units.
    pub fn score(&self, xs: &[Point]) -> Vec<Score> {
        let mut scores = Vec::new();
        self.score_into(xs, &mut Evaluated::default(), &mut scores, |score| score);
        scores
    }

    /// What `of` takes of the score of each point, in memory used again.
    pub(super) fn score_into<T: Send>(
        &self,
        xs: &[Point],
        memory: &mut Evaluated,
        into: &mut Vec<T>,
        of: impl Fn(Score) -> T + Sync,
    ) {
        let Evaluated { inside, outputs } = memory;
        xs.par_iter().map(|x| clamped(&self.bounds, x)).collect_into_vec(inside);
        outputs.resize(xs.len(), [0.0; 4]);
        (self.predict)(inside, outputs);
        let fitness = self.fitness();
        let tasks = xs.par_chunks(TASK).zip(inside.par_chunks(TASK)).zip(outputs.par_chunks(TASK));
        let parts: Vec<Vec<T>> = tasks
            .map(|((xs, inside), outputs)| {
                let mut clearances = [0.0; TASK];
                (self.clearance)(inside, &mut clearances[..xs.len()]);
                let all = xs.iter().zip(outputs).zip(clearances);
                all.map(|((x, outputs), clearance)| of(fitness.judge(x, *outputs, clearance))).collect()
            })
            .collect();
        into.clear();
        into.extend(parts.into_iter().flatten());
    }

    /// The fitness which its predictions are given.
    fn fitness(&self) -> Fitness {
        let Self { margin_m, bounds, penalty_r, penalty_s, .. } = *self;
        Fitness { bounds, margin_m, penalty_r, penalty_s }
    }
}

/// Memory of an evaluation.
#[derive(Default)]
pub(super) struct Evaluated {
    inside: Vec<Point>,
    outputs: Vec<[f64; 4]>,
}
