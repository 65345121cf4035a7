//! Searches which ask for simulations: rounds and strokes take turns, and each
//! is a job of its own.

use std::ops::RangeInclusive;

use manduca_numerics::parameters::Point;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::search::{BreedState, FlownMessage, RefineState, SearchNext, SearchResult, SearchState};
use manduca_protocol::study::{OptimisationSpec, StudySpec};
use manduca_protocol::task::{OptimiseResult, SimulateOutcome, SimulateResult};
use manduca_protocol::view::{JobRole, JobState, SearchView};
use sqlx::sqlite::{SqliteConnection, SqliteExecutor};

use super::names::{named, role_name, unsigned};
use super::submit::insert_simulations;
use super::{Store, StoreError, body};
use crate::compose::stroke_task;
use crate::draw::Drawn;

/// Most rounds of one search.
const ROUNDS: u32 = 1000;
/// Most strokes of one round.
pub(crate) const STROKES: u32 = 1000;

/// A search whose rounds and the strokes they ask for take turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Chain {
    /// Generations of a genetic algorithm whose fitness is flown.
    Breeding,
    /// Rounds of a trust region around an optimum.
    Refining,
}

impl Chain {
    /// What its rounds are.
    pub(super) fn rounds(self) -> JobRole {
        match self {
            Self::Breeding => JobRole::Generation,
            Self::Refining => JobRole::Search,
        }
    }

    /// What the strokes are which they ask for.
    fn strokes(self) -> JobRole {
        match self {
            Self::Breeding => JobRole::Individual,
            Self::Refining => JobRole::Probe,
        }
    }

    /// Whether an optimisation asks for it.
    fn is_wanted(self, asked: &OptimisationSpec) -> bool {
        match self {
            Self::Breeding => asked.is_direct(),
            Self::Refining => asked.refine_simulations > 0,
        }
    }
}

/// Which optimisation and which of its rounds a search job is.
pub(crate) fn round_of(ordinal: u32) -> (u32, u32) {
    (ordinal / ROUNDS, ordinal % ROUNDS)
}

/// The optimisation a stroke is flown for.
pub(crate) fn optimisation_of_stroke(ordinal: u32) -> u32 {
    ordinal / STROKES / ROUNDS
}

fn search_ordinal(optimisation: u32, round: u32) -> u32 {
    optimisation * ROUNDS + round
}

fn stroke_ordinal(optimisation: u32, round: u32, stroke: u32) -> u32 {
    search_ordinal(optimisation, round) * STROKES + stroke
}

/// Queues what each of a study's searches of a chain needs next, when no job of any is open.
/// Tells whether there was anything.
pub(super) async fn continue_searches(
    db: &mut SqliteConnection,
    study: i64,
    spec: &StudySpec,
    chain: Chain,
) -> Result<bool, StoreError> {
    let mut queued = false;
    for (optimisation, asked) in (0_u32..).zip(&spec.optimisations) {
        if chain.is_wanted(asked) {
            queued |= continue_search(db, study, spec, chain, optimisation).await?;
        }
    }
    Ok(queued)
}

async fn continue_search(
    db: &mut SqliteConnection,
    study: i64,
    spec: &StudySpec,
    chain: Chain,
    optimisation: u32,
) -> Result<bool, StoreError> {
    let Some((round, state, result)) = find_last_round(&mut *db, study, chain, optimisation).await? else {
        let begins = match chain {
            Chain::Breeding => true,
            // Only an optimum which can be flown is refined.
            Chain::Refining => {
                let start = find_flown(&mut *db, study, JobRole::Verify, optimisation..=optimisation).await?;
                start.iter().any(|stroke| stroke.scaled.is_some())
            }
        };
        if begins {
            insert_round(db, study, chain, optimisation, 0).await?;
        }
        return Ok(begins);
    };
    let (JobState::Succeeded, Some(result)) = (state, result) else { return Ok(false) };
    let SearchNext::Fly { strokes, .. } = body::parse::<SearchResult>(result)?.next else { return Ok(false) };
    if insert_strokes(db, study, spec, chain, (optimisation, round), &strokes).await? {
        return Ok(true);
    }
    if round + 1 >= ROUNDS {
        return Ok(false);
    }
    insert_round(db, study, chain, optimisation, round + 1).await?;
    Ok(true)
}

async fn insert_round(
    db: &mut SqliteConnection,
    study: i64,
    chain: Chain,
    optimisation: u32,
    round: u32,
) -> Result<(), StoreError> {
    sqlx::query("insert into jobs (study, role, ordinal, state) values (?, ?, ?, 'ready')")
        .bind(study)
        .bind(role_name(chain.rounds()))
        .bind(search_ordinal(optimisation, round))
        .execute(db)
        .await?;
    Ok(())
}

/// Queues the strokes of a round; tells whether they are new.
async fn insert_strokes(
    db: &mut SqliteConnection,
    study: i64,
    spec: &StudySpec,
    chain: Chain,
    (optimisation, round): (u32, u32),
    strokes: &[ParameterValues],
) -> Result<bool, StoreError> {
    let drawn: Vec<Drawn> = (0..STROKES)
        .zip(strokes)
        .map(|(stroke, parameters)| {
            let ordinal = stroke_ordinal(optimisation, round, stroke);
            let key = stroke_task(spec, chain.strokes(), ordinal, *parameters).key();
            Drawn { ordinal, point: parameters.0, key }
        })
        .collect();
    Ok(insert_simulations(db, study, chain.strokes(), &drawn).await? > 0)
}

type Round = (u32, JobState, Option<Vec<u8>>);

/// The last round begun of an optimisation's search, its state and result.
async fn find_last_round(
    db: impl SqliteExecutor<'_>,
    study: i64,
    chain: Chain,
    optimisation: u32,
) -> Result<Option<Round>, StoreError> {
    let found: Option<(i64, String, Option<Vec<u8>>)> = sqlx::query_as(
        "select j.ordinal, j.state, r.body from jobs as j left join results as r on r.job = j.job
         where j.study = ? and j.role = ? and j.ordinal between ? and ? order by j.ordinal desc limit 1",
    )
    .bind(study)
    .bind(role_name(chain.rounds()))
    .bind(search_ordinal(optimisation, 0))
    .bind(search_ordinal(optimisation, ROUNDS - 1))
    .fetch_optional(db)
    .await?;
    let Some((ordinal, state, result)) = found else { return Ok(None) };
    Ok(Some((round_of(unsigned(ordinal)?).1, named(&state)?, result)))
}

/// The optima which generations have found, by the place of their optimisation.
pub(super) async fn list_found(
    db: &mut SqliteConnection,
    study: i64,
    spec: &StudySpec,
) -> Result<Vec<(u32, OptimiseResult)>, StoreError> {
    let mut all = Vec::new();
    for (optimisation, asked) in (0_u32..).zip(&spec.optimisations) {
        if asked.is_direct()
            && let Some((_, JobState::Succeeded, Some(result))) =
                find_last_round(&mut *db, study, Chain::Breeding, optimisation).await?
            && let SearchNext::Found { optimum } = body::parse::<SearchResult>(result)?.next
        {
            all.push((optimisation, *optimum));
        }
    }
    Ok(all)
}

/// What a round handed on to the next.
async fn find_state(
    db: impl SqliteExecutor<'_>,
    study: i64,
    role: JobRole,
    ordinal: u32,
) -> Result<SearchState, StoreError> {
    let found: Option<Vec<u8>> = sqlx::query_scalar(
        "select r.body from jobs as j join results as r on r.job = j.job
         where j.study = ? and j.role = ? and j.ordinal = ?",
    )
    .bind(study)
    .bind(role_name(role))
    .bind(ordinal)
    .fetch_optional(db)
    .await?;
    match found.map(body::parse::<SearchResult>).transpose()?.map(|result| result.next) {
        Some(SearchNext::Fly { state, .. }) => Ok(*state),
        _ => Err(StoreError::Corrupt(format!("round {ordinal} of a search follows none"))),
    }
}

type Stroke = (String, Option<Vec<u8>>);

/// Simulations of a role by ordinal, ended: parameters and result; those given up count as not to be flown.
async fn list_strokes(
    db: impl SqliteExecutor<'_>,
    study: i64,
    role: JobRole,
    ordinals: RangeInclusive<u32>,
) -> Result<Vec<Stroke>, StoreError> {
    let rows = sqlx::query_as(
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
    Ok(rows)
}

async fn find_flown(
    db: impl SqliteExecutor<'_>,
    study: i64,
    role: JobRole,
    ordinals: RangeInclusive<u32>,
) -> Result<Vec<FlownMessage>, StoreError> {
    parsed(list_strokes(db, study, role, ordinals).await?)
}

fn parsed(rows: Vec<Stroke>) -> Result<Vec<FlownMessage>, StoreError> {
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
    /// What a round follows: what the round before it left, and the strokes that one asked for.
    /// The first generation follows nothing; the first round of refining the optimum flown
    /// again, and of a `direct` optimisation all that its generations have flown.
    pub(crate) async fn before_round(
        &self,
        study: i64,
        role: JobRole,
        ordinal: u32,
        direct: bool,
    ) -> Result<(SearchState, Vec<FlownMessage>), StoreError> {
        let (optimisation, round) = round_of(ordinal);
        let chain = if role == JobRole::Generation { Chain::Breeding } else { Chain::Refining };
        if round > 0 {
            let state = find_state(self.readers(), study, role, ordinal - 1).await?;
            let asked =
                stroke_ordinal(optimisation, round - 1, 0)..=stroke_ordinal(optimisation, round - 1, STROKES - 1);
            return Ok((state, find_flown(self.readers(), study, chain.strokes(), asked).await?));
        }
        if chain == Chain::Breeding {
            return Ok((SearchState::Breed(BreedState::default()), Vec::new()));
        }
        let around = if direct { self.individuals(study, optimisation).await? } else { Vec::new() };
        let start = find_flown(self.readers(), study, JobRole::Verify, optimisation..=optimisation).await?;
        Ok((SearchState::Refine(RefineState::first(around)), start))
    }

    /// Every stroke which the generations of an optimisation have flown.
    async fn individuals(&self, study: i64, optimisation: u32) -> Result<Vec<FlownMessage>, StoreError> {
        let all = stroke_ordinal(optimisation, 0, 0)..=stroke_ordinal(optimisation, ROUNDS - 1, STROKES - 1);
        let rows = list_strokes(self.readers(), study, JobRole::Individual, all).await?;
        // Thousands of results are parsed: not on the threads which serve.
        let parsed = tokio::task::spawn_blocking(move || parsed(rows)).await;
        parsed.map_err(|e| StoreError::Corrupt(e.to_string()))?
    }

    /// Whether a round of a search of an optimisation has been given up.
    pub(super) async fn is_given_up(&self, study: i64, chain: Chain, optimisation: u32) -> Result<bool, StoreError> {
        let dead: i64 = sqlx::query_scalar(
            "select count(*) from jobs where state = 'dead' and study = ? and role = ? and ordinal between ? and ?",
        )
        .bind(study)
        .bind(role_name(chain.rounds()))
        .bind(search_ordinal(optimisation, 0))
        .bind(search_ordinal(optimisation, ROUNDS - 1))
        .fetch_one(self.readers())
        .await?;
        Ok(dead > 0)
    }

    /// How a search of an optimisation stands, once its first round has ended.
    pub(super) async fn search_of(
        &self,
        study: i64,
        chain: Chain,
        optimisation: u32,
    ) -> Result<Option<SearchView>, StoreError> {
        let summary: Option<Option<String>> = sqlx::query_scalar(
            "select r.summary from jobs as j join results as r on r.job = j.job
             where j.study = ? and j.role = ? and j.ordinal between ? and ? order by j.ordinal desc limit 1",
        )
        .bind(study)
        .bind(role_name(chain.rounds()))
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
        assert_eq!(optimisation_of_stroke(stroke_ordinal(31, 999, 999)), 31);
        assert_eq!(optimisation_of_stroke(stroke_ordinal(0, 999, 999)), 0);
        // Ordinals fit the wire's 32 bits.
        assert_eq!(u64::from(stroke_ordinal(31, 999, 999)), 31_999_999);
    }
}
