//! Tokens: their hashes, their scopes, and when they ended.

use sqlx::sqlite::SqliteConnection;

use super::{Store, StoreError};
use crate::auth::{Known, Scopes, TokenHash};

/// A token in a list.
#[derive(Debug, Clone, sqlx::FromRow)]
pub(crate) struct TokenRow {
    pub(crate) name: String,
    pub(crate) scopes: String,
    pub(crate) created_ms: i64,
    pub(crate) revoked_ms: Option<i64>,
}

impl Store {
    /// The tokens which allow something.
    pub(crate) async fn tokens(&self) -> Result<Vec<Known>, StoreError> {
        let rows: Vec<(Vec<u8>, String, String)> =
            sqlx::query_as("select hash, name, scopes from tokens where revoked_ms is null")
                .fetch_all(self.quick())
                .await?;
        rows.into_iter().map(|(hash, name, scopes)| known(&hash, &name, &scopes)).collect()
    }
}

fn known(hash: &[u8], name: &str, scopes: &str) -> Result<Known, StoreError> {
    let hash: [u8; 32] = hash.try_into().map_err(|_| StoreError::Corrupt("the hash of a token is cut".into()))?;
    let scopes = Scopes::parse(scopes).map_err(StoreError::Corrupt)?;
    Ok(Known { hash: TokenHash::from_bytes(hash), name: name.into(), scopes })
}

/// Stores a token; false where there is one of this name, or was.
pub(crate) async fn insert_token(
    db: &mut SqliteConnection,
    name: &str,
    hash: &TokenHash,
    scopes: Scopes,
    now: i64,
) -> Result<bool, sqlx::Error> {
    let inserted = sqlx::query(
        "insert into tokens (name, hash, scopes, created_ms) values (?, ?, ?, ?) on conflict (name) do nothing",
    )
    .bind(name)
    .bind(hash.as_bytes().as_slice())
    .bind(scopes.to_string())
    .bind(now)
    .execute(db)
    .await?;
    Ok(inserted.rows_affected() > 0)
}

/// All tokens there ever were.
pub(crate) async fn list_tokens(db: &mut SqliteConnection) -> Result<Vec<TokenRow>, sqlx::Error> {
    sqlx::query_as("select name, scopes, created_ms, revoked_ms from tokens order by token").fetch_all(db).await
}

/// Ends a token; false where there is none of this name. Ending it twice is as good as once.
pub(crate) async fn revoke_token(db: &mut SqliteConnection, name: &str, now: i64) -> Result<bool, sqlx::Error> {
    let revoked = sqlx::query("update tokens set revoked_ms = coalesce(revoked_ms, ?) where name = ?")
        .bind(now)
        .bind(name)
        .execute(db)
        .await?;
    Ok(revoked.rows_affected() > 0)
}
