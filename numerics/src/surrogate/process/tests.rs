//! Processes of functions which are known.

use super::likelihood::Labels;
use super::*;
use crate::insect::Insect;
use crate::parameters::{COUNT, at};
use crate::surrogate::features::mirrored;
use crate::surrogate::random::{Streams, uniform};
use crate::surrogate::{Dataset, Features, Sample, Surrogate, TrainSettings, errors};
use std::ops::ControlFlow;

fn points(n: u64) -> Vec<Point> {
    let bounds = Bounds::default();
    (0..n).filter_map(|i| crate::sampling::sample(&bounds, 3, i, &|_| true)).collect()
}

/// Functions which are smooth in what the frame gives, and obey its laws.
fn truth(frame: &Frame, x: &Point) -> [f64; 4] {
    let u = frame.bounds(&Bounds::default()).to_unit(&frame.inputs(x));
    let (phi, alpha) = (u[at::SWEEP_MEAN] - 0.5, u[at::ROTATION_MEAN] - 0.5);
    let wave = crate::math::sin(2.0 * u[5] + u[7]);
    let inside =
        [0.8 + 0.4 * wave + 0.3 * phi * alpha, phi + 0.5 * alpha * u[8], alpha - phi * wave, 1.0 + u[5] * u[9]];
    frame.outward(x, &inside)
}

fn frame(features: Features) -> Frame {
    Frame::new(features, &Insect::default(), &Bounds::default())
}

fn samples(frame: &Frame, n: u64, se: f64) -> Vec<Sample> {
    let mut rng = Streams::new(8).stream(1);
    let mut noise = || se * 12f64.sqrt() * (uniform(&mut rng) - 0.5);
    points(n).iter().map(|x| Sample { x: *x, y: truth(frame, x).map(|y| y + noise()), se: [se; 4] }).collect()
}

fn fitted(samples: &[Sample], features: Features) -> ProcessFit {
    let (bounds, insect) = (Bounds::default(), Insect::default());
    let data = Dataset { samples, bounds: &bounds, insect: &insect };
    let settings = TrainSettings { features, seed: 4, ..TrainSettings::default() };
    fit(&data, &settings, Vec::new(), &mut |_| ControlFlow::Continue(())).unwrap()
}

#[test]
fn a_fit_goes_on_where_an_earlier_one_was_lost() {
    let (bounds, insect, frame) = (Bounds::default(), Insect::default(), frame(Features::Physical));
    let all = samples(&frame, 320, 0.01);
    let data = Dataset { samples: &all, bounds: &bounds, insect: &insect };
    let settings = TrainSettings { features: Features::Physical, seed: 4, ..TrainSettings::default() };
    let mut left = Vec::new();
    let whole = fit(&data, &settings, Vec::new(), &mut |at| {
        if at.ascent == 7 && at.iteration == 2 {
            left = at.ended.to_vec();
        }
        ControlFlow::Continue(())
    });
    assert_eq!(left.iter().map(|c| c.ascent).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 6]);
    let begun = |left: Vec<Climbed>| {
        let mut first = None;
        let found = fit(&data, &settings, left, &mut |at| {
            first.get_or_insert(at.ascent);
            ControlFlow::Continue(())
        });
        (found, first)
    };
    assert_eq!(begun(left.clone()), (whole.clone(), Some(7)));
    // What cannot be an end of these ascents is no help and no harm.
    left.iter_mut().for_each(|c| c.at[0] = f64::NAN);
    left[3].at.pop();
    assert_eq!(begun(left), (whole, Some(0)));
}

#[test]
fn smooth_functions_are_foreseen_and_obey_the_mirror_law() {
    let frame = frame(Features::Physical);
    let all = samples(&frame, 300, 0.0);
    let found = fitted(&all[..200], Features::Physical);
    let unseen = errors(&found.surrogate, &all[200..]);
    assert!(unseen.rmse.iter().all(|e| *e < 6e-3), "{unseen:?}");
    assert!(found.test.count == 20 && found.test.rmse[0] < 6e-3, "{:?}", found.test);
    let x = all[250].x;
    let [lift, drag, moment, power] = found.surrogate.predict(&x);
    let image = found.surrogate.predict(&mirrored(&x));
    let laws = Surrogate::of_process(frame, found.surrogate.process().unwrap().clone()).unwrap();
    assert_eq!(laws, found.surrogate);
    let (mut held, mut reversed) = (x, mirrored(&x));
    (held[at::STROKE_PLANE], reversed[at::STROKE_PLANE]) = (0.0, 0.0);
    let (one, two) = (found.surrogate.predict(&held), found.surrogate.predict(&reversed));
    assert!((one[0] - two[0]).abs() < 1e-12 && (one[1] + two[1]).abs() < 1e-12, "{one:?} {two:?}");
    assert!([lift, drag, moment, power].iter().chain(&image).all(|v| v.is_finite()));
}

#[test]
fn a_process_of_the_plain_parameters_learns_too() {
    let frame = frame(Features::Paper);
    let all = samples(&frame, 260, 0.0);
    let unseen = errors(&fitted(&all[..220], Features::Paper).surrogate, &all[220..]);
    assert!(unseen.correlation.iter().all(|r| *r > 0.98), "{unseen:?}");
}

#[test]
fn noise_is_averaged_not_learnt() {
    let frame = frame(Features::Physical);
    let exact: Vec<Sample> = samples(&frame, 460, 0.0).split_off(400);
    let noisy = fitted(&samples(&frame, 400, 0.05)[..400], Features::Physical);
    let error = errors(&noisy.surrogate, &exact);
    // Power is learnt over f^3: at low frequency the same error of a label is more.
    assert!(error.rmse[..3].iter().all(|e| *e < 0.03), "{error:?}");
    // The labels' errors are known: nothing else is taken for noise.
    let process = noisy.surrogate.process().unwrap();
    assert!(process.outputs.iter().all(|o| o.noise < 0.05), "{:?}", process.outputs.each_ref().map(|o| o.noise));
}

#[test]
fn derivatives_are_those_of_values_and_lanes_do_not_mix() {
    let frame = frame(Features::Physical);
    let all = samples(&frame, 90, 1e-3);
    let surrogate = fitted(&all[..80], Features::Physical).surrogate;
    let xs: Vec<Point> = all[70..].iter().map(|s| s.x).collect();
    let (mut values, mut jacobians) = (vec![[0.0; 4]; 20], vec![([0.0; 4], [[0.0; COUNT]; 4]); 20]);
    surrogate.predict_into(&xs, &mut values);
    surrogate.jacobians_into(&xs, &mut jacobians);
    for (x, (value, (same, slopes))) in xs.iter().zip(values.iter().zip(&jacobians)) {
        assert_eq!((surrogate.predict(x), value), (*value, same));
        for i in 0..COUNT {
            // Weights of exact labels are large: a shorter step would see their rounding.
            // The sharpness bends away fast near a triangle.
            let share = if i == at::SWEEP_SHAPE { 1e-5 } else { 1e-4 };
            let step = share * (Bounds::default().upper[i] - Bounds::default().lower[i]);
            let at = |sign: f64| {
                let mut moved = *x;
                moved[i] += sign * step;
                surrogate.predict(&moved)
            };
            let (up, down) = (at(1.0), at(-1.0));
            for k in 0..4 {
                let slope = (up[k] - down[k]) / (2.0 * step);
                assert!((slope - slopes[k][i]).abs() < 1e-5 * (1.0 + slope.abs()), "{k} {i}: {slope} {}", slopes[k][i]);
            }
        }
    }
}

#[test]
fn the_likelihoods_gradient_is_its_slope() {
    let mut rng = Streams::new(5).stream(1);
    for sign in [None, Some(1.0), Some(-1.0)] {
        let labels = Labels {
            inputs: (0..120).map(|_| 2.0 * uniform(&mut rng) - 1.0).collect(),
            width: 3,
            even: 1,
            sign,
            values: (0..40).map(|_| uniform(&mut rng)).collect(),
            variances: (0..40).map(|_| 1e-3 * uniform(&mut rng)).collect(),
        };
        let at = [-0.3, 0.2, 0.4, 0.1, -2.0];
        let gradient = labels.gradient(&at, &labels.solve(&at).unwrap());
        for i in 0..5 {
            let moved = |by: f64| {
                let mut at = at;
                at[i] += by;
                labels.solve(&at).unwrap().likelihood
            };
            let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!((slope - gradient[i]).abs() < 1e-5 * (1.0 + slope.abs()), "{sign:?} {i}: {slope} {}", gradient[i]);
        }
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let all = samples(&frame(Features::Physical), 180, 1e-3);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fitted(&all, Features::Physical))
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn what_is_no_process_is_refused() {
    let all = samples(&frame(Features::Physical), 60, 0.0);
    let (bounds, insect) = (Bounds::default(), Insect::default());
    let data = Dataset { samples: &all[..5], bounds: &bounds, insect: &insect };
    assert!(fit(&data, &TrainSettings::default(), Vec::new(), &mut |_| ControlFlow::Continue(())).is_err());
    let good = fitted(&all, Features::Physical).surrogate;
    let of = |change: &dyn Fn(&mut Process)| {
        let mut process = good.process().unwrap().clone();
        change(&mut process);
        Surrogate::of_process(*good.frame(), process)
    };
    assert!(of(&|_| {}).is_ok());
    assert_eq!(of(&|p| p.points.clear()), Err(NetworkError::NoPoints));
    assert!(of(&|p| p.outputs[2].weights.truncate(3)).is_err());
    assert!(of(&|p| p.outputs[1].lengths[4] = 0.0).is_err());
    assert!(of(&|p| p.outputs[0].mean = f64::NAN).is_err());
    assert!(of(&|p| p.points[0][0] = f64::INFINITY).is_err());
    assert!(of(&|p| p.bounds.lower[5] = 1e9).is_err());
}
