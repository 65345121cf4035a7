//! Exact symmetries of hover in still air, first as tests of the solver: they are
//! free data for the surrogate later.

use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::ElevationPhase;
use manduca_numerics::parameters::{Point, at};
use manduca_numerics::simulation::{BodyVelocity, Means, Model, Simulation, simulate};
use manduca_numerics::uvlm::Settings;

const STROKE: Point = [26.0, 15.0, -6.0, 3.0, 8.0, 55.0, 7.0, 55.0, 0.3, 1.3];

fn coarse() -> Settings {
    Settings {
        chordwise_panels: 4,
        spanwise_panels: 6,
        steps_per_stroke: 24,
        strokes: 3,
        strokes_most: 3,
        strokes_dropped: 1,
        ..Settings::default()
    }
}

fn simulation(parameters: Point) -> Simulation {
    Simulation {
        model: Model::Uvlm(coarse()),
        insect: Insect::default(),
        parameters,
        elevation_phase: ElevationPhase::Plus,
        elastic_storage: 0.0,
        body_velocity: BodyVelocity::default(),
    }
}

fn fly(parameters: Point) -> Means {
    simulate(&simulation(parameters)).expect("feasible")
}

fn close(a: f64, b: f64, relative: f64, what: &str) {
    assert!((a - b).abs() <= relative * a.abs().max(b.abs()), "{what}: {a} against {b}");
}

/// The air knows neither gravity nor the tilt of the stroke plane: β only turns the mean force.
#[test]
fn stroke_plane_angle_is_exact() {
    let tilted = fly(STROKE);
    let mut level = STROKE;
    level[at::STROKE_PLANE] = 0.0;
    let level = fly(level);
    for i in 0..3 {
        assert_eq!(tilted.stroke_axes[i].mean, level.stroke_axes[i].mean, "stroke axes {i}");
    }
    assert_eq!(tilted.outputs[3].mean, level.outputs[3].mean);
    let (s, c) = manduca_numerics::math::sin_cos(15.0_f64.to_radians());
    let (t, n) = (level.stroke_axes[0].mean, level.stroke_axes[1].mean);
    close(tilted.outputs[0].mean, n * c - t * s, 1e-12, "lift");
    close(tilted.outputs[1].mean, -(t * c + n * s), 1e-12, "drag");
    // The moment about the centre of mass is fixed too, which tilts with the stroke plane.
    close(tilted.outputs[2].mean, level.outputs[2].mean, 1e-9, "moment");
}

/// (φ0, α0) -> (-φ0, -α0) started half a stroke later is the fore-aft mirror image:
/// normal force and power equal, tangential force and hinge moment reversed. The
/// stroke's second half of the mirrored run is the first half of the other, so the
/// flow from rest differs only by its start; both are run to where it is forgotten.
#[test]
fn fore_aft_mirror() {
    let mut mirrored = STROKE;
    mirrored[at::SWEEP_MEAN] *= -1.0;
    mirrored[at::ROTATION_MEAN] *= -1.0;
    let fly = |parameters| {
        let settings = Settings { strokes: 14, strokes_most: 14, strokes_dropped: 4, wake_strokes: 1.0, ..coarse() };
        simulate(&Simulation { model: Model::Uvlm(settings), ..simulation(parameters) }).expect("feasible")
    };
    let (a, b) = (fly(STROKE), fly(mirrored));
    let weight = Insect::default().weight_n();
    let tolerance = 0.004 * weight;
    assert!(
        (a.stroke_axes[0].mean + b.stroke_axes[0].mean).abs() < tolerance,
        "{:?} {:?}",
        a.stroke_axes,
        b.stroke_axes
    );
    assert!(
        (a.stroke_axes[1].mean - b.stroke_axes[1].mean).abs() < tolerance,
        "{:?} {:?}",
        a.stroke_axes,
        b.stroke_axes
    );
    assert!((a.stroke_axes[2].mean + b.stroke_axes[2].mean).abs() < 0.004 * weight * 0.0183);
    for j in 0..3 {
        assert!((a.joints[j].required_w - b.joints[j].required_w).abs() < 0.004 * 0.0842, "joint {j}");
    }
}

/// With cores tied to lengths and strokes the flow knows no time scale but the
/// stroke: forces and moments scale with f², power with f³.
#[test]
fn frequency_scales_out() {
    let slow = fly(STROKE);
    let mut faster = STROKE;
    faster[at::FREQUENCY] = 2.0 * STROKE[at::FREQUENCY];
    let fast = fly(faster);
    for i in 0..3 {
        close(fast.outputs[i].mean, 4.0 * slow.outputs[i].mean, 1e-8, "force or moment");
    }
    close(fast.outputs[3].mean, 8.0 * slow.outputs[3].mean, 1e-8, "power");
}

/// The same simulation gives the same bits, alone or among others on other threads.
#[test]
fn results_do_not_depend_on_threads() {
    let alone = fly(STROKE);
    let threads: Vec<_> = (0..3).map(|_| std::thread::spawn(|| fly(STROKE))).collect();
    for thread in threads {
        assert_eq!(thread.join().expect("no panic"), alone);
    }
}

/// A gust of 0.2 m/s from ahead and its opposite move the drag in opposite directions.
#[test]
fn body_velocity_is_felt() {
    let drag = |forward_m_s| {
        let body_velocity = BodyVelocity { forward_m_s, ..BodyVelocity::default() };
        simulate(&Simulation { body_velocity, ..simulation(STROKE) }).expect("feasible").outputs[1].mean
    };
    let (back, rest, ahead) = (drag(-0.4), drag(0.0), drag(0.4));
    assert!(back < rest && rest < ahead, "{back} {rest} {ahead}");
}
