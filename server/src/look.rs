//! A stroke flown for who looks at one: the only place where the coordinator flies, and
//! bounded in every way. One flies at a time, a few wait, each costs no more than a limit,
//! and the last answers are kept.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use axum::body::Bytes;
use manduca_numerics::history::{Recorder, Steps, StepsError, record_while};
use manduca_numerics::simulation::{Model, SOLVER_VERSION};
use manduca_numerics::uvlm::Settings;
use manduca_protocol::flight::{SimulationView, WakeChoice};
use manduca_protocol::history::{AXES, HistoryRow, SENSE, SIDE, WakeStep};
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::resolve::{self, ResolvedModel};
use manduca_protocol::task::{SimulateOutcome, SimulateTask};
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;

use crate::error::ApiError;

/// Strokes which wait for the one that flies.
pub(crate) const QUEUE: usize = 8;
/// Answers kept; one has at most some 4 MB.
const KEPT: usize = 16;
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

    fn key(&self) -> Key {
        (self.task.key(), self.wake)
    }

    fn steps(&self) -> Steps {
        match (&self.model.model, self.wake) {
            (Model::Uvlm(_), Some(WakeChoice::Last)) => Steps::last(),
            (Model::Uvlm(settings), Some(WakeChoice::Stroke)) => Steps::thinned(settings, MOST_STEPS, MOST_CORNERS),
            _ => Steps::none(),
        }
    }

    /// Flies it; none when told to stop.
    fn fly(&self, on: &dyn Fn() -> bool) -> Result<Option<Bytes>, Failed> {
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
enum Failed {
    #[error("the flight cannot be recorded")]
    Steps(#[from] StepsError),
    #[error("a mean is not finite")]
    NonFinite,
    #[error("the answer cannot be written")]
    Json(#[from] serde_json::Error),
}

type Key = ([u8; 32], Option<WakeChoice>);

/// Strokes being flown and flown.
#[derive(Debug)]
pub(crate) struct Looks {
    flying: Arc<Semaphore>,
    places: Arc<Semaphore>,
    answers: Mutex<VecDeque<(Key, Bytes)>>,
}

impl Default for Looks {
    fn default() -> Self {
        let (flying, places) = (Arc::new(Semaphore::new(1)), Arc::new(Semaphore::new(1 + QUEUE)));
        Self { flying, places, answers: Mutex::default() }
    }
}

impl Looks {
    /// Flies what was asked for, unless it is known. A client which hangs up stops its flight,
    /// and so does a coordinator which is `stopping`.
    ///
    /// # Errors
    /// When too many wait, or the coordinator stops.
    pub(crate) async fn at(&self, asked: Asked, stopping: &CancellationToken) -> Result<Bytes, ApiError> {
        let key = asked.key();
        if let Some(known) = self.known(&key) {
            return Ok(known);
        }
        let place = self.places.clone().try_acquire_owned().map_err(|_| ApiError::Busy)?;
        let turn = tokio::select! {
            () = stopping.cancelled() => return Err(ApiError::Stopping),
            turn = self.flying.clone().acquire_owned() => turn.map_err(|_| ApiError::Stopping)?,
        };
        // The same may have been asked for while this one waited.
        if let Some(known) = self.known(&key) {
            return Ok(known);
        }
        let stop = stopping.child_token();
        let hung_up = stop.clone().drop_guard();
        let flight = tokio::task::spawn_blocking(move || {
            let flown = asked.fly(&|| !stop.is_cancelled());
            // Held until the flight has ended, whoever still waits for it.
            drop((place, turn));
            flown
        });
        let flown = flight.await.map_err(|e| ApiError::Internal(Box::new(e)))?;
        drop(hung_up);
        let answer = flown.map_err(|e| ApiError::Internal(Box::new(e)))?.ok_or(ApiError::Stopping)?;
        self.keep(key, answer.clone());
        Ok(answer)
    }

    fn known(&self, key: &Key) -> Option<Bytes> {
        let mut answers = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
        let place = answers.iter().position(|(known, _)| known == key)?;
        // What is asked for again is forgotten last.
        let entry = answers.remove(place)?;
        answers.push_back(entry);
        answers.back().map(|(_, answer)| answer.clone())
    }

    fn keep(&self, key: Key, answer: Bytes) {
        let mut answers = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
        answers.push_back((key, answer));
        while answers.len() > KEPT {
            answers.pop_front();
        }
    }
}
