//! How likely labels are under a process, and which way its numbers make them likelier.

use crate::math::{exp, ln};
use crate::surrogate::cholesky::{factorise, solve_lower, solve_upper};
use faer::Mat;
use rayon::prelude::*;

/// One output at some points.
#[derive(Debug, Clone)]
pub(super) struct Labels {
    /// Inputs, the box from -1 to 1, row by row.
    pub(super) inputs: Vec<f64>,
    /// Inputs of a point.
    pub(super) width: usize,
    /// How many of them the mirror leaves alone.
    pub(super) even: usize,
    /// What the mirror image's covariance is multiplied by.
    pub(super) sign: Option<f64>,
    /// The labels.
    pub(super) values: Vec<f64>,
    /// Squares of their standard errors.
    pub(super) variances: Vec<f64>,
}

/// A process's numbers as they are searched: logarithms of the lengths, then of a, then of g.
pub(super) type Logarithms = [f64];

/// What follows from labels and a process's numbers.
pub(super) struct Solved {
    /// Logarithm of the likelihood, but for a constant.
    pub(super) likelihood: f64,
    /// The mean m.
    pub(super) mean: f64,
    /// The weights w.
    pub(super) weights: Vec<f64>,
    factor: Mat<f64>,
}

impl Labels {
    /// How many points.
    pub(super) fn len(&self) -> usize {
        self.values.len()
    }

    /// The same of some of the points.
    pub(super) fn some(&self, chosen: &[usize]) -> Self {
        let row = |&j: &usize| self.inputs[j * self.width..(j + 1) * self.width].iter().copied();
        Self {
            inputs: chosen.iter().flat_map(row).collect(),
            values: chosen.iter().map(|&j| self.values[j]).collect(),
            variances: chosen.iter().map(|&j| self.variances[j]).collect(),
            ..*self
        }
    }

    /// Standard deviation of the labels; about 0 where their mean is known to be.
    pub(super) fn spread(&self) -> f64 {
        let n = self.len() as f64;
        let mean = if self.is_odd() { 0.0 } else { self.values.iter().sum::<f64>() / n };
        (self.values.iter().map(|y| (y - mean) * (y - mean)).sum::<f64>() / n).sqrt()
    }

    /// Whether functions change their sign with the mirror: then their mean is 0.
    fn is_odd(&self) -> bool {
        self.sign.is_some_and(|sign| sign < 0.0)
    }

    /// Squared differences of inputs over lengths, from a point and from its mirror image,
    /// and the two covariances over a², the second with its sign.
    fn pair(&self, i: usize, j: usize, inverse: &[f64], squares: &mut [[f64; 2]]) -> [f64; 2] {
        let row = |j: usize| &self.inputs[j * self.width..(j + 1) * self.width];
        let (mut here, mut there) = (0.0, 0.0);
        for (n, ((u, v), l)) in row(i).iter().zip(row(j)).zip(inverse).enumerate() {
            let apart = (u - v) * l;
            let across = if n < self.even { apart } else { (u + v) * l };
            squares[n] = [apart * apart, across * across];
            here += squares[n][0];
            there += squares[n][1];
        }
        match self.sign {
            Some(sign) => [0.5 * exp(-0.5 * here), 0.5 * sign * exp(-0.5 * there)],
            None => [exp(-0.5 * here), 0.0],
        }
    }

    /// Weights, mean and likelihood; none where the covariance is not positive to working precision.
    pub(super) fn solve(&self, at: &Logarithms) -> Option<Solved> {
        let (n, width) = (self.len(), self.width);
        let inverse: Vec<f64> = at[..width].iter().map(|l| exp(-l)).collect();
        let (variance, noise) = (exp(2.0 * at[width]), exp(2.0 * at[width + 1]));
        let mut factor = Mat::<f64>::zeros(n, n);
        // Column i of the matrix as it lies in memory is row i of the one which is factorised.
        let rows = factor.as_mut().par_col_chunks_mut(1).enumerate();
        rows.for_each(|(i, mut row)| {
            let mut squares = vec![[0.0; 2]; width];
            for j in 0..=i {
                let [here, there] = self.pair(i, j, &inverse, &mut squares);
                row[(j, 0)] = variance * (here + there);
            }
            row[(i, 0)] += self.variances[i] + noise;
        });
        factorise(factor.as_mut().transpose_mut()).ok()?;
        let mut both = Mat::from_fn(n, 2, |i, k| if k == 0 { self.values[i] } else { 1.0 });
        solve_lower(factor.as_ref().transpose(), both.as_mut());
        solve_upper(factor.as_ref().transpose(), both.as_mut());
        let sum = |k: usize| (0..n).map(|i| both[(i, k)]).sum::<f64>();
        let mean = if self.is_odd() { 0.0 } else { sum(0) / sum(1) };
        let weights: Vec<f64> = (0..n).map(|i| both[(i, 0)] - mean * both[(i, 1)]).collect();
        let fit: f64 = self.values.iter().zip(&weights).map(|(y, w)| (y - mean) * w).sum();
        let logarithms: f64 = (0..n).map(|i| ln(factor[(i, i)])).sum();
        let likelihood = -0.5 * fit - logarithms;
        likelihood.is_finite().then_some(Solved { likelihood, mean, weights, factor })
    }

    /// Derivatives of the likelihood by the logarithms: half the trace of
    /// `(w w' - C⁻¹) dC`, with the mean at its best.
    pub(super) fn gradient(&self, at: &Logarithms, solved: &Solved) -> Vec<f64> {
        let (n, width) = (self.len(), self.width);
        let inverse: Vec<f64> = at[..width].iter().map(|l| exp(-l)).collect();
        let (variance, noise) = (exp(2.0 * at[width]), exp(2.0 * at[width + 1]));
        let mut whole = Mat::<f64>::identity(n, n);
        let factor = solved.factor.as_ref().transpose();
        solve_lower(factor, whole.as_mut());
        solve_upper(factor, whole.as_mut());
        let w = &solved.weights;
        let row = |i: usize| {
            let (mut sums, mut squares) = (vec![0.0; width + 2], vec![[0.0; 2]; width]);
            for j in 0..=i {
                let [here, there] = self.pair(i, j, &inverse, &mut squares);
                let share = (w[i] * w[j] - whole[(i, j)]) * if i == j { 0.5 } else { 1.0 };
                let (one, two) = (share * variance * here, share * variance * there);
                for (sum, [apart, across]) in sums.iter_mut().zip(&squares) {
                    *sum += one * apart + two * across;
                }
                sums[width] += 2.0 * (one + two);
                if i == j {
                    sums[width + 1] += 2.0 * share * noise;
                }
            }
            sums
        };
        let rows: Vec<Vec<f64>> = (0..n).into_par_iter().map(row).collect();
        let mut gradient = vec![0.0; width + 2];
        for row in &rows {
            gradient.iter_mut().zip(row).for_each(|(sum, part)| *sum += part);
        }
        gradient
    }
}
