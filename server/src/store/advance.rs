//! A study moves from stage to stage, inside the operation whose change lets it.

use std::collections::BTreeSet;

use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::ids::StudyId;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::resolve;
use manduca_protocol::study::StudySpec;
use manduca_protocol::task::OptimiseResult;
use manduca_protocol::view::{JobRole, StudyState};
use sqlx::sqlite::SqliteConnection;

use super::audits::is_disputed;
use super::count::{open_jobs, read_counts};
use super::decide::{Step, after_optimising, after_refining, after_sampling, after_training, after_verifying};
use super::names::{Condition, Stage, named, role_name, unsigned, uuid};
use super::search::{continue_searches, list_found};
use super::submit::{insert_samples, insert_simulations, insert_stage};
use super::unreadable::advance_or_fail;
use super::{StoreError, Work, body};
use crate::compose::verify_task;
use crate::draw::{Drawn, draw};
use crate::event::Event;

/// The version of studies from before versions were kept: the one there was then.
pub(super) const BEFORE_KEPT: &str = "4";

#[derive(sqlx::FromRow)]
struct RawStudy {
    id: Vec<u8>,
    stage: String,
    condition: String,
    samples: i64,
    next_sample: i64,
    optimisations: i64,
    solver_version: Option<String>,
}

/// A study as decisions see it.
pub(super) struct StudyRow {
    pub(super) study: i64,
    pub(super) id: StudyId,
    pub(super) stage: Stage,
    pub(super) condition: Condition,
    samples: u32,
    next_sample: u32,
    pub(super) optimisations: i64,
    solver_version: Option<String>,
}

impl StudyRow {
    /// Whether the study may fly and compute on.
    ///
    /// # Errors
    /// When it was begun with other numbers than this coordinator's: results are not mixed.
    pub(super) fn check_numbers(&self) -> Result<(), StoreError> {
        let begun = self.solver_version.as_deref().unwrap_or(BEFORE_KEPT);
        if begun == SOLVER_VERSION {
            return Ok(());
        }
        Err(StoreError::WrongState(format!(
            "the study was begun with solver version {begun}, this coordinator computes with {SOLVER_VERSION}, and \
             their results are not mixed: what it has stays; submit it again for new results"
        )))
    }
}

/// A study by its short number.
pub(super) async fn find_study(db: &mut SqliteConnection, study: i64) -> Result<StudyRow, StoreError> {
    let raw: RawStudy = sqlx::query_as(
        "select id, stage, condition, samples, next_sample, optimisations, solver_version from studies where study = ?",
    )
    .bind(study)
    .fetch_one(db)
    .await?;
    Ok(StudyRow {
        study,
        id: StudyId(uuid(&raw.id)?),
        stage: named(&raw.stage)?,
        condition: named(&raw.condition)?,
        samples: unsigned(raw.samples)?,
        next_sample: unsigned(raw.next_sample)?,
        optimisations: raw.optimisations,
        solver_version: raw.solver_version,
    })
}

/// Moves on those of these studies which have no open job left in their stage.
pub(super) async fn advance_ended(work: &mut Work<'_>, studies: &BTreeSet<i64>) -> Result<(), StoreError> {
    if studies.is_empty() {
        return Ok(());
    }
    let mut open = BTreeSet::new();
    for (study, stage, role) in list_open(work.db, studies).await? {
        // What cannot be read is found out by advancing.
        if let (Ok(stage), Ok(role)) = (named::<Stage>(&stage), named(&role))
            && stage.roles().contains(&role)
        {
            open.insert(study);
        }
    }
    for &study in studies.difference(&open) {
        advance_or_fail(work, study).await?;
    }
    Ok(())
}

/// For each of these studies which moves, its stage and the roles of which it has open jobs.
async fn list_open(
    db: &mut SqliteConnection,
    studies: &BTreeSet<i64>,
) -> Result<Vec<(i64, String, String)>, StoreError> {
    let studies = serde_json::to_string(studies).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    let open = sqlx::query_as(
        "select s.study, s.stage, c.role
         from json_each(?1) as d cross join studies as s on s.study = d.value
         cross join study_counts as c on c.study = s.study
         where c.state in ('ready', 'delayed', 'leased') and c.n > 0
         union all
         select s.study, s.stage, 'audit'
         from json_each(?1) as d cross join studies as s on s.study = d.value
         where exists (select 1 from audits as a where a.study = s.study and a.verdict = 'disputed')",
    )
    .bind(studies)
    .fetch_all(db)
    .await?;
    Ok(open)
}

/// Moves a study as far as its finished jobs allow.
pub(super) async fn advance(work: &mut Work<'_>, study: i64) -> Result<(), StoreError> {
    // More than one step happens where a stage's jobs all share earlier results.
    loop {
        let row = find_study(work.db, study).await?;
        if row.condition != Condition::Running {
            return Ok(());
        }
        if is_open(work.db, &row).await? {
            return Ok(());
        }
        // A stage is over when its searches have nothing left to do.
        if let Some(chain) = row.stage.chain() {
            let spec = read_spec(work.db, row.study).await?;
            if continue_searches(work.db, row.study, &spec, chain).await? {
                work.events.push(Event::Ready);
                continue;
            }
        }
        match decide(work.db, &row).await? {
            Step::Draw(n) => draw_further(work, &row, n).await?,
            Step::Enter(stage) => enter(work, &row, stage).await?,
            Step::Succeed => return end(work, &row, "succeeded", None).await,
            Step::Fail(why) => return end(work, &row, "failed", Some(why)).await,
        }
    }
}

/// Whether a job of the stage waits or runs.
async fn is_open(db: &mut SqliteConnection, row: &StudyRow) -> Result<bool, StoreError> {
    for &role in row.stage.roles() {
        if open_jobs(&read_counts(&mut *db, row.study, role).await?) > 0 {
            return Ok(true);
        }
    }
    // Nothing is learnt from samples about which two workers differ.
    Ok(row.stage == Stage::Sampling && is_disputed(db, row.study).await?)
}

/// What follows a stage which has nothing left to do.
async fn decide(db: &mut SqliteConnection, row: &StudyRow) -> Result<Step, StoreError> {
    /// Whose failures are told of a search for optima.
    const SEARCHES: [JobRole; 2] = [JobRole::Optimise, JobRole::Generation];
    let study = row.study;
    Ok(match row.stage {
        Stage::Sampling => {
            let counts = read_counts(&mut *db, study, JobRole::Sample).await?;
            let last = find_last_failure(db, study, &[JobRole::Sample]).await?;
            after_sampling(row.samples, row.next_sample, &counts, last.as_deref())
        }
        Stage::Training => {
            let counts = read_counts(&mut *db, study, JobRole::Train).await?;
            let last = find_last_failure(db, study, &[JobRole::Train]).await?;
            after_training(&counts, row.optimisations, last.as_deref())
        }
        Stage::Optimising => {
            let last = find_last_failure(&mut *db, study, &SEARCHES).await?;
            after_optimising(list_optima(db, study).await?.len(), last.as_deref())
        }
        Stage::Verifying => {
            let counts = read_counts(&mut *db, study, JobRole::Verify).await?;
            let last = find_last_failure(&mut *db, study, &[JobRole::Verify]).await?;
            let earlier = find_last_failure(&mut *db, study, &SEARCHES).await?;
            let found = list_optima(db, study).await?.len();
            after_verifying(row.optimisations, found, &counts, last.or(earlier).as_deref())
        }
        Stage::Refining => {
            let counts = read_counts(&mut *db, study, JobRole::Search).await?;
            let last = find_last_failure(db, study, &[JobRole::Search]).await?;
            after_refining(&counts, last.as_deref())
        }
    })
}

/// Why the last job of any of these roles was given up.
async fn find_last_failure(
    db: &mut SqliteConnection,
    study: i64,
    roles: &[JobRole],
) -> Result<Option<String>, StoreError> {
    for &role in roles {
        if let Some(reason) = find_reason(&mut *db, study, role).await? {
            return Ok(Some(reason));
        }
    }
    Ok(None)
}

async fn find_reason(db: &mut SqliteConnection, study: i64, role: JobRole) -> Result<Option<String>, StoreError> {
    let reason: Option<Option<String>> = sqlx::query_scalar(
        "select reason from jobs where state = 'dead' and study = ? and role = ? order by job desc limit 1",
    )
    .bind(study)
    .bind(role_name(role))
    .fetch_optional(db)
    .await?;
    Ok(reason.flatten())
}

async fn draw_further(work: &mut Work<'_>, row: &StudyRow, n: u32) -> Result<(), StoreError> {
    let spec = read_spec(work.db, row.study).await?;
    let resolved = resolved(&spec)?;
    let end = row.next_sample.saturating_add(n);
    let drawn = draw(&spec, &resolved, row.next_sample..end);
    let jobs = insert_samples(work, row.study, &drawn).await?;
    set_next_sample(work.db, row.study, end).await?;
    work.events.push(Event::Drawn { study: row.id, jobs });
    work.events.push(Event::Ready);
    Ok(())
}

async fn set_next_sample(db: &mut SqliteConnection, study: i64, next: u32) -> Result<(), StoreError> {
    sqlx::query("update studies set next_sample = ? where study = ?").bind(next).bind(study).execute(db).await?;
    Ok(())
}

async fn enter(work: &mut Work<'_>, row: &StudyRow, stage: Stage) -> Result<(), StoreError> {
    end_stage(work, row.study, row.stage).await?;
    begin(work, row, stage).await
}

/// Makes `stage` the present one and queues its jobs; those of its searches are queued by
/// [`advance`].
pub(super) async fn begin(work: &mut Work<'_>, row: &StudyRow, stage: Stage) -> Result<(), StoreError> {
    set_stage(work, row, stage).await?;
    match stage {
        Stage::Sampling | Stage::Refining => {}
        Stage::Training => insert_job(work.db, row.study, JobRole::Train, 0).await?,
        Stage::Optimising => insert_optimisations(work.db, row.study).await?,
        Stage::Verifying => insert_verifications(work.db, row.study).await?,
    }
    work.events.push(Event::Ready);
    Ok(())
}

/// Makes `stage` the present one of a running study.
pub(super) async fn set_stage(work: &mut Work<'_>, row: &StudyRow, stage: Stage) -> Result<(), StoreError> {
    sqlx::query("update studies set stage = ?, condition = 'running', failure = null where study = ?")
        .bind(stage.name())
        .bind(row.study)
        .execute(&mut *work.db)
        .await?;
    insert_stage(work, row.study, stage).await?;
    work.events.push(Event::Moved { study: row.id, state: stage.state(), reason: None });
    Ok(())
}

/// Queues a job, unless there is one.
async fn insert_job(db: &mut SqliteConnection, study: i64, role: JobRole, ordinal: u32) -> Result<(), StoreError> {
    sqlx::query(
        "insert into jobs (study, role, ordinal, state) values (?, ?, ?, 'ready')
         on conflict (study, role, ordinal) do nothing",
    )
    .bind(study)
    .bind(role_name(role))
    .bind(ordinal)
    .execute(db)
    .await?;
    Ok(())
}

/// One job per optimisation on the network; those of an earlier pass stay as they are.
async fn insert_optimisations(db: &mut SqliteConnection, study: i64) -> Result<(), StoreError> {
    let spec = read_spec(&mut *db, study).await?;
    for (ordinal, asked) in (0_u32..).zip(&spec.optimisations) {
        if !asked.is_direct() {
            insert_job(&mut *db, study, JobRole::Optimise, ordinal).await?;
        }
    }
    Ok(())
}

/// One simulation per optimum found; those of an earlier pass stay as they are.
async fn insert_verifications(db: &mut SqliteConnection, study: i64) -> Result<(), StoreError> {
    let spec = read_spec(&mut *db, study).await?;
    let mut optima = Vec::new();
    for (ordinal, found) in list_optima(&mut *db, study).await? {
        let point = found.parameters.0;
        let key = verify_task(&spec, ordinal, ParameterValues(point)).key();
        optima.push(Drawn { ordinal, point, key });
    }
    insert_simulations(db, study, JobRole::Verify, &optima).await?;
    Ok(())
}

/// The optima found, on the network and by generations, by the place of their optimisation.
async fn list_optima(db: &mut SqliteConnection, study: i64) -> Result<Vec<(u32, OptimiseResult)>, StoreError> {
    let rows: Vec<(i64, Vec<u8>)> = sqlx::query_as(
        "select j.ordinal, r.body from jobs as j join results as r on r.job = j.job
         where j.study = ? and j.role = 'optimise' and j.state = 'succeeded' order by j.ordinal",
    )
    .bind(study)
    .fetch_all(&mut *db)
    .await?;
    let mut optima = Vec::with_capacity(rows.len());
    for (ordinal, found) in rows {
        optima.push((unsigned(ordinal)?, body::parse(found)?));
    }
    let spec = read_spec(&mut *db, study).await?;
    optima.extend(list_found(db, study, &spec).await?);
    Ok(optima)
}

/// The study ends here, with a reason when it has failed.
pub(super) async fn end(
    work: &mut Work<'_>,
    row: &StudyRow,
    condition: &'static str,
    reason: Option<String>,
) -> Result<(), StoreError> {
    end_stage(work, row.study, row.stage).await?;
    sqlx::query("update studies set condition = ?, failure = ? where study = ?")
        .bind(condition)
        .bind(&reason)
        .bind(row.study)
        .execute(&mut *work.db)
        .await?;
    let state = if reason.is_some() { StudyState::Failed } else { StudyState::Succeeded };
    work.events.push(Event::Moved { study: row.id, state, reason });
    Ok(())
}

/// Notes when a stage ended.
pub(super) async fn end_stage(work: &mut Work<'_>, study: i64, stage: Stage) -> Result<(), StoreError> {
    sqlx::query(
        "update study_stages set ended_ms = max(started_ms, ?) where study = ? and stage = ? and ended_ms is null",
    )
    .bind(work.now)
    .bind(study)
    .bind(stage.name())
    .execute(&mut *work.db)
    .await?;
    Ok(())
}

/// The specification of a study.
pub(super) async fn read_spec(db: &mut SqliteConnection, study: i64) -> Result<StudySpec, StoreError> {
    let spec: String =
        sqlx::query_scalar("select spec from study_specs where study = ?").bind(study).fetch_one(db).await?;
    body::from_json(spec.as_bytes())
}

/// A stored specification, checked again: another version of this code may have written it.
pub(super) fn resolved(spec: &StudySpec) -> Result<resolve::ResolvedStudy, StoreError> {
    resolve::study(spec).map_err(|faults| {
        let faults: Vec<_> = faults.iter().map(ToString::to_string).collect();
        StoreError::Corrupt(faults.join("; "))
    })
}
