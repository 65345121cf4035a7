//! Leading-edge suction from the bound circulation of a strip.

use nalgebra::{DMatrix, DVector};

/// Fits the strength of the leading-edge singularity to the front panels of a strip.
///
/// On a flat plate with normal velocity w0 + w1 (2x/c - 1) only w0 feeds the
/// square-root singularity, whose suction is π ρ c w0² per span. The lattice's own
/// answers to either downwash are the modes of the fit, so that a plate gives
/// exactly 2π sin²α with any number of panels and no table of factors.
#[derive(Debug, Clone)]
pub struct SuctionFit {
    /// w0 = Σ weight ΔΓ / c.
    weights: Vec<f64>,
}

impl SuctionFit {
    /// For uniform chordwise panels.
    pub fn new(chordwise: usize) -> Self {
        let m = chordwise;
        let position = |i: usize, share: f64| (i as f64 + share) / m as f64;
        // Normal velocity at x of a unit vortex at x': 1 / (2π (x - x')).
        let influence =
            DMatrix::from_fn(m, m, |i, j| 1.0 / (std::f64::consts::TAU * (position(i, 0.75) - position(j, 0.25))));
        let lu = influence.lu();
        let mode = |downwash: &dyn Fn(f64) -> f64| {
            lu.solve(&DVector::from_fn(m, |i, _| downwash(position(i, 0.75)))).unwrap_or_else(|| DVector::zeros(m))
        };
        let flat = mode(&|_| 1.0);
        let linear = mode(&|x| 2.0 * x - 1.0);
        let used = m.div_ceil(2).max(2).min(m);
        let (flat, linear) = (flat.rows(0, used), linear.rows(0, used));
        // Normal equations of the two-mode least squares; a single panel has one mode.
        let (ff, fl, ll) = (flat.dot(&flat), flat.dot(&linear), linear.dot(&linear));
        let determinant = ff * ll - fl * fl;
        let weights = if used < 2 {
            vec![1.0 / flat[0]]
        } else {
            (0..used).map(|i| (ll * flat[i] - fl * linear[i]) / determinant).collect()
        };
        Self { weights }
    }

    /// w0 of a strip from its bound strengths (front first), m/s times chord.
    pub fn singularity(&self, bound: impl Iterator<Item = f64>) -> f64 {
        self.weights.iter().zip(bound).map(|(w, g)| w * g).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A two-dimensional plate: circulation π U c sin α for any number of panels,
    /// suction per chord ½ρU² x 2π sin²α.
    #[test]
    fn plate_has_exact_circulation_and_suction() {
        for m in [1, 2, 4, 6, 8, 10, 16] {
            let fit = SuctionFit::new(m);
            let position = |i: usize, share: f64| (i as f64 + share) / m as f64;
            let influence =
                DMatrix::from_fn(m, m, |i, j| 1.0 / (std::f64::consts::TAU * (position(i, 0.75) - position(j, 0.25))));
            let sine = crate::math::sin(0.3);
            let gamma = influence.lu().solve(&DVector::from_element(m, sine)).unwrap();
            assert!((gamma.sum() - std::f64::consts::PI * sine).abs() < 1e-10, "{m}: {}", gamma.sum());
            let w0 = fit.singularity(gamma.iter().copied());
            let suction = 2.0 * std::f64::consts::PI * w0 * w0;
            assert!((suction - std::f64::consts::TAU * sine.powi(2)).abs() < 1e-6, "{m}: {suction}");
        }
    }
}
