//! Exact laws of hovering strokes: tilt, frequency, fore-aft mirror, energy.

use manduca_numerics::insect::Insect;
use manduca_numerics::math::sin_cos;
use manduca_numerics::parameters::{Point, at};
use manduca_numerics::simulation::{Means, simulate_watched};
use manduca_numerics::uvlm::Settings;
use rayon::prelude::*;

use super::invariants::STROKE;
use crate::check::{Expected, Group, Row, Setup};
use crate::flights::Flight;

/// Default cores on a coarse lattice: these laws hold on any.
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

fn fly(parameters: Point, settings: Settings) -> Option<Means> {
    Flight { settings, ..Flight::of(parameters) }.fly().ok()
}

/// The tilt of the stroke plane only turns the mean force: error of lift and drag
/// over the force.
fn tilt() -> Option<f64> {
    let mut parameters = STROKE;
    parameters[at::STROKE_PLANE] = 0.0;
    let (tilted, level) = (fly(STROKE, coarse())?, fly(parameters, coarse())?);
    let (s, c) = sin_cos(STROKE[at::STROKE_PLANE].to_radians());
    let (t, n) = (level.stroke_axes[0].mean, level.stroke_axes[1].mean);
    let (lift, drag) = (tilted.outputs[0].mean - (n * c - t * s), tilted.outputs[1].mean + (t * c + n * s));
    Some(lift.hypot(drag) / t.hypot(n))
}

/// Forces scale with f², power with f³: greatest relative error of all four outputs.
fn frequency() -> Option<f64> {
    let mut parameters = STROKE;
    parameters[at::FREQUENCY] *= 2.0;
    let (slow, fast) = (fly(STROKE, coarse())?, fly(parameters, coarse())?);
    let factors = [4.0, 4.0, 4.0, 8.0];
    let error = |i: usize| (fast.outputs[i].mean / (factors[i] * slow.outputs[i].mean) - 1.0).abs();
    Some((0..4).map(error).fold(0.0, f64::max))
}

/// (φ0, α0) -> (-φ0, -α0) is the fore-aft mirror image half a stroke later: error
/// of the mean force over the weight. The start is not mirrored and must be forgotten.
fn fore_aft() -> Option<f64> {
    let mut parameters = STROKE;
    parameters[at::SWEEP_MEAN] *= -1.0;
    parameters[at::ROTATION_MEAN] *= -1.0;
    let settings = Settings { strokes: 14, strokes_most: 14, strokes_dropped: 4, wake_strokes: 1.0, ..coarse() };
    let (a, b) = (fly(STROKE, settings)?, fly(parameters, settings)?);
    let (along, normal) =
        (a.stroke_axes[0].mean + b.stroke_axes[0].mean, a.stroke_axes[1].mean - b.stroke_axes[1].mean);
    Some(along.hypot(normal) / Insect::default().weight_n())
}

/// Mean inertial power over a stroke over its amplitude, unrectified, summed over the joints.
fn energy(parameters: Point) -> Option<f64> {
    let settings = Settings { strokes: 1, strokes_most: 1, strokes_dropped: 0, steps_per_stroke: 48, ..coarse() };
    let (mut mean, mut amplitude) = (0.0, 0.0_f64);
    let flight = Flight { settings, ..Flight::of(parameters) };
    simulate_watched(&flight.simulation(), &mut |moment, _| {
        let power = moment.snapshot.joints.iter().map(|j| j.inertial_w).sum::<f64>();
        mean += moment.share * power;
        amplitude = amplitude.max(power.abs());
    })
    .ok()?;
    Some(mean / amplitude)
}

/// The checks.
pub fn group() -> Group {
    let mut sharp = STROKE;
    (sharp[at::SWEEP_SHAPE], sharp[at::ROTATION_SHAPE]) = (0.8, 3.0);
    type Law = (&'static str, fn() -> Option<f64>, f64);
    let laws: [Law; 3] = [
        ("tilt of the stroke plane turns the mean force", tilt, 1e-12),
        ("twice the frequency: four times the force, eight times the power", frequency, 1e-8),
        ("fore-aft mirror image, mean force over weight", fore_aft, 0.004),
    ];
    let row = |what: &str, limit, got: Option<f64>| Row {
        what: what.to_owned(),
        source: "exact laws",
        setup: Setup::Production,
        expected: Expected::Below(limit),
        got: got.unwrap_or(f64::NAN),
    };
    let mut rows: Vec<Row> = laws.par_iter().map(|(what, law, limit)| row(what, *limit, law())).collect();
    rows.push(row("energy: mean inertial power over its amplitude", 1e-3, energy(STROKE)));
    rows.push(row("energy, sharp stroke (K 0.8, C 3)", 1e-3, energy(sharp)));
    Group {
        title: "Laws of hovering",
        about: "Default cores on a lattice of 4 x 6 panels and 24 steps. The mirror image begins with another half \
                stroke, so it holds only once the start is forgotten: means of ten strokes, remembered for one."
            .to_owned(),
        rows,
    }
}
