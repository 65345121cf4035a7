//! Who may ask what. A request carries a token (`Authorization: Bearer ...`);
//! a token allows scopes; a route asks for one.

mod caller;
mod guard;
mod refusals;
mod scope;
mod token;

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

pub use scope::{Scope, Scopes};
pub use token::{Secret, TokenHash};

pub(crate) use caller::{Caller, OPERATOR};
pub(crate) use guard::guard;
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
    read: Mutex<Option<(Instant, Arc<[Known]>)>>,
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
        if let Some(known) = self.fresh() {
            return Ok(find(&known, &hash));
        }
        let known: Arc<[Known]> = store.tokens().await?.into();
        let found = find(&known, &hash);
        if let Ok(mut read) = self.read.lock() {
            if let Some((_, before)) = read.as_ref() {
                tell_changes(before, &known);
            }
            *read = Some((Instant::now(), known));
        }
        Ok(found)
    }

    fn fresh(&self) -> Option<Arc<[Known]>> {
        let read = self.read.lock().ok()?;
        read.as_ref().filter(|(at, _)| at.elapsed() < FRESH).map(|(_, known)| known.clone())
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
