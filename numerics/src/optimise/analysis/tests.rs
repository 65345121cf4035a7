//! Analyses of problems whose answers are known.

use super::*;
use crate::math;
use crate::optimise::sqp::{Flight, SqpSettings, minimise};
use crate::optimise::{GaSettings, Problem, SimplexSettings};
use crate::parameters::{Bounds, Point, at};
use crate::surrogate::random_network;
use std::f64::consts::PI;
use std::ops::ControlFlow;

fn wide(_: &[Point], out: &mut [f64]) {
    out.fill(1.0);
}

/// Ishigami & Homma 1990: sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1 on [-pi, pi]^3, whose
/// indices are known in closed form (Saltelli et al. 2008, Global Sensitivity Analysis, 4.4).
#[test]
fn ishigamis_indices_are_the_published_ones() {
    let mut bounds = Bounds::default();
    bounds.upper[3..].copy_from_slice(&bounds.lower[3..]);
    let predict = |xs: &[Point], out: &mut [[f64; 4]]| {
        for (x, out) in xs.iter().zip(out) {
            let u = bounds.to_unit(x).map(|u| PI * (2.0 * u - 1.0));
            let value = math::sin(u[0]) * (1.0 + 0.1 * u[2].powi(4)) + 7.0 * math::sin(u[1]).powi(2);
            // An output far from 0, one of a single parameter, and a constant one.
            *out = [value, value + 100.0, u[2], 3.0];
        }
    };
    let found = indices(&predict, &bounds, 1 << 14, 4).unwrap();
    let (first, total) = ([0.3139, 0.4424, 0.0], [0.5576, 0.4424, 0.2437]);
    for k in 0..2 {
        assert!((found.variance[k] / 13.8446 - 1.0).abs() < 2e-3, "{found:?}");
        for i in 0..3 {
            assert!((found.first[k][i] - first[i]).abs() < 5e-3, "{found:?}");
            assert!((found.total[k][i] - total[i]).abs() < 5e-3, "{found:?}");
        }
    }
    assert!((found.first[2][2] - 1.0).abs() < 5e-3 && found.total[2][0] == 0.0);
    assert_eq!((found.variance[3], found.total[3], found.total[0][3]), (0.0, [0.0; 10], 0.0));
}

/// Least a + 2 b with lift 4 a b = 1 is sqrt 2; below its multiplier 1/sqrt 2 the penalty is
/// not exact, and the search gives lift away.
#[test]
fn sweeps_show_where_the_penalty_is_exact() {
    let mut bounds = Bounds::default();
    bounds.upper[2..].copy_from_slice(&bounds.lower[2..]);
    let predict = |xs: &[Point], out: &mut [[f64; 4]]| {
        for (x, out) in xs.iter().zip(out) {
            let u = bounds.to_unit(x);
            *out = [4.0 * u[0] * u[1], 0.0, 0.0, u[0] + 2.0 * u[1]];
        }
    };
    let problem =
        Problem { predict: &predict, clearance: &wide, margin_m: 0.0, bounds, penalty_r: 2.0, penalty_s: 5.0 };
    let ga = GaSettings { population: 500, generations: 60, ..Default::default() };
    let simplex = SimplexSettings::default();
    let sweep = |which, weights: &[f64]| penalty_sweep(&problem, &ga, &simplex, (which, weights), 2f64.sqrt());
    let rows = sweep(Weight::Trim, &[0.3, 2.0, 20.0]).unwrap();
    assert!(rows[0].excess < -0.1 && rows[0].penalty > 0.1, "{rows:?}");
    for row in &rows[1..] {
        assert!(row.excess > -1e-9 && row.excess < 0.01, "{rows:?}");
        assert!((row.fitness - 2f64.sqrt() - row.excess).abs() < 1e-12);
    }
    let rows = sweep(Weight::Bounds, &[1.0, 50.0]).unwrap();
    assert!(rows.iter().all(|row| row.excess.abs() < 0.01) && rows[1].weight == 50.0);
    let rows = population_sweep(&problem, &ga, &simplex, &[20, 500], &[0, 1, 2]).unwrap();
    assert_eq!(rows.iter().map(|r| (r.population, r.fitnesses.len())).collect::<Vec<_>>(), [(20, 3), (500, 3)]);
    assert_eq!(rows[1].fitnesses[0], sweep(Weight::Trim, &[2.0]).unwrap()[0].fitness);
    assert!(rows[1].fitnesses.iter().all(|f| f - 2f64.sqrt() < 0.01));
}

/// A front rises as its bound tightens and ends at the optimum without it; holding a
/// parameter at its optimum changes nothing.
#[test]
fn fronts_and_held_parameters_agree_with_the_optimum() {
    let net = random_network(14, 3);
    let flight = Flight { surrogate: &net, clearance: None, margin_m: 0.0, bounds: net.bounds };
    let settings = SqpSettings { starts: 96, ..Default::default() };
    let best = minimise(&flight, &settings, &mut |_| ControlFlow::Continue(())).unwrap().best().clone();
    let i = at::ROTATION_AMPLITUDE;
    let (here, lower) = (best.point[i], net.bounds.lower[i]);
    let upper = net.bounds.upper[i];
    let (side, limits) = if here - lower > upper - here {
        (Side::Upper, [upper, here - 0.05 * (here - lower), here - 0.2 * (here - lower)])
    } else {
        (Side::Lower, [lower, here + 0.05 * (upper - here), here + 0.2 * (upper - here)])
    };
    let points = front(&flight, &settings, (i, side), &limits).unwrap();
    let powers: Vec<f64> = points.iter().map(|p| p.optimum.as_ref().unwrap().outputs[3]).collect();
    assert!((powers[0] - best.outputs[3]).abs() < 1e-8, "{powers:?}");
    assert!(powers[0] < powers[1] && powers[1] < powers[2], "{powers:?}");
    let (free, whole) = whole_front(&flight, &settings, i, &limits[1..], &|| true).unwrap().unwrap();
    assert_eq!(whole_front(&flight, &settings, i, &limits[1..], &|| false), Ok(None));
    assert_eq!(even_limits((1.0, 2.0), 3), [1.0, 1.5, 2.0]);
    assert_eq!(free, best);
    for ((found, limit), power) in whole.iter().zip(&limits[1..]).zip(&powers[1..]) {
        assert_eq!((found.0, found.1.limit), (side, *limit));
        assert_eq!(found.1.optimum.as_ref().unwrap().outputs[3], *power);
    }
    let same = held(&flight, &settings, &[(i, here)]).unwrap().unwrap();
    assert!((same.outputs[3] - best.outputs[3]).abs() < 1e-8 && same.point[i] == here);
    let elsewhere = held(&flight, &settings, &[(i, limits[2])]).unwrap().unwrap();
    assert!(elsewhere.outputs[3] >= powers[2] - 1e-8);
    assert!(held(&flight, &settings, &[(i, upper + 1.0)]).is_err());
    assert!(front(&flight, &settings, (99, Side::Lower), &[0.0]).is_err());
}
