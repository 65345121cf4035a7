//! How far a study's results are to be believed.

use manduca_protocol::ids::WorkerId;
use manduca_protocol::trust::{AuditVerdicts, DistrustedWorker};

use super::names::{unsigned, uuid};
use super::{Store, StoreError};

#[derive(sqlx::FromRow)]
struct Raw {
    id: Vec<u8>,
    name: String,
    token: Option<String>,
    reason: Option<String>,
    replaced: i64,
    disowned: i64,
}

impl Store {
    /// What became of a study's audits.
    pub(crate) async fn audit_verdicts(&self, study: i64) -> Result<AuditVerdicts, StoreError> {
        let rows: Vec<(String, bool, i64)> = sqlx::query_as(
            "select verdict, independent, count(*) from audits where study = ? group by verdict, independent",
        )
        .bind(study)
        .fetch_all(self.readers())
        .await?;
        let mut verdicts = AuditVerdicts::default();
        for (verdict, independent, n) in rows {
            let place = match (verdict.as_str(), independent) {
                ("agrees", true) => &mut verdicts.independent,
                ("agrees", false) => &mut verdicts.not_independent,
                ("disputed", _) => &mut verdicts.disputed,
                _ => &mut verdicts.undecided,
            };
            *place += unsigned::<u64>(n)?;
        }
        Ok(verdicts)
    }

    /// The workers whose results in a study are not believed.
    pub(crate) async fn distrusted(&self, study: i64) -> Result<Vec<DistrustedWorker>, StoreError> {
        let rows: Vec<Raw> = sqlx::query_as(
            "select w.id, w.name, w.token, w.set_aside_reason as reason, sum(d.replaced) as replaced,
                    sum(d.disowned) as disowned
             from (select worker, n as replaced, 0 as disowned from replaced where study = ?1
                   union all
                   select worker, 0, count(*) from disowned where study = ?1 group by worker) as d
             join workers as w on w.id = d.worker group by w.id order by w.name, w.id",
        )
        .bind(study)
        .fetch_all(self.readers())
        .await?;
        let view = |raw: Raw| {
            Ok(DistrustedWorker {
                worker: WorkerId(uuid(&raw.id)?),
                name: raw.name,
                token: raw.token,
                reason: raw.reason,
                replaced: unsigned(raw.replaced)?,
                disowned: unsigned(raw.disowned)?,
            })
        };
        rows.into_iter().map(view).collect()
    }

    /// How many results that a study rests on are not believed any more.
    pub(crate) async fn disowned_results(&self, study: i64) -> Result<u64, StoreError> {
        let n: i64 = sqlx::query_scalar("select count(*) from disowned where study = ?")
            .bind(study)
            .fetch_one(self.readers())
            .await?;
        unsigned(n)
    }

    /// Names of the workers heard of lately that are set aside until an operator readmits them.
    pub(crate) async fn set_aside(&self) -> Result<Vec<String>, StoreError> {
        let names = sqlx::query_scalar(
            "select name from workers where set_aside_ms is not null and left_ms is null order by name limit 10",
        )
        .fetch_all(self.readers())
        .await?;
        Ok(names)
    }

    /// Names of the workers that are given no jobs for a while because too many attempts failed, and how long at most, s.
    pub(crate) async fn quarantined(&self, now: i64) -> Result<Vec<(String, f64)>, StoreError> {
        let names: Vec<(String, i64)> = sqlx::query_as(
            "select name, quarantined_until_ms - ?1 from workers
             where quarantined_until_ms > ?1 and left_ms is null order by name limit 10",
        )
        .bind(now)
        .fetch_all(self.readers())
        .await?;
        Ok(names.into_iter().map(|(name, ms)| (name, ms as f64 / 1000.0)).collect())
    }

    /// The worker whose result a job has although it is not believed any more, by name.
    pub(crate) async fn disowner(&self, job: i64) -> Result<Option<String>, StoreError> {
        let name =
            sqlx::query_scalar("select w.name from disowned as d join workers as w on w.id = d.worker where d.job = ?")
                .bind(job)
                .fetch_optional(self.readers())
                .await?;
        Ok(name)
    }
}
