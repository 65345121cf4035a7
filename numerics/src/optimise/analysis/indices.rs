//! Which parameter is responsible for which share of an output's variance.

use crate::optimise::problem::Predict;
use crate::optimise::sobol::Sobol;
use crate::optimise::{OptimiseError, check, free};
use crate::parameters::{Bounds, COUNT, Point};

/// Sobol's indices of the four outputs; 0 for held parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Indices {
    /// Share of the variance which a parameter has alone, one row per output.
    pub first: [[f64; COUNT]; 4],
    /// Share in which it takes part at all.
    pub total: [[f64; COUNT]; 4],
    /// Variance of each output over the box.
    pub variance: [f64; 4],
}

/// Estimates the indices over a box from `base (free + 2)` predictions.
///
/// ```text
/// S_i = mean f(B) (f(A with column i of B) - f(A)) / variance    Saltelli et al. 2010
/// T_i = mean (f(A) - f(A with column i of B))^2 / 2 / variance   Jansen 1999
/// ```
///
/// A and B are the two halves of the coordinates of one Sobol sequence. The outputs are
/// centred first, which takes most of the scatter out of S.
///
/// # Errors
/// When bounds are out of order or `base` is out of range.
pub fn indices(predict: &Predict<'_>, bounds: &Bounds, base: u32, seed: u64) -> Result<Indices, OptimiseError> {
    check("base", f64::from(base), 2.0..=1e8, "2 to 1e8")?;
    let free = free(bounds)?;
    let sequence = Sobol::new(2 * free.len(), seed).ok_or(OptimiseError::NothingFree)?;
    let (a, b): (Vec<Point>, Vec<Point>) = (0..base)
        .map(|i| {
            let mut dense = [0.0; 2 * COUNT];
            sequence.point(i, &mut dense[..2 * free.len()]);
            let point = |half: &[f64]| {
                let mut unit = [0.0; COUNT];
                free.iter().zip(half).for_each(|(&i, u)| unit[i] = *u);
                bounds.from_unit(&unit)
            };
            (point(&dense[..free.len()]), point(&dense[free.len()..]))
        })
        .unzip();
    let outputs = |xs: &[Point]| {
        let mut out = vec![[0.0; 4]; xs.len()];
        predict(xs, &mut out);
        out
    };
    let (fa, fb) = (outputs(&a), outputs(&b));
    let (mean, variance) = moments(&fa, &fb);
    let mut found = Indices { first: [[0.0; COUNT]; 4], total: [[0.0; COUNT]; 4], variance };
    for &i in &free {
        let mut mixed = a.clone();
        for (mixed, b) in mixed.iter_mut().zip(&b) {
            mixed[i] = b[i];
        }
        let fm = outputs(&mixed);
        for k in 0..4 {
            let (mut first, mut total) = (0.0, 0.0);
            for ((a, b), m) in fa.iter().zip(&fb).zip(&fm) {
                first += (b[k] - mean[k]) * (m[k] - a[k]);
                total += (a[k] - m[k]) * (a[k] - m[k]);
            }
            if variance[k] > 0.0 {
                found.first[k][i] = first / f64::from(base) / variance[k];
                found.total[k][i] = 0.5 * total / f64::from(base) / variance[k];
            }
        }
    }
    Ok(found)
}

/// Mean and variance of each output over both halves.
fn moments(a: &[[f64; 4]], b: &[[f64; 4]]) -> ([f64; 4], [f64; 4]) {
    let n = (a.len() + b.len()) as f64;
    let all = || a.iter().chain(b);
    let mean = std::array::from_fn(|k| all().map(|y| y[k]).sum::<f64>() / n);
    let variance = |k: usize, mean: f64| all().map(|y| (y[k] - mean) * (y[k] - mean)).sum::<f64>() / n;
    (mean, std::array::from_fn(|k| variance(k, mean[k])))
}
