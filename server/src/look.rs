//! The only place where the coordinator flies: a stroke somebody looks at, in its turn (`turn.rs`) and at no
//! more than a limit of work, and one about which two workers differ (`beside.rs`).

use axum::body::Bytes;
use manduca_numerics::history::{Recorder, Steps, StepsError, record_while};
use manduca_numerics::simulation::{Model, SOLVER_VERSION};
use manduca_numerics::uvlm::Settings;
use manduca_protocol::flight::{SimulationView, WakeChoice};
use manduca_protocol::history::{AXES, HistoryRow, SENSE, SIDE, WakeStep};
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::resolve::{self, ResolvedModel};
use manduca_protocol::task::{SimulateOutcome, SimulateResult, SimulateTask};

use crate::turn::Key;

/// Most steps whose rings are answered.
const MOST_STEPS: usize = 32;
/// Most ring corners of one answer, some 60 bytes each.
const MOST_CORNERS: usize = 60_000;
/// A flight's work may be so many times that of the default lattice, both with the most strokes
/// they may have: that takes half a minute where the default takes a second.
pub(crate) const MOST_WORK: f64 = 30.0;

/// A stroke which may be flown here.
#[derive(Debug, Clone)]
pub(crate) struct Asked {
    task: SimulateTask,
    model: ResolvedModel,
    wake: Option<WakeChoice>,
}

impl Asked {
    /// Checks what was asked for; `at` is where its model comes from.
    ///
    /// # Errors
    /// Every fault with its JSON pointer, a flight too long among them.
    pub(crate) fn new(task: SimulateTask, wake: Option<WakeChoice>, at: &str) -> Result<Self, Vec<FieldProblem>> {
        let stroke = resolve::parameters(&task.parameters, "/parameters").err();
        let model = resolve::model(&task.model, at);
        let mut faults = stroke.unwrap_or_default();
        match &model {
            Ok(model) => faults.extend(too_much(model, wake, at)),
            Err(found) => faults.extend(found.iter().cloned()),
        }
        match model {
            Ok(model) if faults.is_empty() => Ok(Self { task, model, wake }),
            _ => Err(faults),
        }
    }

    pub(crate) fn key(&self) -> Key {
        Key::Flight(self.task.key(), self.wake)
    }

    fn steps(&self) -> Steps {
        match (&self.model.model, self.wake) {
            (Model::Uvlm(_), Some(WakeChoice::Last)) => Steps::last(),
            (Model::Uvlm(settings), Some(WakeChoice::Stroke)) => Steps::thinned(settings, MOST_STEPS, MOST_CORNERS),
            _ => Steps::none(),
        }
    }

    /// Flies it; none when told to stop.
    ///
    /// # Errors
    /// When there is no answer to what was accepted.
    pub(crate) fn fly(&self, on: &dyn Fn() -> bool) -> Result<Option<Bytes>, Failed> {
        let simulation = self.model.simulation(&self.task.parameters);
        let Some((flown, recorder)) = record_while(&simulation, &self.steps(), on)? else { return Ok(None) };
        let outcome = SimulateOutcome::of(flown).ok_or(Failed::NonFinite)?;
        Ok(Some(serde_json::to_vec(&self.view(outcome, &recorder))?.into()))
    }

    fn view(&self, outcome: SimulateOutcome, recorder: &Recorder) -> SimulationView {
        let whole = matches!(outcome, SimulateOutcome::Ok { .. });
        let last = recorder.history.last().map_or(0, |i| i.moment.stroke);
        let history = recorder.history.iter().filter(|i| whole && i.moment.stroke == last);
        let dropped = match &self.model.model {
            Model::Uvlm(settings) => settings.strokes_dropped,
            Model::QuasiSteady(_) => 0,
        };
        SimulationView {
            parameters: self.task.parameters,
            model: self.task.model.clone(),
            solver_version: SOLVER_VERSION.into(),
            outcome,
            strokes_dropped: u32::try_from(dropped).unwrap_or(u32::MAX),
            history: history.map(HistoryRow::from).collect(),
            axes: AXES.into(),
            side: SIDE.into(),
            circulation: SENSE.into(),
            wake: recorder.wakes.iter().filter(|_| whole).map(WakeStep::from).collect(),
        }
    }
}

/// The digest of a simulation's result, as the store has those of workers; none when told to stop.
///
/// # Errors
/// When it has none.
pub(crate) fn result(task: &SimulateTask, on: &dyn Fn() -> bool) -> Result<Option<[u8; 32]>, Failed> {
    let model = resolve::model(&task.model, "/model").map_err(|_| Failed::Model)?;
    let Some((flown, _)) = record_while(&model.simulation(&task.parameters), &Steps::none(), on)? else {
        return Ok(None);
    };
    let outcome = SimulateOutcome::of(flown).ok_or(Failed::NonFinite)?;
    let result = SimulateResult { outcome, solver_version: SOLVER_VERSION.into() };
    Ok(Some(*blake3::hash(&serde_json::to_vec(&result)?).as_bytes()))
}

/// Why a flight here would cost too much, or has no wake.
fn too_much(model: &ResolvedModel, wake: Option<WakeChoice>, at: &str) -> Option<FieldProblem> {
    let settings = match &model.model {
        Model::Uvlm(settings) => settings,
        Model::QuasiSteady(_) => return wake.map(|_| FieldProblem::new("/wake", StepsError::NoWake.to_string())),
    };
    let work = |settings: &Settings| settings.interactions(settings.strokes_most.max(settings.strokes));
    let times = work(settings) / work(&Settings::default());
    let why = || {
        format!(
            "a flight takes {times:.0} times the work of the default lattice, and {MOST_WORK} times is the most the \
             coordinator flies: have it flown by `manduca simulate`, or with fewer panels, steps or strokes"
        )
    };
    (times > MOST_WORK).then(|| FieldProblem::new(at, why()))
}

/// Why a stroke which was accepted has no answer.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failed {
    #[error("the model is not valid")]
    Model,
    #[error("the flight cannot be recorded")]
    Steps(#[from] StepsError),
    #[error("a mean is not finite")]
    NonFinite,
    #[error("the answer cannot be written")]
    Json(#[from] serde_json::Error),
}
