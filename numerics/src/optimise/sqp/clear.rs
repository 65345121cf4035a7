//! The last step of a search to the clearance it must keep.

use super::quadratic::{Constraint, MOST, Quadratic, minimise};
use crate::kinematics::Clearance;
use crate::optimise::clamped;
use crate::parameters::{Bounds, COUNT, Point};

/// Lack of clearance which is made up for, m: clearances are no more exact than that.
const MOST_LACK: f64 = 1e-4;
/// What the first step aims beyond the margin, m, and by how much more each further one does.
const SPARE: (f64, f64) = (1e-12, 8.0);
/// Steps at most.
const STEPS: usize = 12;
/// Contacts farther than this beyond the margin do not hinder a step, m.
const NEAR_M: f64 = 2e-3;

/// The stroke nearest to one which lacks a little clearance that lacks none; the stroke itself where it lacks none, or
/// more than a tenth of a millimetre.
///
/// Constraints are kept to the tolerance of a search, and a flight is refused as soon as the wings cross at all: of the
/// strokes which rest on the limit every second one could not be flown. By `clearance`, which decides on that too, this
/// one can.
pub fn cleared(clearance: &Clearance, bounds: &Bounds, x: &Point, margin_m: f64) -> Point {
    let lacks = |x: &Point| margin_m - clearance.of(x);
    let lack = lacks(x);
    // NaN is no lack which a step makes up for.
    if lack.is_nan() || lack <= 0.0 || lack > MOST_LACK {
        return *x;
    }
    let (mut at, mut spare) = (*x, SPARE.0);
    for _ in 0..STEPS {
        let Some(next) = step(clearance, bounds, &at, margin_m + spare) else { break };
        if lacks(&next) <= 0.0 {
            return next;
        }
        (at, spare) = (next, spare * SPARE.1);
    }
    *x
}

/// The shortest step, in widths of the box, after which all contacts near by are `target` away to first order.
fn step(clearance: &Clearance, bounds: &Bounds, x: &Point, target: f64) -> Option<Point> {
    let free: Vec<usize> = (0..COUNT).filter(|&i| !bounds.is_held(i)).collect();
    let width = |i: usize| bounds.upper[i] - bounds.lower[i];
    let row = |of: &dyn Fn(usize) -> f64| {
        let mut row = [0.0; MOST];
        free.iter().enumerate().for_each(|(a, &i)| row[a] = of(i));
        row
    };
    let mut contacts = Vec::new();
    clearance.contacts(x, target + NEAR_M, &mut contacts);
    let mut constraints: Vec<Constraint> = contacts
        .iter()
        .map(|c| (row(&|i| c.slope[i] * width(i)), target - c.distance_m))
        .map(|(normal, bound)| Constraint { normal, bound, equality: false })
        .collect();
    for &i in &free {
        let unit = row(&|j| if i == j { 1.0 } else { 0.0 });
        let bound = (bounds.lower[i] - x[i]) / width(i);
        constraints.push(Constraint { normal: unit, bound, equality: false });
        let bound = (x[i] - bounds.upper[i]) / width(i);
        constraints.push(Constraint { normal: unit.map(|v| -v), bound, equality: false });
    }
    let hessian = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }));
    let problem = Quadratic { n: free.len(), hessian: &hessian, gradient: [0.0; MOST], constraints: &constraints };
    let found = minimise(&problem)?;
    let mut next = *x;
    free.iter().enumerate().for_each(|(a, &i)| next[i] += found.step[a] * width(i));
    Some(clamped(bounds, &next))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::insect::Insect;
    use crate::kinematics::ElevationPhase;
    use crate::parameters::at;

    /// Points of the box whose clearance lacks so much of a margin.
    fn lacking(clearance: &Clearance, lack: f64) -> Vec<(Point, f64)> {
        let bounds = Bounds::default();
        let drawn = (0..60).filter_map(|i| crate::sampling::sample(&bounds, 9, i, &|_| true));
        drawn.map(|x| (x, clearance.of(&x) + lack)).collect()
    }

    #[test]
    fn a_stroke_which_lacks_rounding_is_made_clear_and_hardly_moves() {
        let clearance = Clearance::new(&Insect::default(), ElevationPhase::Plus);
        let bounds = Bounds::default();
        for lack in [1e-17, 1e-14, 1e-12, 1e-9, 1e-6, 9e-5] {
            for (x, margin) in lacking(&clearance, lack) {
                let found = cleared(&clearance, &bounds, &x, margin);
                assert!(clearance.of(&found) >= margin, "{lack}: {} {margin}", clearance.of(&found));
                assert_eq!(clamped(&bounds, &found), found);
                let (a, b) = (bounds.to_unit(&x), bounds.to_unit(&found));
                let moved = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(moved < 1e4 * lack + 1e-8, "{lack}: {moved}");
            }
        }
    }

    #[test]
    fn what_is_clear_or_lacks_much_is_left_alone() {
        let clearance = Clearance::new(&Insect::default(), ElevationPhase::Plus);
        let bounds = Bounds::default();
        for lack in [-1e-3, -1e-15, 2e-4, f64::NAN] {
            for (x, margin) in lacking(&clearance, lack) {
                assert_eq!(cleared(&clearance, &bounds, &x, margin), x);
            }
        }
        // Where nothing that is free moves the wings there is nothing to be done.
        let (x, margin) = lacking(&clearance, 1e-9)[0];
        let mut held = Bounds { lower: x, upper: x };
        held.upper[at::FREQUENCY] += 5.0;
        assert_eq!(cleared(&clearance, &held, &x, margin), x);
    }
}
