//! One descent of sequential quadratic programming, asked for points.

use super::linear::{Linear, Multipliers, lagrangian, parts};
use super::quadratic::{Constraint, MOST, Minimum, Quadratic, Row, minimise};
use crate::parameters::{COUNT, Point};

/// Why a descent ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SqpStop {
    /// Residual and violation are within the tolerance.
    Converged,
    /// No step improves although they are not.
    Stalled,
    /// The most iterations were made.
    Iterations,
    /// A value was not finite.
    NotFinite,
}

/// Steps whose merit a new one may fall back to: a curved constraint makes the
/// merit rise once in a while although the step is good (Maratos' effect).
const MEMORY: usize = 5;

/// Weights of the relaxation where linearised constraints contradict each other.
const RELAXATIONS: [f64; 3] = [1e2, 1e4, 1e6];

/// Sequential quadratic programming as a machine: [`Sqp::ask`], evaluate, [`Sqp::tell`].
///
/// ```text
/// min  f(x)   subject to  c(x) = 0,  h(x) >= 0,  lower <= x <= upper
/// ```
///
/// Each step minimises a quadratic model of the Lagrangian under linearised
/// constraints (Kraft 1988, DFVLR-FB 88-28); the model's matrix is Broyden,
/// Fletcher, Goldfarb and Shanno's with Powell's damping; the step is shortened
/// until the exact penalty function falls.
#[derive(Debug, Clone)]
pub struct Sqp {
    lower: Point,
    upper: Point,
    free: Vec<usize>,
    tolerance: f64,
    iterations_left: usize,
    x: Point,
    here: Option<Linear>,
    hessian: [Row; MOST],
    /// Whether the matrix has learnt anything since it was the identity.
    learnt: bool,
    step: Point,
    share: f64,
    /// Expected change of the merit along the whole step, negative.
    slope: f64,
    asked: Point,
    multipliers: Multipliers,
    /// Weights of the merit: one per equality, then one of all inequalities.
    weights: Vec<f64>,
    recent: Vec<Vec<f64>>,
    residual: f64,
    evaluations: usize,
    finished: Option<SqpStop>,
}

fn identity() -> [Row; MOST] {
    std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }))
}

impl Sqp {
    /// A descent from `start`, which is moved into the bounds.
    pub fn new(lower: Point, upper: Point, start: &Point, tolerance: f64, iterations: usize) -> Self {
        let x: Point = std::array::from_fn(|i| start[i].max(lower[i]).min(upper[i]));
        Self {
            lower,
            upper,
            free: (0..COUNT).filter(|&i| lower[i] < upper[i]).collect(),
            tolerance,
            iterations_left: iterations,
            x,
            here: None,
            hessian: identity(),
            learnt: false,
            step: [0.0; COUNT],
            share: 1.0,
            slope: 0.0,
            asked: x,
            multipliers: Multipliers::default(),
            weights: Vec::new(),
            recent: Vec::new(),
            residual: f64::INFINITY,
            evaluations: 0,
            finished: None,
        }
    }

    /// The point whose neighbourhood is wanted.
    pub fn ask(&self) -> &Point {
        &self.asked
    }

    /// Takes what is at the point asked.
    pub fn tell(&mut self, told: Linear) {
        if self.finished.is_some() {
            return;
        }
        self.evaluations += 1;
        let Some(here) = self.here.take() else {
            if told.is_finite() {
                self.weights = vec![0.0; told.equalities.len() + 1];
                self.begin(told);
            } else {
                self.finished = Some(SqpStop::NotFinite);
            }
            return;
        };
        let most = self.recent.iter().map(|parts| self.merit(parts)).fold(f64::NEG_INFINITY, f64::max);
        let merit = self.merit(&parts(&told));
        let rounding = 1e-15 * (1.0 + most.abs());
        if told.is_finite() && merit <= most + 1e-4 * self.share * self.slope + rounding {
            self.learn(&here, &told);
            self.x = self.asked;
            self.begin(told);
            return;
        }
        self.share *= if told.is_finite() { self.shrink(merit, &here) } else { 0.1 };
        self.asked = self.along(self.share);
        let moved = self.free.iter().any(|&i| (self.asked[i] - self.x[i]).abs() > 1e-15 * (1.0 + self.x[i].abs()));
        if moved && self.share > 1e-9 {
            self.here = Some(here);
        } else if self.learnt {
            self.forget();
            self.begin(here);
        } else {
            self.here = Some(here);
            self.finished = Some(SqpStop::Stalled);
        }
    }

    /// By how much to shorten a step: to the minimum of the parabola through what is known.
    fn shrink(&self, merit: f64, here: &Linear) -> f64 {
        let rise = merit - self.merit(&parts(here)) - self.share * self.slope;
        let best = -0.5 * self.share * self.slope / rise;
        if best.is_finite() { best.clamp(0.1, 0.5) } else { 0.5 }
    }

    fn along(&self, share: f64) -> Point {
        std::array::from_fn(|i| (share.mul_add(self.step[i], self.x[i])).max(self.lower[i]).min(self.upper[i]))
    }

    fn merit(&self, parts: &[f64]) -> f64 {
        parts[0] + parts[1..].iter().zip(&self.weights).map(|(v, w)| v * w).sum::<f64>()
    }

    fn forget(&mut self) {
        (self.hessian, self.learnt) = (identity(), false);
        self.recent.clear();
    }

    /// Finds the next step from a point just reached.
    fn begin(&mut self, here: Linear) {
        let Some((minimum, relaxation)) = self.subproblem(&here) else {
            if self.learnt {
                self.forget();
                return self.begin(here);
            }
            self.here = Some(here);
            self.finished = Some(SqpStop::Stalled);
            return;
        };
        self.note(&here, &minimum);
        if self.recent.len() == MEMORY {
            self.recent.remove(0);
        }
        self.recent.push(parts(&here));
        self.step = [0.0; COUNT];
        for (a, &i) in self.free.iter().enumerate() {
            self.step[i] = minimum.step[a];
        }
        let downhill: f64 = self.free.iter().map(|&i| self.step[i] * here.gradient[i]).sum();
        let penalties = self.merit(&parts(&here)) - here.value;
        self.slope = downhill - (1.0 - relaxation) * penalties;
        self.share = 1.0;
        self.asked = self.along(1.0);
        if self.residual <= self.tolerance && here.violation() <= self.tolerance {
            self.finished = Some(SqpStop::Converged);
        } else if self.iterations_left == 0 {
            self.finished = Some(SqpStop::Iterations);
        } else if self.asked == self.x || relaxation > 1.0 - 1e-9 {
            self.finished = Some(SqpStop::Stalled);
        } else if self.slope >= 0.0 && self.learnt {
            self.forget();
            return self.begin(here);
        }
        self.iterations_left = self.iterations_left.saturating_sub(1);
        self.here = Some(here);
    }

    /// Constraints of the subproblem: equalities, inequalities, bounds.
    ///
    /// With relaxation, variable n lets the share `1 - its value` of each violated
    /// constraint be enough.
    fn constraints(&self, here: &Linear, relaxed: bool) -> Vec<Constraint> {
        let n = self.free.len();
        let row = |g: &Point, c: f64| {
            let mut normal = [0.0; MOST];
            for (a, &i) in self.free.iter().enumerate() {
                normal[a] = g[i];
            }
            if relaxed {
                normal[n] = -c;
            }
            normal
        };
        let equalities = here.equalities.iter();
        let mut all: Vec<Constraint> =
            equalities.map(|(c, g)| Constraint { normal: row(g, *c), bound: -c, equality: true }).collect();
        let inequalities = here.inequalities.iter();
        all.extend(inequalities.map(|(_, c, g)| Constraint { normal: row(g, c.min(0.0)), bound: -c, equality: false }));
        let mut bound = |a: usize, sign: f64, bound: f64| {
            let mut normal = [0.0; MOST];
            normal[a] = sign;
            all.push(Constraint { normal, bound, equality: false });
        };
        for (a, &i) in self.free.iter().enumerate() {
            bound(a, 1.0, self.lower[i] - self.x[i]);
            bound(a, -1.0, self.x[i] - self.upper[i]);
        }
        if relaxed {
            bound(n, 1.0, 0.0);
            bound(n, -1.0, -1.0);
        }
        all
    }

    /// The step and how far constraints had to be relaxed for it.
    fn subproblem(&self, here: &Linear) -> Option<(Minimum, f64)> {
        let n = self.free.len();
        let mut gradient = [0.0; MOST];
        for (a, &i) in self.free.iter().enumerate() {
            gradient[a] = here.gradient[i];
        }
        let constraints = self.constraints(here, false);
        let exact = Quadratic { n, hessian: &self.hessian, gradient, constraints: &constraints };
        if let Some(minimum) = minimise(&exact) {
            return Some((minimum, 0.0));
        }
        let constraints = self.constraints(here, true);
        let mut hessian = self.hessian;
        let solutions = RELAXATIONS.iter().rev().filter_map(|weight| {
            hessian[n][n] = *weight;
            let relaxed = Quadratic { n: n + 1, hessian: &hessian, gradient, constraints: &constraints };
            minimise(&relaxed).map(|m| (m.step[n], m))
        });
        solutions.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(relaxation, m)| (m, relaxation))
    }

    /// Keeps the multipliers, the residual they leave and the weights they ask for.
    fn note(&mut self, here: &Linear, minimum: &Minimum) {
        let (equal, rest) = minimum.multipliers.split_at(here.equalities.len());
        let (unequal, bounds) = rest.split_at(here.inequalities.len());
        self.multipliers.equalities = equal.to_vec();
        let named = here.inequalities.iter().zip(unequal).filter(|(_, m)| **m > 0.0);
        self.multipliers.inequalities = named.map(|((name, ..), m)| (*name, *m)).collect();
        self.multipliers.bounds = [0.0; COUNT];
        for (a, &i) in self.free.iter().enumerate() {
            self.multipliers.bounds[i] = bounds[2 * a] - bounds[2 * a + 1];
        }
        let force = lagrangian(here, &self.multipliers);
        let mut residual: f64 = 0.0;
        for &i in &self.free {
            let bound = self.multipliers.bounds[i];
            let room = if bound > 0.0 { self.x[i] - self.lower[i] } else { self.upper[i] - self.x[i] };
            residual = residual.max((force[i] - bound).abs()).max((bound * room).abs());
        }
        for ((_, c, _), m) in here.inequalities.iter().zip(unequal) {
            residual = residual.max((c * m).abs());
        }
        self.residual = residual;
        let wanted = equal.iter().map(|m| m.abs()).chain([unequal.iter().sum()]);
        for (weight, wanted) in self.weights.iter_mut().zip(wanted) {
            *weight = wanted.max(0.5 * (*weight + wanted));
        }
    }

    /// Updates the matrix from the change of the Lagrangian's gradient.
    fn learn(&mut self, here: &Linear, there: &Linear) {
        let n = self.free.len();
        // What only one of both points knows is left out.
        let known = self.known(here, there);
        let (old, new) = (lagrangian(here, &known), lagrangian(there, &known));
        let (mut s, mut y) = ([0.0; MOST], [0.0; MOST]);
        for (a, &i) in self.free.iter().enumerate() {
            (s[a], y[a]) = (self.asked[i] - self.x[i], new[i] - old[i]);
        }
        let dot = |a: &Row, b: &Row| (0..n).map(|i| a[i] * b[i]).sum::<f64>();
        let bs: Row = std::array::from_fn(|i| if i < n { dot(&self.hessian[i], &s) } else { 0.0 });
        let (sbs, sy) = (dot(&s, &bs), dot(&s, &y));
        if !(sbs > 0.0 && sbs.is_finite() && sy.is_finite()) {
            return;
        }
        let share = if sy >= 0.2 * sbs { 1.0 } else { 0.8 * sbs / (sbs - sy) };
        let r: Row = std::array::from_fn(|i| share * y[i] + (1.0 - share) * bs[i]);
        let sr = dot(&s, &r);
        for i in 0..n {
            for j in 0..n {
                self.hessian[i][j] += r[i] * r[j] / sr - bs[i] * bs[j] / sbs;
            }
        }
        self.learnt = true;
    }

    /// The multipliers of constraints which both points know.
    fn known(&self, here: &Linear, there: &Linear) -> Multipliers {
        let has = |l: &Linear, name: usize| l.inequalities.iter().any(|(n, ..)| *n == name);
        let mut known = self.multipliers.clone();
        known.inequalities.retain(|(name, _)| has(here, *name) && has(there, *name));
        known
    }

    /// Why the descent ended, once it has.
    pub fn finished(&self) -> Option<SqpStop> {
        self.finished
    }

    /// The point reached.
    pub fn point(&self) -> &Point {
        &self.x
    }

    /// What is at the point reached.
    pub fn here(&self) -> Option<&Linear> {
        self.here.as_ref()
    }

    /// Forces at the point reached.
    pub fn multipliers(&self) -> &Multipliers {
        &self.multipliers
    }

    /// How far those forces are from balance, and from belonging to constraints at work.
    pub fn residual(&self) -> f64 {
        self.residual
    }

    /// Largest violation at the point reached.
    pub fn violation(&self) -> f64 {
        self.here.as_ref().map_or(f64::INFINITY, Linear::violation)
    }

    /// Points asked for and told.
    pub fn evaluations(&self) -> usize {
        self.evaluations
    }
}
