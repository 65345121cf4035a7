//! Who asks.

use std::convert::Infallible;
use std::sync::Arc;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;

use super::{Scope, Scopes};

/// The name of the operator's own token, which is given at the start and not stored. Names in
/// parentheses are not given to others.
pub(crate) const OPERATOR: &str = "(operator)";

/// The one who makes a request: the token it carries, by name. The default is a caller of a
/// coordinator that asks for no tokens.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Caller {
    token: Option<Arc<str>>,
    scopes: Scopes,
}

impl Caller {
    /// The bearer of a token.
    pub(crate) fn of(token: Arc<str>, scopes: Scopes) -> Self {
        Self { token: Some(token), scopes }
    }

    /// The name of the token, `None` where no tokens are asked for.
    pub(crate) fn name(&self) -> Option<&str> {
        self.token.as_deref()
    }

    /// The name as an owned text.
    pub(crate) fn named(&self) -> Option<String> {
        self.name().map(str::to_owned)
    }

    /// Whether the token allows what asks for a scope.
    pub(crate) fn allows(&self, scope: Scope) -> bool {
        self.token.is_none() || self.scopes.allow(scope)
    }

    /// Whether the caller may do everything.
    pub(crate) fn is_admin(&self) -> bool {
        self.allows(Scope::Admin)
    }

    /// Whether the caller speaks for a worker that was registered with this token. A worker without
    /// a token is from before tokens were asked for, or from before their names were kept.
    pub(crate) fn speaks_for(&self, token: Option<&str>) -> bool {
        self.name().is_none() || token.is_none() || self.name() == token
    }
}

impl<S: Sync> FromRequestParts<S> for Caller {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(parts.extensions.get::<Self>().cloned().unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_speaks_for_its_own_workers_alone() {
        let of = |name: &str, scope| Caller::of(name.into(), [scope].into_iter().collect());
        let (open, mine) = (Caller::default(), of("mine", Scope::Worker));
        assert!(open.speaks_for(Some("mine")) && open.speaks_for(None) && open.is_admin());
        assert!(mine.speaks_for(Some("mine")) && mine.speaks_for(None) && !mine.is_admin());
        assert!(!mine.speaks_for(Some("other")) && !of("root", Scope::Admin).speaks_for(Some("mine")));
        assert!(of("root", Scope::Admin).is_admin());
    }
}
