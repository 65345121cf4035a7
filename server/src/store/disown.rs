//! A worker's results are not believed any more: they are dropped and computed again where that is
//! still possible, and marked where something has been built on them.

use manduca_protocol::ids::{StudyId, WorkerId};
use sqlx::sqlite::SqliteConnection;

use super::names::uuid;
use super::shares::Rota;
use super::specs::Specs;
use super::workers::give_back_leases;
use super::{Operation, StoreError, Work};
use crate::config::Config;
use crate::event::Event;

/// Sets a worker aside and disowns all of its results.
pub(crate) struct Disown {
    pub(crate) worker: WorkerId,
    pub(crate) why: String,
}

impl Operation for Disown {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        disown(work, self.worker, &self.why).await
    }
}

/// Lets a worker have jobs again, and those that registered under its name and token.
pub(crate) struct Readmit {
    pub(crate) worker: WorkerId,
}

impl Operation for Readmit {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        let readmitted = sqlx::query(
            "update workers set set_aside_ms = null, set_aside_reason = null, strikes = 0, quarantined_until_ms = null
             from (select name, token from workers where id = ?) as w
             where workers.name = w.name and workers.token is w.token",
        )
        .bind(self.worker.0.as_bytes().as_slice())
        .execute(&mut *work.db)
        .await?;
        if readmitted.rows_affected() == 0 {
            return Err(StoreError::UnknownWorker(self.worker));
        }
        work.events.push(Event::Readmitted { worker: self.worker });
        work.events.push(Event::Ready);
        Ok(())
    }
}

/// Disowns a worker by its id, or all workers of a name, without a coordinator.
pub(crate) async fn disown_in(
    db: &mut SqliteConnection,
    now: i64,
    config: &Config,
    worker: &str,
) -> Result<Vec<WorkerId>, StoreError> {
    let id = worker.parse().ok().map(|id: WorkerId| id.0.as_bytes().to_vec());
    let ids: Vec<Vec<u8>> = sqlx::query_scalar("select id from workers where name = ?1 or id = ?2")
        .bind(worker)
        .bind(id)
        .fetch_all(&mut *db)
        .await?;
    let (mut events, mut specs, mut rota) = (Vec::new(), Specs::default(), Rota::default());
    let mut disowned = Vec::new();
    for id in ids {
        let worker = WorkerId(uuid(&id)?);
        let mut work = Work { db: &mut *db, now, config, events: &mut events, specs: &mut specs, rota: &mut rota };
        disown(&mut work, worker, "disowned by an operator").await?;
        disowned.push(worker);
    }
    Ok(disowned)
}

/// Sets a worker aside and disowns all of its results. Twice is as good as once.
pub(super) async fn disown(work: &mut Work<'_>, worker: WorkerId, why: &str) -> Result<(), StoreError> {
    let name = set_aside(work, worker, why).await?;
    drop_unfinished(work, worker).await?;
    list_touched(work.db, worker).await?;
    let told = list_studies(work.db).await?;
    hand_on(work.db).await?;
    drop_audits(work.db).await?;
    queue_again(work.db, worker).await?;
    mark(work, worker).await?;
    sqlx::query("delete from touched").execute(&mut *work.db).await?;
    work.events.push(Event::SetAside { worker, name, reason: why.into() });
    for (id, replaced, marked) in told {
        let study = StudyId(uuid(&id)?);
        work.events.push(Event::Disowned { study, worker, replaced, marked });
    }
    work.events.push(Event::Ready);
    Ok(())
}

/// Gives it no jobs until an operator readmits it; the first reason stays.
async fn set_aside(work: &mut Work<'_>, worker: WorkerId, why: &str) -> Result<String, StoreError> {
    let name: Option<String> = sqlx::query_scalar(
        "update workers set set_aside_reason = iif(set_aside_ms is null, ?2, set_aside_reason),
                            set_aside_ms = coalesce(set_aside_ms, ?3)
         where id = ?1 returning name",
    )
    .bind(worker.0.as_bytes().as_slice())
    .bind(why)
    .bind(work.now)
    .fetch_optional(&mut *work.db)
    .await?;
    name.ok_or(StoreError::UnknownWorker(worker))
}

/// Takes away what it computes, with where that stands.
async fn drop_unfinished(work: &mut Work<'_>, worker: WorkerId) -> Result<(), StoreError> {
    let worker_bytes = worker.0.as_bytes().as_slice();
    for drop in [
        "delete from checkpoints where job in (select job from jobs where worker = ? and state = 'leased')",
        "delete from checkpoints where worker = ?",
        "delete from unchecked_results where worker = ?",
    ] {
        sqlx::query(drop).bind(worker_bytes).execute(&mut *work.db).await?;
    }
    give_back_leases(work, worker).await?;
    Ok(())
}

/// Lists the jobs that have a result of this worker, their own or another job's, and whether their
/// study still samples.
async fn list_touched(db: &mut SqliteConnection, worker: WorkerId) -> Result<(), StoreError> {
    sqlx::query(
        "with own as materialized (
             select r.job from worked as w cross join jobs as j on j.study = w.study
             cross join results as r on r.job = j.job where w.worker = ?1 and r.worker = ?1)
         insert into touched
         select j.job, d.owner, j.study, j.role, j.ordinal,
                s.stage = 'sampling' and s.condition in ('running', 'paused', 'failed')
         from (select job as owner, job from own
               union all
               select own.job, same.job from own cross join jobs as same on same.result_of = own.job) as d
         cross join jobs as j on j.job = d.job
         cross join studies as s on s.study = j.study
         where not exists (select 1 from disowned as o where o.job = j.job)",
    )
    .bind(worker.0.as_bytes().as_slice())
    .execute(&mut *db)
    .await?;
    Ok(())
}

/// For each study, how many results will be replaced and how many marked; audits are counted in neither.
async fn list_studies(db: &mut SqliteConnection) -> Result<Vec<(Vec<u8>, i64, i64)>, StoreError> {
    let told = sqlx::query_as(
        "select s.id, sum(t.samples), sum(not t.samples)
         from touched as t join studies as s on s.study = t.study
         where t.role <> 'audit' group by t.study",
    )
    .fetch_all(db)
    .await?;
    Ok(told)
}

/// A result that is dropped from its own study and shared by others past their sampling stays with the first of these.
async fn hand_on(db: &mut SqliteConnection) -> Result<(), StoreError> {
    let heirs: Vec<(i64, i64)> = sqlx::query_as(
        "select t.owner, min(t.job) from touched as t
         join touched as o on o.job = t.owner
         where o.samples and not t.samples group by t.owner",
    )
    .fetch_all(&mut *db)
    .await?;
    for (owner, heir) in heirs {
        for step in [
            "update results set job = ?2 where job = ?1",
            "update jobs set result_of = null where job = ?2",
            "update jobs set result_of = ?2
             where result_of = ?1 and job in (select job from touched where owner = ?1 and not samples)",
        ] {
            sqlx::query(step).bind(owner).bind(heir).execute(&mut *db).await?;
        }
    }
    Ok(())
}

/// Comparisons with these results say nothing. Audits of samples that are computed again are made again with them.
async fn drop_audits(db: &mut SqliteConnection) -> Result<(), StoreError> {
    for step in [
        "delete from audits where job in (select job from touched)",
        // Whatever they had found, they will be chosen again with the next result of their sample.
        "update jobs set state = 'cancelled', lease_until_ms = null, not_before_ms = null, progress = null
         from touched as t
         where t.role = 'sample' and t.samples and jobs.study = t.study and jobs.role = 'audit'
           and jobs.ordinal = t.ordinal",
        "delete from results where job in (
             select a.job from touched as t
             join jobs as a on a.study = t.study and a.role = 'audit' and a.ordinal = t.ordinal
             where t.role = 'sample' and t.samples)",
        "delete from audits where sample in (select job from touched where role = 'sample')",
    ] {
        sqlx::query(step).execute(&mut *db).await?;
    }
    Ok(())
}

/// Queues the jobs of studies that still sample, and drops their results.
async fn queue_again(db: &mut SqliteConnection, worker: WorkerId) -> Result<(), StoreError> {
    sqlx::query(
        "insert into replaced (study, worker, n)
         select study, ?1, count(*) from touched where samples and role <> 'audit' group by study
         on conflict (study, worker) do update set n = n + excluded.n",
    )
    .bind(worker.0.as_bytes().as_slice())
    .execute(&mut *db)
    .await?;
    for step in [
        // An audit that was cancelled above with its sample stays so.
        "update jobs set state = 'ready', worker = null, reason = null, failures = 0, losses = 0, result_of = null,
                         lease_until_ms = null, not_before_ms = null, progress = null
         where job in (select job from touched where samples) and state in ('succeeded', 'infeasible')",
        "delete from results where job in (select owner from touched)
           and job in (select job from touched where samples)",
    ] {
        sqlx::query(step).execute(&mut *db).await?;
    }
    Ok(())
}

/// Marks the results that studies past their sampling rest on: nobody shares them any more.
async fn mark(work: &mut Work<'_>, worker: WorkerId) -> Result<(), StoreError> {
    sqlx::query(
        "insert or ignore into disowned (job, study, worker, since_ms)
         select job, study, ?1, ?2 from touched where not samples and role <> 'audit'",
    )
    .bind(worker.0.as_bytes().as_slice())
    .bind(work.now)
    .execute(&mut *work.db)
    .await?;
    Ok(())
}
