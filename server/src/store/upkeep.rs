//! Copies, checks and the removal of what is old.

use std::path::Path;

use manduca_protocol::ids::StudyId;
use sqlx::sqlite::SqliteConnection;

use super::last_use::doubt;
use super::names::uuid;
use super::{Operation, StoreError, Work};
use crate::config::millis;
use crate::event::Event;

/// Writes a copy of a database which may be in use: as it is at this moment, and compact.
pub(crate) async fn copy_to(db: &mut SqliteConnection, file: &Path) -> Result<(), sqlx::Error> {
    sqlx::query("vacuum into ?").bind(file.to_string_lossy().into_owned()).execute(db).await?;
    Ok(())
}

/// One rule of the store, and how often it is broken.
pub(crate) type Breach = (&'static str, i64);

/// What SQLite finds wrong with the file: its pages, its indexes, values against the rules of their columns.
pub(crate) async fn check_file(db: &mut SqliteConnection) -> Result<Vec<String>, sqlx::Error> {
    let said: Vec<String> = sqlx::query_scalar("pragma integrity_check(20)").fetch_all(&mut *db).await?;
    Ok(said.into_iter().filter(|line| line != "ok").collect())
}

/// The rules between the tables that are broken.
pub(crate) async fn list_breaches(db: &mut SqliteConnection) -> Result<Vec<Breach>, sqlx::Error> {
    let loose = sqlx::query("pragma foreign_key_check").fetch_all(&mut *db).await?.len() as i64;
    let mut breaches = vec![("rows refer to others which are not there", loose)];
    breaches.push(("counters differ from a recount", count_wrong_counters(db).await?));
    breaches.push(("finished jobs have no result", count_without_result(db).await?));
    breaches.push(("results belong to jobs which are not finished", count_early_results(db).await?));
    breaches.push(("leases have no worker or no end", count_loose_leases(db).await?));
    breaches.retain(|(_, n)| *n > 0);
    Ok(breaches)
}

async fn count_wrong_counters(db: &mut SqliteConnection) -> Result<i64, sqlx::Error> {
    sqlx::query_scalar(
        "select count(*) from (
             select study, role, state, count(*) as n from jobs group by study, role, state
             union all select study, role, state, -n from study_counts where n > 0)
         group by study, role, state having sum(n) <> 0",
    )
    .fetch_all(db)
    .await
    .map(|groups: Vec<i64>| groups.len() as i64)
}

async fn count_without_result(db: &mut SqliteConnection) -> Result<i64, sqlx::Error> {
    sqlx::query_scalar(
        "select count(*) from jobs as j where j.state in ('succeeded', 'infeasible')
         and not exists (select 1 from results as r where r.job = coalesce(j.result_of, j.job))",
    )
    .fetch_one(db)
    .await
}

async fn count_early_results(db: &mut SqliteConnection) -> Result<i64, sqlx::Error> {
    sqlx::query_scalar(
        "select count(*) from results as r join jobs as j on j.job = r.job
         where j.state not in ('succeeded', 'infeasible')",
    )
    .fetch_one(db)
    .await
}

async fn count_loose_leases(db: &mut SqliteConnection) -> Result<i64, sqlx::Error> {
    sqlx::query_scalar(
        "select count(*) from jobs where state = 'leased' and (worker is null or lease_until_ms is null)",
    )
    .fetch_one(db)
    .await
}

/// The studies which ended before this time, the oldest first, each with its jobs.
pub(crate) async fn list_ended_before(
    db: &mut SqliteConnection,
    before: i64,
) -> Result<Vec<(Vec<u8>, String, i64)>, sqlx::Error> {
    sqlx::query_as(
        "select s.id, s.name, coalesce((select sum(c.n) from study_counts as c where c.study = s.study), 0)
         from studies as s
         where s.condition in ('succeeded', 'failed', 'cancelled')
           and (select max(coalesce(t.ended_ms, t.started_ms)) from study_stages as t where t.study = s.study) < ?
           and not exists (select 1 from jobs as j where j.state = 'leased' and j.study = s.study)
         order by s.study",
    )
    .bind(before)
    .fetch_all(db)
    .await
}

/// A study which ended before this time, the oldest first.
pub(crate) async fn find_ended_before(
    db: &mut SqliteConnection,
    before: i64,
) -> Result<Option<(i64, Vec<u8>, String)>, sqlx::Error> {
    sqlx::query_as(
        "select s.study, s.id, s.name from studies as s
         where s.condition in ('succeeded', 'failed', 'cancelled')
           and (select max(coalesce(t.ended_ms, t.started_ms)) from study_stages as t where t.study = s.study) < ?
           and not exists (select 1 from jobs as j where j.state = 'leased' and j.study = s.study)
         order by s.study limit 1",
    )
    .bind(before)
    .fetch_optional(db)
    .await
}

/// Removes a study with all its jobs. Results which jobs of other studies share
/// go to one of those; gives how many jobs were removed.
pub(crate) async fn delete_study(db: &mut SqliteConnection, study: i64) -> Result<u64, sqlx::Error> {
    hand_results_on(db, study).await?;
    for table in [
        "delete from audits where study = ?",
        "delete from disowned where study = ?",
        "delete from replaced where study = ?",
        "delete from worked where study = ?",
        "delete from unchecked_results where job in (select job from jobs where study = ?)",
        "delete from checkpoints where job in (select job from jobs where study = ?)",
        "delete from results where job in (select job from jobs where study = ?)",
    ] {
        sqlx::query(table).bind(study).execute(&mut *db).await?;
    }
    // Jobs of one study may share results among themselves.
    sqlx::query("update jobs set result_of = null where study = ? and result_of is not null")
        .bind(study)
        .execute(&mut *db)
        .await?;
    let removed = sqlx::query("delete from jobs where study = ?").bind(study).execute(&mut *db).await?;
    for table in [
        "delete from study_counts where study = ?",
        "delete from study_stages where study = ?",
        "delete from added_optimisations where study = ?",
        "delete from studies where study = ?",
    ] {
        sqlx::query(table).bind(study).execute(&mut *db).await?;
    }
    Ok(removed.rows_affected())
}

/// The first job of another study which shares a result becomes its owner.
async fn hand_results_on(db: &mut SqliteConnection, study: i64) -> Result<(), sqlx::Error> {
    let heirs: Vec<(i64, i64)> = sqlx::query_as(
        "select o.job, min(d.job) from jobs as d join jobs as o on o.job = d.result_of
         where o.study = ?1 and d.study <> ?1 group by o.job",
    )
    .bind(study)
    .fetch_all(&mut *db)
    .await?;
    for (owner, heir) in heirs {
        let steps = [
            "update results set job = ?2 where job = ?1",
            "update jobs set result_of = null where job = ?2",
            "update jobs set result_of = ?2 where result_of = ?1",
        ];
        for step in steps {
            sqlx::query(step).bind(owner).bind(heir).execute(&mut *db).await?;
        }
    }
    Ok(())
}

/// Workers which said goodbye are kept for so long, ms.
const GONE_MS: i64 = 24 * 3600 * 1000;
/// Workers which are silent are kept for so long, ms.
const SILENT_MS: i64 = 7 * GONE_MS;
/// Workers removed in one commit: others wait behind it.
const MOST_FORGOTTEN: usize = 1000;

/// Workers which went long ago and which no job, result or evidence names: their ids in hexadecimal digits.
pub(crate) async fn list_forgotten(db: &mut SqliteConnection, now: i64) -> Result<Vec<String>, sqlx::Error> {
    sqlx::query_scalar(
        "select hex(id) from workers where (left_ms < ?1 or last_seen_ms < ?2)
           and id not in (select worker from jobs where worker is not null) and id not in (select worker from worked)
           and id not in (select worker from refused_results) and id not in (select worker from failures)",
    )
    .bind(now - GONE_MS)
    .bind(now - SILENT_MS)
    .fetch_all(db)
    .await
}

/// Removes these workers, unless one was heard of again. The connection must not enforce foreign keys,
/// which would look through all jobs for each.
pub(crate) async fn delete_workers(db: &mut SqliteConnection, workers: &[String], now: i64) -> Result<(), sqlx::Error> {
    for chunk in workers.chunks(MOST_FORGOTTEN) {
        sqlx::query(
            "delete from workers where id in (select unhex(value) from json_each(?1))
               and (left_ms < ?2 or last_seen_ms < ?3)",
        )
        .bind(serde_json::to_string(chunk).unwrap_or_default())
        .bind(now - GONE_MS)
        .bind(now - SILENT_MS)
        .execute(&mut *db)
        .await?;
    }
    Ok(())
}

/// Removes one study which ended long enough ago.
pub(crate) struct Prune {
    /// When the coordinator began to work, by its clock.
    pub(crate) began: i64,
}

/// What became of a removal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pruned {
    /// A study was removed; there may be others.
    One,
    /// There is none to remove.
    None,
    /// The clock is so far ahead of the store's last use that it may be wrong.
    Doubtful {
        /// The last use.
        last: i64,
    },
}

impl Operation for Prune {
    type Output = Pruned;

    async fn apply(self, work: &mut Work<'_>) -> Result<Pruned, StoreError> {
        let Some(keep) = work.config.keep else { return Ok(Pruned::None) };
        let Some((study, id, name)) = find_ended_before(work.db, work.now - millis(keep)).await? else {
            return Ok(Pruned::None);
        };
        if let Some(last) = doubt(work, self.began).await? {
            return Ok(Pruned::Doubtful { last });
        }
        let jobs = delete_study(work.db, study).await?;
        work.specs.clear();
        work.events.push(Event::Pruned { study: StudyId(uuid(&id)?), name, jobs });
        Ok(Pruned::One)
    }
}
