//! Fronts: least power against a bound of one parameter.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::ids::StudyId;
use crate::point::ParameterValues;
use crate::task::Scaled;

/// Which way a limit bounds the parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FrontSide {
    /// From above: below its value at the optimum.
    AtMost,
    /// From below.
    AtLeast,
}

/// Least power in trim under a limit, as the surrogate says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FrontPointView {
    /// The limit, in the parameter's unit.
    pub limit: f64,
    /// Which way it bounds.
    pub side: FrontSide,
    /// P+; none where no stroke in trim is known under this limit.
    pub power: Option<f64>,
    /// P, W.
    pub power_w: Option<f64>,
    /// By how much P+ falls per unit of the parameter given back.
    pub price: Option<f64>,
    /// The stroke.
    pub parameters: Option<ParameterValues>,
}

/// A front.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FrontView {
    /// The study whose surrogate was asked.
    pub study: StudyId,
    /// The optimisation whose bounds and held values count; none for the whole box.
    pub optimisation: Option<String>,
    /// The parameter.
    pub quantity: String,
    /// Its value at the optimum without a further bound; none where the surrogate knows no stroke in trim.
    pub free: Option<f64>,
    /// P+ there.
    pub least_power: Option<f64>,
    /// By limits, upwards; none where there is no optimum.
    pub points: Vec<FrontPointView>,
    /// Who says so: the surrogate as it was trained, which knows nothing of the strokes that refining flew since.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by: Option<String>,
    /// Root mean square errors of the surrogate on strokes of the box which it has not seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test_rmse: Option<Scaled>,
}
