//! One stroke, flown.

use manduca_numerics::simulation;
use manduca_protocol::resolve;
use manduca_protocol::task::{SimulateOutcome, SimulateResult, SimulateTask};

use super::ComputeError;

/// Flies the stroke of a task.
///
/// # Errors
/// When the task is refused or the means are not finite; an infeasible stroke is a result.
pub fn simulate(task: &SimulateTask) -> Result<SimulateResult, ComputeError> {
    resolve::parameters(&task.parameters, "/parameters").map_err(ComputeError::Refused)?;
    let model = resolve::model(&task.model, "/model").map_err(ComputeError::Refused)?;
    let flown = simulation::simulate(&model.simulation(&task.parameters));
    let outcome = SimulateOutcome::of(flown).ok_or(ComputeError::NonFinite)?;
    Ok(SimulateResult { outcome, solver_version: simulation::SOLVER_VERSION.into() })
}
