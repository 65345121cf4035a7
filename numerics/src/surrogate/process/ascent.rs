//! The way up to the likeliest numbers.

use super::likelihood::{Labels, Solved};
use nalgebra::{DMatrix, DVector};
use std::ops::ControlFlow;

/// The likelihood's slope, per sample and factor e of a number, below which its top is reached.
const FLAT: f64 = 1e-6;
/// What a step must gain of the slope's promise (Armijo 1966).
const GAIN: f64 = 1e-4;
/// Longest first step, a factor e.
const LONGEST: f64 = 1.0;
/// Halvings of a step.
const HALVINGS: usize = 12;

/// Why an ascent ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AscentStop {
    /// No slope within the bounds is left.
    Flat,
    /// All iterations were made.
    MaxIterations,
    /// No step made the labels likelier.
    Stuck,
    /// The observer asked to stop.
    Interrupted,
    /// None was made: the labels do not depend on what is free.
    Constant,
}

/// Where an ascent ended.
pub(super) struct Top {
    pub(super) at: Vec<f64>,
    pub(super) solved: Solved,
    pub(super) iterations: usize,
    pub(super) stop: AscentStop,
}

/// Climbs the likelihood from a point between bounds by a projected quasi-Newton method
/// (Broyden, Fletcher, Goldfarb, Shanno; numbers at bounds they would cross are left out).
/// None where the first point has no likelihood.
pub(super) fn climb(
    labels: &Labels,
    start: Vec<f64>,
    bounds: &[(f64, f64)],
    most: usize,
    observe: &mut dyn FnMut(usize, f64) -> ControlFlow<()>,
) -> Option<Top> {
    let inside = |at: &DVector<f64>| {
        DVector::from_iterator(at.len(), at.iter().zip(bounds).map(|(v, (low, high))| v.max(*low).min(*high)))
    };
    let n = start.len();
    let mut at = inside(&DVector::from_vec(start));
    let mut solved = labels.solve(at.as_slice())?;
    let mut slope = DVector::from_vec(labels.gradient(at.as_slice(), &solved));
    let mut inverse = DMatrix::<f64>::identity(n, n) * (LONGEST / slope.amax().max(1e-300));
    let end =
        |at: DVector<f64>, solved, iterations, stop| Some(Top { at: at.as_slice().to_vec(), solved, iterations, stop });
    for iteration in 0..most {
        if observe(iteration, solved.likelihood).is_break() {
            return end(at, solved, iteration, AscentStop::Interrupted);
        }
        let held: Vec<bool> = (0..n)
            .map(|i| (at[i] <= bounds[i].0 && slope[i] <= 0.0) || (at[i] >= bounds[i].1 && slope[i] >= 0.0))
            .collect();
        let free = |v: &DVector<f64>| DVector::from_fn(n, |i, _| if held[i] { 0.0 } else { v[i] });
        let uphill = free(&slope);
        if uphill.amax() <= FLAT * labels.len() as f64 {
            return end(at, solved, iteration, AscentStop::Flat);
        }
        let mut step = free(&(&inverse * &uphill));
        if step.dot(&uphill) <= 0.0 {
            inverse = DMatrix::identity(n, n) * (LONGEST / uphill.amax());
            step = &uphill * (LONGEST / uphill.amax());
        }
        let mut length = (LONGEST / step.amax()).min(1.0);
        let taken = (0..HALVINGS).find_map(|_| {
            let next = inside(&(&at + &step * length));
            let promise = uphill.dot(&(&next - &at));
            length *= 0.5;
            let found = labels.solve(next.as_slice())?;
            (found.likelihood >= solved.likelihood + GAIN * promise && promise > 0.0).then_some((next, found))
        });
        let Some((next, found)) = taken else { return end(at, solved, iteration, AscentStop::Stuck) };
        let after = DVector::from_vec(labels.gradient(next.as_slice(), &found));
        update(&mut inverse, &(&next - &at), &(&slope - &after));
        (at, solved, slope) = (next, found, after);
    }
    end(at, solved, most, AscentStop::MaxIterations)
}

/// The inverse of the curvature after a step and the fall of the slope over it.
fn update(inverse: &mut DMatrix<f64>, step: &DVector<f64>, fall: &DVector<f64>) {
    let along = step.dot(fall);
    if along <= 1e-10 * step.norm() * fall.norm() {
        return;
    }
    let image = &*inverse * fall;
    let factor = (1.0 + fall.dot(&image) / along) / along;
    inverse.ger(factor, step, step, 1.0);
    inverse.ger(-1.0 / along, &image, step, 1.0);
    inverse.ger(-1.0 / along, step, &image, 1.0);
}
