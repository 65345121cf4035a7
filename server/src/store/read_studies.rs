//! Studies as users see them.

use std::collections::BTreeMap;

use manduca_protocol::ids::StudyId;
use manduca_protocol::study::StudySpec;
use manduca_protocol::task::{
    ErrorsMessage, OptimiseResult, Progress, Scaled, SimulateOutcome, SimulateResult, TrainResult,
};
use manduca_protocol::view::{
    JobCounts, JobRole, OptimumStatus, OptimumView, StageSeconds, StudyState, StudySummary, StudyView, SurrogateView,
};
use sqlx::Row;
use sqlx::sqlite::{SqlitePool, SqliteRow};

use super::advance::BEFORE_KEPT;
use super::count::{open_jobs, read_counts};
use super::names::{Condition, Stage, named, role_name, unsigned, uuid};
use super::search::{Chain, list_found};
use super::{Store, StoreError, body};
use crate::clock::rfc3339;
use crate::remark;

#[derive(sqlx::FromRow)]
struct RawStudy {
    study: i64,
    name: String,
    samples: i64,
    stage: String,
    condition: String,
    failure: Option<String>,
    created_ms: i64,
    solver_version: Option<String>,
    submitted_by: Option<String>,
    steered_by: Option<String>,
}

/// A study's head: where it is and what was asked.
pub(crate) struct StudyHead {
    pub(crate) study: i64,
    pub(crate) stage: Stage,
    pub(crate) condition: Condition,
    pub(crate) failure: Option<String>,
    pub(crate) created_ms: i64,
    pub(crate) spec: StudySpec,
    /// Of the numbers it was begun with.
    pub(crate) solver_version: String,
    submitted_by: Option<String>,
    steered_by: Option<String>,
}

impl StudyHead {
    /// What users call its state.
    pub(crate) fn state(&self) -> StudyState {
        self.condition.state(self.stage)
    }

    /// What most jobs of its stage are for.
    fn counted(&self) -> JobRole {
        let flies = self.stage == Stage::Optimising && self.spec.optimisations.iter().any(|o| o.is_direct());
        if flies { JobRole::Individual } else { self.stage.role() }
    }
}

/// How far generations are: strokes flown, and how many will be at most.
fn breeding(spec: &StudySpec, optima: &[OptimumView], strokes: &JobCounts) -> Progress {
    let flown = strokes.succeeded + strokes.infeasible + strokes.dead;
    let mut left = open_jobs(strokes);
    let mut notes = Vec::new();
    for (asked, optimum) in spec.optimisations.iter().zip(optima).filter(|(asked, _)| asked.is_direct()) {
        if optimum.optimum.is_some() {
            continue;
        }
        let told = optimum.breeding.as_ref().map_or(0, |b| b.standing.rounds);
        let best = optimum.breeding.as_ref().and_then(|b| b.standing.fitness);
        let best = best.map_or_else(String::new, |fitness| format!(", best fitness {fitness:.5}"));
        notes.push(format!("{}: generation {} of {}{best}", asked.name, told + 1, asked.generations()));
        // The generation which is flown is among the open jobs.
        left += u64::from(asked.population()) * u64::from(asked.generations().saturating_sub(told + 1));
    }
    Progress { done: flown, total: flown + left, note: notes.join("; ") }
}

impl Store {
    /// A study's head.
    ///
    /// # Errors
    /// When there is no such study, or its row cannot be read.
    pub(crate) async fn study_head(&self, id: StudyId) -> Result<StudyHead, StoreError> {
        match self.readable_head(id).await? {
            (head, None) => Ok(head),
            (_, Some(damage)) => Err(StoreError::Corrupt(damage)),
        }
    }

    /// What can be read of a study's head, and what is wrong with the rest: to look at, not to compute from.
    async fn readable_head(&self, id: StudyId) -> Result<(StudyHead, Option<String>), StoreError> {
        let raw: Option<RawStudy> = sqlx::query_as(
            "select study, name, samples, stage, condition, failure, created_ms, solver_version, submitted_by, steered_by
             from studies where id = ?",
        )
        .bind(id.0.as_bytes().as_slice())
        .fetch_optional(self.readers())
        .await?;
        let raw = raw.ok_or(StoreError::UnknownStudy(id))?;
        let mut damage = None;
        let spec = match self.spec_of(raw.study).await {
            Ok(spec) => spec,
            Err(StoreError::Corrupt(why)) => {
                damage = Some(format!("the specification of this study cannot be read: {why}"));
                placeholder(raw.name, raw.samples)?
            }
            Err(error) => return Err(error),
        };
        let head = StudyHead {
            study: raw.study,
            stage: readable(named(&raw.stage).map(Some), &mut damage)?.unwrap_or(Stage::Sampling),
            condition: readable(named(&raw.condition).map(Some), &mut damage)?.unwrap_or(Condition::Failed),
            failure: raw.failure,
            created_ms: raw.created_ms,
            spec,
            solver_version: raw.solver_version.unwrap_or_else(|| BEFORE_KEPT.to_owned()),
            submitted_by: raw.submitted_by,
            steered_by: raw.steered_by,
        };
        Ok((head, damage))
    }

    async fn spec_of(&self, study: i64) -> Result<StudySpec, StoreError> {
        let spec: String = sqlx::query_scalar("select spec from study_specs where study = ?")
            .bind(study)
            .fetch_one(self.readers())
            .await?;
        body::from_json(spec.as_bytes())
    }

    /// A whole study; rate and estimate are left to the caller, who knows them.
    pub(crate) async fn study(&self, id: StudyId, now: i64) -> Result<StudyView, StoreError> {
        let (head, mut damage) = self.readable_head(id).await?;
        let db = self.readers();
        let stage_jobs = read_counts(db, head.study, head.counted()).await?;
        // A damaged part is left out, so that the rest can be seen and the study cancelled.
        let surrogate = readable(self.test_errors_of(head.study).await, &mut damage)?;
        let optimisations = readable(self.optima(&head).await, &mut damage)?;
        let progress = match head.counted() {
            JobRole::Individual => Some(breeding(&head.spec, &optimisations, &stage_jobs)),
            _ => readable(find_progress(db, head.study, head.stage).await, &mut damage)?,
        };
        Ok(StudyView {
            id,
            state: head.state(),
            paused_from: (head.condition == Condition::Paused).then(|| head.stage.state()),
            failure: head.failure.clone().or(damage),
            created_at: rfc3339(head.created_ms),
            samples: self.sample_counts(head.study).await?,
            stage_jobs,
            audits: read_counts(db, head.study, JobRole::Audit).await?,
            audit_verdicts: self.audit_verdicts(head.study).await?,
            distrusted: self.distrusted(head.study).await?,
            disowned_results: self.disowned_results(head.study).await?,
            progress,
            rate_per_s: None,
            eta_s: None,
            stages_s: self.stage_seconds(head.study, now).await?,
            surrogate,
            optimisations,
            submitted_by: head.submitted_by,
            steered_by: head.steered_by,
            spec: head.spec,
            solver_version: head.solver_version,
        })
    }

    /// Sampling jobs of a study by state.
    pub(crate) async fn sample_counts(&self, study: i64) -> Result<JobCounts, StoreError> {
        read_counts(self.readers(), study, JobRole::Sample).await
    }

    /// How long each stage took, or takes so far.
    pub(crate) async fn stage_seconds(&self, study: i64, now: i64) -> Result<StageSeconds, StoreError> {
        let rows: Vec<(String, i64, Option<i64>)> =
            sqlx::query_as("select stage, started_ms, ended_ms from study_stages where study = ?")
                .bind(study)
                .fetch_all(self.readers())
                .await?;
        let mut seconds = StageSeconds::default();
        for (stage, started, ended) in rows {
            let slot = match named::<Stage>(&stage)? {
                Stage::Sampling => &mut seconds.sampling,
                Stage::Training => &mut seconds.training,
                Stage::Optimising => &mut seconds.optimising,
                Stage::Verifying => &mut seconds.verifying,
                Stage::Refining => &mut seconds.refining,
            };
            *slot = Some((ended.unwrap_or(now) - started).max(0) as f64 / 1000.0);
        }
        Ok(seconds)
    }

    /// The errors of a study's surrogate on the test share, once there is one. Its curve, which may be long, is
    /// not read.
    pub(crate) async fn test_errors_of(&self, study: i64) -> Result<Option<ErrorsMessage>, StoreError> {
        let errors: Option<Option<String>> = sqlx::query_scalar(
            "select r.summary ->> '$.test' from jobs as j join results as r on r.job = j.job
             where j.study = ? and j.role = 'train' and j.ordinal = 0",
        )
        .bind(study)
        .fetch_optional(self.readers())
        .await?;
        errors.flatten().map(|json| body::from_json(json.as_bytes())).transpose()
    }

    /// A study's training without the weights, once there is one.
    pub(crate) async fn surrogate_of(&self, study: i64) -> Result<Option<SurrogateView>, StoreError> {
        let summary: Option<Option<String>> = sqlx::query_scalar(
            "select r.summary from jobs as j join results as r on r.job = j.job
             where j.study = ? and j.role = 'train' and j.ordinal = 0",
        )
        .bind(study)
        .fetch_optional(self.readers())
        .await?;
        match summary.flatten() {
            Some(json) => body::parse_apart(json.into_bytes()).await.map(Some),
            None => Ok(None),
        }
    }

    /// A study's whole training, once there is one.
    pub(crate) async fn training_of(&self, study: i64) -> Result<Option<TrainResult>, StoreError> {
        let stored: Option<Vec<u8>> = sqlx::query_scalar(
            "select r.body from jobs as j join results as r on r.job = j.job
             where j.study = ? and j.role = 'train' and j.ordinal = 0",
        )
        .bind(study)
        .fetch_optional(self.readers())
        .await?;
        match stored {
            Some(stored) => body::parse_apart(stored).await.map(Some),
            None => Ok(None),
        }
    }

    /// Every optimisation of a study, in the order asked.
    pub(crate) async fn optima(&self, head: &StudyHead) -> Result<Vec<OptimumView>, StoreError> {
        if head.spec.optimisations.is_empty() {
            return Ok(Vec::new());
        }
        let mut optimised = list_ended(self.readers(), head.study, JobRole::Optimise).await?;
        let mut verified = list_ended(self.readers(), head.study, JobRole::Verify).await?;
        let found = list_found(&mut *self.readers().acquire().await?, head.study, &head.spec).await?;
        let mut found: BTreeMap<u32, OptimiseResult> = found.into_iter().collect();
        let mut optima = Vec::with_capacity(head.spec.optimisations.len());
        for (ordinal, asked) in (0_u32..).zip(&head.spec.optimisations) {
            let optimised = optimised.remove(&ordinal.into());
            let verified = verified.remove(&ordinal.into());
            let gone = self.is_given_up(head.study, Chain::Breeding, ordinal).await?;
            let dead = gone || [&optimised, &verified].iter().any(|job| matches!(job, Some(None)));
            let optimum: Option<OptimiseResult> = match found.remove(&ordinal) {
                None => match optimised.flatten() {
                    Some(stored) => Some(body::parse_apart(stored).await?),
                    None => None,
                },
                bred => bred,
            };
            let simulated: Option<SimulateResult> = verified.flatten().map(body::parse).transpose()?;
            let breeding = self.search_of(head.study, Chain::Breeding, ordinal).await?;
            let search = self.search_of(head.study, Chain::Refining, ordinal).await?;
            let status = match (&optimum, &simulated) {
                _ if dead => OptimumStatus::Failed,
                _ if search.as_ref().is_some_and(|s| s.ended.is_some()) => OptimumStatus::Refined,
                (Some(_), Some(_)) => OptimumStatus::Verified,
                (Some(_), None) => OptimumStatus::Optimised,
                (None, _) => OptimumStatus::Pending,
            };
            let gap = optimum.as_ref().zip(simulated.as_ref()).and_then(|(o, s)| gap(o, s));
            let name = asked.name.clone();
            let (refined_clearance_mm, paper, warnings) = (None, None, Vec::new());
            let view = OptimumView {
                name,
                status,
                optimum,
                simulated,
                gap,
                breeding,
                search,
                refined_clearance_mm,
                paper,
                warnings,
            };
            optima.push(view);
        }
        remark::complete(&head.spec, &mut optima);
        Ok(optima)
    }

    /// A page of studies, newest first, before the study of this short number. The next one stands in for one that
    /// cannot be read.
    pub(crate) async fn studies(
        &self,
        state: Option<&str>,
        mut before: i64,
        limit: u32,
    ) -> Result<Vec<(i64, StudySummary)>, StoreError> {
        let mut page = Vec::new();
        loop {
            let wanted = limit as usize - page.len();
            let rows = list_studies(self.readers(), state, before, wanted as i64).await?;
            page.extend(rows.iter().filter_map(listed));
            match rows.last() {
                Some(last) if rows.len() == wanted && page.len() < limit as usize => before = last.try_get("study")?,
                _ => return Ok(page),
            }
        }
    }

    /// The study submitted under this key before, for those who would rather not draw its samples again.
    pub(crate) async fn study_by_idempotency_key(
        &self,
        key: &str,
        digest: &[u8; 32],
    ) -> Result<Option<StudyId>, StoreError> {
        let mut db = self.readers().acquire().await?;
        super::submit::find_by_idempotency_key(&mut db, key, digest).await
    }
}

/// What stands for a specification that cannot be read: the name and the number of samples are kept elsewhere, too.
fn placeholder(name: String, samples: i64) -> Result<StudySpec, StoreError> {
    let known = serde_json::json!({ "name": name, "sampling": { "samples": samples } });
    serde_json::from_value(known).map_err(|e| StoreError::Corrupt(e.to_string()))
}

/// A part of a view, or nothing where it cannot be read; what is wrong is told once.
fn readable<T: Default>(part: Result<T, StoreError>, damage: &mut Option<String>) -> Result<T, StoreError> {
    match part {
        Err(StoreError::Corrupt(why)) => {
            damage.get_or_insert(format!("a part of this study cannot be read: {why}"));
            Ok(T::default())
        }
        part => part,
    }
}

/// Simulated minus predicted.
fn gap(optimum: &OptimiseResult, simulated: &SimulateResult) -> Option<Scaled> {
    let SimulateOutcome::Ok { scaled, .. } = &simulated.outcome else { return None };
    let predicted = &optimum.predicted;
    Some(Scaled {
        lift: scaled.lift.mean - predicted.lift,
        drag: scaled.drag.mean - predicted.drag,
        pitch_moment: scaled.pitch_moment.mean - predicted.pitch_moment,
        power: scaled.power.mean - predicted.power,
    })
}

/// Ended jobs of a role by ordinal: their result, or none where the job is dead.
async fn list_ended(db: &SqlitePool, study: i64, role: JobRole) -> Result<BTreeMap<i64, Option<Vec<u8>>>, StoreError> {
    let rows: Vec<(i64, Option<Vec<u8>>)> = sqlx::query_as(
        "select j.ordinal, r.body from jobs as j left join results as r on r.job = coalesce(j.result_of, j.job)
         where j.study = ? and j.role = ? and j.state in ('succeeded', 'infeasible', 'dead')",
    )
    .bind(study)
    .bind(role_name(role))
    .fetch_all(db)
    .await?;
    Ok(rows.into_iter().collect())
}

/// Where the one long job of a stage is; of many short ones the counts tell.
async fn find_progress(db: &SqlitePool, study: i64, stage: Stage) -> Result<Option<Progress>, StoreError> {
    if matches!(stage, Stage::Sampling | Stage::Verifying | Stage::Refining) {
        return Ok(None);
    }
    let progress: Option<String> = sqlx::query_scalar(
        "select progress from jobs where study = ? and role = ? and state = 'leased' and progress is not null
         order by ordinal limit 1",
    )
    .bind(study)
    .bind(role_name(stage.role()))
    .fetch_optional(db)
    .await?;
    progress.map(|json| body::from_json(json.as_bytes())).transpose()
}

#[derive(sqlx::FromRow)]
struct RawSummary {
    study: i64,
    id: Vec<u8>,
    /// Bytes, for a damaged name need not be text.
    name: Vec<u8>,
    stage: String,
    condition: String,
    created_ms: i64,
    samples: i64,
    succeeded: i64,
    submitted_by: Option<String>,
}

async fn list_studies(
    db: &SqlitePool,
    state: Option<&str>,
    before: i64,
    limit: i64,
) -> Result<Vec<SqliteRow>, StoreError> {
    let rows = sqlx::query(
        "select s.study, s.id, cast(s.name as blob) as name, s.stage, s.condition, s.created_ms, s.samples,
                coalesce(c.n, 0) as succeeded, s.submitted_by
         from studies as s
         left join study_counts as c on c.study = s.study and c.role = 'sample' and c.state = 'succeeded'
         where s.study < ?1 and (?2 is null or iif(s.condition = 'running', s.stage, s.condition) = ?2)
         order by s.study desc limit ?3",
    )
    .bind(before)
    .bind(state)
    .bind(limit)
    .fetch_all(db)
    .await?;
    Ok(rows)
}

/// A study of a list, or nothing where its row cannot be read: one damaged row must not hide the others.
fn listed(row: &SqliteRow) -> Option<(i64, StudySummary)> {
    let raw: Result<RawSummary, sqlx::Error> = sqlx::FromRow::from_row(row);
    let read = raw.map_err(StoreError::from).and_then(summary);
    let study: i64 = row.try_get("study").unwrap_or_default();
    let told = |e: &StoreError| tracing::error!(study, error.cause = %e, "A study cannot be read and is passed over");
    read.inspect_err(told).ok()
}

fn summary(raw: RawSummary) -> Result<(i64, StudySummary), StoreError> {
    let stage = named(&raw.stage).unwrap_or(Stage::Sampling);
    let condition = named(&raw.condition).unwrap_or(Condition::Failed);
    let summary = StudySummary {
        id: StudyId(uuid(&raw.id)?),
        name: String::from_utf8_lossy(&raw.name).into_owned(),
        state: condition.state(stage),
        created_at: rfc3339(raw.created_ms),
        samples: unsigned(raw.samples)?,
        samples_succeeded: unsigned(raw.succeeded.max(0))?,
        submitted_by: raw.submitted_by,
    };
    Ok((raw.study, summary))
}
