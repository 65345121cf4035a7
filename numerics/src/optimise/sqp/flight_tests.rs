//! Flights with known optima, and the search as a whole.

use super::*;
use crate::insect::Insect;
use crate::kinematics::{Clearance, ElevationPhase};
use crate::optimise::OptimiseError;
use crate::parameters::{Bounds, COUNT, Point, at};
use crate::surrogate::random_network;
use crate::surrogate::{Features, Frame, Jacobian, Network, Surrogate};
use std::ops::ControlFlow;

fn go(_: &SqpProgress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// In unit coordinates: L+ = 4 a b, D+ = c - 0.3, M+ = d - c, P+ = a + 2 b + slope e.
struct Known {
    bounds: Bounds,
    slope: f64,
}

impl Differentiable for Known {
    fn jacobians_into(&self, xs: &[Point], out: &mut [Jacobian]) {
        for (x, (y, slopes)) in xs.iter().zip(out) {
            let u = self.bounds.to_unit(x);
            *y = [4.0 * u[0] * u[1], u[2] - 0.3, u[3] - u[2], u[0] + 2.0 * u[1] + self.slope * u[4]];
            *slopes = [[0.0; COUNT]; 4];
            (slopes[0][0], slopes[0][1]) = (4.0 * u[1], 4.0 * u[0]);
            (slopes[1][2], slopes[2][2], slopes[2][3]) = (1.0, -1.0, 1.0);
            (slopes[3][0], slopes[3][1], slopes[3][4]) = (1.0, 2.0, self.slope);
            for row in slopes {
                for (i, slope) in row.iter_mut().enumerate() {
                    let span = self.bounds.upper[i] - self.bounds.lower[i];
                    *slope = if span > 0.0 { *slope / span } else { 0.0 };
                }
            }
        }
    }
}

fn settings(starts: usize) -> SqpSettings {
    SqpSettings { starts, ..Default::default() }
}

/// Least a + 2 b with 4 a b = L is sqrt(2 L): at L = 1 the price of lift is 1/sqrt 2.
/// D+ and M+ cost nothing, and e lies at the bound which its slope asks for.
#[test]
fn prices_are_the_derivatives_of_the_optimum() {
    let mut bounds = Bounds::default();
    bounds.upper[5..].copy_from_slice(&bounds.lower[5..]);
    let known = Known { bounds, slope: -0.25 };
    let flight = Flight { surrogate: &known, clearance: None, margin_m: 0.0, bounds };
    let found = minimise(&flight, &settings(40), &mut go).unwrap();
    let best = found.best();
    assert!((best.outputs[3] - (2f64.sqrt() - 0.25)).abs() < 1e-9, "{best:?}");
    let prices = [0.5f64.sqrt(), 0.0, 0.0];
    assert!(best.multipliers.iter().zip(prices).all(|(a, b)| (a - b).abs() < 1e-8), "{best:?}");
    assert!((best.bound_multipliers[4] + 0.25).abs() < 1e-8);
    assert_eq!((best.point[4], best.point[5]), (bounds.upper[4], bounds.lower[5]));
    assert!(best.residual <= 1e-10 && best.violation <= 1e-10 && best.clearance_m.is_infinite());
    assert_eq!((found.optima.len(), found.converged, best.hits, found.starts), (1, 40, 40, 40));
}

/// The wings' room at work: its price per mm is the derivative of the power by the margin.
#[test]
fn the_clearance_is_kept_and_has_its_price() {
    let bounds = Bounds::default();
    let net = random_network(12, 31);
    let wing = Clearance::new(&Insect::default(), ElevationPhase::Plus);
    let power = Power(net);
    let at = |margin_m: f64| {
        let flight = Flight { surrogate: &power, clearance: Some(&wing), margin_m, bounds };
        let found = minimise(&flight, &settings(64), &mut go).unwrap();
        found.best().clone()
    };
    let free = at(-1.0);
    let margin = free.clearance_m + 2e-3;
    let (low, mid, high) = (at(margin - 1e-5), at(margin), at(margin + 1e-5));
    assert!((mid.clearance_m - margin).abs() < 1e-11 && mid.outputs[3] > free.outputs[3]);
    let price = (high.outputs[3] - low.outputs[3]) / 0.02;
    let error = (mid.clearance_multiplier_per_mm / price - 1.0).abs();
    assert!(error < 1e-3, "{} against {price}", mid.clearance_multiplier_per_mm);
}

/// Only the power of a network; trimmed everywhere.
struct Power(Network);

impl Differentiable for Power {
    fn jacobians_into(&self, xs: &[Point], out: &mut [Jacobian]) {
        Differentiable::jacobians_into(&self.0, xs, out);
        for (y, slopes) in out {
            (y[0], y[1], y[2]) = (1.0, 0.0, 0.0);
            slopes[..3].fill([0.0; COUNT]);
        }
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let net = random_network(20, 7);
    let wing = Clearance::new(&Insect::default(), ElevationPhase::Plus);
    let flight = Flight { surrogate: &net, clearance: Some(&wing), margin_m: 0.0, bounds: net.bounds };
    let run = |threads, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let settings = SqpSettings { seed, ..settings(100) };
        pool.install(|| minimise(&flight, &settings, &mut go)).unwrap()
    };
    assert_eq!(run(1, 5), run(3, 5));
    assert_ne!(run(1, 5).evaluations, run(1, 6).evaluations);
}

#[test]
fn it_can_be_interrupted_and_refuses_nonsense() {
    let bounds = Bounds::default();
    let known = Known { bounds, slope: 0.0 };
    let flight = Flight { surrogate: &known, clearance: None, margin_m: 0.0, bounds };
    let mut stop = |p: &SqpProgress| if p.ended >= 256 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let found = minimise(&flight, &settings(600), &mut stop).unwrap();
    assert_eq!((found.starts, found.interrupted), (256, true));
    assert!(minimise(&flight, &settings(0), &mut go).is_err());
    let loose = SqpSettings { tolerance: f64::NAN, ..settings(1) };
    assert!(minimise(&flight, &loose, &mut go).is_err());
    // No lift anywhere.
    let mut still = bounds;
    still.upper[0] = bounds.lower[0];
    let held = Known { bounds: still, slope: 0.0 };
    let flight = Flight { surrogate: &held, clearance: None, margin_m: 0.0, bounds: still };
    assert_eq!(minimise(&flight, &settings(9), &mut go), Err(OptimiseError::NothingConverged { starts: 9 }));
}

/// A surrogate of sharpness is searched in it: slopes are those by the coordinates, at a level shape too.
#[test]
fn a_surrogate_of_sharpness_is_searched_by_sharpness() {
    let bounds = Bounds::default();
    let frame = Frame::new(Features::Physical, &Insect::default(), &bounds);
    let network = Network { bounds: frame.bounds(&bounds), ..random_network(12, 5) };
    let surrogate = Surrogate::new(frame, vec![network]).unwrap();
    let flight = Flight { surrogate: &surrogate, clearance: None, margin_m: 0.0, bounds };
    let mut unit = [0.4; COUNT];
    (unit[at::SWEEP_SHAPE], unit[at::ROTATION_SHAPE]) = (0.0, 1.0);
    assert_eq!((flight.table(&unit)[at::SWEEP_SHAPE], flight.table(&unit)[at::ROTATION_SHAPE]), (0.0, 5.0));
    for k in [0.0, 0.3, 1.0] {
        unit[at::SWEEP_SHAPE] = k;
        let linear = flight.linearise(&[unit]).remove(0);
        let i = at::SWEEP_SHAPE;
        let moved = |by: f64| {
            let mut u = unit;
            u[i] = k + by;
            surrogate.predict(&flight.table(&u))[3]
        };
        let step = 1e-5;
        let slope = match k {
            0.0 => (moved(step) - moved(0.0)) / step,
            1.0 => (moved(0.0) - moved(-step)) / step,
            _ => (moved(step) - moved(-step)) / (2.0 * step),
        };
        assert!((linear.gradient[i] - slope).abs() < 1e-3 * (1.0 + slope.abs()), "{k}: {} {slope}", linear.gradient[i]);
        assert!(slope.abs() > 1e-4, "level at {k}: {slope}");
    }
    // What is told of an optimum is so at the optimum itself.
    let Ok(found) = minimise(&flight, &settings(60), &mut go) else { panic!("a network with strokes in trim") };
    for optimum in &found.optima {
        assert_eq!(optimum.outputs, surrogate.predict(&optimum.point), "{optimum:?}");
        assert!(optimum.violation < 1e-8, "{optimum:?}");
    }
    // A bound's price is told per width of the box: at a level shape it is nothing.
    unit[at::SWEEP_SHAPE] = 0.0;
    let prices = flight.per_width(&unit, &[1.0; COUNT]);
    assert!(prices[at::SWEEP_SHAPE] < 1e-4 && prices[at::FREQUENCY] == 1.0, "{prices:?}");
}
