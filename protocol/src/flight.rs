//! One stroke looked at: asked for by parameters, answered with its last stroke step by step.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::history::{HistoryRow, WakeStep};
use crate::ids::StudyId;
use crate::point::ParameterValues;
use crate::strict;
use crate::study::ModelSpec;
use crate::task::SimulateOutcome;

/// Which vortex rings are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WakeChoice {
    /// Those of the flight's last step.
    Last,
    /// Those of steps of the last stroke, evenly thinned to at most 32.
    Stroke,
}

/// A stroke to be flown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SimulationRequest {
    /// A study whose model the stroke is flown with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub study: Option<StudyId>,
    /// Another model, as in a study; not beside `study`. Without either the default model.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "model")]
    pub model: Option<ModelSpec>,
    /// The stroke.
    pub parameters: ParameterValues,
    /// The vortex rings wanted; none where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wake: Option<WakeChoice>,
}

/// A model or null, and never a list.
fn model<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Option<ModelSpec>, D::Error> {
    #[derive(Deserialize)]
    #[serde(transparent)]
    struct Given(#[serde(deserialize_with = "strict::object")] ModelSpec);
    Ok(Option::<Given>::deserialize(deserializer)?.map(|given| given.0))
}

/// A stroke flown: its means, and its last stroke step by step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SimulationView {
    /// The stroke.
    pub parameters: ParameterValues,
    /// The model it was flown with.
    pub model: ModelSpec,
    /// Version of the numbers.
    pub solver_version: String,
    /// Its means, or why it has none: bit for bit those of a sample of a study with this model.
    #[serde(flatten)]
    pub outcome: SimulateOutcome,
    /// First strokes which are not in the means.
    pub strokes_dropped: u32,
    /// Steps of the last stroke in order; none of a stroke which is infeasible.
    pub history: Vec<HistoryRow>,
    /// How `nodes` of the wake are measured.
    pub axes: String,
    /// Whose rings these are.
    pub side: String,
    /// Which way `circulation_m2_s` turns.
    pub circulation: String,
    /// The rings asked for, by step.
    pub wake: Vec<WakeStep>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(more: &str) -> Result<SimulationRequest, String> {
        let parameters = serde_json::to_string(&ParameterValues([1.0; 10])).unwrap();
        serde_json::from_str(&format!(r#"{{"parameters":{parameters}{more}}}"#)).map_err(|e| e.to_string())
    }

    #[test]
    fn all_but_the_stroke_may_be_left_out_or_null() {
        let bare = read("").unwrap();
        assert_eq!(read(r#","study":null,"model":null,"wake":null"#).unwrap(), bare);
        assert_eq!(read(r#","wake":"stroke","model":{}"#).unwrap().wake, Some(WakeChoice::Stroke));
        for (more, told) in [
            (r#","wake":"all""#, "unknown variant"),
            (r#","colour":1"#, "unknown field `colour`"),
            (r#","model":["uvlm"]"#, "invalid type: sequence"),
            (r#","model":{"colour":1}"#, "unknown field `colour`"),
            (r#","study":"latest""#, "UUID"),
        ] {
            let error = read(more).unwrap_err();
            assert!(error.contains(told), "{more}: {error}");
        }
    }
}
