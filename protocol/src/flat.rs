//! Tagged objects as they are read.
//!
//! Serde keeps every field of an internally tagged enum in memory, in a form of many times its
//! size, until it knows which variant they belong to. Here all fields of all variants stand in one
//! structure, so that each value is read straight into its type, whatever the order of the fields.
//! Names of fields differ between the variants of one enum, or mean the same.

use serde::Deserialize;

use crate::optimum::{GenerationMessage, Optimality, OptimiseResult};
use crate::point::ParameterValues;
use crate::search::{
    BreedState, FlownMessage, RefineState, SearchNext, SearchResult, SearchState, Standing, TrimPrices,
};
use crate::strict;
use crate::task::{
    Checkpoint, JobKind, JobResult, JointPowers, MeansMessage, Scaled, ScaledEstimates, SimulateOutcome, SimulateResult,
};
use crate::training::{
    AscentMessage, EpochMessage, ErrorsMessage, FitCheckpoint, FrameMessage, MemberMessage, NetworkMessage,
    SurrogateMessage, TrainCheckpoint, TrainResult,
};

/// A field which must be there.
fn need<T>(field: Option<T>, name: &str) -> Result<T, String> {
    field.ok_or_else(|| format!("missing field `{name}`"))
}

/// Refuses fields of other variants: each is a name and whether it was given.
fn refuse(given: &[(&str, bool)], of: &str) -> Result<(), String> {
    match given.iter().find(|(_, given)| *given) {
        Some((name, _)) => Err(format!("unknown field `{name}`, which {of} does not have")),
        None => Ok(()),
    }
}

/// Names of these fields with whether they were given.
macro_rules! given {
    ($from:ident: $($field:ident),+) => { [$((stringify!($field), $from.$field.is_some())),+] };
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum OutcomeTag {
    Ok,
    Infeasible,
}

/// Every field of [`JobResult`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ResultFields {
    kind: JobKind,
    solver_version: String,
    // Of a simulation.
    outcome: Option<OutcomeTag>,
    means: Option<MeansMessage>,
    scaled: Option<ScaledEstimates>,
    joints: Option<JointPowers>,
    power_per_lift_w_per_n: Option<f64>,
    strokes_averaged: Option<u32>,
    reason: Option<String>,
    // Of a training.
    surrogate: Option<SurrogateMessage>,
    curve: Option<Vec<EpochMessage>>,
    #[serde(default, deserialize_with = "strict::few_given")]
    best_iterations: Option<Vec<u32>>,
    #[serde(default, deserialize_with = "strict::few_given")]
    stops: Option<Vec<String>>,
    train: Option<ErrorsMessage>,
    validation: Option<ErrorsMessage>,
    test: Option<ErrorsMessage>,
    // Of an optimisation.
    parameters: Option<ParameterValues>,
    predicted: Option<Scaled>,
    fitness: Option<f64>,
    penalty: Option<f64>,
    clearance_mm: Option<f64>,
    history: Option<Vec<GenerationMessage>>,
    stopped: Option<String>,
    evaluations: Option<u64>,
    optimality: Option<Optimality>,
    // Of a round of a search.
    next: Option<SearchNext>,
    standing: Option<Standing>,
}

impl ResultFields {
    fn of_simulation(&self) -> [(&'static str, bool); 7] {
        given!(self: outcome, means, scaled, joints, power_per_lift_w_per_n, strokes_averaged, reason)
    }

    fn of_training(&self) -> [(&'static str, bool); 7] {
        given!(self: surrogate, curve, best_iterations, stops, train, validation, test)
    }

    fn of_optimisation(&self) -> [(&'static str, bool); 9] {
        given!(self: parameters, predicted, fitness, penalty, clearance_mm, history, stopped, evaluations, optimality)
    }

    fn of_search(&self) -> [(&'static str, bool); 2] {
        given!(self: next, standing)
    }

    /// Refuses fields of other kinds than this one's.
    fn only(&self, kind: JobKind, of: &str) -> Result<(), String> {
        let kinds: [(JobKind, &[(&str, bool)]); 4] = [
            (JobKind::Simulate, &self.of_simulation()),
            (JobKind::Train, &self.of_training()),
            (JobKind::Optimise, &self.of_optimisation()),
            (JobKind::Search, &self.of_search()),
        ];
        kinds.iter().filter(|(other, _)| *other != kind).try_for_each(|(_, fields)| refuse(fields, of))
    }

    fn simulation(self) -> Result<SimulateResult, String> {
        self.only(JobKind::Simulate, "a simulation's result")?;
        SimulateFields {
            outcome: need(self.outcome, "outcome")?,
            means: self.means,
            scaled: self.scaled,
            joints: self.joints,
            power_per_lift_w_per_n: self.power_per_lift_w_per_n,
            strokes_averaged: self.strokes_averaged,
            reason: self.reason,
            solver_version: self.solver_version,
        }
        .try_into()
    }

    fn training(self) -> Result<TrainResult, String> {
        self.only(JobKind::Train, "a training's result")?;
        Ok(TrainResult {
            surrogate: need(self.surrogate, "surrogate")?,
            curve: need(self.curve, "curve")?,
            best_iterations: need(self.best_iterations, "best_iterations")?,
            stops: need(self.stops, "stops")?,
            train: need(self.train, "train")?,
            validation: need(self.validation, "validation")?,
            test: need(self.test, "test")?,
            solver_version: self.solver_version,
        })
    }

    fn optimisation(self) -> Result<OptimiseResult, String> {
        self.only(JobKind::Optimise, "an optimisation's result")?;
        Ok(OptimiseResult {
            parameters: need(self.parameters, "parameters")?,
            predicted: need(self.predicted, "predicted")?,
            fitness: need(self.fitness, "fitness")?,
            penalty: need(self.penalty, "penalty")?,
            clearance_mm: need(self.clearance_mm, "clearance_mm")?,
            history: need(self.history, "history")?,
            stopped: need(self.stopped, "stopped")?,
            evaluations: need(self.evaluations, "evaluations")?,
            optimality: self.optimality,
            solver_version: self.solver_version,
        })
    }

    fn search(self) -> Result<SearchResult, String> {
        self.only(JobKind::Search, "a search's result")?;
        let (next, standing) = (need(self.next, "next")?, need(self.standing, "standing")?);
        Ok(SearchResult { next, standing, solver_version: self.solver_version })
    }
}

impl TryFrom<ResultFields> for JobResult {
    type Error = String;

    fn try_from(fields: ResultFields) -> Result<Self, String> {
        Ok(match fields.kind {
            JobKind::Simulate => Self::Simulate(Box::new(fields.simulation()?)),
            JobKind::Train => Self::Train(Box::new(fields.training()?)),
            JobKind::Optimise => Self::Optimise(Box::new(fields.optimisation()?)),
            JobKind::Search => Self::Search(Box::new(fields.search()?)),
        })
    }
}

/// Every field of [`SimulateResult`].
#[derive(Deserialize)]
pub(crate) struct SimulateFields {
    outcome: OutcomeTag,
    means: Option<MeansMessage>,
    scaled: Option<ScaledEstimates>,
    joints: Option<JointPowers>,
    power_per_lift_w_per_n: Option<f64>,
    strokes_averaged: Option<u32>,
    reason: Option<String>,
    solver_version: String,
}

impl TryFrom<SimulateFields> for SimulateResult {
    type Error = String;

    fn try_from(fields: SimulateFields) -> Result<Self, String> {
        let outcome = match fields.outcome {
            OutcomeTag::Ok => {
                refuse(&given!(fields: reason), "a flown stroke")?;
                SimulateOutcome::Ok {
                    means: need(fields.means, "means")?,
                    scaled: need(fields.scaled, "scaled")?,
                    joints: need(fields.joints, "joints")?,
                    power_per_lift_w_per_n: fields.power_per_lift_w_per_n,
                    strokes_averaged: need(fields.strokes_averaged, "strokes_averaged")?,
                }
            }
            OutcomeTag::Infeasible => {
                let others = given!(fields: means, scaled, joints, power_per_lift_w_per_n, strokes_averaged);
                refuse(&others, "an infeasible stroke")?;
                SimulateOutcome::Infeasible { reason: need(fields.reason, "reason")? }
            }
        };
        Ok(Self { outcome, solver_version: fields.solver_version })
    }
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum CheckpointTag {
    Train,
    Fit,
}

/// Every field of [`Checkpoint`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CheckpointFields {
    kind: CheckpointTag,
    members: Option<Vec<MemberMessage>>,
    network: Option<NetworkMessage>,
    objective: Option<f64>,
    damping: Option<f64>,
    growth: Option<f64>,
    curve: Option<Vec<EpochMessage>>,
    best: Option<NetworkMessage>,
    ascents: Option<Vec<AscentMessage>>,
}

impl TryFrom<CheckpointFields> for Checkpoint {
    type Error = String;

    fn try_from(fields: CheckpointFields) -> Result<Self, String> {
        match fields.kind {
            CheckpointTag::Train => {
                refuse(&given!(fields: ascents), "the checkpoint of a training")?;
                Ok(Self::Train(Box::new(TrainCheckpoint {
                    members: need(fields.members, "members")?,
                    network: need(fields.network, "network")?,
                    objective: need(fields.objective, "objective")?,
                    damping: need(fields.damping, "damping")?,
                    growth: need(fields.growth, "growth")?,
                    curve: need(fields.curve, "curve")?,
                    best: need(fields.best, "best")?,
                })))
            }
            CheckpointTag::Fit => {
                let others = given!(fields: members, network, objective, damping, growth, curve, best);
                refuse(&others, "the checkpoint of a fit")?;
                Ok(Self::Fit(FitCheckpoint { ascents: need(fields.ascents, "ascents")? }))
            }
        }
    }
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum FeaturesTag {
    Paper,
    Physical,
}

/// Every field of [`FrameMessage`].
#[derive(Deserialize)]
pub(crate) struct FrameFields {
    features: FeaturesTag,
    reference_hz: Option<f64>,
    arm: Option<[f64; 2]>,
    mirror: Option<bool>,
    #[serde(default)]
    sharpness: bool,
}

impl TryFrom<FrameFields> for FrameMessage {
    type Error = String;

    fn try_from(fields: FrameFields) -> Result<Self, String> {
        Ok(match fields.features {
            FeaturesTag::Paper => Self::Paper,
            FeaturesTag::Physical => Self::Physical {
                reference_hz: need(fields.reference_hz, "reference_hz")?,
                arm: need(fields.arm, "arm")?,
                mirror: need(fields.mirror, "mirror")?,
                sharpness: fields.sharpness,
            },
        })
    }
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum SearchTag {
    Breed,
    Refine,
}

/// Every field of [`SearchState`].
#[derive(Deserialize)]
pub(crate) struct StateFields {
    search: SearchTag,
    genes: Option<Vec<[f64; 10]>>,
    #[serde(default, deserialize_with = "strict::elite_given")]
    elite: Option<Vec<Option<f64>>>,
    history: Option<Vec<[Option<f64>; 2]>>,
    best: Option<([f64; 10], f64)>,
    champion: Option<FlownMessage>,
    simulations: Option<u32>,
    round: Option<u32>,
    radius: Option<f64>,
    candidate: Option<u32>,
    predicted: Option<[f64; 4]>,
    weight: Option<f64>,
    prices: Option<TrimPrices>,
    flown: Option<Vec<FlownMessage>>,
    #[serde(default)]
    around: Vec<FlownMessage>,
}

impl TryFrom<StateFields> for SearchState {
    type Error = String;

    fn try_from(fields: StateFields) -> Result<Self, String> {
        Ok(match fields.search {
            SearchTag::Breed => Self::Breed(BreedState {
                genes: need(fields.genes, "genes")?,
                elite: need(fields.elite, "elite")?,
                history: need(fields.history, "history")?,
                best: fields.best,
                champion: fields.champion,
                simulations: need(fields.simulations, "simulations")?,
            }),
            SearchTag::Refine => Self::Refine(RefineState {
                round: need(fields.round, "round")?,
                radius: need(fields.radius, "radius")?,
                candidate: fields.candidate,
                predicted: fields.predicted,
                weight: need(fields.weight, "weight")?,
                prices: fields.prices,
                flown: need(fields.flown, "flown")?,
                around: fields.around,
            }),
        })
    }
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum NextTag {
    Fly,
    Found,
    Done,
}

/// Every field of [`SearchNext`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct NextFields {
    next: NextTag,
    state: Option<Box<SearchState>>,
    strokes: Option<Vec<ParameterValues>>,
    optimum: Option<Box<OptimiseResult>>,
    reason: Option<String>,
    converged: Option<bool>,
}

impl TryFrom<NextFields> for SearchNext {
    type Error = String;

    fn try_from(fields: NextFields) -> Result<Self, String> {
        Ok(match fields.next {
            NextTag::Fly => {
                Self::Fly { state: need(fields.state, "state")?, strokes: need(fields.strokes, "strokes")? }
            }
            NextTag::Found => Self::Found { optimum: need(fields.optimum, "optimum")? },
            NextTag::Done => {
                Self::Done { reason: need(fields.reason, "reason")?, converged: need(fields.converged, "converged")? }
            }
        })
    }
}

#[cfg(test)]
mod tests;
