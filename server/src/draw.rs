//! The drawing of a study's samples: a pure function of the study.

use std::cell::Cell;
use std::ops::Range;

use manduca_numerics::kinematics::Clearance;
use manduca_numerics::parameters::Point;
use manduca_numerics::sampling::sample_with_faces;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::resolve::ResolvedStudy;
use manduca_protocol::study::StudySpec;
use manduca_protocol::task::SimulateTask;

/// Strokes tried per feasible one found before the box is called infeasible. It
/// bounds the work a submission can cause.
const TRIES_PER_SAMPLE: u64 = 40;
/// Strokes tried in any case.
const TRIES_AT_LEAST: u64 = 20_000;

/// One stroke drawn: its index, its values and the key of its simulation.
#[derive(Debug, Clone)]
pub(crate) struct Drawn {
    pub(crate) ordinal: u32,
    pub(crate) point: Point,
    pub(crate) key: [u8; 32],
}

/// Draws the samples of these indices; indices without a feasible stroke are left out.
pub(crate) fn draw(spec: &StudySpec, study: &ResolvedStudy, indices: Range<u32>) -> Vec<Drawn> {
    let (margin_m, faces) = (spec.sampling.clearance_margin_mm * 1e-3, spec.sampling.faces);
    let clearance = Clearance::new(&study.model.insect, study.model.elevation_phase);
    let tries = Cell::new(TRIES_AT_LEAST);
    let accept = |x: &Point| {
        // Out of tries nothing is computed any more, and every index ends empty.
        tries.set(tries.get().saturating_sub(1));
        let accepted = tries.get() > 0 && clearance.of(x) >= margin_m;
        if accepted {
            tries.set(tries.get() + TRIES_PER_SAMPLE);
        }
        accepted
    };
    let mut drawn = Vec::with_capacity(indices.len());
    for ordinal in indices {
        if tries.get() == 0 {
            break;
        }
        if let Some(point) = sample_with_faces(&study.bounds, spec.seed, ordinal.into(), faces, &accept) {
            drawn.push(Drawn { ordinal, point, key: simulate_task(spec, &point).key() });
        }
    }
    drawn
}

/// Draws the whole first sampling of a study.
///
/// # Errors
/// When too few strokes of the box keep the wings apart.
pub(crate) fn draw_all(spec: &StudySpec, study: &ResolvedStudy) -> Result<Vec<Drawn>, FieldProblem> {
    let drawn = draw(spec, study, 0..spec.sampling.samples);
    if drawn.len() == spec.sampling.samples as usize {
        return Ok(drawn);
    }
    let margin = spec.sampling.clearance_margin_mm;
    Err(FieldProblem::new(
        "/parameters",
        format!("too few strokes within these bounds keep the wings {margin} mm from the plane of symmetry"),
    ))
}

/// The simulation of one stroke of a study.
pub(crate) fn simulate_task(spec: &StudySpec, point: &Point) -> SimulateTask {
    SimulateTask { model: spec.model.clone(), parameters: ParameterValues(*point) }
}
