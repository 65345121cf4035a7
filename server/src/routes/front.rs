//! Least power against a bound of one parameter, asked of a study's surrogate.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use manduca_numerics::kinematics::Clearance;
use manduca_numerics::optimise::OptimiseError;
use manduca_numerics::optimise::analysis::{FrontPoint, Side, even_limits, whole_front};
use manduca_numerics::optimise::sqp::{Flight, LocalOptimum};
use manduca_numerics::parameters::TABLE;
use manduca_numerics::surrogate::Surrogate;
use manduca_protocol::front::{FrontPointView, FrontSide, FrontView};
use manduca_protocol::ids::StudyId;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::problem::Problem;
use manduca_protocol::resolve::{self, ResolvedModel, ResolvedOptimisation};
use manduca_protocol::study::{OptimisationSpec, StudySpec};
use manduca_protocol::task::Scaled;
use manduca_protocol::view::PredictionResponse;
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::surrogate::surrogate;
use crate::error::ApiError;
use crate::fair::Asker;
use crate::http::parts::{Id, Params};
use crate::state::AppState;
use crate::store::StoreError;
use crate::turn::Key;

/// Points of a front where nothing is asked.
const POINTS: u32 = 9;
/// Most points.
const MOST_POINTS: u32 = 25;
/// Most descents of a point, whatever the optimisation has.
const MOST_STARTS: usize = 200;

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(front))
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct FrontParams {
    /// The parameter which is bounded, such as `stroke_plane_deg`.
    #[param(example = "stroke_plane_deg")]
    quantity: String,
    /// Limits, evenly over its bounds, 2 to 25; 9 where left out.
    points: Option<u32>,
    /// The optimisation whose bounds and held values count; the whole box where left out.
    optimisation: Option<String>,
}

/// The least power in trim when a parameter must be below, or above, each of several limits.
///
/// The epsilon-constraint front of power against that parameter, found on the study's surrogate; nothing is flown or
/// stored. One is computed at a time; when too many wait, 429 says when to come again.
#[utoipa::path(get, path = "/v1/studies/{study}/surrogate/front", tag = "studies",
    params(("study" = StudyId, Path), FrontParams),
    responses(
        (status = 200, body = FrontView),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", headers(("Retry-After" = u64))),
        (status = 503, body = Problem, content_type = "application/problem+json", headers(("Retry-After" = u64))),
    ))]
async fn front(
    State(state): State<AppState>,
    asker: Asker,
    Id(study): Id<StudyId>,
    Params(params): Params<FrontParams>,
) -> Result<Response, ApiError> {
    let head = state.store().study_head(study).await?;
    let asked = Asked::new(study, &head.spec, &params)?;
    let asked = Asked { test_rmse: state.store().test_errors_of(head.study).await?.map(|test| test.rmse), ..asked };
    let surrogate = surrogate(&state, asker, head.study).await?;
    let answer =
        state.turns().take(asked.key(), asker, state.stopping(), move |on| asked.answer(&surrogate, on)).await?;
    Ok(([(header::CONTENT_TYPE, "application/json")], answer).into_response())
}

/// A front which can be computed.
struct Asked {
    study: StudyId,
    optimisation: Option<String>,
    quantity: usize,
    points: u32,
    model: ResolvedModel,
    margin_m: f64,
    how: ResolvedOptimisation,
    /// Errors of the surrogate.
    test_rmse: Option<Scaled>,
}

/// Why there is no front.
#[derive(Debug, thiserror::Error)]
enum Failed {
    #[error("the search cannot be made")]
    Search(#[from] OptimiseError),
    #[error("the answer cannot be written")]
    Json(#[from] serde_json::Error),
}

impl Asked {
    fn new(study: StudyId, spec: &StudySpec, params: &FrontParams) -> Result<Self, ApiError> {
        let quantity = TABLE.iter().position(|p| p.name == params.quantity);
        let quantity = quantity
            .ok_or_else(|| ApiError::query("/quantity", format!("`{}` is none of the parameters", params.quantity)))?;
        let points = params.points.unwrap_or(POINTS);
        if !(2..=MOST_POINTS).contains(&points) {
            return Err(ApiError::query("/points", format!("{points} is outside 2 to {MOST_POINTS}")));
        }
        let found = match &params.optimisation {
            Some(name) => spec.optimisations.iter().find(|o| o.name == *name).cloned(),
            None => OptimisationSpec::whole_box(spec.sampling.clearance_margin_mm).ok(),
        };
        let found = found.ok_or_else(|| ApiError::query("/optimisation", "the study has none of that name"))?;
        let corrupt = |_| ApiError::from(StoreError::Corrupt("the study's settings".into()));
        let resolved = resolve::study(spec).map_err(corrupt)?;
        let mut how = resolve::optimisation(&found, &resolved.bounds, spec.seed).map_err(corrupt)?;
        if how.bounds.is_held(quantity) {
            return Err(ApiError::query("/quantity", "it is held: there is no front"));
        }
        how.sqp.starts = how.sqp.starts.min(MOST_STARTS);
        let (optimisation, margin_m) = (params.optimisation.clone(), found.margin_m());
        Ok(Self { study, optimisation, quantity, points, model: resolved.model, margin_m, how, test_rmse: None })
    }

    fn key(&self) -> Key {
        Key::Front(self.study, self.optimisation.clone(), self.quantity, self.points)
    }

    fn answer(&self, surrogate: &Surrogate, on: &dyn Fn() -> bool) -> Result<Option<axum::body::Bytes>, Failed> {
        let clearance = Clearance::new(&self.model.insect, self.model.elevation_phase);
        let bounds = self.how.bounds;
        let flight = Flight { surrogate, clearance: Some(&clearance), margin_m: self.margin_m, bounds };
        let limits = even_limits((bounds.lower[self.quantity], bounds.upper[self.quantity]), self.points);
        let (optimum, points) = match whole_front(&flight, &self.how.sqp, self.quantity, &limits, on) {
            Ok(Some((optimum, points))) => (Some(optimum), points),
            Ok(None) => return Ok(None),
            Err(OptimiseError::NothingConverged { .. }) => (None, Vec::new()),
            Err(error) => return Err(error.into()),
        };
        let view = FrontView {
            study: self.study,
            optimisation: self.optimisation.clone(),
            quantity: TABLE[self.quantity].name.into(),
            free: optimum.as_ref().map(|o| o.point[self.quantity]),
            least_power: optimum.as_ref().map(|o| o.outputs[3]),
            points: points.iter().map(|(side, point)| self.point(*side, point)).collect(),
            by: Some(PredictionResponse::BY.into()),
            test_rmse: self.test_rmse,
        };
        Ok(Some(serde_json::to_vec(&view)?.into()))
    }

    fn point(&self, side: Side, point: &FrontPoint) -> FrontPointView {
        let (lower, upper) = (self.how.bounds.lower[self.quantity], self.how.bounds.upper[self.quantity]);
        let width = if side == Side::Upper { point.limit - lower } else { upper - point.limit };
        let found = point.optimum.as_ref();
        let price = |o: &LocalOptimum| o.bound_multipliers[self.quantity] / width;
        FrontPointView {
            limit: point.limit,
            side: if side == Side::Upper { FrontSide::AtMost } else { FrontSide::AtLeast },
            power: found.map(|o| o.outputs[3]),
            power_w: found.map(|o| o.outputs[3] * self.model.insect.power_scale_w),
            price: found.map(price).filter(|p| p.is_finite()),
            parameters: found.map(|o| ParameterValues(o.point)),
        }
    }
}
