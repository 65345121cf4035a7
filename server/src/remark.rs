//! What is said of optima beside what jobs found: computed where they are shown, and stored nowhere.

use manduca_numerics::kinematics::Clearance;
use manduca_protocol::study::StudySpec;
use manduca_protocol::view::OptimumView;
use manduca_protocol::{paper, remarks, resolve};

/// Adds the refined strokes' clearances, the comparable strokes of the paper, and warnings. Of a study which is not valid
/// any more nothing is added.
pub(crate) fn complete(spec: &StudySpec, optima: &mut [OptimumView]) {
    let Ok(study) = resolve::study(spec) else { return };
    let clearance = Clearance::new(&study.model.insect, study.model.elevation_phase);
    for ((optimum, asked), how) in optima.iter_mut().zip(&spec.optimisations).zip(&study.optimisations) {
        let refined = optimum.search.as_ref().and_then(|search| search.standing.best.as_ref());
        optimum.refined_clearance_mm = refined.map(|best| 1e3 * clearance.of(&best.parameters.0));
        let case = paper::comparable(&study.model, &how.bounds, asked.margin_m(), asked.is_direct());
        optimum.paper = case.map(|case| case.name.to_owned());
        optimum.warnings = remarks::remarks(asked, optimum);
    }
}
