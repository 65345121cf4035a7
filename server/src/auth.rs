//! Who may ask what. A request carries a token (`Authorization: Bearer ...`);
//! a token allows scopes; a route asks for one.

mod caller;
mod guard;
mod host;
mod pass;
mod refusals;
mod scope;
mod site;
mod token;

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

pub use host::{Host, Hosts};
pub use scope::{Scope, Scopes};
pub use token::{Secret, TokenHash};

pub(crate) use caller::{Caller, OPERATOR};
pub(crate) use guard::guard;
pub(crate) use pass::Pass;
pub(crate) use refusals::Refusals;

use crate::store::{Store, StoreError};

/// How long a change of the tokens by another process may go unnoticed.
const FRESH: Duration = Duration::from_secs(1);

/// Whether tokens are asked for.
#[derive(Debug, Clone, Default)]
pub enum Access {
    /// No: whoever reaches the port may do everything.
    #[default]
    Open,
    /// Yes: one of the database's, or one of these, which allow everything.
    Tokens(Vec<TokenHash>),
}

/// A token which is known.
#[derive(Debug, Clone)]
pub(crate) struct Known {
    pub(crate) hash: TokenHash,
    pub(crate) name: Arc<str>,
    pub(crate) scopes: Scopes,
}

/// The tokens of the database, read again when they may have changed.
#[derive(Debug, Default)]
pub(crate) struct Tokens {
    read: Mutex<Option<Reading>>,
    /// Held by the one request that reads them, for all that wait for it.
    turn: tokio::sync::Mutex<()>,
}

/// The tokens as they were at some time.
#[derive(Debug, Clone)]
struct Reading {
    began: Instant,
    known: Arc<[Known]>,
}

impl Tokens {
    /// The bearer of a token; `None` when it is not known.
    ///
    /// # Errors
    /// When the tokens cannot be read.
    pub(crate) async fn bearer(
        &self,
        secret: &Secret,
        given: &[TokenHash],
        store: &Store,
    ) -> Result<Option<Caller>, StoreError> {
        let hash = secret.hash();
        let given = given.iter().fold(false, |known, one| known | (*one == hash));
        if given {
            return Ok(Some(Caller::of(OPERATOR.into(), Scopes::ALL)));
        }
        self.bearer_lately(&hash, store).await
    }

    /// Returns the bearer of a token of the database, or `None` if it was revoked more than a second ago.
    ///
    /// # Errors
    /// Returns an error if the tokens cannot be read.
    pub(crate) async fn bearer_lately(&self, hash: &TokenHash, store: &Store) -> Result<Option<Caller>, StoreError> {
        Ok(find(&self.since(Instant::now().checked_sub(FRESH), store).await?, hash))
    }

    /// Returns the bearer of a token of the database at this moment, or `None` if it is revoked.
    ///
    /// # Errors
    /// Returns an error if the tokens cannot be read.
    pub(crate) async fn bearer_now(&self, hash: &TokenHash, store: &Store) -> Result<Option<Caller>, StoreError> {
        Ok(find(&self.since(Some(Instant::now()), store).await?, hash))
    }

    /// The tokens as they were read at some time or later. Requests that ask together share one reading.
    async fn since(&self, since: Option<Instant>, store: &Store) -> Result<Arc<[Known]>, StoreError> {
        if let Some(known) = self.read_since(since) {
            return Ok(known);
        }
        let _turn = self.turn.lock().await;
        if let Some(known) = self.read_since(since) {
            return Ok(known);
        }
        let began = Instant::now();
        let known: Arc<[Known]> = store.tokens().await?.into();
        if let Ok(mut read) = self.read.lock() {
            if let Some(before) = read.as_ref() {
                tell_changes(&before.known, &known);
            }
            *read = Some(Reading { began, known: known.clone() });
        }
        Ok(known)
    }

    fn read_since(&self, since: Option<Instant>) -> Option<Arc<[Known]>> {
        let read = self.read.lock().ok()?;
        read.as_ref().filter(|reading| since.is_none_or(|since| reading.began >= since)).map(|r| r.known.clone())
    }
}

/// Logs what another process did to the tokens meanwhile.
fn tell_changes(before: &[Known], now: &[Known]) {
    let names = |known: &[Known]| -> BTreeSet<Arc<str>> { known.iter().map(|one| one.name.clone()).collect() };
    let (before, now) = (names(before), names(now));
    for name in now.difference(&before) {
        tracing::info!(token.name = &**name, "Token created");
    }
    for name in before.difference(&now) {
        tracing::info!(token.name = &**name, "Token revoked");
    }
}

/// All are compared, each in constant time: how long it takes tells nothing.
fn find(known: &[Known], hash: &TokenHash) -> Option<Caller> {
    known.iter().fold(
        None,
        |found, one| {
            if one.hash == *hash { Some(Caller::of(one.name.clone(), one.scopes)) } else { found }
        },
    )
}
