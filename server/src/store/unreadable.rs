//! A study whose rows cannot be read fails by itself: all others go on.

use manduca_protocol::ids::StudyId;
use manduca_protocol::view::StudyState;
use sqlx::Connection;
use sqlx::sqlite::SqliteConnection;

use super::advance::advance;
use super::names::uuid;
use super::{StoreError, Work};
use crate::event::Event;

/// [`advance`], but a study that cannot be read fails instead.
pub(super) async fn advance_or_fail(work: &mut Work<'_>, study: i64) -> Result<(), StoreError> {
    let told = work.events.len();
    let mut savepoint = Connection::begin(&mut *work.db).await?;
    let mut inner = Work {
        db: &mut savepoint,
        now: work.now,
        config: work.config,
        events: &mut *work.events,
        specs: &mut *work.specs,
        rota: &mut *work.rota,
    };
    match advance(&mut inner, study).await {
        Ok(()) => Ok(savepoint.commit().await?),
        Err(StoreError::Corrupt(why)) => {
            savepoint.rollback().await?;
            work.events.truncate(told);
            work.specs.clear();
            fail_unreadable(work, study, &why).await
        }
        Err(error) => Err(error),
    }
}

/// Says of what cannot be read which study it belongs to.
pub(super) fn of_study<T>(study: i64, read: Result<T, StoreError>) -> Result<T, StoreError> {
    read.map_err(|error| match error {
        StoreError::Corrupt(why) => StoreError::Unreadable(study, why),
        error => error,
    })
}

/// Ends a study that cannot be read, with the reason. Nothing more of it is given out, and it can be cancelled.
pub(super) async fn fail_unreadable(work: &mut Work<'_>, study: i64, why: &str) -> Result<(), StoreError> {
    let reason = format!("the database is damaged where this study lies: {why} (`manduca db check` says more)");
    sqlx::query(
        "update studies set condition = 'failed', failure = ? where study = ? and condition not in ('succeeded', 'cancelled')",
    )
    .bind(&reason)
    .bind(study)
    .execute(&mut *work.db)
    .await?;
    cancel_audits(work.db, study).await?;
    end_stages(work, study).await?;
    if let Some(id) = find_id(work.db, study).await? {
        work.events.push(Event::Moved { study: id, state: StudyState::Failed, reason: Some(reason) });
    }
    Ok(())
}

/// Cancels a study whose row cannot be read.
pub(super) async fn cancel_unreadable(work: &mut Work<'_>, study: i64) -> Result<(), StoreError> {
    end_stages(work, study).await?;
    sqlx::query("update studies set condition = 'cancelled' where study = ?")
        .bind(study)
        .execute(&mut *work.db)
        .await?;
    if let Some(id) = find_id(work.db, study).await? {
        work.events.push(Event::Moved { study: id, state: StudyState::Cancelled, reason: None });
    }
    Ok(())
}

/// Audits are given out after their study's end, too.
async fn cancel_audits(db: &mut SqliteConnection, study: i64) -> Result<(), StoreError> {
    sqlx::query(
        "update jobs set state = 'cancelled', lease_until_ms = null, not_before_ms = null, progress = null
         where study = ? and role = 'audit' and state in ('ready', 'delayed', 'leased')",
    )
    .bind(study)
    .execute(db)
    .await?;
    Ok(())
}

async fn end_stages(work: &mut Work<'_>, study: i64) -> Result<(), StoreError> {
    sqlx::query("update study_stages set ended_ms = max(started_ms, ?) where study = ? and ended_ms is null")
        .bind(work.now)
        .bind(study)
        .execute(&mut *work.db)
        .await?;
    Ok(())
}

async fn find_id(db: &mut SqliteConnection, study: i64) -> Result<Option<StudyId>, StoreError> {
    let id: Option<Vec<u8>> =
        sqlx::query_scalar("select id from studies where study = ?").bind(study).fetch_optional(db).await?;
    Ok(id.and_then(|id| uuid(&id).ok()).map(StudyId))
}
