//! Trimmed flight at least power as a smooth problem.

use super::linear::Linear;
use crate::kinematics::{Clearance, Contact};
use crate::parameters::{Bounds, COUNT, Point};
use crate::surrogate::sharpness::{SHAPES, of_shape, shape_of, slope_at};
use crate::surrogate::{Jacobian, Network, Surrogate};

/// Unit of the clearance among the constraints, m: its size then is that of the others.
const UNIT_M: f64 = 1e-2;

/// Contacts farther than this beyond the margin are left out, m: no step of an
/// optimiser crosses so much unseen more than once.
const FAR_M: f64 = 1e-2;

/// Least shape at which a surrogate of sharpness is linearised: at 0 it is level in the shape, and only the ratio of
/// both slopes says whether power falls with sharpness.
const LEAST_SHAPE: f64 = 1e-5;

/// A surrogate with derivatives.
pub trait Differentiable: Sync {
    /// `[L+, D+, M+, P+]` and their derivatives by the ten parameters, in table units,
    /// at each point, on the calling thread.
    fn jacobians_into(&self, xs: &[Point], out: &mut [Jacobian]);

    /// Whether it knows the shapes K and C by their sharpness alone.
    fn is_sharp(&self) -> bool {
        false
    }
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

    fn is_sharp(&self) -> bool {
        self.frame().is_sharp()
    }
}

/// Trimmed flight at least power: `min P+` with `L+ = 1`, `D+ = 0`, `M+ = 0`, clearance
/// at least the margin, inside the box.
///
/// Searched in unit coordinates, from bound to bound evenly; of a surrogate which knows shapes
/// by their sharpness, evenly in that. In K and C themselves it is level at 0 whatever lies beyond,
/// and descents which touch the bound would stay there.
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
    pub(super) fn linearise(&self, us: &[Point]) -> Vec<Linear> {
        let placed: Vec<(Point, Point)> = us.iter().map(|u| self.placed(u)).collect();
        let xs: Vec<Point> = placed.iter().map(|(x, _)| *x).collect();
        let mut found = vec![([0.0; 4], [[0.0; COUNT]; 4]); xs.len()];
        self.surrogate.jacobians_into(&xs, &mut found);
        let mut contacts = Vec::new();
        let both = placed.iter().zip(found);
        both.map(|((x, stretch), jacobian)| {
            if let Some(clearance) = self.clearance {
                clearance.contacts(x, self.margin_m + FAR_M, &mut contacts);
            }
            self.linear(&jacobian, &contacts, stretch)
        })
        .collect()
    }

    /// A point in table units; held parameters have their held values.
    pub(super) fn table(&self, unit: &Point) -> Point {
        let mut x = self.bounds.from_unit(unit);
        for i in self.by_sharpness().filter(|i| unit[*i] > 0.0 && unit[*i] < 1.0) {
            let (low, high) = self.sharpness(i);
            x[i] = shape_of(i, low + unit[i] * (high - low));
        }
        super::super::clamped(&self.bounds, &x)
    }

    /// What the surrogate says at a point in table units; descents were told of one beside it where a shape is 0.
    pub(super) fn outputs(&self, point: &Point) -> [f64; 4] {
        let mut found = [([0.0; 4], [[0.0; COUNT]; 4])];
        self.surrogate.jacobians_into(std::slice::from_ref(point), &mut found);
        found[0].0
    }

    /// Shapes which are searched by their sharpness.
    fn by_sharpness(&self) -> impl Iterator<Item = usize> + use<> {
        let (sharp, bounds) = (self.surrogate.is_sharp(), self.bounds);
        SHAPES.into_iter().filter(move |i| sharp && !bounds.is_held(*i) && bounds.lower[*i] >= 0.0)
    }

    /// Sharpness at both bounds of a shape.
    fn sharpness(&self, i: usize) -> (f64, f64) {
        (of_shape(i, self.bounds.lower[i]), of_shape(i, self.bounds.upper[i]))
    }

    /// Where a point is linearised, and the derivatives of the parameters by its coordinates.
    fn placed(&self, unit: &Point) -> (Point, Point) {
        let mut x = self.table(unit);
        let mut stretch: Point = std::array::from_fn(|i| self.bounds.upper[i] - self.bounds.lower[i]);
        for i in self.by_sharpness() {
            let (low, high) = self.sharpness(i);
            x[i] = x[i].max(LEAST_SHAPE);
            stretch[i] = (high - low) / slope_at(i, x[i]);
        }
        (x, stretch)
    }

    /// Multipliers of bounds in unit coordinates as those of bounds which are raised by widths of the box.
    pub(super) fn per_width(&self, unit: &Point, multipliers: &Point) -> Point {
        let (_, stretch) = self.placed(unit);
        std::array::from_fn(|i| {
            let width = self.bounds.upper[i] - self.bounds.lower[i];
            if stretch[i] == width { multipliers[i] } else { multipliers[i] * width / stretch[i] }
        })
    }

    fn linear(&self, (y, slopes): &Jacobian, contacts: &[Contact], stretch: &Point) -> Linear {
        let unit = |slope: &Point| std::array::from_fn(|i| slope[i] * stretch[i]);
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
