//! A study comes in.

use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::ids::StudyId;
use manduca_protocol::view::JobRole;
use sqlx::sqlite::SqliteConnection;

use super::advance::{advance, begin, find_study};
use super::audits::choose;
use super::count::read_counts;
use super::names::{Stage, role_name, uuid};
use super::{Operation, StoreError, Work};
use crate::draw::Drawn;
use crate::event::Event;

/// Rows given to SQLite at once.
const CHUNK: usize = 2000;

/// A study with its samples, checked and drawn.
pub(crate) struct Submit {
    pub(crate) id: StudyId,
    pub(crate) name: String,
    /// Canonical JSON.
    pub(crate) spec: String,
    pub(crate) digest: [u8; 32],
    pub(crate) samples: u32,
    pub(crate) optimisations: usize,
    pub(crate) idempotency_key: Option<String>,
    /// Name of the token that submits it.
    pub(crate) by: Option<String>,
    pub(crate) drawn: Vec<Drawn>,
    /// Whether it takes no results of other studies.
    pub(crate) fresh: bool,
    /// What decides which of its samples are audited.
    pub(crate) secret: [u8; 32],
}

/// The study which now is, or already was.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Submitted {
    pub(crate) id: StudyId,
    pub(crate) created: bool,
}

impl Operation for Submit {
    type Output = Submitted;

    async fn apply(self, work: &mut Work<'_>) -> Result<Submitted, StoreError> {
        if let Some(key) = &self.idempotency_key
            && let Some(id) = find_by_idempotency_key(&mut *work.db, key, &self.digest).await?
        {
            return Ok(Submitted { id, created: false });
        }
        let study = insert_study(work, &self).await?;
        insert_samples(work, study, &self.drawn).await?;
        let counts = read_counts(&mut *work.db, study, JobRole::Sample).await?;
        let cached = counts.succeeded + counts.infeasible;
        work.events.push(Event::Submitted { study: self.id, samples: self.samples, cached, by: self.by.clone() });
        // Without samples there is no network: such a study only flies generations.
        let first = if self.samples == 0 { Stage::Optimising } else { Stage::Sampling };
        let row = find_study(work.db, study).await?;
        begin(work, &row, first).await?;
        advance(work, study).await?;
        Ok(Submitted { id: self.id, created: true })
    }
}

/// The study submitted under this key before.
///
/// # Errors
/// When that was another study.
pub(super) async fn find_by_idempotency_key(
    db: &mut SqliteConnection,
    key: &str,
    digest: &[u8; 32],
) -> Result<Option<StudyId>, StoreError> {
    let found: Option<(Vec<u8>, Vec<u8>)> =
        sqlx::query_as("select id, spec_digest from studies where idempotency_key = ?")
            .bind(key)
            .fetch_optional(db)
            .await?;
    let Some((id, earlier)) = found else { return Ok(None) };
    if earlier != digest {
        return Err(StoreError::IdempotencyKeyReused);
    }
    Ok(Some(StudyId(uuid(&id)?)))
}

async fn insert_study(work: &mut Work<'_>, study: &Submit) -> Result<i64, StoreError> {
    let inserted = sqlx::query(
        "insert into studies (id, name, spec, stage, condition, samples, next_sample, optimisations,
                              created_ms, idempotency_key, spec_digest, solver_version, submitted_by, fresh, secret)
         values (?1, ?2, ?3, 'sampling', 'running', ?4, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)",
    )
    .bind(study.id.0.as_bytes().as_slice())
    .bind(&study.name)
    .bind(&study.spec)
    .bind(study.samples)
    .bind(study.optimisations as i64)
    .bind(work.now)
    .bind(&study.idempotency_key)
    .bind(study.digest.as_slice())
    .bind(SOLVER_VERSION)
    .bind(&study.by)
    .bind(study.fresh)
    .bind(study.secret.as_slice())
    .execute(&mut *work.db)
    .await?;
    Ok(inserted.last_insert_rowid())
}

/// Notes that a stage begins, or goes on after all; what passed in between does not count.
pub(super) async fn insert_stage(work: &mut Work<'_>, study: i64, stage: Stage) -> Result<(), StoreError> {
    sqlx::query(
        "insert into study_stages (study, stage, started_ms) values (?, ?, ?)
         on conflict (study, stage) do update set
             started_ms = started_ms + excluded.started_ms - coalesce(ended_ms, excluded.started_ms), ended_ms = null",
    )
    .bind(study)
    .bind(stage.name())
    .bind(work.now)
    .execute(&mut *work.db)
    .await?;
    Ok(())
}

/// Queues samples; of those that share a result, some are audited.
pub(super) async fn insert_samples(work: &mut Work<'_>, study: i64, drawn: &[Drawn]) -> Result<u64, StoreError> {
    let inserted = insert_simulations(work.db, study, JobRole::Sample, drawn).await?;
    choose(work, study, drawn.iter().map(|d| (d.ordinal, d.key.as_slice()))).await?;
    Ok(inserted)
}

/// Queues simulations. One whose equal has a result already is inserted as
/// finished and shares that result, unless that came from a worker whose results were
/// disowned, or from another study and this one takes none. Those queued before stay as
/// they are.
pub(super) async fn insert_simulations(
    db: &mut SqliteConnection,
    study: i64,
    role: JobRole,
    drawn: &[Drawn],
) -> Result<u64, StoreError> {
    let mut inserted = 0;
    for chunk in drawn.chunks(CHUNK) {
        let rows: Vec<_> = chunk.iter().map(row).collect::<Result<_, _>>()?;
        let rows = serde_json::to_string(&rows).map_err(|e| StoreError::Corrupt(e.to_string()))?;
        inserted += insert_chunk(db, study, role, &rows).await?;
    }
    Ok(inserted)
}

/// Ordinal, parameters, key. The parameters travel as text inside the text, so
/// that SQLite never reads, rounds and writes them.
fn row(drawn: &Drawn) -> Result<(u32, String, String), StoreError> {
    let parameters = serde_json::to_string(&drawn.point).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    Ok((drawn.ordinal, parameters, blake3::Hash::from_bytes(drawn.key).to_hex().to_string()))
}

async fn insert_chunk(db: &mut SqliteConnection, study: i64, role: JobRole, rows: &str) -> Result<u64, StoreError> {
    let inserted = sqlx::query(
        "insert into jobs (study, role, ordinal, state, parameters, key, result_of, reason)
         select ?1, ?2, d.value ->> 0, coalesce(done.state, 'ready'), d.value ->> 1, unhex(d.value ->> 2),
                done.job, done.reason
         from json_each(?3) as d
         left join jobs as done on done.job = (
             select min(equal.job) from jobs as equal
             where equal.key = unhex(d.value ->> 2) and equal.state in ('succeeded', 'infeasible')
               and equal.result_of is null
               and (equal.study = ?1 or (select not s.fresh from studies as s where s.study = ?1))
               and not exists (select 1 from disowned as o where o.job = equal.job))
         where true
         on conflict (study, role, ordinal) do nothing",
    )
    .bind(study)
    .bind(role_name(role))
    .bind(rows)
    .execute(db)
    .await?;
    Ok(inserted.rows_affected())
}
