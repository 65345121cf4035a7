//! What the surrogate gets wrong near an optimum, learnt from the simulations made there.

use nalgebra::{DMatrix, DVector};

use crate::math::{exp, ln};
use crate::parameters::{Bounds, COUNT, Point};

/// Lengths of correlation tried, in widths of the box.
const LENGTHS: [f64; 6] = [0.1, 0.2, 0.4, 0.8, 1.6, 3.2];
/// Amplitudes tried, in root mean squares of the residuals about their mean.
const AMPLITUDES: [f64; 5] = [0.5, 1.0, 2.0, 4.0, 8.0];
/// Least standard deviation of a residual: below it a simulation depends on its numerics.
const LEAST_NOISE: f64 = 3e-4;

/// A gaussian process on the residuals of one output.
///
/// ```text
/// δ(u) = m + Σ_j α_j k(u, u_j),   k(u, v) = a² exp(-|u - v|² / 2 ℓ²)
/// (K + diag(s_j²)) α = r - m,     m by generalised least squares
/// ```
///
/// u is the point in the unit box (held parameters left out), r_j the residual and
/// s_j its standard error. ℓ and a are those of a small grid which make the
/// residuals likeliest. Source: Rasmussen & Williams 2006, chapters 2 and 5.
#[derive(Debug, Clone)]
pub struct Kriging {
    bounds: Bounds,
    points: Vec<Point>,
    weights: Vec<f64>,
    mean: f64,
    length: f64,
    amplitude: f64,
}

impl Kriging {
    /// From points, residuals there and their standard errors. `None` without
    /// points, or where no setting of the grid gives a factorisation.
    pub fn fit(bounds: &Bounds, points: &[Point], residuals: &[f64], errors: &[f64]) -> Option<Self> {
        let n = points.len() as f64;
        let units: Vec<Point> = points.iter().map(|x| bounds.to_unit(x)).collect();
        let average = residuals.iter().sum::<f64>() / n;
        let spread = (residuals.iter().map(|r| (r - average).powi(2)).sum::<f64>() / n).sqrt().max(LEAST_NOISE);
        let mut best: Option<(f64, Self)> = None;
        for length in LENGTHS {
            for factor in AMPLITUDES {
                let Some((likelihood, fitted)) = Self::with(bounds, &units, residuals, errors, length, factor * spread)
                else {
                    continue;
                };
                if best.as_ref().is_none_or(|(known, _)| likelihood > *known) {
                    best = Some((likelihood, fitted));
                }
            }
        }
        best.map(|(_, fitted)| fitted)
    }

    fn with(
        bounds: &Bounds,
        units: &[Point],
        residuals: &[f64],
        errors: &[f64],
        length: f64,
        amplitude: f64,
    ) -> Option<(f64, Self)> {
        let n = units.len();
        let covariance = DMatrix::from_fn(n, n, |i, j| {
            let noise = if i == j { errors[i].powi(2) + LEAST_NOISE.powi(2) } else { 0.0 };
            kernel(&units[i], &units[j], length, amplitude) + noise
        });
        let factor = covariance.cholesky()?;
        let ones = factor.solve(&DVector::from_element(n, 1.0));
        let values = DVector::from_column_slice(residuals);
        let mean = ones.dot(&values) / ones.sum();
        let centred = values.add_scalar(-mean);
        let weights = factor.solve(&centred);
        let logarithms: f64 = (0..n).map(|i| ln(factor.l_dirty()[(i, i)])).sum();
        let likelihood = -0.5 * centred.dot(&weights) - logarithms;
        let fitted = Self {
            bounds: *bounds,
            points: units.to_vec(),
            weights: weights.as_slice().to_vec(),
            mean,
            length,
            amplitude,
        };
        likelihood.is_finite().then_some((likelihood, fitted))
    }

    /// δ at a point in table units, and its derivatives by the parameters.
    pub fn value_and_gradient(&self, x: &Point) -> (f64, Point) {
        let u = self.bounds.to_unit(x);
        let (mut value, mut gradient) = (self.mean, [0.0; COUNT]);
        for (v, weight) in self.points.iter().zip(&self.weights) {
            let share = weight * kernel(&u, v, self.length, self.amplitude);
            value += share;
            for i in 0..COUNT {
                gradient[i] -= share * (u[i] - v[i]) / self.length.powi(2);
            }
        }
        for (i, slope) in gradient.iter_mut().enumerate() {
            let width = self.bounds.upper[i] - self.bounds.lower[i];
            *slope = if width > 0.0 { *slope / width } else { 0.0 };
        }
        (value, gradient)
    }
}

fn kernel(u: &Point, v: &Point, length: f64, amplitude: f64) -> f64 {
    let squared: f64 = u.iter().zip(v).map(|(a, b)| (a - b).powi(2)).sum();
    amplitude.powi(2) * exp(-0.5 * squared / length.powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(n: u64) -> Vec<Point> {
        let bounds = Bounds::default();
        (0..n).filter_map(|i| crate::sampling::sample(&bounds, 3, i, &|_| true)).collect()
    }

    fn wavy(x: &Point) -> f64 {
        let u = Bounds::default().to_unit(x);
        0.1 + 0.05 * u[0] - 0.08 * u[2] * u[5] + 0.02 * crate::math::sin(3.0 * u[9])
    }

    #[test]
    fn it_passes_through_what_it_has_seen_and_foresees_what_is_near() {
        let bounds = Bounds::default();
        let seen = points(80);
        let residuals: Vec<f64> = seen.iter().map(wavy).collect();
        let fitted = Kriging::fit(&bounds, &seen, &residuals, &[0.0; 80]).expect("a fit");
        for x in &seen {
            assert!((fitted.value_and_gradient(x).0 - wavy(x)).abs() < 2e-3);
        }
        let unseen = &points(140)[80..];
        let error = unseen.iter().map(|x| (fitted.value_and_gradient(x).0 - wavy(x)).powi(2)).sum::<f64>() / 60.0;
        let spread = unseen.iter().map(|x| (wavy(x) - 0.1).powi(2)).sum::<f64>() / 60.0;
        assert!(error < 0.1 * spread, "{error} {spread}");
    }

    #[test]
    fn its_gradient_is_that_of_its_values() {
        let bounds = Bounds::default();
        let seen = points(30);
        let residuals: Vec<f64> = seen.iter().map(wavy).collect();
        let fitted = Kriging::fit(&bounds, &seen, &residuals, &[1e-3; 30]).expect("a fit");
        let x = points(31)[30];
        let (_, gradient) = fitted.value_and_gradient(&x);
        for i in 0..COUNT {
            let step = 1e-5 * (bounds.upper[i] - bounds.lower[i]);
            let at = |sign: f64| {
                let mut moved = x;
                moved[i] += sign * step;
                fitted.value_and_gradient(&moved).0
            };
            let slope = (at(1.0) - at(-1.0)) / (2.0 * step);
            assert!((slope - gradient[i]).abs() < 1e-6 * (1e-3 + slope.abs()), "{i}: {slope} {}", gradient[i]);
        }
    }

    #[test]
    fn noise_is_not_learnt() {
        let bounds = Bounds::default();
        let seen = points(40);
        let noisy: Vec<f64> = (0..40).map(|i| if i % 2 == 0 { 0.01 } else { -0.01 }).collect();
        let fitted = Kriging::fit(&bounds, &seen, &noisy, &[0.01; 40]).expect("a fit");
        let largest = seen.iter().map(|x| fitted.value_and_gradient(x).0.abs()).fold(0.0, f64::max);
        assert!(largest < 6e-3, "{largest}");
    }
}
