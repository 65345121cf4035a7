//! What a page about a study is drawn from, of bounded size however large the study.

use axum::Json;
use axum::extract::State;
use manduca_numerics::surrogate::{Split, Surrogate};
use manduca_numerics::wing::Outline;
use manduca_protocol::ids::StudyId;
use manduca_protocol::overview::{FailureGroup, PointsView, ReferenceView, Share, ThroughputView, WingView};
use manduca_protocol::problem::Problem;
use manduca_protocol::task::{Scaled, SimulateOutcome};
use manduca_protocol::view::DatasetRow;
use manduca_protocol::{network, resolve};
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::clock::rfc3339;
use crate::error::ApiError;
use crate::http::parts::{Id, Params};
use crate::state::AppState;
use crate::store::{StoreError, StudyHead};

/// Most samples of one answer.
const MOST_POINTS: u32 = 2000;
/// Most intervals of one answer.
const MOST_INTERVALS: u32 = 200;
/// Places along the span at which the wing's edges are told.
const STATIONS: usize = 33;

pub(super) fn router() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(reference))
        .routes(routes!(points))
        .routes(routes!(throughput))
        .routes(routes!(failures))
        .routes(routes!(wing))
}

/// What is the same for all studies: the ten parameters, the four means, published strokes.
#[utoipa::path(get, path = "/v1/reference", tag = "watch", responses((status = 200, body = ReferenceView)))]
async fn reference() -> Json<ReferenceView> {
    Json(ReferenceView::new())
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct PointsParams {
    /// Only samples which serve for this in the training; not before there is a surrogate.
    #[param(inline)]
    share: Option<Share>,
    /// Samples at most, 1 to 2000; 2000 where left out.
    limit: Option<u32>,
}

/// Samples flown so far, thinned evenly to what a page can show, with what is predicted there.
#[utoipa::path(get, path = "/v1/studies/{study}/points", tag = "studies",
    params(("study" = StudyId, Path), PointsParams),
    responses(
        (status = 200, body = PointsView),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
async fn points(
    State(state): State<AppState>,
    Id(study): Id<StudyId>,
    Params(params): Params<PointsParams>,
) -> Result<Json<PointsView>, ApiError> {
    let limit = within("/limit", params.limit, MOST_POINTS)?;
    let head = state.store().study_head(study).await?;
    let flown = state.store().flown_samples(head.study).await?;
    let surrogate = match state.store().training_of(head.study).await? {
        Some(done) => Some(network::surrogate(&done.surrogate).map_err(StoreError::Corrupt)?),
        None => None,
    };
    let shares = surrogate.as_ref().map(|_| shares(&head, flown.len()));
    let wanted: Vec<usize> = match (params.share, &shares) {
        (None, _) => (0..flown.len()).collect(),
        (Some(share), Some(shares)) => (0..flown.len()).filter(|&i| shares[i] == share).collect(),
        (Some(_), None) => return Err(ApiError::NotYet("the study has no network yet")),
    };
    let shown = thinned(&wanted, limit as usize);
    let ordinals: Vec<u32> = shown.iter().map(|&i| flown[i]).collect();
    let rows = state.store().samples_at(head.study, &ordinals).await?;
    let total = u32::try_from(wanted.len()).unwrap_or(u32::MAX);
    // Samples neither vanish nor lose their means: there is a row for each.
    let shares = shares.map(|shares| shown.iter().map(|&i| shares[i]).collect());
    let view = tokio::task::spawn_blocking(move || view(total, rows, surrogate.as_ref(), shares)).await;
    Ok(Json(view.map_err(|e| ApiError::Internal(Box::new(e)))?))
}

/// What each sample served for, by its place among those flown.
fn shares(head: &StudyHead, count: usize) -> Vec<Share> {
    let spec = &head.spec.surrogate;
    let split = Split::new(count, spec.train_share, spec.validation_share, head.spec.seed);
    let mut shares = vec![Share::Train; count];
    for (places, share) in [(split.validation, Share::Validation), (split.test, Share::Test)] {
        for place in places {
            shares[place] = share;
        }
    }
    shares
}

/// At most `limit` of these, evenly spread: always the same of the same.
fn thinned(all: &[usize], limit: usize) -> Vec<usize> {
    let shown = all.len().min(limit);
    (0..shown).map(|k| all[k * all.len() / shown]).collect()
}

fn view(total: u32, rows: Vec<DatasetRow>, surrogate: Option<&Surrogate>, shares: Option<Vec<Share>>) -> PointsView {
    let mut view = PointsView {
        total,
        samples: Vec::with_capacity(rows.len()),
        parameters: Vec::with_capacity(rows.len()),
        simulated: Vec::with_capacity(rows.len()),
        standard_errors: Vec::with_capacity(rows.len()),
        predicted: None,
        shares,
    };
    for row in rows {
        let SimulateOutcome::Ok { scaled, .. } = &row.result.outcome else { continue };
        let means = [scaled.lift, scaled.drag, scaled.pitch_moment, scaled.power];
        view.samples.push(row.sample);
        view.parameters.push(row.parameters.0.map(short));
        view.simulated.push(means.map(|e| short(e.mean)));
        view.standard_errors.push(means.map(|e| short(e.se)));
        if let Some(surrogate) = surrogate {
            let predicted = surrogate.predict(&row.parameters.0).map(short);
            view.predicted.get_or_insert_default().push(predicted);
        }
    }
    view
}

/// A number with as many digits as a plot can show.
fn short(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

fn within(pointer: &str, asked: Option<u32>, most: u32) -> Result<u32, ApiError> {
    let asked = asked.unwrap_or(most);
    if (1..=most).contains(&asked) {
        return Ok(asked);
    }
    Err(ApiError::query(pointer, format!("{asked} is outside 1 to {most}")))
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct ThroughputParams {
    /// Intervals at most, 1 to 200; 200 where left out.
    intervals: Option<u32>,
}

/// How many results came in when, from the first to the last.
#[utoipa::path(get, path = "/v1/studies/{study}/throughput", tag = "studies",
    params(("study" = StudyId, Path), ThroughputParams),
    responses(
        (status = 200, body = ThroughputView),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
async fn throughput(
    State(state): State<AppState>,
    Id(study): Id<StudyId>,
    Params(params): Params<ThroughputParams>,
) -> Result<Json<ThroughputView>, ApiError> {
    let intervals = within("/intervals", params.intervals, MOST_INTERVALS)?;
    let study = state.store().study_number(study).await?;
    Ok(Json(over_time(&state.store().finish_times(study).await?, intervals)))
}

/// Counts times by interval; an interval has a whole number of seconds.
fn over_time(times: &[i64], intervals: u32) -> ThroughputView {
    let Some((first, last)) = times.iter().min().zip(times.iter().max()) else {
        return ThroughputView { from: None, interval_s: 1.0, results: Vec::new(), busy_s: None };
    };
    let interval_ms = ((last - first) / i64::from(intervals) / 1000 + 1) * 1000;
    let count = usize::try_from((last - first) / interval_ms).unwrap_or(0) + 1;
    let mut results = vec![0; count];
    for time in times {
        if let Some(n) = usize::try_from((time - first) / interval_ms).ok().and_then(|i| results.get_mut(i)) {
            *n += 1;
        }
    }
    let busy_s = Some(busy_ms(times.to_vec()) as f64 / 1000.0);
    ThroughputView { from: Some(rfc3339(*first)), interval_s: interval_ms as f64 / 1000.0, results, busy_s }
}

/// Gaps between results longer than this, and than ten of its long ones, are pauses, ms.
const PAUSE_MS: i64 = 10_000;

/// Time in which results came in, at least a second: all gaps between them but the pauses, ms.
fn busy_ms(mut times: Vec<i64>) -> i64 {
    times.sort_unstable();
    let mut gaps: Vec<i64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_unstable();
    let long = gaps.get(gaps.len() * 9 / 10).copied().unwrap_or(0);
    let pause = PAUSE_MS.max(10 * long);
    gaps.iter().filter(|gap| **gap <= pause).sum::<i64>().max(1000)
}

/// Jobs which failed or cannot be flown, alike ones together.
#[utoipa::path(get, path = "/v1/studies/{study}/failures", tag = "studies", params(("study" = StudyId, Path)),
    responses(
        (status = 200, body = Vec<FailureGroup>),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
async fn failures(State(state): State<AppState>, Id(study): Id<StudyId>) -> Result<Json<Vec<FailureGroup>>, ApiError> {
    let study = state.store().study_number(study).await?;
    Ok(Json(state.store().failures(study).await?))
}

/// The wing and the scales of a study's insect.
#[utoipa::path(get, path = "/v1/studies/{study}/wing", tag = "studies", params(("study" = StudyId, Path)),
    responses(
        (status = 200, body = WingView),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
async fn wing(State(state): State<AppState>, Id(study): Id<StudyId>) -> Result<Json<WingView>, ApiError> {
    let head = state.store().study_head(study).await?;
    let resolved =
        resolve::study(&head.spec).map_err(|_| StoreError::Corrupt("a stored study is not valid any more".into()))?;
    let insect = resolved.model.insect;
    let outline = Outline::new(&insect);
    let station = |k: usize| {
        // Closer towards the tip, where the chord changes fastest.
        let share = (k as f64 / (STATIONS - 1) as f64 * std::f64::consts::FRAC_PI_2).sin();
        let x = insect.root_cutout + (1.0 - insect.root_cutout) * share;
        let (leading, trailing) = outline.edges(x);
        [x * insect.wing_length_m, leading, trailing]
    };
    let [lift, drag, pitch_moment, power] = insect.scales();
    Ok(Json(WingView {
        hinge_offset_m: insect.hinge_offset_m,
        wing_length_m: insect.wing_length_m,
        elevation_phase: head.spec.model.elevation_phase,
        scales: Scaled { lift, drag, pitch_moment, power },
        stations: (0..STATIONS).map(station).collect(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_is_even_and_keeps_what_is_few() {
        let all: Vec<usize> = (0..10).collect();
        assert_eq!(thinned(&all, 20), all);
        assert_eq!(thinned(&all, 4), [0, 2, 5, 7]);
        assert_eq!(thinned(&[], 4), [0; 0]);
    }

    #[test]
    fn every_result_is_in_one_interval() {
        let times: Vec<i64> = (0..1000).map(|i| 5_000 + i * 777).collect();
        let told = over_time(&times, 200);
        assert!(told.results.len() <= 200 && told.results.iter().sum::<u32>() == 1000, "{told:?}");
        assert_eq!(told.interval_s, 4.0);
        let one = over_time(&[7], 200);
        assert_eq!((one.results, one.from.as_deref()), (vec![1], Some("1970-01-01T00:00:00.007Z")));
        assert!(over_time(&[], 200).from.is_none());
    }

    #[test]
    fn what_lies_idle_between_results_is_no_work() {
        // 700 results in 10 s, and an hour later 21 of an optimisation which was asked for then, in 2 s.
        let sampling = (0..=700).map(|i| i * 10_000 / 700);
        let later = (0..=20).map(|i| 3_600_000 + i * 100);
        let told = over_time(&sampling.chain(later).collect::<Vec<_>>(), 200);
        assert_eq!(told.busy_s, Some(12.0));
        // Slow flights are not idle: ten minutes each, one after the other.
        let slow: Vec<i64> = (0..50).map(|i| i * 600_000).collect();
        assert_eq!(over_time(&slow, 200).busy_s, Some(49.0 * 600.0));
        assert_eq!(over_time(&[5], 10).busy_s, Some(1.0));
    }

    #[test]
    fn numbers_keep_six_digits() {
        assert_eq!([short(1.234_567_89), short(-0.000_123_456_789), short(0.0)], [1.23457, -0.000_123_457, 0.0]);
    }
}
