//! Tasks are composed from the study when they are needed: nothing is stored twice.

use manduca_numerics::uvlm;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::resolve::{ResolvedOptimisation, ResolvedStudy};
use manduca_protocol::search::{FlownMessage, SearchState, SearchTask};
use manduca_protocol::study::{ModelKind, OptimisationSpec, StudySpec};
use manduca_protocol::task::{Checkpoint, OptimiseTask, SimulateTask, SurrogateMessage, Task, TrainSample, TrainTask};
use manduca_protocol::view::JobRole;
use manduca_protocol::worker::Lease;

use crate::config::RunLimits;
use crate::draw::simulate_task;
use crate::store::{Leased, StoreError, kind_of, optimisation_of_stroke, round_of};

/// The lease of a job as the worker gets it: simulations with their task, the
/// rest to be fetched, for their tasks are large.
pub(crate) fn lease(leased: &Leased, limits: &RunLimits) -> Result<Lease, StoreError> {
    let kind = kind_of(leased.role);
    let task = match &leased.parameters {
        Some(parameters) => Some(simulation(&leased.spec, leased.role, leased.ordinal, parameters)?),
        None => None,
    };
    Ok(Lease {
        job: leased.job,
        attempt: leased.attempt,
        study: leased.study,
        kind,
        run_limit_s: limits.of(kind).as_secs_f64(),
        task,
    })
}

/// The task of a simulation whose stroke is stored.
pub(crate) fn simulation(spec: &StudySpec, role: JobRole, ordinal: u32, parameters: &str) -> Result<Task, StoreError> {
    let point = serde_json::from_str(parameters).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    Ok(Task::Simulate(match role {
        JobRole::Verify => verify_task(spec, ordinal, ParameterValues(point)),
        _ => stroke_task(spec, role, ordinal, ParameterValues(point)),
    }))
}

/// The simulation which flies an optimum again, over more strokes than a sample.
pub(crate) fn verify_task(spec: &StudySpec, ordinal: u32, parameters: ParameterValues) -> SimulateTask {
    let mut model = spec.model.clone();
    let asked = spec.optimisations.get(ordinal as usize).map_or(0, |o| o.verify_strokes);
    if model.kind == ModelKind::Uvlm {
        let sampled = model.solver.get("strokes").copied().unwrap_or(uvlm::Settings::default().strokes as f64);
        if f64::from(asked) > sampled {
            model.solver.insert("strokes".into(), asked.into());
        }
    }
    SimulateTask { model, parameters }
}

/// The simulation of a stroke which is sampled, or which a search asked for: refining flies
/// as exactly as an optimum, a generation as a sample.
pub(crate) fn stroke_task(spec: &StudySpec, role: JobRole, ordinal: u32, parameters: ParameterValues) -> SimulateTask {
    match role {
        JobRole::Probe => verify_task(spec, optimisation_of_stroke(ordinal), parameters),
        _ => simulate_task(spec, &parameters.0),
    }
}

/// The training on a study's samples, from where an earlier attempt stood.
pub(crate) fn train_task(
    spec: &StudySpec,
    study: &ResolvedStudy,
    dataset: Vec<TrainSample>,
    checkpoint: Option<Checkpoint>,
) -> Task {
    let (checkpoint, fit) = match checkpoint {
        Some(Checkpoint::Train(at)) => (Some(at), None),
        Some(Checkpoint::Fit(at)) => (None, Some(Box::new(at))),
        None => (None, None),
    };
    Task::Train(TrainTask {
        surrogate: spec.surrogate.clone(),
        seed: spec.seed,
        bounds: (&study.bounds).into(),
        dataset,
        model: spec.model.clone(),
        checkpoint,
        fit,
    })
}

/// One of a study's optimisations, as asked for and checked.
fn optimisation<'a>(
    spec: &'a StudySpec,
    study: &'a ResolvedStudy,
    ordinal: u32,
) -> Result<(&'a OptimisationSpec, &'a ResolvedOptimisation), StoreError> {
    let found = spec.optimisations.get(ordinal as usize).zip(study.optimisations.get(ordinal as usize));
    found.ok_or_else(|| StoreError::Corrupt(format!("the study has no optimisation {ordinal}")))
}

/// One of a study's optimisations on its surrogate.
pub(crate) fn optimise_task(
    spec: &StudySpec,
    study: &ResolvedStudy,
    ordinal: u32,
    surrogate: SurrogateMessage,
) -> Result<Task, StoreError> {
    let (optimisation, resolved) = optimisation(spec, study, ordinal)?;
    Ok(Task::Optimise(OptimiseTask {
        model: spec.model.clone(),
        bounds: (&resolved.bounds).into(),
        optimisation: optimisation.clone(),
        seed: spec.seed,
        surrogate,
    }))
}

/// A round of one of a study's searches, after what the round before left and the strokes it asked for.
pub(crate) fn search_task(
    spec: &StudySpec,
    study: &ResolvedStudy,
    ordinal: u32,
    surrogate: Option<SurrogateMessage>,
    state: SearchState,
    flown: Vec<FlownMessage>,
) -> Result<Task, StoreError> {
    let (index, _) = round_of(ordinal);
    let (optimisation, resolved) = optimisation(spec, study, index)?;
    Ok(Task::Search(SearchTask {
        model: spec.model.clone(),
        bounds: (&resolved.bounds).into(),
        optimisation: optimisation.clone(),
        seed: spec.seed,
        surrogate,
        state,
        flown,
    }))
}
