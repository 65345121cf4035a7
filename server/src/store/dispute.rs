//! A sample and its audit differ: the coordinator flies the stroke itself, and whoever differs from it is wrong.

use std::collections::BTreeSet;

use manduca_protocol::ids::{JobId, WorkerId};
use manduca_protocol::study::StudySpec;
use manduca_protocol::task::{JobKind, Provenance};
use sqlx::sqlite::SqliteConnection;

use super::advance::advance_ended;
use super::complete::{Outcome, Prepared};
use super::disown::disown;
use super::evidence::{Class, Evidence, refuse, settle};
use super::names::{unsigned, uuid};
use super::{Operation, Store, StoreError, Work, body};

/// How often the coordinator begins to fly a stroke about which two workers differ.
const MOST_TRIES: i64 = 3;

/// A stroke about which two workers differ.
#[derive(Debug, Clone)]
pub(crate) struct Dispute {
    pub(crate) audit: JobId,
    pub(crate) sample: JobId,
    pub(crate) ordinal: u32,
    pub(crate) parameters: String,
    pub(crate) spec: StudySpec,
}

#[derive(sqlx::FromRow)]
struct Raw {
    audit: i64,
    sample: i64,
    ordinal: i64,
    parameters: String,
    spec: String,
}

impl Store {
    /// The oldest of the differences that are to be settled.
    pub(crate) async fn next_dispute(&self) -> Result<Option<Dispute>, StoreError> {
        let raw: Option<Raw> = sqlx::query_as(
            "select a.job as audit, a.sample, s.ordinal, s.parameters, p.spec
             from audits as a cross join jobs as s on s.job = a.sample cross join study_specs as p on p.study = a.study
             where a.verdict = 'disputed' order by a.job limit 1",
        )
        .fetch_optional(self.readers())
        .await?;
        let Some(raw) = raw else { return Ok(None) };
        Ok(Some(Dispute {
            audit: JobId(raw.audit),
            sample: JobId(raw.sample),
            ordinal: unsigned(raw.ordinal)?,
            parameters: raw.parameters,
            spec: body::from_json(raw.spec.as_bytes())?,
        }))
    }
}

/// Counts that a stroke is about to be flown: one that takes the coordinator with it is not flown for ever.
pub(crate) struct BeginDispute {
    pub(crate) audit: JobId,
}

impl Operation for BeginDispute {
    /// Whether it may be flown.
    type Output = bool;

    async fn apply(self, work: &mut Work<'_>) -> Result<bool, StoreError> {
        let tries: Option<i64> = sqlx::query_scalar(
            "update audits set tries = tries + 1 where job = ? and verdict = 'disputed' returning tries",
        )
        .bind(self.audit.0)
        .fetch_optional(&mut *work.db)
        .await?;
        Ok(tries.is_some_and(|tries| tries <= MOST_TRIES))
    }
}

/// What the coordinator's own flight says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Truth {
    /// The digest of its result.
    Digest([u8; 32]),
    /// It has a number that is not finite: no result is right.
    Nothing,
    /// It could not be flown.
    Unknown,
}

/// Settles a difference by the coordinator's own flight.
pub(crate) struct Settle {
    pub(crate) audit: JobId,
    pub(crate) truth: Truth,
}

#[derive(sqlx::FromRow)]
struct Held {
    job: i64,
    attempt: i64,
    worker: Vec<u8>,
    name: String,
    digest: Vec<u8>,
    body: Vec<u8>,
    level: String,
    wall_s: f64,
}

impl Operation for Settle {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        let found: Option<(i64, i64)> =
            sqlx::query_as("select study, sample from audits where job = ? and verdict = 'disputed'")
                .bind(self.audit.0)
                .fetch_optional(&mut *work.db)
                .await?;
        let Some((study, sample)) = found else { return Ok(()) };
        let truth: Option<&[u8]> = match &self.truth {
            Truth::Digest(digest) => Some(digest),
            Truth::Nothing => None,
            Truth::Unknown => {
                sqlx::query("update audits set verdict = 'undecided' where job = ?")
                    .bind(self.audit.0)
                    .execute(&mut *work.db)
                    .await?;
                return advance_ended(work, &BTreeSet::from([study])).await;
            }
        };
        let mut wrong = Vec::new();
        for job in [sample, self.audit.0] {
            wrong.extend(find_held(work.db, job).await?.filter(|held| truth != Some(held.digest.as_slice())));
        }
        sqlx::query("delete from audits where job = ?").bind(self.audit.0).execute(&mut *work.db).await?;
        let (mut accused, mut evidence) = (BTreeSet::new(), Evidence::default());
        for held in wrong {
            let worker = WorkerId(uuid(&held.worker)?);
            let why = format!("its result of job {} differs from the coordinator's own flight", held.job);
            accuse(work, &mut evidence, worker, &held, &why).await?;
            if accused.insert(worker) {
                disown(work, worker, &why).await?;
            }
        }
        settle(work, evidence).await?;
        advance_ended(work, &BTreeSet::from([study])).await
    }
}

/// The result a job has, its own or a shared one.
async fn find_held(db: &mut SqliteConnection, job: i64) -> Result<Option<Held>, StoreError> {
    let held = sqlx::query_as(
        "select r.job, r.attempt, r.worker, w.name, r.digest, r.body, r.level, r.wall_s
         from jobs as j cross join results as r on r.job = coalesce(j.result_of, j.job)
         cross join workers as w on w.id = r.worker
         where j.job = ?",
    )
    .bind(job)
    .fetch_optional(db)
    .await?;
    Ok(held)
}

/// Keeps a wrong result as evidence against its worker.
async fn accuse(
    work: &mut Work<'_>,
    evidence: &mut Evidence,
    worker: WorkerId,
    held: &Held,
    why: &str,
) -> Result<(), StoreError> {
    let digest = held.digest.as_slice().try_into();
    let wrong = Prepared {
        job: JobId(held.job),
        attempt: unsigned(held.attempt)?,
        kind: JobKind::Simulate,
        outcome: Outcome::Succeeded,
        flown: None,
        digest: digest.map_err(|_| StoreError::Corrupt("the digest of a result is cut".into()))?,
        body: held.body.clone(),
        summary: None,
        provenance: Provenance { wall_s: held.wall_s, level: held.level.clone() },
    };
    tracing::warn!(worker.id = %worker, worker.name = held.name, job.id = held.job, "{why}");
    refuse(work, evidence, worker, &wrong, Class::Nondeterminism, why).await
}
