//! Whether an optimum lies where it may, and is what it claims to be there.

use manduca_numerics::kinematics::Clearance;
use manduca_numerics::optimise::{Fitness, GaSettings, clamped};
use manduca_numerics::parameters::{Bounds, OUTPUTS, Point};
use manduca_numerics::surrogate::Surrogate;
use manduca_protocol::resolve::{ResolvedModel, ResolvedStudy};
use manduca_protocol::study::{OptimisationSpec, StudySpec};
use manduca_protocol::task::{OptimiseResult, Scaled};

use super::{Fault, agrees, differs, inside};
use crate::store::StoreError;

/// Error of what is computed again on another processor: relative, and for numbers near zero.
pub(super) const TOLERANCE: f64 = 1e-6;

/// One of a study's optimisations.
pub(super) struct Asked<'s> {
    pub(super) spec: &'s OptimisationSpec,
    pub(super) bounds: Bounds,
    pub(super) ga: GaSettings,
    pub(super) model: &'s ResolvedModel,
    clearance: Clearance,
}

impl<'s> Asked<'s> {
    /// The optimisation in this place of its study.
    ///
    /// # Errors
    /// When there is none.
    pub(super) fn new(spec: &'s StudySpec, study: &'s ResolvedStudy, place: u32) -> Result<Self, StoreError> {
        let found = spec.optimisations.get(place as usize).zip(study.optimisations.get(place as usize));
        let missing = || StoreError::Corrupt(format!("the study has no optimisation {place}"));
        let (spec, resolved) = found.ok_or_else(missing)?;
        let clearance = Clearance::new(&study.model.insect, study.model.elevation_phase);
        Ok(Self { spec, bounds: resolved.bounds, ga: resolved.ga, model: &study.model, clearance })
    }

    /// Checks fitness, penalty and clearance of a point with these means.
    pub(super) fn judge(&self, claimed: &OptimiseResult) -> Result<(), Fault> {
        let point = &claimed.parameters.0;
        inside(&self.bounds, point)?;
        self.clear(point, claimed.clearance_mm)?;
        let score = self.fitness().judge(point, four(&claimed.predicted), claimed.clearance_mm * 1e-3);
        for (name, claim, found) in
            [("fitness", claimed.fitness, score.fitness), ("penalty", claimed.penalty, score.penalty)]
        {
            // A penalty is a factor times what may be rounding.
            let least = TOLERANCE * (1.0 + self.spec.penalty_r + self.spec.penalty_s);
            if !agrees(claim, found, TOLERANCE, least) {
                let why = format!("the {name} of the optimum is {found}, not {claim} as claimed");
                return Err(differs(claim, found, why));
            }
        }
        Ok(())
    }

    fn fitness(&self) -> Fitness {
        Fitness {
            bounds: self.bounds,
            margin_m: self.spec.margin_m(),
            penalty_r: self.spec.penalty_r,
            penalty_s: self.spec.penalty_s,
        }
    }

    /// Fitness of an individual which was flown with these means at the nearest point of the box.
    pub(super) fn fitness_of(&self, individual: &Point, means: [f64; 4]) -> f64 {
        let clearance_m = self.clearance.of(&clamped(&self.bounds, individual));
        self.fitness().judge(individual, means, clearance_m).fitness
    }

    fn clear(&self, point: &Point, claimed_mm: f64) -> Result<(), Fault> {
        let found = self.clearance.of(point) * 1e3;
        if agrees(claimed_mm, found, TOLERANCE, TOLERANCE) {
            return Ok(());
        }
        let why = format!("the wings keep {found} mm at the optimum, not {claimed_mm} mm as claimed");
        Err(differs(claimed_mm, found, why))
    }
}

pub(super) fn four(s: &Scaled) -> [f64; 4] {
    [s.lift, s.drag, s.pitch_moment, s.power]
}

/// Checks an optimum against the surrogate it was found on.
pub(super) fn check(asked: &Asked<'_>, surrogate: &Surrogate, claimed: &OptimiseResult) -> Result<(), Fault> {
    inside(&asked.bounds, &claimed.parameters.0)?;
    predicted(surrogate, &claimed.parameters.0, &claimed.predicted)?;
    asked.judge(claimed)?;
    if claimed.history.len() > asked.spec.generations() as usize {
        return Err(format!("{} generations are more than were asked for", claimed.history.len()).into());
    }
    let Some(known) = &claimed.optimality else { return Ok(()) };
    if known.starts > asked.spec.starts || known.converged > known.starts {
        return Err(format!("{} of {} descents are more than were asked for", known.converged, known.starts).into());
    }
    known.optima.iter().try_for_each(|local| {
        inside(&asked.bounds, &local.parameters.0)?;
        predicted(surrogate, &local.parameters.0, &local.predicted)?;
        asked.clear(&local.parameters.0, local.clearance_mm)
    })
}

fn predicted(surrogate: &Surrogate, point: &Point, claimed: &Scaled) -> Result<(), Fault> {
    let found = surrogate.predict(point);
    for ((name, ..), (claim, found)) in OUTPUTS.iter().zip(four(claimed).into_iter().zip(found)) {
        if !agrees(claim, found, TOLERANCE, TOLERANCE) {
            let why = format!("the surrogate predicts {name} {found} at the optimum, not {claim} as claimed");
            return Err(differs(claim, found, why));
        }
    }
    Ok(())
}
