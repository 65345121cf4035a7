//! Work on a database from outside the coordinator, which may run meanwhile.

pub(crate) mod check;
mod disown;
pub(crate) mod upkeep;

use std::path::Path;

use manduca_protocol::text::check_name;

use crate::auth::{Scopes, Secret};
use crate::clock::{Clock, SystemClock, rfc3339};
use crate::store::{File, OpenError, insert_token, list_tokens, revoke_token};

/// Longest name of a token, characters.
const LONGEST_NAME: usize = 100;

/// Why something could not be done with a database.
#[derive(Debug, thiserror::Error)]
pub enum OfflineError {
    /// It could not be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// SQLite refused.
    #[error("the database failed")]
    Database(#[from] sqlx::Error),
    /// A file could not be read or written.
    #[error("{0}")]
    File(#[from] std::io::Error),
    /// What was asked for makes no sense as it stands.
    #[error("{0}")]
    Refused(String),
}

/// A token as it is listed. The token itself is not kept.
#[derive(Debug, Clone, serde::Serialize)]
pub struct Token {
    /// Name for people.
    pub name: String,
    /// What it allows, with spaces between.
    pub scopes: String,
    /// RFC 3339, UTC.
    pub created_at: String,
    /// From when on it allows nothing.
    pub revoked_at: Option<String>,
}

/// An open database.
pub struct Offline {
    pub(crate) file: File,
}

impl Offline {
    /// Opens a database and brings its tables up to date. It is made when missing.
    ///
    /// # Errors
    /// When that fails.
    pub async fn make(database: &Path) -> Result<Self, OfflineError> {
        Ok(Self { file: File::make(database).await? })
    }

    /// Opens a database to change something, and brings its tables up to date.
    ///
    /// # Errors
    /// When there is none, or that fails.
    pub async fn open(database: &Path) -> Result<Self, OfflineError> {
        Ok(Self { file: File::open(database).await? })
    }

    /// Opens a database to look at it: neither the file nor its folder is changed, and both may be read-only.
    ///
    /// # Errors
    /// When there is none, or it cannot be read.
    pub async fn look(database: &Path) -> Result<Self, OfflineError> {
        Ok(Self { file: File::look(database).await? })
    }

    /// Makes a token. What is returned is shown once and stored nowhere.
    ///
    /// # Errors
    /// When there is one of this name.
    pub async fn create_token(&mut self, name: &str, scopes: Scopes) -> Result<Secret, OfflineError> {
        check_name(name, LONGEST_NAME).map_err(|why| OfflineError::Refused(format!("the name of the token {why}")))?;
        if scopes == Scopes::default() {
            return Err(OfflineError::Refused("a token has a scope".into()));
        }
        if name.starts_with('(') {
            return Err(OfflineError::Refused(format!("`{name}`: names in parentheses are the coordinator's own")));
        }
        let secret = Secret::random()?;
        let now = SystemClock::start().now_ms();
        if insert_token(self.file.db(), name, &secret.hash(), scopes, now).await? {
            return Ok(secret);
        }
        Err(OfflineError::Refused(format!("there is a token `{name}` already, or was: names are not used twice")))
    }

    /// All tokens, the revoked ones too.
    ///
    /// # Errors
    /// When they cannot be read.
    pub async fn tokens(&mut self) -> Result<Vec<Token>, OfflineError> {
        self.file.check_version().await?;
        let rows = list_tokens(self.file.db()).await?;
        let token = |row: crate::store::TokenRow| Token {
            name: row.name,
            scopes: row.scopes,
            created_at: rfc3339(row.created_ms),
            revoked_at: row.revoked_ms.map(rfc3339),
        };
        Ok(rows.into_iter().map(token).collect())
    }

    /// Ends a token. A running coordinator notices within a second.
    ///
    /// # Errors
    /// When there is none of this name.
    pub async fn revoke_token(&mut self, name: &str) -> Result<(), OfflineError> {
        if revoke_token(self.file.db(), name, SystemClock::start().now_ms()).await? {
            return Ok(());
        }
        Err(OfflineError::Refused(format!("there is no token `{name}` (`manduca token list` shows them)")))
    }

    /// Closes the file.
    pub async fn close(self) {
        self.file.close().await;
    }
}
