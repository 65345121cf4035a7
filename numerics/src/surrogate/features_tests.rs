//! The laws of hovering in the surrogate.

use super::features::{MIRROR_SIGNS, mirrored};
use super::network::tests::{random_network, random_points};
use super::*;
use crate::balance::Body;
use crate::insect::Insect;
use crate::kinematics::{ElevationPhase, Stroke};
use crate::parameters::{Bounds, at};
use crate::simulation::{BodyVelocity, Model, Simulation, simulate};
use crate::{quasi_steady, uvlm};
use std::ops::ControlFlow;

const STROKE: Point = [26.0, 15.0, -6.0, 3.0, 8.0, 55.0, 7.0, 55.0, 0.3, 1.3];

fn simulation(parameters: Point, model: Model) -> Simulation {
    Simulation {
        model,
        insect: Insect::default(),
        parameters,
        elevation_phase: ElevationPhase::Plus,
        elastic_storage: 0.0,
        body_velocity: BodyVelocity::default(),
    }
}

fn blades() -> Model {
    Model::QuasiSteady(quasi_steady::Settings { blade_elements: 12, steps_per_stroke: 200, ..Default::default() })
}

fn fly(parameters: Point, model: Model) -> [f64; 4] {
    simulate(&simulation(parameters, model)).unwrap().scaled.map(|e| e.mean)
}

fn frame() -> Frame {
    Frame::new(Features::Physical, &Insect::default(), &Bounds::default())
}

fn assert_close(a: &[f64; 4], b: &[f64; 4], tolerance: f64) {
    for k in 0..4 {
        assert!((a[k] - b[k]).abs() < tolerance, "{a:?} {b:?}");
    }
}

#[test]
fn the_centre_of_mass_is_fixed_in_the_stroke_plane() {
    let (x, z) = Insect::default().centre_in_stroke_plane();
    for beta in [0.0, 15.0, 50.0] {
        let mut stroke = STROKE;
        stroke[at::STROKE_PLANE] = beta;
        let simulation = simulation(stroke, blades());
        let body = Body::new(&simulation, &Stroke::new(&stroke, ElevationPhase::Plus));
        let reference = body.air().reference;
        assert!((reference.x - x).abs() < 1e-15 && (reference.z - z).abs() < 1e-15, "{reference:?} {x} {z}");
    }
}

/// What the network learns is the simulation's own stroke-plane axes, hinge moment included.
#[test]
fn the_inside_of_the_frame_is_what_the_simulation_says() {
    let insect = Insect::default();
    let uvlm = uvlm::Settings {
        chordwise_panels: 4,
        spanwise_panels: 6,
        steps_per_stroke: 24,
        strokes: 3,
        strokes_most: 3,
        strokes_dropped: 1,
        ..Default::default()
    };
    for model in [blades(), Model::Uvlm(uvlm)] {
        let means = simulate(&simulation(STROKE, model)).unwrap();
        let [tangential, normal, hinge] = means.stroke_axes.map(|e| e.mean);
        let Frame::Physical { reference_hz, mirror: true, .. } = frame() else { panic!("no mirror") };
        let r = reference_hz / STROKE[at::FREQUENCY];
        let [w, _, wc, p0] = insect.scales();
        let said = [normal / w, tangential / w, hinge / wc, means.outputs[3].mean / p0 * r];
        let y = means.scaled.map(|e| e.mean);
        assert_close(&frame().inward(&STROKE, &y), &said.map(|v| v * r * r), 1e-12);
        assert_close(&frame().outward(&STROKE, &frame().inward(&STROKE, &y)), &y, 1e-13);
    }
}

/// A stroke flown tilted, faster and mirrored says what the frame makes of the first one:
/// exactly for blade elements, which have no start to forget, but for the moment. At the
/// one instant when the wing stands still rounding decides which way its centre of
/// pressure lies.
#[test]
fn the_laws_hold_in_real_simulations() {
    let frame = frame();
    let inside = frame.inward(&STROKE, &fly(STROKE, blades()));
    let mut other = STROKE;
    (other[at::FREQUENCY], other[at::STROKE_PLANE]) = (37.0, 41.0);
    let reversed = [inside[0], -inside[1], -inside[2], inside[3]];
    for (stroke, inside) in [(other, inside), (mirrored(&other), reversed)] {
        let (flown, said) = (fly(stroke, blades()), frame.outward(&stroke, &inside));
        assert!((flown[2] - said[2]).abs() < 4e-3, "{flown:?} {said:?}");
        assert_close(&[flown[0], flown[1], said[2], flown[3]], &said, 1e-10);
    }
}

/// Two random networks as one surrogate.
fn surrogate() -> Surrogate {
    let bounds = frame().bounds(&Bounds::default());
    let members = [3, 4].map(|seed| Network { bounds, ..random_network(9, seed) });
    Surrogate::new(frame(), members.into()).unwrap()
}

#[test]
fn predictions_obey_the_laws_exactly() {
    let (surrogate, frame) = (surrogate(), frame());
    for x in random_points(50, &Bounds::default(), 5) {
        let inside = frame.inward(&x, &surrogate.predict(&x));
        let mut other = x;
        (other[at::FREQUENCY], other[at::STROKE_PLANE]) = (19.0, 3.0);
        assert_close(&surrogate.predict(&other), &frame.outward(&other, &inside), 1e-12);
        let image = mirrored(&x);
        let reversed = [inside[0], -inside[1], -inside[2], inside[3]];
        assert_close(&surrogate.predict(&image), &frame.outward(&image, &reversed), 1e-12);
    }
}

#[test]
fn a_surrogate_is_the_mean_of_its_networks_and_their_images() {
    let (surrogate, frame) = (surrogate(), frame());
    let xs = random_points(70, &Bounds::default(), 6);
    let mut out = vec![[0.0; 4]; xs.len()];
    surrogate.predict_into(&xs, &mut out);
    for (x, out) in xs.iter().zip(out) {
        assert_eq!(surrogate.predict(x), out);
        let mut mean = [0.0; 4];
        for member in surrogate.members() {
            let inputs = frame.inputs(x);
            let (own, image) = (member.predict(&inputs), member.predict(&mirrored(&inputs)));
            for k in 0..4 {
                mean[k] += 0.25 * (own[k] + MIRROR_SIGNS[k] * image[k]);
            }
        }
        assert_close(&frame.outward(x, &mean), &out, 1e-12);
    }
    assert!(Surrogate::new(frame, Vec::new()).is_err());
    let mut other = random_network(3, 1);
    other.bounds.lower[3] += 1.0;
    assert!(Surrogate::new(frame, vec![random_network(3, 1), other]).is_err());
}

#[test]
fn derivatives_are_those_of_the_prediction() {
    let surrogate = surrogate();
    for x in random_points(10, &Bounds::default(), 8) {
        let (y, jacobian) = surrogate.jacobian(&x);
        assert_close(&y, &surrogate.predict(&x), 1e-13);
        for i in 0..10 {
            let step = 1e-5 * (Bounds::default().upper[i] - Bounds::default().lower[i]);
            let (mut ahead, mut behind) = (x, x);
            (ahead[i], behind[i]) = (x[i] + step, x[i] - step);
            let (ahead, behind) = (surrogate.predict(&ahead), surrogate.predict(&behind));
            for k in 0..4 {
                let slope = (ahead[k] - behind[k]) / (2.0 * step);
                assert!((jacobian[k][i] - slope).abs() < 1e-6 * (1.0 + slope.abs()), "{k} {i}");
            }
        }
    }
}

/// K = 0.6 and C = 2: -ln(0.645) and ln 5. A triangle has the sharpness of 1/200, beyond it nothing changes.
#[test]
fn shapes_are_given_by_their_sharpness() {
    let mut x = STROKE;
    (x[at::SWEEP_SHAPE], x[at::ROTATION_SHAPE]) = (0.6, 2.0);
    let inputs = frame().inputs(&x);
    assert!((inputs[at::SWEEP_SHAPE] - 0.438_504_9).abs() < 1e-7, "{inputs:?}");
    assert!((inputs[at::ROTATION_SHAPE] - 1.609_437_9).abs() < 1e-7, "{inputs:?}");
    assert_eq!(inputs[..at::SWEEP_SHAPE], x[..at::SWEEP_SHAPE]);
    x[at::SWEEP_SHAPE] = 1.0;
    let triangle = frame().inputs(&x);
    x[at::SWEEP_SHAPE] = 1.5;
    assert_eq!(frame().inputs(&x), triangle);
    assert_eq!(Frame::Paper.inputs(&x), x);
    let all = frame().bounds(&Bounds::default());
    assert_eq!(all.upper[at::SWEEP_SHAPE], triangle[at::SWEEP_SHAPE]);
}

#[test]
fn a_box_on_one_side_has_no_mirror_images() {
    let mut bounds = Bounds::default();
    bounds.lower[at::SWEEP_MEAN] = 1.0;
    let frame = Frame::new(Features::Physical, &Insect::default(), &bounds);
    assert!(matches!(frame, Frame::Physical { mirror: false, .. }));
    assert_eq!(frame.bounds(&bounds).lower[at::SWEEP_MEAN], 1.0);
    (bounds.lower[at::SWEEP_MEAN], bounds.upper[at::SWEEP_MEAN]) = (-5.0, 20.0);
    let frame = Frame::new(Features::Physical, &Insect::default(), &bounds);
    let inside = frame.bounds(&bounds);
    assert_eq!((inside.lower[at::SWEEP_MEAN], inside.upper[at::SWEEP_MEAN]), (-20.0, 20.0));
    assert!(inside.is_held(at::FREQUENCY) && inside.is_held(at::STROKE_PLANE));
}

/// The exact laws leave a smaller problem: the same few strokes teach more.
#[test]
fn physical_features_learn_more_from_the_same_samples() {
    let bounds = Bounds::default();
    let all: Vec<Sample> = random_points(700, &bounds, 31)
        .into_iter()
        .filter_map(|x| Some((x, simulate(&simulation(x, blades())).ok()?)))
        .map(|(x, means)| Sample { x, y: means.scaled.map(|e| e.mean), se: [0.0; 4] })
        .collect();
    let (known, unknown) = all.split_at(400);
    let insect = Insect::default();
    let error = |features| {
        let settings = TrainSettings { neurons: 15, max_iterations: 20, features, ..Default::default() };
        let data = Dataset { samples: known, bounds: &bounds, insect: &insect };
        let training = train(&data, &settings, None, &mut |_| ControlFlow::Continue(())).unwrap();
        errors(&training.surrogate, unknown).rmse.iter().sum::<f64>()
    };
    let (physical, paper) = (error(Features::Physical), error(Features::Paper));
    assert!(physical < 0.75 * paper, "{physical} {paper}");
}
