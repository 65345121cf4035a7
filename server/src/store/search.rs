//! Searches which ask for simulations: rounds and strokes take turns, and each
//! is a job of its own.

use manduca_numerics::parameters::Point;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::search::{FlownMessage, SearchNext, SearchResult};
use manduca_protocol::study::StudySpec;
use manduca_protocol::task::{SimulateOutcome, SimulateResult};
use manduca_protocol::view::{JobRole, JobState, SearchView};
use sqlx::sqlite::{SqliteConnection, SqliteExecutor};

use super::names::{named, role_name, unsigned};
use super::submit::insert_simulations;
use super::{Store, StoreError, body};
use crate::compose::probe_task;
use crate::draw::Drawn;

/// Most rounds of one search.
const ROUNDS: u32 = 1000;
/// Most strokes of one round.
pub(crate) const STROKES: u32 = 1000;

/// Which optimisation and which of its rounds a search job is.
pub(crate) fn round_of(ordinal: u32) -> (u32, u32) {
    (ordinal / ROUNDS, ordinal % ROUNDS)
}

/// The optimisation a stroke is flown for.
pub(crate) fn optimisation_of_probe(ordinal: u32) -> u32 {
    ordinal / STROKES / ROUNDS
}

fn search_ordinal(optimisation: u32, round: u32) -> u32 {
    optimisation * ROUNDS + round
}

fn probe_ordinal(optimisation: u32, round: u32, stroke: u32) -> u32 {
    search_ordinal(optimisation, round) * STROKES + stroke
}

/// Queues what each of a study's searches needs next, when no job of any is open.
/// Tells whether there was anything.
pub(super) async fn continue_searches(
    db: &mut SqliteConnection,
    study: i64,
    spec: &StudySpec,
) -> Result<bool, StoreError> {
    let mut queued = false;
    for (optimisation, asked) in (0_u32..).zip(&spec.optimisations) {
        if asked.refine_simulations > 0 {
            queued |= continue_search(db, study, spec, optimisation).await?;
        }
    }
    Ok(queued)
}

async fn continue_search(
    db: &mut SqliteConnection,
    study: i64,
    spec: &StudySpec,
    optimisation: u32,
) -> Result<bool, StoreError> {
    let Some((round, state, result)) = find_last_round(&mut *db, study, optimisation).await? else {
        let start = find_flown(&mut *db, study, JobRole::Verify, optimisation..=optimisation).await?;
        if start.iter().all(|stroke| stroke.scaled.is_none()) {
            return Ok(false);
        }
        insert_round(db, study, optimisation, 0).await?;
        return Ok(true);
    };
    let (JobState::Succeeded, Some(result)) = (state, result) else { return Ok(false) };
    let SearchNext::Fly { strokes, .. } = body::parse::<SearchResult>(result)?.next else { return Ok(false) };
    if insert_probes(db, study, spec, optimisation, round, &strokes).await? {
        return Ok(true);
    }
    if round + 1 >= ROUNDS {
        return Ok(false);
    }
    insert_round(db, study, optimisation, round + 1).await?;
    Ok(true)
}

async fn insert_round(db: &mut SqliteConnection, study: i64, optimisation: u32, round: u32) -> Result<(), StoreError> {
    sqlx::query("insert into jobs (study, role, ordinal, state) values (?, 'search', ?, 'ready')")
        .bind(study)
        .bind(search_ordinal(optimisation, round))
        .execute(db)
        .await?;
    Ok(())
}

/// Queues the strokes of a round; tells whether they are new.
async fn insert_probes(
    db: &mut SqliteConnection,
    study: i64,
    spec: &StudySpec,
    optimisation: u32,
    round: u32,
    strokes: &[ParameterValues],
) -> Result<bool, StoreError> {
    let drawn: Vec<Drawn> = (0..STROKES)
        .zip(strokes)
        .map(|(stroke, parameters)| {
            let ordinal = probe_ordinal(optimisation, round, stroke);
            let key = probe_task(spec, ordinal, *parameters).key();
            Drawn { ordinal, point: parameters.0, key }
        })
        .collect();
    Ok(insert_simulations(db, study, JobRole::Probe, &drawn).await? > 0)
}

type Round = (u32, JobState, Option<Vec<u8>>);

/// The last round begun of an optimisation's search, its state and result.
async fn find_last_round(
    db: impl SqliteExecutor<'_>,
    study: i64,
    optimisation: u32,
) -> Result<Option<Round>, StoreError> {
    let found: Option<(i64, String, Option<Vec<u8>>)> = sqlx::query_as(
        "select j.ordinal, j.state, r.body from jobs as j left join results as r on r.job = j.job
         where j.study = ? and j.role = 'search' and j.ordinal between ? and ? order by j.ordinal desc limit 1",
    )
    .bind(study)
    .bind(search_ordinal(optimisation, 0))
    .bind(search_ordinal(optimisation, ROUNDS - 1))
    .fetch_optional(db)
    .await?;
    let Some((ordinal, state, result)) = found else { return Ok(None) };
    Ok(Some((round_of(unsigned(ordinal)?).1, named(&state)?, result)))
}

/// The result of a round.
async fn find_round(db: impl SqliteExecutor<'_>, study: i64, ordinal: u32) -> Result<Option<SearchResult>, StoreError> {
    let found: Option<Vec<u8>> = sqlx::query_scalar(
        "select r.body from jobs as j join results as r on r.job = j.job
         where j.study = ? and j.role = 'search' and j.ordinal = ?",
    )
    .bind(study)
    .bind(ordinal)
    .fetch_optional(db)
    .await?;
    found.map(body::parse).transpose()
}

/// The strokes a round asked for, in its order; those given up count as not to be flown.
async fn find_probes(
    db: impl SqliteExecutor<'_>,
    study: i64,
    optimisation: u32,
    round: u32,
) -> Result<Vec<FlownMessage>, StoreError> {
    let range = probe_ordinal(optimisation, round, 0)..=probe_ordinal(optimisation, round, STROKES - 1);
    find_flown(db, study, JobRole::Probe, range).await
}

/// Simulations of a role by ordinal, ended.
async fn find_flown(
    db: impl SqliteExecutor<'_>,
    study: i64,
    role: JobRole,
    ordinals: std::ops::RangeInclusive<u32>,
) -> Result<Vec<FlownMessage>, StoreError> {
    let rows: Vec<(String, Option<Vec<u8>>)> = sqlx::query_as(
        "select j.parameters, r.body from jobs as j left join results as r on r.job = coalesce(j.result_of, j.job)
         where j.study = ? and j.role = ? and j.ordinal between ? and ?
           and j.state in ('succeeded', 'infeasible', 'dead') order by j.ordinal",
    )
    .bind(study)
    .bind(role_name(role))
    .bind(ordinals.start())
    .bind(ordinals.end())
    .fetch_all(db)
    .await?;
    rows.into_iter().map(|(parameters, result)| flown(&parameters, result)).collect()
}

fn flown(parameters: &str, result: Option<Vec<u8>>) -> Result<FlownMessage, StoreError> {
    let point: Point = body::from_json(parameters.as_bytes())?;
    let result: Option<SimulateResult> = result.map(body::parse).transpose()?;
    let scaled = result.and_then(|result| match result.outcome {
        SimulateOutcome::Ok { scaled, .. } => Some(scaled),
        SimulateOutcome::Infeasible { .. } => None,
    });
    Ok(FlownMessage { parameters: ParameterValues(point), scaled })
}

impl Store {
    /// What a round follows: the round before it, and the strokes that one asked for.
    /// The first follows the optimum flown again.
    pub(crate) async fn before_round(
        &self,
        study: i64,
        ordinal: u32,
    ) -> Result<(Option<SearchResult>, Vec<FlownMessage>), StoreError> {
        let (optimisation, round) = round_of(ordinal);
        if round == 0 {
            let start = find_flown(self.readers(), study, JobRole::Verify, optimisation..=optimisation).await?;
            return Ok((None, start));
        }
        let before = find_round(self.readers(), study, ordinal - 1).await?;
        Ok((before, find_probes(self.readers(), study, optimisation, round - 1).await?))
    }

    /// How the search around an optimum stands, once its first round has ended.
    pub(super) async fn search_of(&self, study: i64, optimisation: u32) -> Result<Option<SearchView>, StoreError> {
        let summary: Option<Option<String>> = sqlx::query_scalar(
            "select r.summary from jobs as j join results as r on r.job = j.job
             where j.study = ? and j.role = 'search' and j.ordinal between ? and ? order by j.ordinal desc limit 1",
        )
        .bind(study)
        .bind(search_ordinal(optimisation, 0))
        .bind(search_ordinal(optimisation, ROUNDS - 1))
        .fetch_optional(self.readers())
        .await?;
        summary.flatten().map(|json| body::from_json(json.as_bytes())).transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ordinals_tell_optimisation_and_round() {
        assert_eq!(round_of(search_ordinal(31, 999)), (31, 999));
        assert_eq!(optimisation_of_probe(probe_ordinal(31, 999, 999)), 31);
        assert_eq!(optimisation_of_probe(probe_ordinal(0, 999, 999)), 0);
        // Ordinals fit the wire's 32 bits.
        assert_eq!(u64::from(probe_ordinal(31, 999, 999)), 31_999_999);
    }
}
