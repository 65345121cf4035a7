//! When the store was last at work, and whether the clock may be believed.

use sqlx::sqlite::SqliteConnection;

use super::{Operation, StoreError, Work};

/// A clock further ahead of the last use is doubted, and believed after as long a time of work.
const DOUBT_MS: i64 = 24 * 3600 * 1000;

/// When the store was last at work; none before its first use.
pub(crate) async fn find_last_use(db: &mut SqliteConnection) -> Result<Option<i64>, sqlx::Error> {
    sqlx::query_scalar("select seen_ms from last_use where one = 1").fetch_optional(db).await
}

/// Whether a clock is so far ahead of the last use that it may be wrong.
pub(crate) fn is_ahead(last: Option<i64>, now: i64) -> bool {
    last.is_some_and(|last| now.saturating_sub(last) > DOUBT_MS)
}

/// The last use, where the clock is not to be believed by a coordinator that began to work at `began`.
pub(super) async fn doubt(work: &mut Work<'_>, began: i64) -> Result<Option<i64>, StoreError> {
    let last = find_last_use(work.db).await?;
    Ok(last.filter(|_| is_ahead(last, work.now) && work.now.saturating_sub(began) < DOUBT_MS))
}

/// Notes that the store is at work now, unless the clock is not to be believed.
pub(crate) struct Remember {
    /// When the coordinator began to work, by the same clock.
    pub(crate) began: i64,
}

impl Operation for Remember {
    type Output = ();

    async fn apply(self, work: &mut Work<'_>) -> Result<(), StoreError> {
        if doubt(work, self.began).await?.is_some() {
            return Ok(());
        }
        sqlx::query(
            "insert into last_use (one, seen_ms) values (1, ?1) on conflict (one) do update set seen_ms = excluded.seen_ms",
        )
        .bind(work.now)
        .execute(&mut *work.db)
        .await?;
        Ok(())
    }
}
