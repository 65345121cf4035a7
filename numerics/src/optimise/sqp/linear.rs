//! A problem around a point, and the forces there.

use crate::parameters::Point;

/// A problem around a point: values and gradients by the coordinates searched.
#[derive(Debug, Clone, Default)]
pub struct Linear {
    /// What is to be least.
    pub value: f64,
    /// Its gradient.
    pub gradient: Point,
    /// What is to be 0, with gradients; always as many, in the same order.
    pub equalities: Vec<(f64, Point)>,
    /// What is to be at least 0: a name which follows a constraint from point to
    /// point, value, gradient. Constraints far from 0 may be left out.
    pub inequalities: Vec<(usize, f64, Point)>,
}

impl Linear {
    pub(super) fn is_finite(&self) -> bool {
        let all = |g: &Point| g.iter().all(|v| v.is_finite());
        let equalities = self.equalities.iter().all(|(c, g)| c.is_finite() && all(g));
        let inequalities = self.inequalities.iter().all(|(_, c, g)| c.is_finite() && all(g));
        self.value.is_finite() && all(&self.gradient) && equalities && inequalities
    }

    /// Largest violation.
    pub(super) fn violation(&self) -> f64 {
        let equalities = self.equalities.iter().map(|(c, _)| c.abs());
        self.inequalities.iter().map(|(_, c, _)| -c).chain(equalities).fold(0.0, f64::max)
    }
}

/// Forces in the balance at a point: gradient = sum of multiplier times gradient of constraint.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Multipliers {
    /// Of the equalities.
    pub equalities: Vec<f64>,
    /// Of the inequalities by their names, those at work only.
    pub inequalities: Vec<(usize, f64)>,
    /// Of the bounds: positive at a lower one, negative at an upper one.
    pub bounds: Point,
}

/// Value, violation of each equality, and the largest of those of the inequalities.
pub(super) fn parts(at: &Linear) -> Vec<f64> {
    let lacking = at.inequalities.iter().map(|(_, c, _)| (-c).max(0.0)).fold(0.0, f64::max);
    let equalities = at.equalities.iter().map(|(c, _)| c.abs());
    [at.value].into_iter().chain(equalities).chain([lacking]).collect()
}

/// Gradient of the Lagrangian without the bounds.
pub(super) fn lagrangian(at: &Linear, multipliers: &Multipliers) -> Point {
    let mut force = at.gradient;
    let mut take = |multiplier: f64, gradient: &Point| {
        for (f, g) in force.iter_mut().zip(gradient) {
            *f -= multiplier * g;
        }
    };
    for ((_, g), m) in at.equalities.iter().zip(&multipliers.equalities) {
        take(*m, g);
    }
    for (name, m) in &multipliers.inequalities {
        if let Some((_, _, g)) = at.inequalities.iter().find(|(n, ..)| n == name) {
            take(*m, g);
        }
    }
    force
}
