//! Training as a whole.

use super::network::tests::random_points;
use super::*;
use crate::insect::Insect;
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
    (bounds, xs.into_iter().map(|x| Sample { x, y: smooth(&bounds, &x), se: [0.0; 4] }).collect())
}

/// A training on the ten parameters as they are.
fn run(
    samples: &[Sample],
    bounds: &Bounds,
    settings: &TrainSettings,
    observe: &mut dyn FnMut(&Checkpoint) -> ControlFlow<()>,
) -> Result<Training, TrainError> {
    let insect = Insect::default();
    let settings = TrainSettings { features: Features::Paper, ..settings.clone() };
    train(&Dataset { samples, bounds, insect: &insect }, &settings, None, observe)
}

fn go(_: &Checkpoint) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

#[test]
fn a_smooth_function_is_learnt_by_either_method() {
    let (bounds, samples) = samples(900);
    for method in [Method::LevenbergMarquardt, Method::VariableProjection] {
        let settings = TrainSettings { neurons: 20, max_iterations: 60, method, ..Default::default() };
        let mut seen = Vec::new();
        let result = run(&samples, &bounds, &settings, &mut |at| {
            seen.extend(at.curve.last().copied());
            ControlFlow::Continue(())
        });
        let training = result.unwrap();
        let member = &training.members[0];
        assert_eq!(seen, member.curve);
        assert_eq!((training.train.count, training.test.count), (720, 90));
        for k in 0..4 {
            assert!(training.test.rmse[k] < 3e-3, "{:?}", training.test);
            assert!(training.test.correlation[k] > 0.999, "{:?}", training.test);
        }
        let best = member.curve[member.best_iteration];
        let least = member.curve.iter().map(|e| e.validation_mse).fold(f64::INFINITY, f64::min);
        assert_eq!(best.validation_mse, least);
    }
}

#[test]
fn the_best_validation_weights_are_kept() {
    let (bounds, mut samples) = samples(120);
    // Noise makes forty neurons overfit ninety-six samples at once.
    for (i, s) in samples.iter_mut().enumerate() {
        s.y[i % 4] += if i % 3 == 0 { 0.2 } else { -0.1 };
    }
    let settings = TrainSettings { neurons: 40, patience: 4, method: Method::LevenbergMarquardt, ..Default::default() };
    let training = run(&samples, &bounds, &settings, &mut go).unwrap();
    let member = &training.members[0];
    assert_eq!(member.stopped, Stop::Validation);
    let (best, last) = (member.best_iteration, member.curve.len() - 1);
    assert_eq!(last, best + 4);
    let rmse = training.validation.rmse;
    let mse = rmse.iter().map(|r| r * r).sum::<f64>() / 4.0;
    assert!((mse / member.curve[best].validation_mse - 1.0).abs() < 1e-9);
    assert!(member.curve[last].validation_mse > member.curve[best].validation_mse);
}

/// A training which is stopped after every iteration, and goes on from what was told,
/// ends in the same bits: networks, curves, errors.
#[test]
fn an_interrupted_training_yields_the_same_bits() {
    let (bounds, samples) = samples(150);
    let insect = Insect::default();
    let data = Dataset { samples: &samples, bounds: &bounds, insect: &insect };
    for method in [Method::LevenbergMarquardt, Method::VariableProjection] {
        let settings = TrainSettings { neurons: 8, max_iterations: 5, method, ensemble: 2, ..Default::default() };
        let whole = train(&data, &settings, None, &mut go).unwrap();
        assert_eq!(whole.members.len(), 2);
        let mut kept = None;
        for _ in 0..20 {
            let mut heard = 0;
            let resumed = train(&data, &settings, kept.clone(), &mut |at| {
                kept = Some(at.clone());
                heard += 1;
                if heard == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            });
            let resumed = resumed.unwrap();
            if resumed.members.last().unwrap().stopped != Stop::Interrupted {
                kept = None;
                assert_eq!(resumed, whole);
                break;
            }
        }
        assert!(kept.is_none(), "it never came to its end");
    }
}

#[test]
fn a_checkpoint_of_another_training_is_refused() {
    let (bounds, samples) = samples(150);
    let insect = Insect::default();
    let data = Dataset { samples: &samples, bounds: &bounds, insect: &insect };
    let settings = TrainSettings { neurons: 4, max_iterations: 1, ..Default::default() };
    let mut kept = None;
    train(&data, &settings, None, &mut |at| {
        kept = Some(at.clone());
        ControlFlow::Continue(())
    })
    .unwrap();
    let kept = kept.unwrap();
    let refused = |at: Checkpoint, settings: &TrainSettings| {
        matches!(train(&data, settings, Some(at), &mut go), Err(TrainError::Checkpoint(_)))
    };
    assert!(refused(kept.clone(), &TrainSettings { neurons: 5, ..settings.clone() }));
    assert!(refused(kept.clone(), &TrainSettings { features: Features::Paper, ..settings.clone() }));
    assert!(refused(Checkpoint { curve: Vec::new(), ..kept.clone() }, &settings));
    assert!(refused(Checkpoint { damping: f64::NAN, ..kept.clone() }, &settings));
    assert!(!refused(kept, &settings));
}

/// Half of the labels are noise, and say so by their standard errors: believed less,
/// they do less harm.
#[test]
fn noisy_labels_weigh_less() {
    let (bounds, clean) = samples(700);
    let truth = clean[600..].to_vec();
    let mut noisy = clean[..600].to_vec();
    for (i, s) in noisy.iter_mut().enumerate().filter(|(i, _)| i % 2 == 0) {
        for k in 0..4 {
            s.y[k] += 0.2 * math::sin(12.9898 * (4 * i + k) as f64);
        }
    }
    let settings = TrainSettings { neurons: 10, max_iterations: 25, ..Default::default() };
    let error = |se: f64| {
        let told: Vec<Sample> = noisy
            .iter()
            .enumerate()
            .map(|(i, s)| Sample { se: [if i % 2 == 0 { se } else { 0.0 }; 4], ..*s })
            .collect();
        errors(&run(&told, &bounds, &settings, &mut go).unwrap().surrogate, &truth).rmse
    };
    let (told, untold) = (error(0.14), error(0.0));
    let sum = |e: [f64; 4]| e.iter().sum::<f64>();
    assert!(sum(told) < 0.7 * sum(untold), "{told:?} {untold:?}");
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let (bounds, samples) = samples(1400);
    let settings = TrainSettings { neurons: 30, max_iterations: 4, ..Default::default() };
    let results = [1, 4].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&samples, &bounds, &settings, &mut go)).unwrap()
    });
    assert_eq!(results[0], results[1]);
    let other = TrainSettings { seed: 1, ..settings };
    assert_ne!(results[0].surrogate, run(&samples, &bounds, &other, &mut go).unwrap().surrogate);
}

#[test]
fn the_observer_can_stop() {
    let (bounds, samples) = samples(200);
    let settings = TrainSettings { neurons: 5, ..Default::default() };
    let training = run(&samples, &bounds, &settings, &mut |at| {
        if at.curve.len() == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    let training = training.unwrap();
    let member = &training.members[0];
    assert_eq!((member.stopped, member.curve.len()), (Stop::Interrupted, 3));
}

#[test]
fn what_cannot_be_trained_is_refused() {
    let (bounds, good) = samples(40);
    let settings = TrainSettings { neurons: 3, max_iterations: 2, ..Default::default() };
    let run = |samples: &[Sample], bounds: &Bounds, settings: &TrainSettings| {
        run(samples, bounds, settings, &mut go).map(|_| ())
    };
    assert!(run(&good, &bounds, &settings).is_ok());
    for few in [0, 1, 5] {
        let error = run(&good[..few], &bounds, &settings);
        assert!(matches!(error, Err(TrainError::TooFewSamples { .. })), "{few}: {error:?}");
    }
    let mut bad = good.clone();
    bad[7].x[3] = f64::NAN;
    assert_eq!(run(&bad, &bounds, &settings), Err(TrainError::NotFinite { index: 7 }));
    bad = good.clone();
    bad[8].y[0] = f64::INFINITY;
    assert_eq!(run(&bad, &bounds, &settings), Err(TrainError::NotFinite { index: 8 }));
    let shares = TrainSettings { train_share: 0.9, ..settings.clone() };
    assert!(matches!(run(&good, &bounds, &shares), Err(TrainError::Shares { .. })));
    let none = TrainSettings { neurons: 0, ..settings.clone() };
    assert!(matches!(run(&good, &bounds, &none), Err(TrainError::Neurons { .. })));
    let many = TrainSettings { ensemble: 1000, ..settings.clone() };
    assert!(matches!(run(&good, &bounds, &many), Err(TrainError::Ensemble { .. })));
}
