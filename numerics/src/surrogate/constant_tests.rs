//! Outputs which do not depend on what is free.

use super::process::fit;
use super::*;
use crate::insect::Insect;
use crate::kinematics::ElevationPhase;
use crate::optimise::{GaSettings, Problem, SimplexSettings, optimise};
use crate::parameters::{Bounds, Point, at};
use crate::simulation::{BodyVelocity, Model, Simulation, simulate};
use std::ops::ControlFlow;

/// The measured stroke's values hold all but these parameters.
fn box_of(free: &[(usize, f64, f64)]) -> Bounds {
    let stroke = crate::cases::CASES[2].parameters;
    let mut bounds = Bounds { lower: stroke, upper: stroke };
    for &(i, low, high) in free {
        (bounds.lower[i], bounds.upper[i]) = (low, high);
    }
    bounds
}

fn flown(x: Point) -> Sample {
    let simulation = Simulation {
        model: Model::QuasiSteady(crate::quasi_steady::Settings::default()),
        insect: Insect::default(),
        parameters: x,
        elevation_phase: ElevationPhase::Plus,
        elastic_storage: 0.0,
        body_velocity: BodyVelocity::default(),
    };
    Sample { x, y: simulate(&simulation).unwrap().scaled.map(|e| e.mean), se: [0.0; 4] }
}

fn points(bounds: &Bounds, n: u64) -> impl Iterator<Item = Point> {
    (0..n).filter_map(|i| crate::sampling::sample(bounds, 3, i, &|_| true))
}

fn samples(bounds: &Bounds, n: u64) -> Vec<Sample> {
    points(bounds, n).map(flown).collect()
}

/// Trained by each method and fitted as a process: the surrogate with its errors on the test share.
fn learnt(samples: &[Sample], bounds: &Bounds, features: Features) -> Vec<(Surrogate, Errors)> {
    let insect = Insect::default();
    let data = Dataset { samples, bounds, insect: &insect };
    let settings = |method| TrainSettings {
        neurons: 8,
        max_iterations: 40,
        features,
        method,
        ensemble: 2,
        ..TrainSettings::default()
    };
    let mut all: Vec<_> = [Method::VariableProjection, Method::LevenbergMarquardt]
        .into_iter()
        .map(|method| train(&data, &settings(method), None, &mut |_| ControlFlow::Continue(())).unwrap())
        .map(|training| (training.surrogate, training.test))
        .collect();
    let found = fit(&data, &settings(Method::default()), Vec::new(), &mut |_| ControlFlow::Continue(())).unwrap();
    all.push((found.surrogate, found.test));
    all
}

/// Power does not depend on the stroke plane, nor does the moment: it is predicted by what it is.
#[test]
fn a_constant_output_is_predicted_by_its_constant() {
    let bounds = box_of(&[(at::STROKE_PLANE, 0.0, 30.0)]);
    let all = samples(&bounds, 60);
    for (surrogate, test) in learnt(&all, &bounds, Features::Paper) {
        assert_eq!(test.rmse[3], 0.0, "{test:?}");
        assert!(test.rmse.iter().all(|e| *e < 1e-3) && test.rmse[2] < 1e-15, "{test:?}");
        let (y, slopes) = surrogate.jacobian(&all[7].x);
        assert_eq!((y[3], slopes[3]), (all[0].y[3], [0.0; 10]));
        let problem = Problem {
            predict: &|xs, out| surrogate.predict_into(xs, out),
            clearance: &|_, out| out.fill(1.0),
            margin_m: 0.0,
            bounds,
            penalty_r: 2.0,
            penalty_s: 5.0,
        };
        let ga = GaSettings { population: 60, generations: 20, ..GaSettings::default() };
        let go = &mut |_: &_| ControlFlow::Continue(());
        let found = optimise(&problem, &ga, &SimplexSettings::default(), go).unwrap();
        assert_eq!(found.score.outputs[3], all[0].y[3]);
    }
}

/// What only changes by the frame's exact laws needs nothing learnt.
#[test]
fn the_laws_alone_predict_tilt_and_frequency() {
    let bounds = box_of(&[(at::FREQUENCY, 20.0, 35.0), (at::STROKE_PLANE, 0.0, 30.0)]);
    for (surrogate, test) in learnt(&samples(&bounds, 40), &bounds, Features::Physical) {
        // At one instant of a stroke rounding decides on the side of the centre of pressure, and so on the moment.
        assert!([0, 1, 3].iter().all(|&k| test.rmse[k] < 1e-9) && test.rmse[2] < 5e-3, "{test:?}");
        let mut x = bounds.lower;
        (x[at::FREQUENCY], x[at::STROKE_PLANE]) = (34.0, 3.0);
        let (y, said) = (flown(x).y, surrogate.predict(&x));
        assert!((y[0] - said[0]).abs() < 1e-9 && (y[3] - said[3]).abs() < 1e-9, "{y:?} {said:?}");
    }
}

#[test]
fn samples_which_are_all_alike_are_predicted_as_they_are() {
    let bounds = Bounds::default();
    let alike = Sample { y: [0.7, 0.0, -0.2, 1.1], ..flown(crate::cases::CASES[2].parameters) };
    let all: Vec<_> = points(&bounds, 30).map(|x| Sample { x, ..alike }).collect();
    for (surrogate, test) in learnt(&all, &bounds, Features::Paper) {
        assert_eq!((surrogate.predict(&all[3].x), test.rmse), (alike.y, [0.0; 4]));
    }
}
