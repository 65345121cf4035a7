//! What a flight looks like step by step: loads and power over time, and the
//! vortex rings of chosen steps.

use std::fmt;
use std::str::FromStr;

use crate::kinematics::{ElevationPhase, Stroke, Vector};
use crate::math::sin_cos;
use crate::simulation::{Infeasible, Means, Model, Moment, Simulation, simulate_watched, simulate_while};
use crate::uvlm::{Rings, Settings, Solver};

/// Most ring corners kept of one flight; a corner takes 24 bytes here and some 70 in JSON.
pub const MOST_CORNERS: usize = 5_000_000;

/// One entry of a list of steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Choice {
    /// The flight's last step.
    Last,
    /// Of the last stroke every so manieth step, from its first.
    Every(usize),
    /// One step: stroke from 1, step from 0.
    At { stroke: usize, step: usize },
}

/// Steps of a flight, such as `last`, `all` (of the last stroke), `all/4` (every fourth of
/// them) or `7:0,7:12` (stroke from 1, step from 0).
///
/// ```
/// use manduca_numerics::history::Steps;
/// assert_eq!("7:0, last".parse::<Steps>().map(|s| s.to_string()), Ok("7:0,last".into()));
/// assert!("7-0".parse::<Steps>().is_err());
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Steps(Vec<Choice>);

/// Why steps cannot be kept.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StepsError {
    /// An entry is none.
    #[error("`{0}` is no step: expected last, all, all/N, or STROKE:STEP such as 7:0, with commas between")]
    Unreadable(String),
    /// A stroke which is not flown.
    #[error("{stroke}:{step}: there are strokes 1 to {strokes}")]
    Stroke {
        /// The stroke asked for.
        stroke: usize,
        /// The step asked for.
        step: usize,
        /// Strokes flown.
        strokes: usize,
    },
    /// A step a stroke does not have.
    #[error("{stroke}:{step}: a stroke has steps 0 to {last}")]
    Step {
        /// The stroke asked for.
        stroke: usize,
        /// The step asked for.
        step: usize,
        /// The last step of a stroke.
        last: usize,
    },
    /// Blade elements shed no vortices.
    #[error("the quasi-steady model has no wake")]
    NoWake,
    /// More than fits in memory and in anyone's plot.
    #[error("these steps have {corners} ring corners, and at most {MOST_CORNERS} are kept: choose fewer steps")]
    TooMany {
        /// Corners of all rings of all steps chosen.
        corners: usize,
    },
}

impl FromStr for Steps {
    type Err = StepsError;

    fn from_str(text: &str) -> Result<Self, StepsError> {
        let entry = |entry: &str| match entry.trim() {
            "last" => Ok(Choice::Last),
            "all" => Ok(Choice::Every(1)),
            other => {
                if let Some(n) = other.strip_prefix("all/").and_then(|n| n.parse().ok()).filter(|n| *n > 0) {
                    return Ok(Choice::Every(n));
                }
                let numbers = other.split_once(':').and_then(|(s, n)| Some((s.parse().ok()?, n.parse().ok()?)));
                let (stroke, step) = numbers.ok_or_else(|| StepsError::Unreadable(other.to_owned()))?;
                Ok(Choice::At { stroke, step })
            }
        };
        text.split(',').map(entry).collect::<Result<_, _>>().map(Self)
    }
}

impl fmt::Display for Steps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, choice) in self.0.iter().enumerate() {
            let comma = if i > 0 { "," } else { "" };
            match choice {
                Choice::Last => write!(f, "{comma}last")?,
                Choice::Every(1) => write!(f, "{comma}all")?,
                Choice::Every(n) => write!(f, "{comma}all/{n}")?,
                Choice::At { stroke, step } => write!(f, "{comma}{stroke}:{step}")?,
            }
        }
        Ok(())
    }
}

impl Steps {
    /// No step at all.
    pub fn none() -> Self {
        Self::default()
    }

    /// The flight's last step.
    pub fn last() -> Self {
        Self(vec![Choice::Last])
    }

    /// Every `n`-th step of the last stroke, from its first; 0 counts as 1.
    pub fn every(n: usize) -> Self {
        Self(vec![Choice::Every(n.max(1))])
    }

    /// Steps of the last stroke, evenly thinned until they are at most `steps` with at most
    /// `corners` ring corners in all.
    pub fn thinned(settings: &Settings, steps: usize, corners: usize) -> Self {
        let fits =
            |n: &usize| settings.steps_per_stroke.div_ceil(*n) <= steps && Self::every(*n).corners(settings) <= corners;
        let n = (1..settings.steps_per_stroke).find(fits).unwrap_or(settings.steps_per_stroke);
        Self::every(n)
    }

    /// Ring corners of these steps of a flight, at most.
    fn corners(&self, settings: &Settings) -> usize {
        let (strokes, steps) = (settings.strokes, settings.steps_per_stroke);
        let longest = (settings.wake_strokes * steps as f64).round().max(1.0) as usize;
        let first = if self.0.iter().any(|c| matches!(c, Choice::At { .. })) { 0 } else { (strokes - 1) * steps };
        (first..strokes * steps)
            .filter(|flown| self.has(settings, flown / steps + 1, flown % steps))
            .map(|flown| (settings.chordwise_panels + 1 + flown.min(longest)) * (settings.spanwise_panels + 1))
            .sum()
    }

    /// Whether a step is one of those asked for by number.
    fn name(&self, stroke: usize, step: usize) -> bool {
        self.0.contains(&Choice::At { stroke, step })
    }

    /// Whether a step is chosen, if no further stroke is flown.
    fn has(&self, settings: &Settings, stroke: usize, step: usize) -> bool {
        let of_last = |choice: &Choice| match choice {
            Choice::Last => step + 1 == settings.steps_per_stroke,
            Choice::Every(n) => step.is_multiple_of(*n),
            Choice::At { .. } => false,
        };
        self.name(stroke, step) || stroke >= settings.strokes && self.0.iter().any(of_last)
    }

    /// The steps a flight at these settings has, one after the other from its start.
    fn check(&self, settings: &Settings) -> Result<(), StepsError> {
        let (strokes, steps) = (settings.strokes, settings.steps_per_stroke);
        for choice in &self.0 {
            if let Choice::At { stroke, step } = *choice {
                if !(1..=strokes).contains(&stroke) {
                    return Err(StepsError::Stroke { stroke, step, strokes });
                }
                if step >= steps {
                    return Err(StepsError::Step { stroke, step, last: steps - 1 });
                }
            }
        }
        let corners = self.corners(settings);
        if corners > MOST_CORNERS { Err(StepsError::TooMany { corners }) } else { Ok(()) }
    }
}

/// One step with its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instant {
    /// Time since the flight began, s.
    pub time_s: f64,
    /// Angles, loads and power.
    pub moment: Moment,
}

/// The vortex rings of one step: the left wing's, first the wing, then its wake from
/// young to old. The right wing's are the mirror image in y = 0, where every
/// circulation turns the other way.
///
/// Positive circulation runs from corner (row, column + 1) to (row, column) and on
/// to (row + 1, column).
#[derive(Debug, Clone, PartialEq)]
pub struct Wake {
    /// Number of the stroke, from 1.
    pub stroke: usize,
    /// Number of the step in its stroke, from 0.
    pub step: usize,
    /// Time since the stroke began, in strokes.
    pub phase: f64,
    /// Time since the flight began, s.
    pub time_s: f64,
    /// Corners in a row, from root to tip.
    pub columns: usize,
    /// Rows of corners on the wing; the last is the line from which the wake springs.
    pub wing_rows: usize,
    /// Corners row by row, m, in earth axes: forward, to the left, up, from midway
    /// between the hinges. The stroke plane is tilted in them, forward edge down.
    pub corners: Vec<[f64; 3]>,
    /// Circulations row by row, m²/s: one row and one column fewer than corners.
    pub circulation: Vec<f64>,
}

/// Collects what a flight shows: hand [`Recorder::watch`] every step.
#[derive(Debug, Clone)]
pub struct Recorder {
    /// Every step flown, in order.
    pub history: Vec<Instant>,
    /// The rings of the steps chosen, in order.
    pub wakes: Vec<Wake>,
    chosen: Option<(Settings, Steps)>,
    period: f64,
    /// Sine and cosine of the stroke plane angle.
    tilt: (f64, f64),
}

impl Recorder {
    /// For one flight of `simulation`, keeping the rings of `steps`.
    ///
    /// # Errors
    /// When the flight has no such steps, no wake, or they are too many.
    pub fn new(simulation: &Simulation, steps: &Steps) -> Result<Self, StepsError> {
        let chosen = match &simulation.model {
            _ if steps.0.is_empty() => None,
            Model::Uvlm(settings) => {
                steps.check(settings)?;
                Some((*settings, steps.clone()))
            }
            Model::QuasiSteady(_) => return Err(StepsError::NoWake),
        };
        // Neither period nor tilt depends on the elevation.
        let stroke = Stroke::new(&simulation.parameters, ElevationPhase::Plus);
        let (period, tilt) = (stroke.period(), sin_cos(stroke.stroke_plane));
        Ok(Self { history: Vec::new(), wakes: Vec::new(), chosen, period, tilt })
    }

    /// Keeps a step.
    pub fn watch(&mut self, moment: &Moment, solver: Option<&Solver>) {
        let time_s = ((moment.stroke - 1) as f64 + moment.phase) * self.period;
        self.history.push(Instant { time_s, moment: *moment });
        let (Some((settings, steps)), Some(solver)) = (&self.chosen, solver) else { return };
        if moment.step == 0 && moment.stroke > settings.strokes {
            // Another stroke is flown for the standard errors: the one before was not the last.
            self.wakes.retain(|w| steps.name(w.stroke, w.step));
        }
        if steps.has(settings, moment.stroke, moment.step) {
            let wake = self.wake(moment, time_s, &solver.rings());
            self.wakes.push(wake);
        }
    }

    fn wake(&self, moment: &Moment, time_s: f64, rings: &Rings<'_>) -> Wake {
        let (s, c) = self.tilt;
        let [x, y, z] = rings.nodes;
        let level = |i: usize| Vector::new(x[i] * c + z[i] * s, y[i], z[i] * c - x[i] * s).into();
        Wake {
            stroke: moment.stroke,
            step: moment.step,
            phase: moment.phase,
            time_s,
            columns: rings.columns,
            wing_rows: rings.bound_rows,
            corners: (0..x.len()).map(level).collect(),
            circulation: rings.circulation.to_vec(),
        }
    }
}

/// What a flight ended with, and what was recorded of it.
pub type Recorded = (Result<Means, Infeasible>, Recorder);

/// Flies a simulation and records it. A flight which breaks off is recorded as far as it went.
///
/// # Errors
/// When the steps cannot be kept; nothing is flown then.
pub fn record(simulation: &Simulation, steps: &Steps) -> Result<Recorded, StepsError> {
    let mut recorder = Recorder::new(simulation, steps)?;
    let flown = simulate_watched(simulation, &mut |moment, solver| recorder.watch(moment, solver));
    Ok((flown, recorder))
}

/// [`record`] for as long as `on` says at each step; none where it did not.
///
/// # Errors
/// When the steps cannot be kept; nothing is flown then.
pub fn record_while(
    simulation: &Simulation,
    steps: &Steps,
    on: &dyn Fn() -> bool,
) -> Result<Option<Recorded>, StepsError> {
    let mut recorder = Recorder::new(simulation, steps)?;
    let flown = simulate_while(simulation, &mut |moment, solver| {
        recorder.watch(moment, solver);
        on()
    });
    Ok(flown.transpose().map(|flown| (flown, recorder)))
}

#[cfg(test)]
#[path = "history_tests.rs"]
mod tests;
