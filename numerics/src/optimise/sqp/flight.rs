//! Trimmed flight at least power as a smooth problem.

use super::linear::Linear;
use crate::kinematics::{Clearance, Contact};
use crate::parameters::{Bounds, COUNT, Point};
use crate::surrogate::{Jacobian, Network, Surrogate};

/// Unit of the clearance among the constraints, m: its size then is that of the others.
const UNIT_M: f64 = 1e-2;

/// Contacts farther than this beyond the margin are left out, m: no step of an
/// optimiser crosses so much unseen more than once.
const FAR_M: f64 = 1e-2;

/// A surrogate with derivatives.
pub trait Differentiable: Sync {
    /// `[L+, D+, M+, P+]` and their derivatives by the ten parameters, in table units,
    /// at each point, on the calling thread.
    fn jacobians_into(&self, xs: &[Point], out: &mut [Jacobian]);
}

impl Differentiable for Network {
    fn jacobians_into(&self, xs: &[Point], out: &mut [Jacobian]) {
        Network::jacobians_into(self, xs, out);
    }
}

impl Differentiable for Surrogate {
    fn jacobians_into(&self, xs: &[Point], out: &mut [Jacobian]) {
        Surrogate::jacobians_into(self, xs, out);
    }
}

/// Trimmed flight at least power: `min P+` with `L+ = 1`, `D+ = 0`, `M+ = 0`, clearance
/// at least the margin, inside the box. Searched in unit coordinates.
#[derive(Clone, Copy)]
pub struct Flight<'a> {
    /// The surrogate.
    pub surrogate: &'a dyn Differentiable,
    /// The wings' room; none where they cannot collide.
    pub clearance: Option<&'a Clearance>,
    /// Clearance asked for, m.
    pub margin_m: f64,
    /// The box searched; `lower == upper` holds a parameter.
    pub bounds: Bounds,
}

impl Flight<'_> {
    /// Linearises the problem at points in unit coordinates, in the order of `us`.
    pub(super) fn linearise(&self, us: &[Point]) -> Vec<(Jacobian, Linear)> {
        let xs: Vec<Point> = us.iter().map(|u| self.table(u)).collect();
        let mut found = vec![([0.0; 4], [[0.0; COUNT]; 4]); xs.len()];
        self.surrogate.jacobians_into(&xs, &mut found);
        let mut contacts = Vec::new();
        let both = xs.iter().zip(found);
        both.map(|(x, jacobian)| {
            if let Some(clearance) = self.clearance {
                clearance.contacts(x, self.margin_m + FAR_M, &mut contacts);
            }
            (jacobian, self.linear(&jacobian, &contacts))
        })
        .collect()
    }

    /// A point in table units; held parameters have their held values.
    pub(super) fn table(&self, unit: &Point) -> Point {
        let x = self.bounds.from_unit(unit);
        super::super::clamped(&self.bounds, &x)
    }

    fn linear(&self, (y, slopes): &Jacobian, contacts: &[Contact]) -> Linear {
        let span: Point = std::array::from_fn(|i| self.bounds.upper[i] - self.bounds.lower[i]);
        let unit = |slope: &Point| std::array::from_fn(|i| slope[i] * span[i]);
        let contact = |c: &Contact| {
            let slope: Point = unit(&c.slope);
            (c.id, (c.distance_m - self.margin_m) / UNIT_M, slope.map(|s| s / UNIT_M))
        };
        Linear {
            value: y[3],
            gradient: unit(&slopes[3]),
            equalities: vec![(y[0] - 1.0, unit(&slopes[0])), (y[1], unit(&slopes[1])), (y[2], unit(&slopes[2]))],
            inequalities: contacts.iter().map(contact).collect(),
        }
    }

    /// Change of P+ per mm of margin from the multipliers of contacts.
    pub(super) fn price_per_mm(multipliers: &[(usize, f64)]) -> f64 {
        multipliers.iter().map(|(_, m)| m).sum::<f64>() * 1e-3 / UNIT_M
    }
}
