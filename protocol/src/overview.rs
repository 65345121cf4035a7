//! What a page about a study is drawn from: sums and thinned samples whose size does
//! not grow with the study.

use manduca_numerics::cases::CASES;
use manduca_numerics::parameters::{OUTPUTS, TABLE};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::ids::{JobId, StudyId};
use crate::point::ParameterValues;
use crate::study::ElevationPhase;
use crate::task::Scaled;
use crate::view::{JobRole, JobState};

/// What a sample serves for in the training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Share {
    /// The weights are fitted to it.
    Train,
    /// It says when to stop.
    Validation,
    /// It only judges the result.
    Test,
}

/// Samples which stand for all: every one, or evenly thinned by their index.
/// `GET /v1/studies/{study}/points`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PointsView {
    /// How many samples they stand for.
    pub total: u32,
    /// Index of each sample.
    pub samples: Vec<u32>,
    /// Its ten values in the table's order.
    #[schema(value_type = Vec<Vec<f64>>)]
    pub parameters: Vec<[f64; 10]>,
    /// L+, D+, M+ and P+ as simulated.
    #[schema(value_type = Vec<Vec<f64>>)]
    pub simulated: Vec<[f64; 4]>,
    /// Standard errors of these.
    #[schema(value_type = Vec<Vec<f64>>)]
    pub standard_errors: Vec<[f64; 4]>,
    /// The same as predicted; absent before there is a surrogate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Vec<f64>>>)]
    pub predicted: Option<Vec<[f64; 4]>>,
    /// What each serves for in the training.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shares: Option<Vec<Share>>,
}

/// Results over time. `GET /v1/studies/{study}/throughput`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ThroughputView {
    /// When the first interval begins, RFC 3339 in UTC; none before the first result.
    pub from: Option<String>,
    /// Length of an interval, s.
    pub interval_s: f64,
    /// Results which came in in each interval, those found in the store without a flight left out.
    pub results: Vec<u32>,
    /// Time in which results came in, s: without the pauses in which no job was flown, such as between the end of a
    /// study and an optimisation added to it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub busy_s: Option<f64>,
}

/// Jobs which failed alike. `GET /v1/studies/{study}/failures`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FailureGroup {
    /// `infeasible`, `dead` or `delayed`.
    pub state: JobState,
    /// What the jobs are for.
    pub role: JobRole,
    /// Why, numbers left out.
    pub reason: String,
    /// How many.
    pub jobs: u64,
    /// One of them.
    pub example: JobId,
    /// Why that one failed, to the letter.
    pub example_reason: String,
}

/// The wing and the scales of a study's insect. `GET /v1/studies/{study}/wing`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WingView {
    /// Distance of each hinge from the plane of symmetry, m.
    pub hinge_offset_m: f64,
    /// Wing length, m.
    pub wing_length_m: f64,
    /// Sign of the elevation's second harmonic.
    pub elevation_phase: ElevationPhase,
    /// What L, D, M and P are divided by: N, N, N m, W.
    pub scales: Scaled,
    /// Along the span: distance from the hinge, leading and trailing edge ahead of the feathering axis, m.
    #[schema(value_type = Vec<Vec<f64>>)]
    pub stations: Vec<[f64; 3]>,
}

/// One of the ten parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ParameterInfo {
    /// Name on the wire.
    pub name: String,
    /// Symbol in the literature.
    pub symbol: String,
    /// Unit; empty where it has none.
    pub unit: String,
    /// Lower bound of the paper's box.
    pub lower: f64,
    /// Upper bound of the paper's box.
    pub upper: f64,
    /// What it is.
    pub meaning: String,
}

/// One of the four means.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OutputInfo {
    /// Name on the wire.
    pub name: String,
    /// Symbol.
    pub symbol: String,
}

/// A published stroke.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CaseInfo {
    /// Name, as `manduca simulate --case` takes it.
    pub name: String,
    /// For people.
    pub title: String,
    /// The stroke.
    pub parameters: ParameterValues,
    /// Published lift over weight.
    pub lift: f64,
    /// Published power, mW.
    pub power_mw: Option<f64>,
    /// Published power per lift, W/N.
    pub power_per_lift_w_per_n: f64,
}

/// What is the same for all studies. `GET /v1/reference`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReferenceView {
    /// The ten parameters in their order.
    pub parameters: Vec<ParameterInfo>,
    /// L+, D+, M+ and P+ in their order.
    pub outputs: Vec<OutputInfo>,
    /// Published strokes of the preset `hawkmoth`.
    pub cases: Vec<CaseInfo>,
    /// Version of the numbers.
    pub solver_version: String,
}

impl ReferenceView {
    /// All of it.
    pub fn new() -> Self {
        let parameter = |p: &manduca_numerics::parameters::Parameter| ParameterInfo {
            name: p.name.into(),
            symbol: p.symbol.into(),
            unit: p.unit.into(),
            lower: p.lower,
            upper: p.upper,
            meaning: p.meaning.into(),
        };
        let case = |c: &manduca_numerics::cases::Case| CaseInfo {
            name: c.name.into(),
            title: c.title.into(),
            parameters: ParameterValues(c.parameters),
            lift: c.paper_lift,
            power_mw: c.paper_power_mw,
            power_per_lift_w_per_n: c.paper_power_per_lift,
        };
        Self {
            parameters: TABLE.iter().map(parameter).collect(),
            outputs: OUTPUTS.iter().map(|o| OutputInfo { name: o.0.into(), symbol: o.2.into() }).collect(),
            cases: CASES.iter().map(case).collect(),
            solver_version: manduca_numerics::simulation::SOLVER_VERSION.into(),
        }
    }
}

impl Default for ReferenceView {
    fn default() -> Self {
        Self::new()
    }
}

/// Something changed: look again. The data of an event of `GET /v1/events`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ChangeMessage {
    /// Studies which changed.
    pub studies: Vec<StudyId>,
    /// Whether workers came, left or were given jobs.
    pub workers: bool,
    /// Whether anything may have changed: at the beginning, and after more than could be kept.
    pub everything: bool,
}

/// One event of `GET /v1/events`, as its lines name it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ChangeEvent {
    /// `changed`.
    pub event: String,
    /// A [`ChangeMessage`] as JSON: `{"studies": [...], "workers": false, "everything": true}`.
    pub data: String,
}
