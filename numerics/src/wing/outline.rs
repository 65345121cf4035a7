//! Outline of the wing: Ellington's beta distribution of chord.

use crate::insect::Insect;
use crate::math::{exp, ln_gamma, powf};

/// Leading and trailing edge along the span.
///
/// c/c_mean = x^(p-1) (1-x)^(q-1) / B(p, q), p = r1 k, q = (1 - r1) k,
/// k = r1 (1 - r1) / (r2² - r1²) - 1 (Ellington 1984, Phil. Trans. R. Soc. B 305).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outline {
    p: f64,
    q: f64,
    scale: f64,
    axis: f64,
}

impl Outline {
    /// From the insect's area radii, mean chord and feathering axis.
    pub fn new(insect: &Insect) -> Self {
        let (r1, r2) = (insect.area_radius_1, insect.area_radius_2);
        let k = r1 * (1.0 - r1) / (r2 * r2 - r1 * r1) - 1.0;
        let (p, q) = (r1 * k, (1.0 - r1) * k);
        let beta = exp(ln_gamma(p) + ln_gamma(q) - ln_gamma(p + q));
        Self { p, q, scale: insect.mean_chord_m / beta, axis: insect.feathering_axis }
    }

    /// Chord at a fraction of the wing length, m.
    pub fn chord(&self, x: f64) -> f64 {
        if x <= 0.0 || x >= 1.0 {
            return 0.0;
        }
        self.scale * powf(x, self.p - 1.0) * powf(1.0 - x, self.q - 1.0)
    }

    /// Leading and trailing edge at a fraction of the wing length, m ahead of the feathering axis.
    pub fn edges(&self, x: f64) -> (f64, f64) {
        let chord = self.chord(x);
        (self.axis * chord, (self.axis - 1.0) * chord)
    }

    /// Integral over the span of `f(x) chord(x)`, x from 0 to 1.
    pub fn integrate(&self, f: impl Fn(f64, f64) -> f64) -> f64 {
        self.samples().map(|(x, weight)| f(x, self.chord(x)) * weight).sum()
    }

    /// Places x and weights chord(x) dx of the integral over the span (midpoint rule
    /// in an angle, which removes the root singularities at both ends).
    pub fn samples(&self) -> impl Iterator<Item = (f64, f64)> {
        const POINTS: usize = 4000;
        let step = std::f64::consts::PI / POINTS as f64;
        (0..POINTS).map(move |i| {
            let (s, c) = crate::math::sin_cos((i as f64 + 0.5) * step);
            let x = 0.5 * (1.0 - c);
            (x, self.chord(x) * 0.5 * s * step)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn area_and_its_moments_are_those_asked_for() {
        let insect = Insect::default();
        let outline = Outline::new(&insect);
        let area = outline.integrate(|_, _| 1.0);
        let first = outline.integrate(|x, _| x) / area;
        let second = (outline.integrate(|x, _| x * x) / area).sqrt();
        assert!((area / insect.mean_chord_m - 1.0).abs() < 1e-4, "{area}");
        assert!((first - 0.4586).abs() < 1e-4 && (second - 0.525).abs() < 1e-4, "{first} {second}");
    }
}
