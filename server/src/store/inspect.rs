//! Rows as `manduca db check` reads them: texts as bytes, for a damaged one need not be text.

use sqlx::sqlite::SqliteConnection;

/// Rows of one read.
const CHUNK: i64 = 500;

/// A study.
#[derive(Debug, sqlx::FromRow)]
pub(crate) struct StudyRow {
    pub(crate) study: i64,
    pub(crate) id: Vec<u8>,
    pub(crate) name: Vec<u8>,
    pub(crate) spec: Vec<u8>,
    pub(crate) spec_digest: Vec<u8>,
    pub(crate) stage: Vec<u8>,
    pub(crate) condition: Vec<u8>,
    pub(crate) samples: i64,
    pub(crate) next_sample: i64,
    pub(crate) optimisations: i64,
    pub(crate) solver_version: Option<Vec<u8>>,
}

/// A job, with the result it has or shares.
#[derive(Debug, sqlx::FromRow)]
pub(crate) struct JobRow {
    pub(crate) job: i64,
    pub(crate) study: i64,
    pub(crate) role: Vec<u8>,
    pub(crate) state: Vec<u8>,
    pub(crate) ordinal: i64,
    pub(crate) attempt: i64,
    pub(crate) failures: i64,
    pub(crate) losses: i64,
    pub(crate) parameters: Option<Vec<u8>>,
    pub(crate) key: Option<Vec<u8>>,
    pub(crate) worker: Option<Vec<u8>>,
    pub(crate) reason: Option<Vec<u8>>,
    pub(crate) progress: Option<Vec<u8>>,
    /// Key of the job whose result this one shares.
    pub(crate) shared_key: Option<Vec<u8>>,
    pub(crate) shares: bool,
}

/// A result, with the role of its job.
#[derive(Debug, sqlx::FromRow)]
pub(crate) struct ResultRow {
    pub(crate) job: i64,
    pub(crate) role: Option<Vec<u8>>,
    pub(crate) state: Option<Vec<u8>>,
    pub(crate) reason: Option<Vec<u8>>,
    pub(crate) attempt: i64,
    pub(crate) worker: Vec<u8>,
    pub(crate) digest: Vec<u8>,
    pub(crate) body: Vec<u8>,
    pub(crate) summary: Option<Vec<u8>>,
    pub(crate) wall_s: f64,
    pub(crate) level: Vec<u8>,
}

/// All studies.
pub(crate) async fn list_studies(db: &mut SqliteConnection) -> Result<Vec<StudyRow>, sqlx::Error> {
    sqlx::query_as(
        "select study, id, cast(name as blob) as name, cast(spec as blob) as spec, spec_digest,
                cast(stage as blob) as stage, cast(condition as blob) as condition, samples, next_sample,
                optimisations, cast(solver_version as blob) as solver_version
         from studies order by study",
    )
    .fetch_all(db)
    .await
}

/// Added optimisations: study, ordinal, specification.
pub(crate) async fn list_added(db: &mut SqliteConnection) -> Result<Vec<(i64, i64, Vec<u8>)>, sqlx::Error> {
    sqlx::query_as("select study, ordinal, cast(spec as blob) from added_optimisations order by study, ordinal")
        .fetch_all(db)
        .await
}

/// Some jobs, after this one.
pub(crate) async fn list_jobs(db: &mut SqliteConnection, after: i64) -> Result<Vec<JobRow>, sqlx::Error> {
    sqlx::query_as(
        "select j.job, j.study, cast(j.role as blob) as role, cast(j.state as blob) as state, j.ordinal, j.attempt,
                j.failures, j.losses, cast(j.parameters as blob) as parameters, j.key, j.worker,
                cast(j.reason as blob) as reason, cast(j.progress as blob) as progress, o.key as shared_key,
                j.result_of is not null as shares
         from jobs as j left join jobs as o on o.job = j.result_of
         where j.job > ? order by j.job limit ?",
    )
    .bind(after)
    .bind(CHUNK)
    .fetch_all(db)
    .await
}

/// Some results, after that of this job.
pub(crate) async fn list_results(db: &mut SqliteConnection, after: i64) -> Result<Vec<ResultRow>, sqlx::Error> {
    sqlx::query_as(
        "select r.job, cast(j.role as blob) as role, cast(j.state as blob) as state, cast(j.reason as blob) as reason,
                r.attempt, r.worker, r.digest, r.body, cast(r.summary as blob) as summary, r.wall_s,
                cast(r.level as blob) as level
         from results as r left join jobs as j on j.job = r.job
         where r.job > ? order by r.job limit ?",
    )
    .bind(after)
    .bind(CHUNK)
    .fetch_all(db)
    .await
}

/// Refused results whose body is kept, after this one: number, digest, body.
pub(crate) async fn list_refused(
    db: &mut SqliteConnection,
    after: i64,
) -> Result<Vec<(i64, Vec<u8>, Vec<u8>)>, sqlx::Error> {
    sqlx::query_as(
        "select refused, digest, body from refused_results where body is not null and refused > ? order by refused limit ?",
    )
    .bind(after)
    .bind(CHUNK)
    .fetch_all(db)
    .await
}

/// Checkpoints after that of this job: job, body.
pub(crate) async fn list_checkpoints(
    db: &mut SqliteConnection,
    after: i64,
) -> Result<Vec<(i64, Vec<u8>)>, sqlx::Error> {
    sqlx::query_as("select job, body from checkpoints where job > ? order by job limit 1")
        .bind(after)
        .fetch_all(db)
        .await
}

/// Tokens: name, scopes, length of the hash.
pub(crate) async fn list_token_rows(db: &mut SqliteConnection) -> Result<Vec<(Vec<u8>, Vec<u8>, i64)>, sqlx::Error> {
    sqlx::query_as("select cast(name as blob), cast(scopes as blob), length(hash) from tokens order by token")
        .fetch_all(db)
        .await
}

/// Workers: id, name, instruction level, version of the solver.
pub(crate) async fn list_worker_rows(
    db: &mut SqliteConnection,
) -> Result<Vec<(Vec<u8>, Vec<u8>, Vec<u8>, Option<Vec<u8>>)>, sqlx::Error> {
    sqlx::query_as(
        "select id, cast(name as blob), cast(level as blob), cast(solver_version as blob) from workers order by id",
    )
    .fetch_all(db)
    .await
}

/// Stages: study, stage, whether it ended before it began.
pub(crate) async fn list_stage_rows(db: &mut SqliteConnection) -> Result<Vec<(i64, Vec<u8>, bool)>, sqlx::Error> {
    sqlx::query_as(
        "select study, cast(stage as blob), coalesce(ended_ms < started_ms, 0) from study_stages order by study, stage",
    )
    .fetch_all(db)
    .await
}
