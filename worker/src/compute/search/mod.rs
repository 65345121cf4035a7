//! A round of a search which asks for simulations.

mod breed;
mod refine;

use manduca_numerics::insect::Insect;
use manduca_protocol::resolve;
use manduca_protocol::search::{SearchResult, SearchState, SearchTask};
use manduca_protocol::task::ScaledEstimates;

use super::ComputeError;

pub(super) use breed::stopped;

/// Proposes the next strokes of a search, or ends it.
pub(super) fn search(task: &SearchTask) -> Result<SearchResult, ComputeError> {
    let model = resolve::model(&task.model, "/model").map_err(ComputeError::Refused)?;
    match &task.state {
        SearchState::Breed(state) => breed::breed(task, &model, state),
        SearchState::Refine(state) => refine::refine(task, &model, state),
    }
}

/// `[L+, D+, M+, P+]` and their standard errors.
fn means(s: &ScaledEstimates) -> ([f64; 4], [f64; 4]) {
    let all = [&s.lift, &s.drag, &s.pitch_moment, &s.power];
    (all.map(|e| e.mean), all.map(|e| e.se))
}

/// Power per lift of `[L+, D+, M+, P+]`, W/N; none where nothing is lifted.
fn power_per_lift(insect: &Insect, y: &[f64; 4]) -> Option<f64> {
    let scales = insect.scales();
    Some(y[3] * scales[3] / (y[0] * scales[0])).filter(|p| p.is_finite() && y[0] > 0.0)
}
