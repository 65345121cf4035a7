//! What a token allows.

use std::fmt;
use std::str::FromStr;

/// One thing a token may allow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// Look at everything.
    Read,
    /// Submit and steer studies, and look at them.
    Submit,
    /// Take jobs and return results.
    Worker,
    /// All of these, and steer workers.
    Admin,
}

impl Scope {
    /// All scopes.
    pub const ALL: [Self; 4] = [Self::Read, Self::Submit, Self::Worker, Self::Admin];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Submit => "submit",
            Self::Worker => "worker",
            Self::Admin => "admin",
        }
    }

    fn bit(self) -> u8 {
        1 << self as u8
    }
}

impl fmt::Display for Scope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Scope {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|scope| scope.name() == text);
        found.ok_or_else(|| format!("`{text}` is none of read, submit, worker and admin"))
    }
}

/// Some scopes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Scopes(u8);

impl Scopes {
    /// All of them.
    pub const ALL: Self = Self(0b1111);

    /// Whether what asks for `scope` is allowed.
    pub fn allow(self, scope: Scope) -> bool {
        let admin = self.0 & Scope::Admin.bit() != 0;
        let reads = scope == Scope::Read && self.0 & Scope::Submit.bit() != 0;
        admin || reads || self.0 & scope.bit() != 0
    }

    /// Names with spaces between, as stored.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        text.split_whitespace().map(Scope::from_str).collect()
    }
}

impl FromIterator<Scope> for Scopes {
    fn from_iter<I: IntoIterator<Item = Scope>>(scopes: I) -> Self {
        Self(scopes.into_iter().fold(0, |bits, scope| bits | scope.bit()))
    }
}

impl fmt::Display for Scopes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<_> = Scope::ALL.into_iter().filter(|s| self.0 & s.bit() != 0).map(Scope::name).collect();
        f.write_str(&names.join(" "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn admin_allows_everything_and_submit_reads() {
        let of = |text| Scopes::parse(text).expect("scopes");
        assert!(Scope::ALL.iter().all(|&s| of("admin").allow(s) && Scopes::ALL.allow(s)));
        assert!(of("submit").allow(Scope::Read) && !of("submit").allow(Scope::Worker));
        assert!(!of("worker").allow(Scope::Read) && !of("read").allow(Scope::Submit));
        assert!(Scope::ALL.iter().all(|&s| !of("").allow(s)));
        assert_eq!(of("worker read").to_string(), "read worker");
        assert!(Scopes::parse("read root").is_err());
    }
}
