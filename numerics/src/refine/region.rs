//! The trust region: where to simulate next, and when to stop.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::kriging::Kriging;
use crate::optimise::sqp::Differentiable;
use crate::parameters::{Bounds, COUNT, Point};
use crate::surrogate::Jacobian;

/// Least weight of |1 - L+| + |D+| + |M+| in the merit.
const LEAST_WEIGHT: f64 = 2.0;
/// That weight over the largest multiplier of the trim met so far: below 1 the least merit is out of trim.
const ABOVE: f64 = 1.5;
/// Largest gap of L+, D+ and M+ which counts as agreement even where the standard error is smaller.
const AGREED: f64 = 1e-3;
/// Largest |1 - L+| + |D+| + |M+| of an answer.
const TRIMMED: f64 = 3e-3;
/// Least gain of the merit worth another round.
const GAIN: f64 = 5e-4;
/// Smallest radius, in widths of the box.
const SMALLEST: f64 = 1e-3;
/// Largest radius.
const LARGEST: f64 = 0.5;

/// How to refine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineSettings {
    /// Most simulations.
    pub simulations: usize,
    /// Simulations of a round: the candidate and points around it.
    pub batch: usize,
    /// First radius of the trust region, in widths of the box.
    pub radius: f64,
    /// Seed of the points around a candidate.
    pub seed: u64,
}

impl Default for RefineSettings {
    fn default() -> Self {
        Self { simulations: 150, batch: 12, radius: 0.1, seed: 0 }
    }
}

/// A stroke flown: `[L+, D+, M+, P+]` and standard errors; none where it cannot be flown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flown {
    /// The stroke.
    pub x: Point,
    /// Means and standard errors.
    pub means: Option<([f64; 4], [f64; 4])>,
}

/// What is carried from round to round.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// Rounds done.
    pub round: usize,
    /// Radius, in widths of the box.
    pub radius: f64,
    /// Which flown stroke the last candidate is, and what was predicted of it.
    pub candidate: Option<(usize, [f64; 4])>,
    /// Weight of |1 - L+| + |D+| + |M+| in the [`merit`]; it only grows.
    pub weight: f64,
    /// Prices at the last optimum of the corrected surrogate: by how much P+ rises per unit of
    /// L+, D+ and M+ asked for.
    pub prices: Option<[f64; 3]>,
}

impl Default for Region {
    /// Before the first round.
    fn default() -> Self {
        let radius = RefineSettings::default().radius;
        Self { round: 0, radius, candidate: None, weight: LEAST_WEIGHT, prices: None }
    }
}

impl Region {
    /// The prices, and a weight above them.
    fn priced(&self, prices: [f64; 3]) -> Self {
        let largest = prices.iter().map(|p| p.abs()).fold(0.0, f64::max);
        Self { weight: self.weight.max(ABOVE * largest), prices: Some(prices), ..self.clone() }
    }
}

/// Why refining ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RefineStop {
    /// Prediction and simulation agree at a trimmed stroke with strokes flown all around it, and nothing better
    /// is foreseen.
    Agreed,
    /// No simulations are left.
    Budget,
    /// The trust region shrank to nothing.
    Radius,
    /// Nothing could be flown, or no candidate be found.
    Nothing,
}

/// What follows a round.
#[derive(Debug, Clone, PartialEq)]
pub enum Next {
    /// Fly these, candidate first, append them to the strokes flown and come back.
    Fly {
        /// To be handed in again.
        region: Region,
        /// The strokes.
        batch: Vec<Point>,
    },
    /// Done: the best stroke flown, with the last prediction made before it was flown.
    Done {
        /// Why.
        stop: RefineStop,
        /// Which flown stroke it is.
        best: usize,
        /// `[L+, D+, M+, P+]` predicted there by everything else known.
        predicted: [f64; 4],
        /// The region with its last weight and prices.
        region: Region,
    },
}

/// An optimum of a model in a trust region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Minimum {
    /// The stroke.
    pub point: Point,
    /// By how much P+ rises per unit of L+, D+ and M+ asked for.
    pub prices: [f64; 3],
}

/// The least P+ with L+ = 1, D+ = M+ = 0 and enough clearance, of a model within bounds, from a start.
pub type Minimise<'a> = dyn Fn(&dyn Differentiable, &Bounds, &Point) -> Option<Minimum> + 'a;

/// The surrogate, and how an optimum is found on a corrected one.
pub struct Tools<'a> {
    /// The surrogate as trained.
    pub surrogate: &'a dyn Differentiable,
    /// Finds an optimum.
    pub minimise: &'a Minimise<'a>,
    /// Whether the wings keep their distance.
    pub clear: &'a dyn Fn(&Point) -> bool,
}

/// Merit of a stroke: P+ + w (|1 - L+| + |D+| + |M+|).
pub fn merit(y: &[f64; 4], weight: f64) -> f64 {
    y[3] + weight * off_trim(y)
}

/// Standard error of a merit whose parts all err to one side.
fn noise(se: &[f64; 4], weight: f64) -> f64 {
    se[3] + weight * (se[0] + se[1] + se[2])
}

/// P+ of a stroke corrected to exact trim by the prices of L+, D+ and M+, to first order:
/// P+ + p_L (1 - L+) - p_D D+ - p_M M+.
pub fn trimmed_power(y: &[f64; 4], prices: &[f64; 3]) -> f64 {
    y[3] + prices[0] * (1.0 - y[0]) - prices[1] * y[1] - prices[2] * y[2]
}

/// |1 - L+| + |D+| + |M+|.
pub fn off_trim(y: &[f64; 4]) -> f64 {
    (1.0 - y[0]).abs() + y[1].abs() + y[2].abs()
}

/// One round: judges the last candidate, learns from all strokes flown, proposes
/// the next. `flown` begins with the optimum of the surrogate.
pub fn step(tools: &Tools<'_>, bounds: &Bounds, settings: &RefineSettings, flown: &[Flown], region: &Region) -> Next {
    let Some(best) = best_of(flown, region.weight) else {
        return Next::Done { stop: RefineStop::Nothing, best: 0, predicted: [f64::NAN; 4], region: region.clone() };
    };
    let (radius, agreed) = judge(flown, region, best);
    let done = |stop, region: Region| {
        let others: Vec<Flown> = flown.iter().enumerate().filter(|(i, _)| *i != best).map(|(_, f)| *f).collect();
        let predicted = match region.candidate {
            Some((candidate, predicted)) if candidate == best => predicted,
            _ => Corrected::new(tools.surrogate, bounds, &others).at(&flown[best].x),
        };
        Next::Done { stop, best, predicted, region }
    };
    if flown.len() >= settings.simulations {
        return done(RefineStop::Budget, region.clone());
    }
    if radius < SMALLEST {
        return done(RefineStop::Radius, region.clone());
    }
    let centre = flown[best].x;
    let corrected = Corrected::new(tools.surrogate, bounds, flown);
    // Far from trim the nearest stroke in trim may lie outside: then the reach grows.
    let reaches = std::iter::successors(Some(radius), |reach| (*reach < 1.0).then_some(2.0 * reach));
    let found = reaches.map(|reach| (tools.minimise)(&corrected, &around(bounds, &centre, reach), &centre));
    let Some(candidate) = found.flatten().next() else { return done(RefineStop::Nothing, region.clone()) };
    let region = region.priced(candidate.prices);
    let predicted = corrected.at(&candidate.point);
    let here = flown[best].means.map_or([f64::NAN; 4], |m| m.0);
    let doubt = flown[best].means.map_or(0.0, |m| noise(&m.1, region.weight));
    let gain = merit(&here, region.weight) - merit(&predicted, region.weight);
    let nothing_better = agreed && off_trim(&here) <= TRIMMED && gain < doubt.max(GAIN);
    // That nothing better is near says a slope, and a slope is known where strokes lie all around.
    if nothing_better && surrounding(bounds, settings, flown, &centre) >= settings.batch {
        return done(RefineStop::Agreed, region);
    }
    // Once a prediction held, fewer points around the next one are enough.
    let size = if agreed && !nothing_better { settings.batch.div_ceil(3) } else { settings.batch };
    let size = size.clamp(1, settings.simulations - flown.len());
    let width = if nothing_better { settings.radius } else { radius };
    let batch = batch(tools, bounds, settings, &candidate.point, width, region.round, size);
    let candidate = Some((flown.len(), predicted));
    Next::Fly { region: Region { round: region.round + 1, radius, candidate, ..region }, batch }
}

/// The stroke of least merit flown so far.
fn best_of(flown: &[Flown], weight: f64) -> Option<usize> {
    let merits = flown.iter().enumerate().filter_map(|(i, f)| f.means.map(|m| (i, merit(&m.0, weight))));
    merits.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
}

/// The next radius, and whether the last prediction agreed with its simulation.
fn judge(flown: &[Flown], region: &Region, best: usize) -> (f64, bool) {
    let Some((candidate, predicted)) = region.candidate else { return (region.radius, false) };
    let Some((y, se)) = flown[candidate].means else { return (region.radius * 0.5, false) };
    let agrees = (0..4).all(|k| (y[k] - predicted[k]).abs() <= (2.0 * se[k]).max(AGREED));
    let merit = |y: &[f64; 4]| merit(y, region.weight);
    let before = flown[..candidate].iter().filter_map(|f| f.means.map(|m| merit(&m.0))).fold(f64::INFINITY, f64::min);
    let (foreseen, gained) = (before - merit(&predicted), before - merit(&y));
    let doubt = noise(&se, region.weight).max(GAIN);
    // Where no more than noise was to be gained, the merit says nothing about the model.
    let radius = if foreseen < doubt && agrees {
        region.radius
    } else if gained > 0.7 * foreseen {
        region.radius * 1.5
    } else if gained > 0.2 * foreseen {
        region.radius
    } else {
        region.radius * 0.5
    };
    (radius.min(LARGEST), agrees && (candidate == best || gained > -doubt))
}

/// The box around a point, within the bounds.
fn around(bounds: &Bounds, centre: &Point, radius: f64) -> Bounds {
    let mut local = *bounds;
    for i in (0..COUNT).filter(|&i| !bounds.is_held(i)) {
        let reach = radius * (bounds.upper[i] - bounds.lower[i]);
        local.lower[i] = (centre[i] - reach).max(bounds.lower[i]);
        local.upper[i] = (centre[i] + reach).min(bounds.upper[i]);
    }
    local
}

/// How many strokes were flown to their end in the half of the first trust region nearest to a point.
fn surrounding(bounds: &Bounds, settings: &RefineSettings, flown: &[Flown], centre: &Point) -> usize {
    let near = around(bounds, centre, 0.5 * settings.radius);
    let inside = |x: &Point| (0..COUNT).all(|i| (near.lower[i]..=near.upper[i]).contains(&x[i]));
    flown.iter().filter(|f| f.means.is_some() && inside(&f.x)).count()
}

/// The candidate and points around it, in the half of the trust region nearest to it.
fn batch(
    tools: &Tools<'_>,
    bounds: &Bounds,
    settings: &RefineSettings,
    candidate: &Point,
    radius: f64,
    round: usize,
    size: usize,
) -> Vec<Point> {
    let near = around(bounds, candidate, 0.5 * radius);
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    rng.set_stream(round as u64);
    let mut batch = vec![*candidate];
    for _ in 0..100 * size {
        if batch.len() >= size {
            break;
        }
        let unit: Point = std::array::from_fn(|_| rng.random());
        let x = near.from_unit(&unit);
        if (tools.clear)(&x) {
            batch.push(x);
        }
    }
    batch
}

/// The surrogate plus what the strokes flown say of its errors.
struct Corrected<'a> {
    surrogate: &'a dyn Differentiable,
    errors: [Option<Kriging>; 4],
}

impl<'a> Corrected<'a> {
    fn new(surrogate: &'a dyn Differentiable, bounds: &Bounds, flown: &[Flown]) -> Self {
        let known: Vec<_> = flown.iter().filter_map(|f| f.means.map(|(y, se)| (f.x, y, se))).collect();
        let points: Vec<Point> = known.iter().map(|k| k.0).collect();
        let mut predicted = vec![NOTHING; points.len()];
        surrogate.jacobians_into(&points, &mut predicted);
        let errors = std::array::from_fn(|k| {
            let residuals: Vec<f64> = known.iter().zip(&predicted).map(|(f, p)| f.1[k] - p.0[k]).collect();
            let noise: Vec<f64> = known.iter().map(|f| f.2[k]).collect();
            if points.is_empty() { None } else { Kriging::fit(bounds, &points, &residuals, &noise) }
        });
        Self { surrogate, errors }
    }

    /// `[L+, D+, M+, P+]` at a point.
    fn at(&self, x: &Point) -> [f64; 4] {
        let mut out = [NOTHING];
        self.jacobians_into(std::slice::from_ref(x), &mut out);
        out[0].0
    }
}

/// Values and derivatives not yet known.
const NOTHING: Jacobian = ([0.0; 4], [[0.0; COUNT]; 4]);

impl Differentiable for Corrected<'_> {
    fn jacobians_into(&self, xs: &[Point], out: &mut [Jacobian]) {
        self.surrogate.jacobians_into(xs, out);
        for (x, (y, jacobian)) in xs.iter().zip(out) {
            for (k, error) in self.errors.iter().enumerate() {
                let Some(error) = error else { continue };
                let (value, gradient) = error.value_and_gradient(x);
                y[k] += value;
                for (slope, add) in jacobian[k].iter_mut().zip(gradient) {
                    *slope += add;
                }
            }
        }
    }
}
