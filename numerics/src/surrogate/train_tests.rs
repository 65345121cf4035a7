//! Training as a whole.

use super::network::tests::random_points;
use super::*;
use crate::math;
use crate::parameters::Bounds;
use std::ops::ControlFlow;

/// A smooth function of ten variables on the box.
fn smooth(bounds: &Bounds, x: &Point) -> [f64; 4] {
    let u = bounds.to_unit(x);
    [
        1.0 + 0.5 * u[0] * u[5] + 0.2 * math::sin(2.0 * u[2]),
        0.3 * u[1] - 0.2 * u[2] * u[3] + 0.1 * math::cos(3.0 * u[9]),
        0.2 * math::sin(u[4] + 2.0 * u[6]) - 0.1 * u[8],
        0.4 + u[0] * u[0] * u[5] + 0.1 * u[7],
    ]
}

fn samples(n: usize) -> (Bounds, Vec<Sample>) {
    let bounds = Bounds::default();
    let xs = random_points(n, &bounds, 21);
    (bounds, xs.into_iter().map(|x| Sample { x, y: smooth(&bounds, &x) }).collect())
}

fn go(_: &Epoch) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

#[test]
fn a_smooth_function_is_learnt() {
    let (bounds, samples) = samples(900);
    let settings = TrainSettings { neurons: 20, max_iterations: 60, ..Default::default() };
    let mut seen = Vec::new();
    let result = train(&samples, &bounds, &settings, &mut |epoch| {
        seen.push(*epoch);
        ControlFlow::Continue(())
    });
    let training = result.unwrap();
    assert_eq!(seen, training.curve);
    assert_eq!((training.train.count, training.test.count), (720, 90));
    for k in 0..4 {
        assert!(training.test.rmse[k] < 3e-3, "{:?}", training.test);
        assert!(training.test.correlation[k] > 0.999, "{:?}", training.test);
    }
    let best = training.curve[training.best_iteration];
    let least = training.curve.iter().map(|e| e.validation_mse).fold(f64::INFINITY, f64::min);
    assert_eq!(best.validation_mse, least);
}

#[test]
fn the_best_validation_weights_are_kept() {
    let (bounds, mut samples) = samples(120);
    // Noise makes forty neurons overfit ninety-six samples at once.
    for (i, s) in samples.iter_mut().enumerate() {
        s.y[i % 4] += if i % 3 == 0 { 0.2 } else { -0.1 };
    }
    let settings = TrainSettings { neurons: 40, patience: 4, ..Default::default() };
    let training = train(&samples, &bounds, &settings, &mut go).unwrap();
    assert_eq!(training.stopped, Stop::Validation);
    let (best, last) = (training.best_iteration, training.curve.len() - 1);
    assert_eq!(last, best + 4);
    let rmse = training.validation.rmse;
    let mse = rmse.iter().map(|r| r * r).sum::<f64>() / 4.0;
    assert!((mse / training.curve[best].validation_mse - 1.0).abs() < 1e-9);
    assert!(training.curve[last].validation_mse > training.curve[best].validation_mse);
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let (bounds, samples) = samples(1400);
    let settings = TrainSettings { neurons: 30, max_iterations: 4, ..Default::default() };
    let results = [1, 4].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| train(&samples, &bounds, &settings, &mut go)).unwrap()
    });
    assert_eq!(results[0], results[1]);
    let other = TrainSettings { seed: 1, ..settings };
    assert_ne!(results[0].network, train(&samples, &bounds, &other, &mut go).unwrap().network);
}

#[test]
fn the_observer_can_stop() {
    let (bounds, samples) = samples(200);
    let settings = TrainSettings { neurons: 5, ..Default::default() };
    let training = train(&samples, &bounds, &settings, &mut |epoch| {
        if epoch.iteration == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    let training = training.unwrap();
    assert_eq!((training.stopped, training.curve.len()), (Stop::Interrupted, 3));
}

#[test]
fn what_cannot_be_trained_is_refused() {
    let (bounds, good) = samples(40);
    let settings = TrainSettings { neurons: 3, max_iterations: 2, ..Default::default() };
    let run = |samples: &[Sample], bounds: &Bounds, settings: &TrainSettings| {
        train(samples, bounds, settings, &mut go).map(|_| ())
    };
    assert!(run(&good, &bounds, &settings).is_ok());
    for few in [0, 1, 5, 9] {
        let error = run(&good[..few], &bounds, &settings);
        assert!(matches!(error, Err(TrainError::TooFewSamples { .. })), "{few}: {error:?}");
    }
    let mut bad = good.clone();
    bad[7].x[3] = f64::NAN;
    assert_eq!(run(&bad, &bounds, &settings), Err(TrainError::NotFinite { index: 7 }));
    bad = good.clone();
    bad[8].y[0] = f64::INFINITY;
    assert_eq!(run(&bad, &bounds, &settings), Err(TrainError::NotFinite { index: 8 }));
    bad = good.clone();
    bad.iter_mut().for_each(|s| s.y[2] = 0.5);
    let constant = TrainError::ConstantOutput { output: "pitch_moment" };
    assert_eq!(run(&bad, &bounds, &settings), Err(constant));
    let shares = TrainSettings { train_share: 0.9, ..settings.clone() };
    assert!(matches!(run(&good, &bounds, &shares), Err(TrainError::Shares { .. })));
    let none = TrainSettings { neurons: 0, ..settings.clone() };
    assert!(matches!(run(&good, &bounds, &none), Err(TrainError::Neurons { .. })));
    let held = Bounds { lower: bounds.lower, upper: bounds.lower };
    assert_eq!(run(&good, &held, &settings), Err(TrainError::NothingFree));
}
