//! The first stroke of two flapping rectangular wings, as other codes have it.

use manduca_numerics::kinematics::{Attitude, ElevationPhase, Stroke};
use manduca_numerics::uvlm::{Air, Planform, Pose, Settings, solver_of};

use super::scheme::Scheme;
use crate::check::{Expected, Group, Row, Setup};

/// Title of the checks.
pub const TITLE: &str = "Against other codes";
const SOURCE: &str = "four public vortex-lattice codes, whose loads contain the full suction in the wing's plane";
/// The flight in a few words.
pub const SHORT: &str = "two rectangular wings, second half of the first stroke";
const LENGTH: f64 = 0.0485;
const CHORD: f64 = 0.018;
const HINGE: f64 = 0.005;
const AMPLITUDE_DEG: f64 = 60.0;

/// Mean lift of both wings over the second half of the first stroke, N.
pub fn second_half_lift(settings: &Settings, strips: usize, cosine: f64) -> f64 {
    let x = [26.8, 0.0, 0.0, 0.0, 0.0, AMPLITUDE_DEG, 0.0, 60.0, 0.0, 0.0];
    let stroke = Stroke::new(&x, ElevationPhase::Plus);
    let steps = settings.steps_per_stroke;
    let dt = stroke.period() / steps as f64;
    let planform = Planform::straight(0.0, LENGTH, CHORD, 0.0, strips, cosine);
    let speeds: Vec<f64> =
        planform.span.iter().map(|r| r * 4.0 * AMPLITUDE_DEG.to_radians() * stroke.frequency).collect();
    let mut solver = solver_of(&planform, settings, CHORD, stroke.period(), &speeds, Air::still(1.225));
    let (mut lift, mut count) = (0.0, 0);
    for step in 0..steps {
        let attitude = Attitude::new(&stroke.angles(step as f64 / steps as f64));
        let pose = Pose::hinged(HINGE, &attitude);
        let Some(load) = solver.step(&pose, dt) else { return f64::NAN };
        if 2 * step >= steps {
            lift += 2.0 * load.force.z;
            count += 1;
        }
    }
    lift / f64::from(count)
}

const MEAN: &str = "mean lift, mN";
const MEAN_THICK: &str = "mean lift, mN, bound core 0.05 c";

/// The checks.
pub fn group() -> Group {
    let in_plane = |settings: Settings| Settings { suction_to_lift: 0.0, suction_in_plane: 1.0, ..settings };
    let with_cores = |core| Settings { steps_per_stroke: 40, ..in_plane(Scheme::fine(core, 0.125, 6).settings) };
    let fine = with_cores(0.05);
    let flown = in_plane(Settings::default());
    let production = Settings { steps_per_stroke: 40, chordwise_panels: 6, ..flown };
    let thick = |settings: Settings| Settings { bound_core: 0.05, ..settings };
    let thin = with_cores(flown.bound_core);
    let theirs = |settings: Settings| 1e3 * second_half_lift(&settings, 12, 0.0);
    let closer = |settings: Settings| theirs(Settings { steps_per_stroke: 80, ..settings });
    let finer = |settings: Settings| {
        1e3 * second_half_lift(&Settings { chordwise_panels: 12, steps_per_stroke: 80, ..settings }, 24, 0.0)
    };
    let ours =
        |settings: Settings| 1e3 * second_half_lift(&settings, settings.spanwise_panels, settings.spanwise_cosine);
    let row = |what: &str, setup, got| Row {
        what: what.to_owned(),
        source: SOURCE,
        setup,
        expected: Expected::Between { low: 19.3, high: 22.5 },
        got,
    };
    Group {
        title: TITLE,
        about: format!(
            "Two rectangular wings of 48.5 x 18 mm, hinges 5 mm off the plane of symmetry, feathering axis c/4, 26.8 Hz, \
             φa = αa = 60°: mean lift of both over the second half of the first stroke, with all suction in the wing's \
             plane and none turned into lift. 6 x 12 panels and 40 steps as in the other codes. Fine: all cores 0.05 c. \
             The core of the bound segments decides: 0.05 c is 0.3 of a panel and feeds the suction, the more the finer \
             the lattice ({:.1} mN with twice the panels both ways and twice the steps). Without cores there is no limit \
             either, for in this half the wing flies through the wake of the first: with all cores {} c there are {:.1} \
             mN, {:.1} with twice the steps, {:.1} with twice the panels as well. As flown without suction {:.1} mN.",
            finer(fine),
            thin.bound_core,
            theirs(thin),
            closer(thin),
            finer(thin),
            ours(Settings { suction_in_plane: 0.0, ..flown }),
        ),
        rows: vec![
            row(MEAN, Setup::Fine, theirs(fine)),
            row(MEAN, Setup::Production, theirs(production)),
            row(MEAN, Setup::Flown, ours(flown)),
            row(MEAN_THICK, Setup::Production, theirs(thick(production))),
            row(MEAN_THICK, Setup::Flown, ours(thick(flown))),
        ],
    }
}
