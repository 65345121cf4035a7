//! How far predictions are from what they should be.

use super::{Sample, Surrogate};
use crate::parameters::Point;

/// How a surrogate errs on some samples, per output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Errors {
    /// Root of the mean squared error, scaled units.
    pub rmse: [f64; 4],
    /// Pearson correlation of prediction and target; 0 where either is constant.
    pub correlation: [f64; 4],
    /// How many samples.
    pub count: usize,
}

/// Errors of a surrogate on samples it may never have seen.
pub fn errors(surrogate: &Surrogate, samples: &[Sample]) -> Errors {
    let xs: Vec<Point> = samples.iter().map(|s| s.x).collect();
    let targets: Vec<[f64; 4]> = samples.iter().map(|s| s.y).collect();
    let mut found = vec![[0.0; 4]; xs.len()];
    surrogate.predict_into(&xs, &mut found);
    errors_of(&found, &targets)
}

fn errors_of(found: &[[f64; 4]], targets: &[[f64; 4]]) -> Errors {
    let n = found.len().max(1) as f64;
    let mut errors = Errors { rmse: [0.0; 4], correlation: [0.0; 4], count: found.len() };
    for k in 0..4 {
        let (mut f_mean, mut t_mean) = (0.0, 0.0);
        for (f, t) in found.iter().zip(targets) {
            f_mean += f[k] / n;
            t_mean += t[k] / n;
        }
        let [mut squares, mut ff, mut tt, mut ft] = [0.0; 4];
        for (f, t) in found.iter().zip(targets) {
            let (a, b) = (f[k] - f_mean, t[k] - t_mean);
            squares += (f[k] - t[k]) * (f[k] - t[k]);
            (ff, tt, ft) = (a.mul_add(a, ff), b.mul_add(b, tt), a.mul_add(b, ft));
        }
        errors.rmse[k] = (squares / n).sqrt();
        let spread = ff.sqrt() * tt.sqrt();
        errors.correlation[k] = if spread > 0.0 { (ft / spread).clamp(-1.0, 1.0) } else { 0.0 };
    }
    errors
}
