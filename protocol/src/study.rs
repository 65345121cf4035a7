//! A study as a user writes it, in TOML or JSON. Whatever is left out has the
//! default shown here; whatever is unknown is refused.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::{Error, IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use utoipa::ToSchema;

use crate::{strict, whole};

/// A whole study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StudySpec {
    /// Name, 1 to 100 characters.
    pub name: String,
    /// Free text.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Seed of everything random in the study, at most 2^53 - 1.
    #[serde(default, deserialize_with = "whole::number")]
    pub seed: u64,
    /// Insect, aerodynamics and solver settings.
    #[serde(default, deserialize_with = "strict::object")]
    pub model: ModelSpec,
    /// Bounds `[low, high]` or a held value per parameter; the paper's box where left out.
    #[serde(default, deserialize_with = "strict::map")]
    pub parameters: BTreeMap<String, Range>,
    /// How many samples.
    #[serde(deserialize_with = "strict::object")]
    pub sampling: SamplingSpec,
    /// The neural network.
    #[serde(default, deserialize_with = "strict::object")]
    pub surrogate: SurrogateSpec,
    /// What to optimise on it, in order.
    #[serde(default, deserialize_with = "strict::objects")]
    pub optimisations: Vec<OptimisationSpec>,
    /// Share of the samples flown once more by another worker and compared bit by bit, 0 to 1.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub audit: f64,
    /// Whether every simulation is flown for this study, although others may have flown the same.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub fresh: bool,
}

/// Bounds or a held value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
// Read by an implementation below: that of serde would keep whatever else is given in memory.
#[serde(untagged)]
pub enum Range {
    /// Held at this value.
    Held(f64),
    /// Free between low and high.
    Between([f64; 2]),
}

impl<'de> Deserialize<'de> for Range {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Given;
        impl<'de> Visitor<'de> for Given {
            type Value = Range;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number, which holds the parameter, or [low, high]")
            }
            fn visit_f64<E: Error>(self, value: f64) -> Result<Range, E> {
                Ok(Range::Held(value))
            }
            fn visit_i64<E: Error>(self, value: i64) -> Result<Range, E> {
                Ok(Range::Held(value as f64))
            }
            fn visit_u64<E: Error>(self, value: u64) -> Result<Range, E> {
                Ok(Range::Held(value as f64))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut ends: A) -> Result<Range, A::Error> {
                let length = |n| A::Error::invalid_length(n, &self);
                let low = ends.next_element()?.ok_or_else(|| length(0))?;
                let high = ends.next_element()?.ok_or_else(|| length(1))?;
                match ends.next_element::<IgnoredAny>()? {
                    Some(_) => Err(length(3)),
                    None => Ok(Range::Between([low, high])),
                }
            }
        }
        deserializer.deserialize_any(Given)
    }
}

/// Which aerodynamic model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ModelKind {
    /// Extended unsteady vortex lattice.
    #[default]
    Uvlm,
    /// Quasi-steady blade elements.
    QuasiSteady,
}

/// Sign of the elevation's second harmonic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ElevationPhase {
    /// U-shaped tip path.
    #[default]
    Plus,
    /// Inverted U.
    Minus,
}

/// Insect, aerodynamics and solver settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ModelSpec {
    /// Aerodynamic model.
    pub kind: ModelKind,
    /// Preset the insect starts from: `hawkmoth` or `hawkmoth-f1`.
    pub insect: String,
    /// Changes to the preset, field by field, SI units (`manduca insects` lists them).
    #[serde(skip_serializing_if = "BTreeMap::is_empty", deserialize_with = "strict::map")]
    pub insect_changes: BTreeMap<String, f64>,
    /// Settings of the solver which differ from its defaults (`manduca simulate --help` lists them).
    #[serde(skip_serializing_if = "BTreeMap::is_empty", deserialize_with = "strict::map")]
    pub solver: BTreeMap<String, f64>,
    /// Sign of the elevation's second harmonic.
    pub elevation_phase: ElevationPhase,
    /// Share of a joint's negative power that a spring returns, 0 to 1.
    pub elastic_storage: f64,
}

impl Default for ModelSpec {
    fn default() -> Self {
        Self {
            kind: ModelKind::Uvlm,
            insect: "hawkmoth".into(),
            insect_changes: BTreeMap::new(),
            solver: BTreeMap::new(),
            elevation_phase: ElevationPhase::Plus,
            elastic_storage: 0.0,
        }
    }
}

/// The sampling of the design box.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SamplingSpec {
    /// Feasible samples wanted; 0 where every optimisation is `direct`: then nothing is sampled or trained.
    #[serde(deserialize_with = "whole::number")]
    pub samples: u32,
    /// Least distance of the wings from the plane of symmetry, mm.
    #[serde(default)]
    pub clearance_margin_mm: f64,
    /// Share of the samples on faces, edges and corners of the box, 0 to 1.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub faces: f64,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// How the weights are searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TrainMethod {
    /// Levenberg-Marquardt on the hidden weights, the output weights always at their best.
    #[default]
    VariableProjection,
    /// Levenberg-Marquardt on all weights, as in the paper.
    LevenbergMarquardt,
}

/// What predicts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SurrogateKind {
    /// Networks of one hidden layer.
    #[default]
    Network,
    /// A gaussian process: more exact with up to some 2000 samples, slower to ask the more there are.
    GaussianProcess,
}

/// What the surrogate learns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Features {
    /// Tilt, frequency and fore-aft mirror image by their exact laws, the rest by networks.
    #[default]
    Physical,
    /// Ten parameters to L+, D+, M+, P+, as in the paper.
    Paper,
}

/// The surrogate and its training. A gaussian process takes `features` and the shares alone, and fits
/// to the training and the validation share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SurrogateSpec {
    /// `network` or `gaussian-process`.
    pub kind: SurrogateKind,
    /// Neurons in the hidden layer.
    #[serde(deserialize_with = "whole::number")]
    pub neurons: u32,
    /// How the weights are searched.
    pub method: TrainMethod,
    /// What it learns.
    pub features: Features,
    /// Networks of different first weights whose mean is the prediction.
    #[serde(deserialize_with = "whole::number")]
    pub ensemble: u32,
    /// Most iterations of each network.
    #[serde(deserialize_with = "whole::number")]
    pub max_iterations: u32,
    /// Iterations without a better validation error before it stops.
    #[serde(deserialize_with = "whole::number")]
    pub patience: u32,
    /// Share of the samples trained on.
    pub train_share: f64,
    /// Share of the samples which decide when to stop; the rest tests.
    pub validation_share: f64,
}

impl Default for SurrogateSpec {
    fn default() -> Self {
        Self {
            kind: SurrogateKind::default(),
            neurons: 500,
            method: TrainMethod::default(),
            features: Features::default(),
            ensemble: 1,
            max_iterations: 200,
            patience: 6,
            train_share: 0.8,
            validation_share: 0.1,
        }
    }
}

/// How an optimum is searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Sequential quadratic programming from many starts: the constrained optimum itself.
    #[default]
    Sqp,
    /// As the paper: genetic algorithm on the penalised fitness (Eq. 8), then simplex.
    Paper,
    /// The genetic algorithm on simulations themselves, no network between.
    Direct,
}

impl Method {
    /// Population and generations where a study leaves them out: the paper's.
    fn effort(self) -> (u32, u32) {
        match self {
            Self::Sqp | Self::Paper => (100_000, 300),
            Self::Direct => (300, 50),
        }
    }
}

/// One optimisation, on the trained network or by simulations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
// Read by an implementation below, which knows defaults that depend on the method.
#[serde(deny_unknown_fields, remote = "Self")]
pub struct OptimisationSpec {
    /// Name, unique in the study.
    pub name: String,
    /// `sqp`, `paper` for genetic algorithm and simplex, or `direct` for the genetic algorithm on simulations.
    #[serde(default)]
    pub method: Method,
    /// Narrower bounds or held values, inside the study's.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty", deserialize_with = "strict::map")]
    pub parameters: BTreeMap<String, Range>,
    /// Descents of `sqp`, each from another point of the box.
    #[serde(default = "starts", deserialize_with = "whole::number")]
    pub starts: u32,
    /// Weight r of |1-L+| + |D+| + |M+| in the fitness (paper Eq. 8).
    #[serde(default = "penalty_r")]
    pub penalty_r: f64,
    /// Weight s of leaving the bounds (paper Eq. 8).
    #[serde(default = "penalty_s")]
    pub penalty_s: f64,
    /// Individuals of the genetic algorithm, of `paper` and `direct`; 100000 and 300 where left out.
    #[serde(default, deserialize_with = "whole::optional")]
    pub population: Option<u32>,
    /// Most generations; 300 of `paper` and 50 of `direct` where left out.
    #[serde(default, deserialize_with = "whole::optional")]
    pub generations: Option<u32>,
    /// Stop when the best fitness changes less than this over 50 generations.
    #[serde(default = "tolerance")]
    pub tolerance: f64,
    /// Stop tolerance of the simplex.
    #[serde(default = "simplex_tolerance")]
    pub simplex_tolerance: f64,
    /// Least distance of the wings from the plane of symmetry, mm.
    #[serde(default)]
    pub clearance_margin_mm: f64,
    /// Strokes of the re-simulation of the optimum (UVLM); more strokes, smaller standard error.
    #[serde(default = "verify_strokes", deserialize_with = "whole::number")]
    pub verify_strokes: u32,
    /// Most simulations around the optimum, until prediction and simulation agree; 0 leaves it as found.
    #[serde(default = "refine_simulations", deserialize_with = "whole::number")]
    pub refine_simulations: u32,
}

impl OptimisationSpec {
    /// Individuals of a generation.
    pub fn population(&self) -> u32 {
        self.population.unwrap_or(self.method.effort().0)
    }

    /// Most generations.
    pub fn generations(&self) -> u32 {
        self.generations.unwrap_or(self.method.effort().1)
    }

    /// The same by another method: what had the default of its method has that of the other.
    pub fn by(mut self, method: Method) -> Self {
        let ((population, generations), now) = (self.method.effort(), method.effort());
        self.population = Some(if self.population() == population { now.0 } else { self.population() });
        self.generations = Some(if self.generations() == generations { now.1 } else { self.generations() });
        Self { method, ..self }
    }

    /// One of the study's whole box, with all else as where nothing is said; for analyses of no named optimisation.
    ///
    /// # Errors
    /// Never: what has a default is optional.
    pub fn whole_box(clearance_margin_mm: f64) -> Result<Self, serde_json::Error> {
        serde_json::from_value(serde_json::json!({ "name": "whole box", "clearance_margin_mm": clearance_margin_mm }))
    }

    /// The clearance which a search keeps, m: what is asked for, and at least 0, for wings which cross are not flown.
    pub fn margin_m(&self) -> f64 {
        (self.clearance_margin_mm * 1e-3).max(0.0)
    }

    /// Whether its fitness is flown.
    pub fn is_direct(&self) -> bool {
        self.method == Method::Direct
    }
}

impl<'de> Deserialize<'de> for OptimisationSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let given = Self::deserialize(deserializer)?;
        let (population, generations) = (Some(given.population()), Some(given.generations()));
        Ok(Self { population, generations, ..given })
    }
}

impl Serialize for OptimisationSpec {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Self::serialize(self, serializer)
    }
}

fn starts() -> u32 {
    200
}
fn penalty_r() -> f64 {
    2.0
}
fn penalty_s() -> f64 {
    5.0
}
fn tolerance() -> f64 {
    1e-6
}
fn simplex_tolerance() -> f64 {
    1e-10
}
fn verify_strokes() -> u32 {
    18
}
fn refine_simulations() -> u32 {
    150
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_of_an_optimisation_depends_on_its_method() {
        let read = |json| serde_json::from_str::<OptimisationSpec>(json).unwrap();
        let of = |o: &OptimisationSpec| (o.population, o.generations);
        assert_eq!(of(&read(r#"{"name":"a"}"#)), (Some(100_000), Some(300)));
        let direct = read(r#"{"name":"a","method":"direct","generations":7}"#);
        assert_eq!(of(&direct), (Some(300), Some(7)));
        // What is left out is shown, and what is shown is read again.
        let shown = serde_json::to_value(&direct).unwrap();
        assert_eq!((&shown["population"], &shown["generations"]), (&300.into(), &7.into()));
        assert_eq!(serde_json::from_value::<OptimisationSpec>(shown).unwrap(), direct);
        assert_eq!(of(&direct.by(Method::Paper)), (Some(100_000), Some(7)));
        let told = serde_json::from_str::<OptimisationSpec>(r#"{"name":"a","colour":1}"#).unwrap_err().to_string();
        assert!(told.contains("unknown field `colour`"), "{told}");
    }
}
