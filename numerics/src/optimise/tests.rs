//! Both searches on problems with known answers.

use super::*;
use crate::math;
use crate::parameters::{Bounds, COUNT, Point};
use std::f64::consts::TAU;
use std::ops::ControlFlow;

fn go(_: &Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn wide(_: &[Point], out: &mut [f64]) {
    out.fill(1.0);
}

/// Holds all but the first `n` parameters at their lower bounds.
fn first(n: usize) -> Bounds {
    let mut bounds = Bounds::default();
    bounds.upper[n..].copy_from_slice(&bounds.lower[n..]);
    bounds
}

fn ga(population: usize, generations: usize) -> GaSettings {
    GaSettings { population, generations, ..Default::default() }
}

fn problem<'a>(bounds: Bounds, predict: &'a Predict<'a>) -> Problem<'a> {
    Problem { predict, clearance: &wide, margin_m: 0.0, bounds, penalty_r: 2.0, penalty_s: 5.0 }
}

/// A batch function of power alone, in unit coordinates: lift 1, trimmed.
fn power(bounds: Bounds, f: impl Fn(&Point) -> f64 + Sync) -> impl Fn(&[Point], &mut [[f64; 4]]) + Sync {
    move |xs, out| {
        for (x, out) in xs.iter().zip(out) {
            *out = [1.0, 0.0, 0.0, f(&bounds.to_unit(x))];
        }
    }
}

fn sphere(u: &Point) -> f64 {
    u.iter().enumerate().map(|(i, u)| (u - 0.07 * (i + 1) as f64).powi(2)).sum()
}

#[test]
fn a_shifted_sphere_in_ten_dimensions() {
    let bounds = Bounds::default();
    let predict = power(bounds, sphere);
    let problem = problem(bounds, &predict);
    let found = optimise(&problem, &ga(2000, 100), &Default::default(), &mut go).unwrap();
    assert!(found.score.fitness < 1e-12, "{found:?}");
    assert!(found.score.fitness <= found.simplex_start_fitness);
    let unit = bounds.to_unit(&found.point);
    assert!(unit.iter().enumerate().all(|(i, u)| (u - 0.07 * (i + 1) as f64).abs() < 1e-6));
    assert_eq!(found.generations, found.history.len());
    assert!(found.history.windows(2).all(|w| w[1].best <= w[0].best));
    assert_eq!(found.simplex_stop, Some(SimplexStop::Converged));
}

#[test]
fn rastrigin_in_five_dimensions_with_five_held() {
    let bounds = first(5);
    let predict = power(bounds, |u| {
        let term = |u: f64| {
            let x = 10.24 * (u - 0.55);
            x * x + 10.0 * (1.0 - math::cos(TAU * x))
        };
        u[..5].iter().map(|u| term(*u)).sum()
    });
    let problem = problem(bounds, &predict);
    let found = optimise(&problem, &ga(8000, 120), &Default::default(), &mut go).unwrap();
    assert!(found.score.fitness < 1e-8, "{found:?}");
    assert_eq!(found.point[5..], bounds.lower[5..]);
}

/// Least a + 2 b with lift a b = 1/4 (so that L+ = 4 a b) has a = 2 b = 1/sqrt 2;
/// the multiplier of the lift is 1/sqrt 2, below r = 2, so the penalty is exact.
#[test]
fn penalties_reach_the_constraints() {
    let bounds = first(4);
    let predict = |xs: &[Point], out: &mut [[f64; 4]]| {
        for (x, out) in xs.iter().zip(out) {
            let u = bounds.to_unit(x);
            *out = [4.0 * u[0] * u[1], u[2] - 0.3, u[3] - u[2], u[0] + 2.0 * u[1]];
        }
    };
    let problem = problem(bounds, &predict);
    let found = optimise(&problem, &ga(5000, 100), &Default::default(), &mut go).unwrap();
    let [lift, drag, moment, p] = found.score.outputs;
    assert!((lift - 1.0).abs() < 1e-4 && drag.abs() < 1e-4 && moment.abs() < 1e-4, "{found:?}");
    assert!((p - 2f64.sqrt()).abs() < 1e-4, "{found:?}");
    let unit = bounds.to_unit(&found.point);
    assert!((unit[0] - 0.5f64.sqrt()).abs() < 0.02, "{unit:?}");
}

#[test]
fn clearance_and_box_hold_at_the_optimum() {
    let bounds = first(3);
    // Power falls with every parameter: u0 ends at the clearance, the rest at the box.
    let predict = power(bounds, |u| 3.0 - u[0] - u[1] - u[2]);
    let clearance = |xs: &[Point], out: &mut [f64]| {
        for (x, out) in xs.iter().zip(out) {
            *out = 0.01 * (1.0 - bounds.to_unit(x)[0]);
        }
    };
    let problem = Problem { clearance: &clearance, margin_m: 0.004, ..problem(bounds, &predict) };
    let found = optimise(&problem, &ga(2000, 80), &Default::default(), &mut go).unwrap();
    let unit = bounds.to_unit(&found.point);
    assert!((unit[0] - 0.6).abs() < 1e-4, "{found:?}");
    assert!((unit[1] - 1.0).abs() < 1e-4 && (unit[2] - 1.0).abs() < 1e-4, "{found:?}");
    for i in 0..COUNT {
        assert!((bounds.lower[i]..=bounds.upper[i]).contains(&found.point[i]));
    }
    assert_eq!(problem.score(&[found.point])[0], found.score);
}

#[test]
fn the_fitness_is_the_formula() {
    let bounds = first(2);
    let predict = |xs: &[Point], out: &mut [[f64; 4]]| {
        for (x, out) in xs.iter().zip(out) {
            // What the surrogate sees lies inside the box.
            assert!(x[0] <= bounds.upper[0] && x[1] >= bounds.lower[1]);
            *out = [0.9, -0.02, 0.03, 0.5];
        }
    };
    let clearance = |_: &[Point], out: &mut [f64]| out.fill(0.0005);
    let problem = Problem { clearance: &clearance, margin_m: 0.001, ..problem(bounds, &predict) };
    let mut x = bounds.lower;
    // A tenth of the width above in one parameter, a fifth below in the other;
    // a held parameter off its value costs nothing.
    x[0] = 42.5;
    x[1] = -10.0;
    x[7] = 99.0;
    let score = problem.score(&[x])[0];
    assert!((score.penalty - (2.0 * 0.15 + 5.0 * (0.1 + 0.2) + 5.0 * 0.5)).abs() < 1e-12);
    assert!((score.fitness - score.penalty - 0.5).abs() < 1e-12);
    let nan = |_: &[Point], out: &mut [f64]| out.fill(f64::NAN);
    assert!(Problem { clearance: &nan, ..problem }.score(&[x])[0].fitness.is_nan());
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let bounds = Bounds::default();
    let predict = power(bounds, sphere);
    let problem = problem(bounds, &predict);
    let run = |threads, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let settings = GaSettings { seed, ..ga(3000, 12) };
        pool.install(|| optimise(&problem, &settings, &Default::default(), &mut go)).unwrap()
    };
    assert_eq!(run(1, 5), run(4, 5));
    assert_ne!(run(1, 5).history, run(1, 6).history);
}

#[test]
fn asking_and_telling_equals_the_driver() {
    let bounds = first(6);
    let predict = power(bounds, sphere);
    let problem = problem(bounds, &predict);
    let (settings, simplex) = (ga(400, 30), SimplexSettings::default());
    let driven = optimise(&problem, &settings, &simplex, &mut go).unwrap();
    let score = |xs: &[Point]| -> Vec<f64> { xs.iter().map(|x| problem.score(&[*x])[0].fitness).collect() };
    let mut search = Ga::new(bounds, settings).unwrap();
    assert_eq!(search.ask().len(), 400);
    let mut evaluations = 0;
    while search.finished().is_none() {
        let told = score(search.ask());
        evaluations += told.len();
        search.tell(&told).unwrap();
    }
    // The twenty elite are asked for once only.
    assert_eq!(evaluations, 400 + 29 * 380);
    assert_eq!(search.history(), driven.history);
    assert_eq!(search.finished(), Some(GaStop::Generations));
    let start = clamped(&bounds, &search.best().unwrap().0);
    let mut descent = NelderMead::new(bounds, simplex, &start).unwrap();
    while descent.finished().is_none() {
        descent.tell(&score(descent.ask())).unwrap();
    }
    assert_eq!(clamped(&bounds, &descent.best().unwrap().0), driven.point);
    assert_eq!(descent.evaluations(), driven.simplex_evaluations);
    assert_eq!(evaluations + descent.evaluations(), driven.evaluations);
}

#[test]
fn a_restored_search_goes_on_to_the_same_bits() {
    let bounds = first(6);
    let settings = GaSettings { seed: 7, ..ga(60, 20) };
    // A third of the points cannot be flown.
    let fitness = |x: &Point| {
        let u = bounds.to_unit(x);
        if u[0] > 0.66 { f64::NAN } else { sphere(&u) }
    };
    let told = |search: &Ga| search.ask().iter().map(fitness).collect::<Vec<_>>();
    let mut whole = Ga::new(bounds, settings).unwrap();
    let mut broken = Ga::new(bounds, settings).unwrap();
    let mut asked = 0;
    while whole.finished().is_none() {
        asked += whole.ask().len();
        whole.tell(&told(&whole)).unwrap();
        // Stored and taken up before every generation, the first one too.
        broken = Ga::restore(bounds, settings, broken.snapshot()).unwrap();
        broken.tell(&told(&broken)).unwrap();
        assert_eq!((broken.ask(), broken.history(), broken.best()), (whole.ask(), whole.history(), whole.best()));
    }
    assert_eq!((broken.finished(), asked), (Some(GaStop::Generations), settings.most_asked()));
}

#[test]
fn a_snapshot_of_another_search_is_refused() {
    let (bounds, settings) = (first(6), ga(60, 20));
    let mut search = Ga::new(bounds, settings).unwrap();
    let told: Vec<f64> = search.ask().iter().map(|x| x[0]).collect();
    search.tell(&told).unwrap();
    let snapshot = search.snapshot();
    assert_eq!((snapshot.units.len(), snapshot.elite.len()), (60, 3));
    let refused =
        |settings, snapshot| matches!(Ga::restore(bounds, settings, snapshot), Err(OptimiseError::Snapshot(_)));
    assert!(refused(ga(50, 20), snapshot.clone()) && refused(ga(60, 1), snapshot.clone()));
    assert!(refused(settings, GaSnapshot { elite: Vec::new(), ..snapshot.clone() }));
    assert!(refused(settings, GaSnapshot::default()));
    let mut wild = snapshot;
    wild.units[3][2] = f64::NAN;
    assert!(refused(settings, wild));
}

#[test]
fn it_stalls_and_can_be_interrupted() {
    let bounds = first(2);
    let flat = power(bounds, |_| 1.0);
    let problem = problem(bounds, &flat);
    let settings = GaSettings { stall_generations: 5, ..ga(50, 100) };
    let found = optimise(&problem, &settings, &Default::default(), &mut go).unwrap();
    assert_eq!((found.ga_stop, found.generations), (GaStop::Stalled, 6));
    let mut stop = |p: &Progress| {
        if p.generation == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let found = optimise(&problem, &settings, &Default::default(), &mut stop).unwrap();
    assert_eq!((found.ga_stop, found.generations), (GaStop::Interrupted, 3));
    assert_eq!((found.simplex_evaluations, found.simplex_stop), (0, None));
}

#[test]
fn nonsense_is_refused_without_a_panic() {
    let bounds = first(3);
    let refused = |settings| Ga::new(bounds, settings).is_err();
    assert!(refused(ga(1, 10)) && refused(ga(10, 0)));
    assert!(refused(GaSettings { elite_share: f64::NAN, ..ga(10, 10) }));
    let held = Bounds { lower: bounds.lower, upper: bounds.lower };
    assert_eq!(Ga::new(held, ga(10, 10)).err(), Some(OptimiseError::NothingFree));
    let mut search = Ga::new(bounds, ga(10, 10)).unwrap();
    assert_eq!(search.tell(&[1.0]), Err(OptimiseError::Told { asked: 10, told: 1 }));
    let nan = power(bounds, |_| f64::NAN);
    let result = optimise(&problem(bounds, &nan), &ga(20, 5), &Default::default(), &mut go);
    assert_eq!(result, Err(OptimiseError::NothingFinite));
    assert!(NelderMead::new(bounds, Default::default(), &[f64::NAN; COUNT]).is_err());
    // All elite but one, and nobody crossed, still runs.
    let odd = GaSettings { elite_share: 1.0, crossover_share: 0.0, ..ga(20, 5) };
    let predict = power(bounds, sphere);
    assert!(optimise(&problem(bounds, &predict), &odd, &Default::default(), &mut go).is_ok());
}
