//! What a study must bear out of a simulation's result: cheap, for the writer asks it of each.

use std::f64::consts::PI;
use std::ops::RangeInclusive;

use manduca_numerics::insect::Insect;
use manduca_numerics::parameters::{OUTPUTS, at};
use manduca_numerics::simulation::Model;
use manduca_protocol::resolve;
use manduca_protocol::study::StudySpec;
use manduca_protocol::view::JobRole;

use super::search::optimisation_of_stroke;
use crate::validity::Flown;

/// Relative error of a scaled mean times its scale.
const ROUNDING: f64 = 1e-9;

/// Times the loads of the fastest stroke there can be beyond which a result is nonsense.
const NONSENSE: f64 = 100.0;

/// Force (N), moment (N m) and power (W) which no stroke up to this frequency comes near. Three angles of up to pi
/// move the tip at V = 6 pi² f R at most, and the force of both wings is 100 times 2 rho R c V (V/2 + c f).
fn most(insect: &Insect, frequency_hz: f64) -> [f64; 3] {
    let arm = insect.wing_length_m + insect.hinge_offset_m.abs();
    let speed = 6.0 * PI * PI * frequency_hz * arm;
    let area = insect.wing_length_m * insect.mean_chord_m;
    let scale = insect.air_density_kg_m3 * area * speed * (0.5 * speed + insect.mean_chord_m * frequency_hz);
    let wing = insect.wing_mass_kg * arm * (2.0 * PI * frequency_hz).powi(2) * PI;
    let force = NONSENSE * 2.0 * (scale + wing);
    [force, force * (arm + 1.0), force * speed]
}

/// What the results of one study must agree with.
#[derive(Debug, Clone)]
pub(crate) struct Limits {
    /// What the four means are divided by.
    scales: [f64; 4],
    model: Model,
    /// What no stroke of the study comes near: force (N), moment (N m) and power (W), of both wings.
    most: [f64; 3],
    /// Least strokes of the optimum flown again, by the place of its optimisation.
    verify_strokes: Vec<usize>,
}

impl Limits {
    /// Those of a study, unless its model is not one of this version.
    pub(super) fn of(spec: &StudySpec) -> Option<Self> {
        let study = resolve::study(spec).ok()?;
        let model = study.model;
        let verify_strokes = spec.optimisations.iter().map(|o| o.verify_strokes as usize).collect();
        let most = most(&model.insect, study.bounds.upper[at::FREQUENCY]);
        Some(Self { scales: model.insect.scales(), model: model.model, most, verify_strokes })
    }

    /// Checks the means of a flight.
    ///
    /// # Errors
    /// A sentence that says which of them do not follow from the others or from the study.
    pub(super) fn check(&self, flown: &Flown, role: JobRole, ordinal: u32) -> Result<(), String> {
        for ((si, scaled), scale) in flown.si.iter().zip(&flown.scaled).zip(self.scales) {
            for (value, over) in si.iter().zip(scaled) {
                let claimed = over * scale;
                let error = (claimed - value).abs();
                if error.is_nan() || error > ROUNDING * value.abs().max(claimed.abs()) {
                    return Err(format!("a scaled mean of {over} is not {value} over the scale {scale}"));
                }
            }
        }
        let [force, moment, power] = self.most;
        for ((value, most), output) in flown.si.iter().zip([force, force, moment, power]).zip(&OUTPUTS) {
            if value.iter().any(|number| number.abs() > most) {
                let why = format!("{} of {} +- {} is more than any wing gives", output.0, value[0], value[1]);
                return Err(why);
            }
        }
        let possible = self.strokes(role, ordinal);
        if !possible.contains(&(flown.strokes as usize)) {
            let (least, most) = possible.into_inner();
            return Err(format!("{} strokes are in the means; {least} to {most} are possible", flown.strokes));
        }
        Ok(())
    }

    /// Strokes that may be in the means of a flight.
    fn strokes(&self, role: JobRole, ordinal: u32) -> RangeInclusive<usize> {
        let Model::Uvlm(settings) = &self.model else { return 1..=1 };
        let again = match role {
            JobRole::Verify => self.verify_strokes.get(ordinal as usize),
            JobRole::Probe => self.verify_strokes.get(optimisation_of_stroke(ordinal) as usize),
            _ => None,
        };
        let flown = settings.strokes.max(again.copied().unwrap_or_default());
        let most = flown.max(settings.strokes_most);
        let kept = |strokes: usize| strokes.saturating_sub(settings.strokes_dropped).max(1);
        kept(flown)..=kept(most)
    }
}
