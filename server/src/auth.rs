//! Who may ask what. A request carries a token (`Authorization: Bearer ...`);
//! a token allows scopes; a route asks for one.

mod guard;
mod scope;
mod token;

use std::sync::Mutex;
use std::time::{Duration, Instant};

pub use scope::{Scope, Scopes};
pub use token::{Secret, TokenHash};

pub(crate) use guard::guard;

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

/// A token which is known: its hash and what it allows.
pub(crate) type Known = (TokenHash, Scopes);

/// The tokens of the database, read again when they may have changed.
#[derive(Debug, Default)]
pub(crate) struct Tokens {
    read: Mutex<Option<(Instant, Vec<Known>)>>,
}

impl Tokens {
    /// What a token allows; none when it is not known.
    ///
    /// # Errors
    /// When the tokens cannot be read.
    pub(crate) async fn scopes(
        &self,
        secret: &Secret,
        given: &[TokenHash],
        store: &Store,
    ) -> Result<Option<Scopes>, StoreError> {
        let hash = secret.hash();
        let given = given.iter().fold(false, |known, one| known | (*one == hash));
        if given {
            return Ok(Some(Scopes::ALL));
        }
        if let Some(known) = self.fresh() {
            return Ok(find(&known, &hash));
        }
        let known = store.tokens().await?;
        let found = find(&known, &hash);
        if let Ok(mut read) = self.read.lock() {
            *read = Some((Instant::now(), known));
        }
        Ok(found)
    }

    fn fresh(&self) -> Option<Vec<Known>> {
        let read = self.read.lock().ok()?;
        read.as_ref().filter(|(at, _)| at.elapsed() < FRESH).map(|(_, known)| known.clone())
    }
}

/// All are compared, each in constant time: how long it takes tells nothing.
fn find(known: &[Known], hash: &TokenHash) -> Option<Scopes> {
    known.iter().fold(None, |found, (one, scopes)| if one == hash { Some(*scopes) } else { found })
}
