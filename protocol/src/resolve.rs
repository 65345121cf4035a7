//! The one checked conversion from what was sent to what the science accepts.
//! Every fault is found, not just the first, each with its JSON pointer.

use std::collections::BTreeMap;

use manduca_numerics::insect::{Insect, PRESETS};
use manduca_numerics::kinematics;
use manduca_numerics::optimise::sqp::SqpSettings;
use manduca_numerics::optimise::{GaSettings, SimplexSettings};
use manduca_numerics::parameters::{Bounds, TABLE, index};
use manduca_numerics::simulation::{BodyVelocity, Model, Simulation};
use manduca_numerics::surrogate::TrainSettings;
use manduca_numerics::table::{FieldError, Table};
use manduca_numerics::{quasi_steady, uvlm};

use crate::names::{nearest, suggestion, unknown_parameter};
use crate::point::ParameterValues;
use crate::problem::{FieldProblem, MOST_FAULTS};
use crate::study::{ElevationPhase, ModelKind, ModelSpec, OptimisationSpec, Range, StudySpec};
use crate::text::{check_name, check_prose};

mod training;

pub use training::surrogate;
use training::surrogate_at;

/// Most samples of one study.
pub const MAX_SAMPLES: u32 = 200_000;
/// Fewest samples of one study.
pub const MIN_SAMPLES: u32 = 20;
/// Most neurons.
pub const MAX_NEURONS: u32 = 1_000;
/// Most networks of one ensemble.
pub const MAX_ENSEMBLE: u32 = 16;
/// Largest population.
pub const MAX_POPULATION: u32 = 1_000_000;
/// Largest population whose fitness is flown: strokes of one round.
pub const MAX_FLOWN_POPULATION: u32 = 1_000;
/// Most generations whose fitness is flown, each a round.
pub const MAX_FLOWN_GENERATIONS: u32 = 900;
/// Most descents of one optimisation.
pub const MAX_STARTS: u32 = 100_000;
/// Most optimisations of one study.
pub const MAX_OPTIMISATIONS: usize = 32;
/// Longest name of a study or an optimisation, characters.
pub const LONGEST_NAME: usize = 100;
/// Longest description of a study, characters.
pub const LONGEST_DESCRIPTION: usize = 10_000;
/// Most simulations around one optimum.
pub const MAX_REFINING: u32 = 5_000;
/// Largest seed: what every JSON reader holds exactly.
pub const MAX_SEED: u64 = (1 << 53) - 1;

/// The faults found so far, and how many are only counted.
#[derive(Default)]
struct Faults {
    found: Vec<FieldProblem>,
    more: usize,
}

impl Faults {
    fn add(&mut self, pointer: impl Into<String>, detail: impl Into<String>) {
        if self.found.len() < MOST_FAULTS {
            self.found.push(FieldProblem::new(pointer, detail));
        } else {
            self.more += 1;
        }
    }

    fn count(&self) -> usize {
        self.found.len() + self.more
    }

    fn within(&mut self, pointer: &str, value: f64, min: f64, max: f64) {
        if !(min..=max).contains(&value) {
            self.add(pointer, format!("{value} is outside {min} to {max}"));
        }
    }

    fn finish<T>(mut self, value: T) -> Result<T, Vec<FieldProblem>> {
        if self.more > 0 {
            self.found.push(FieldProblem::more(self.more));
        }
        if self.found.is_empty() { Ok(value) } else { Err(self.found) }
    }
}

/// Everything of the model but the stroke itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResolvedModel {
    /// Aerodynamics and settings.
    pub model: Model,
    /// Insect.
    pub insect: Insect,
    /// Sign of the elevation's second harmonic.
    pub elevation_phase: kinematics::ElevationPhase,
    /// Elastic storage.
    pub elastic_storage: f64,
}

impl ResolvedModel {
    /// The simulation of one stroke in still air.
    pub fn simulation(&self, parameters: &ParameterValues) -> Simulation {
        Simulation {
            model: self.model,
            insect: self.insect,
            parameters: parameters.0,
            elevation_phase: self.elevation_phase,
            elastic_storage: self.elastic_storage,
            body_velocity: BodyVelocity::default(),
        }
    }
}

/// One optimisation, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct ResolvedOptimisation {
    /// Bounds with held values.
    pub bounds: Bounds,
    /// Sequential quadratic programming.
    pub sqp: SqpSettings,
    /// Whether the genetic algorithm's fitness is flown.
    pub direct: bool,
    /// Genetic algorithm.
    pub ga: GaSettings,
    /// Simplex.
    pub simplex: SimplexSettings,
}

impl ResolvedOptimisation {
    /// Strokes its generations ask for at most; 0 where a network answers.
    pub fn individuals(&self) -> usize {
        if self.direct { self.ga.most_asked() } else { 0 }
    }
}

/// A study, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct ResolvedStudy {
    /// Model.
    pub model: ResolvedModel,
    /// The sampled box.
    pub bounds: Bounds,
    /// Training.
    pub surrogate: TrainSettings,
    /// Optimisations in the order given.
    pub optimisations: Vec<ResolvedOptimisation>,
}

fn escape(name: &str) -> String {
    name.replace('~', "~0").replace('/', "~1")
}

fn set_all<T: Table>(into: &mut T, values: &BTreeMap<String, f64>, at: &str, faults: &mut Faults) {
    for (name, &value) in values {
        if let Err(e) = into.set(name, value) {
            let meant = nearest(name, T::FIELDS.iter().map(|f| f.name));
            let meant = if matches!(e, FieldError::Unknown { .. }) { suggestion(meant) } else { String::new() };
            faults.add(format!("{at}/{}", escape(name)), format!("{meant}{e}"));
        }
    }
}

fn model_at(spec: &ModelSpec, at: &str, faults: &mut Faults) -> ResolvedModel {
    let mut insect = Insect::preset(&spec.insect).unwrap_or_else(|| {
        faults
            .add(format!("{at}/insect"), format!("unknown preset `{}`; known are {}", spec.insect, PRESETS.join(", ")));
        Insect::default()
    });
    let before = faults.count();
    set_all(&mut insect, &spec.insect_changes, &format!("{at}/insect_changes"), faults);
    if faults.count() == before
        && let Err((field, why)) = insect.check()
    {
        faults.add(format!("{at}/insect_changes/{field}"), why);
    }
    let before = faults.count();
    let model = match spec.kind {
        ModelKind::Uvlm => {
            let mut settings = uvlm::Settings::default();
            set_all(&mut settings, &spec.solver, &format!("{at}/solver"), faults);
            if faults.count() == before
                && let Err((field, why)) = settings.check().and_then(|()| settings.check_on(&insect))
            {
                faults.add(format!("{at}/solver/{field}"), why);
            }
            Model::Uvlm(settings)
        }
        ModelKind::QuasiSteady => {
            let mut settings = quasi_steady::Settings::default();
            set_all(&mut settings, &spec.solver, &format!("{at}/solver"), faults);
            Model::QuasiSteady(settings)
        }
    };
    faults.within(&format!("{at}/elastic_storage"), spec.elastic_storage, 0.0, 1.0);
    ResolvedModel {
        model,
        insect,
        elevation_phase: match spec.elevation_phase {
            ElevationPhase::Plus => kinematics::ElevationPhase::Plus,
            ElevationPhase::Minus => kinematics::ElevationPhase::Minus,
        },
        elastic_storage: spec.elastic_storage,
    }
}

/// Checks a model on its own.
///
/// # Errors
/// Every fault with its JSON pointer below `at`.
pub fn model(spec: &ModelSpec, at: &str) -> Result<ResolvedModel, Vec<FieldProblem>> {
    let mut faults = Faults::default();
    let model = model_at(spec, at, &mut faults);
    faults.finish(model)
}

/// Checks ten values against what the model accepts.
///
/// # Errors
/// Every fault with its JSON pointer below `at`.
pub fn parameters(values: &ParameterValues, at: &str) -> Result<(), Vec<FieldProblem>> {
    let mut faults = Faults::default();
    for (p, &value) in TABLE.iter().zip(&values.0) {
        faults.within(&format!("{at}/{}", p.name), value, p.least, p.most);
    }
    faults.finish(())
}

fn bounds_at(inside: &Bounds, ranges: &BTreeMap<String, Range>, at: &str, faults: &mut Faults) -> Bounds {
    let mut bounds = *inside;
    for (name, range) in ranges {
        let pointer = format!("{at}/{}", escape(name));
        let Some(i) = index(name) else {
            faults.add(pointer, unknown_parameter(name));
            continue;
        };
        let (low, high) = match *range {
            Range::Held(value) => (value, value),
            Range::Between([low, high]) => (low, high),
        };
        let (least, most) = (inside.lower[i], inside.upper[i]);
        if !(least..=most).contains(&low) || !(least..=most).contains(&high) {
            faults.add(pointer, format!("{low} to {high} {} is not inside {least} to {most}", TABLE[i].unit));
        } else if low > high {
            faults.add(pointer, format!("lower bound {low} is above upper bound {high}"));
        } else {
            (bounds.lower[i], bounds.upper[i]) = (low, high);
        }
    }
    bounds
}

fn study_bounds(spec: &StudySpec, faults: &mut Faults) -> Bounds {
    let accepted = Bounds { lower: TABLE.map(|p| p.least), upper: TABLE.map(|p| p.most) };
    let given = bounds_at(&accepted, &spec.parameters, "/parameters", faults);
    let mut bounds = Bounds::default();
    for name in spec.parameters.keys() {
        if let Some(i) = index(name) {
            (bounds.lower[i], bounds.upper[i]) = (given.lower[i], given.upper[i]);
        }
    }
    if (0..TABLE.len()).all(|i| bounds.is_held(i)) {
        faults.add("/parameters", "every parameter is held: there is nothing to sample");
    }
    bounds
}

fn optimisation_at(
    spec: &OptimisationSpec,
    study: &Bounds,
    seed: u64,
    at: &str,
    faults: &mut Faults,
) -> ResolvedOptimisation {
    let bounds = bounds_at(study, &spec.parameters, &format!("{at}/parameters"), faults);
    if (0..TABLE.len()).all(|i| bounds.is_held(i)) {
        faults.add(format!("{at}/parameters"), "every parameter is held: there is nothing to optimise");
    }
    faults.within(&format!("{at}/starts"), spec.starts.into(), 1.0, MAX_STARTS.into());
    faults.within(&format!("{at}/penalty_r"), spec.penalty_r, 0.0, 1e9);
    faults.within(&format!("{at}/penalty_s"), spec.penalty_s, 0.0, 1e9);
    let direct = spec.is_direct();
    let (individuals, generations) =
        if direct { (MAX_FLOWN_POPULATION, MAX_FLOWN_GENERATIONS) } else { (MAX_POPULATION, 10_000) };
    let least = if direct { 4.0 } else { 10.0 };
    faults.within(&format!("{at}/population"), spec.population().into(), least, individuals.into());
    faults.within(&format!("{at}/generations"), spec.generations().into(), 1.0, generations.into());
    faults.within(&format!("{at}/tolerance"), spec.tolerance, 0.0, 1.0);
    faults.within(&format!("{at}/simplex_tolerance"), spec.simplex_tolerance, 0.0, 1.0);
    faults.within(&format!("{at}/clearance_margin_mm"), spec.clearance_margin_mm, -1000.0, 1000.0);
    faults.within(&format!("{at}/verify_strokes"), spec.verify_strokes.into(), 4.0, 200.0);
    faults.within(&format!("{at}/refine_simulations"), spec.refine_simulations.into(), 0.0, MAX_REFINING.into());
    ResolvedOptimisation {
        bounds,
        sqp: SqpSettings { starts: spec.starts as usize, seed, ..SqpSettings::default() },
        direct,
        ga: GaSettings {
            population: spec.population() as usize,
            generations: spec.generations() as usize,
            tolerance: spec.tolerance,
            seed,
            ..GaSettings::default()
        },
        simplex: SimplexSettings { tolerance: spec.simplex_tolerance, ..SimplexSettings::default() },
    }
}

/// Checks an optimisation on its own, inside the bounds of its study.
///
/// # Errors
/// Every fault with its JSON pointer.
pub fn optimisation(
    spec: &OptimisationSpec,
    study: &Bounds,
    seed: u64,
) -> Result<ResolvedOptimisation, Vec<FieldProblem>> {
    let mut faults = Faults::default();
    let optimisation = optimisation_at(spec, study, seed, "", &mut faults);
    faults.finish(optimisation)
}

/// Checks the texts of a study that is submitted. One that was accepted before keeps the texts it has.
pub fn texts(spec: &StudySpec) -> Vec<FieldProblem> {
    let prose = check_prose(&spec.description, LONGEST_DESCRIPTION);
    let own = [name(&spec.name, "/name"), prose.err().map(|why| FieldProblem::new("/description", why))];
    let optimisations = spec.optimisations.iter().take(MAX_OPTIMISATIONS).enumerate();
    let of_optimisations = optimisations.map(|(i, o)| name(&o.name, &format!("/optimisations/{i}/name")));
    own.into_iter().chain(of_optimisations).flatten().collect()
}

/// Checks the name of a study or an optimisation that is submitted.
pub fn name(name: &str, at: &str) -> Option<FieldProblem> {
    check_name(name, LONGEST_NAME).err().map(|why| FieldProblem::new(at, why))
}

/// Checks a whole study, but for its [`texts`].
///
/// # Errors
/// Every fault with its JSON pointer.
pub fn study(spec: &StudySpec) -> Result<ResolvedStudy, Vec<FieldProblem>> {
    let mut faults = Faults::default();
    if spec.seed > MAX_SEED {
        faults.add("/seed", format!("is above {MAX_SEED}"));
    }
    let model = model_at(&spec.model, "/model", &mut faults);
    let bounds = study_bounds(spec, &mut faults);
    let samples = spec.sampling.samples;
    let direct = !spec.optimisations.is_empty() && spec.optimisations.iter().all(OptimisationSpec::is_direct);
    if samples != 0 {
        faults.within("/sampling/samples", samples.into(), MIN_SAMPLES.into(), MAX_SAMPLES.into());
    } else if !direct {
        let why = "is 0, which is for studies whose optimisations are all `direct`; otherwise";
        faults.add("/sampling/samples", format!("{why} {MIN_SAMPLES} to {MAX_SAMPLES}"));
    }
    faults.within("/audit", spec.audit, 0.0, 1.0);
    faults.within("/sampling/faces", spec.sampling.faces, 0.0, 1.0);
    faults.within("/sampling/clearance_margin_mm", spec.sampling.clearance_margin_mm, -1000.0, 1000.0);
    // Of a number of samples which is refused itself no split is checked.
    let split = if (MIN_SAMPLES..=MAX_SAMPLES).contains(&samples) { samples } else { 0 };
    let surrogate = surrogate_at(&spec.surrogate, split, spec.seed, &mut faults);
    if spec.optimisations.len() > MAX_OPTIMISATIONS {
        faults.add("/optimisations", format!("more than {MAX_OPTIMISATIONS}"));
    }
    let mut optimisations = Vec::new();
    for (i, optimisation) in spec.optimisations.iter().take(MAX_OPTIMISATIONS).enumerate() {
        let at = format!("/optimisations/{i}");
        if spec.optimisations[..i].iter().any(|other| other.name == optimisation.name) {
            faults.add(format!("{at}/name"), "is the name of an earlier optimisation");
        }
        optimisations.push(optimisation_at(optimisation, &bounds, spec.seed, &at, &mut faults));
    }
    faults.finish(ResolvedStudy { model, bounds, surrogate, optimisations })
}
