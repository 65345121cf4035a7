//! Tokens and their hashes.

use std::fmt;

use crate::http::cursor::hex;

/// What every token of ours begins with, so that scanners find one that leaked.
const PREFIX: &str = "manduca_";
/// Least length of a token made elsewhere, characters.
const SHORTEST: usize = 20;
/// Most length, characters.
const LONGEST: usize = 200;

/// A token. It is not shown, not even for debugging.
#[derive(Clone)]
pub struct Secret(String);

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret")
    }
}

impl Secret {
    /// A new token of 32 random bytes.
    ///
    /// # Errors
    /// When the system has no random numbers.
    pub fn random() -> std::io::Result<Self> {
        let mut bytes = [0_u8; 32];
        getrandom::fill(&mut bytes).map_err(std::io::Error::other)?;
        Ok(Self(format!("{PREFIX}{}", hex(&bytes))))
    }

    /// A token made elsewhere, without the white space around it.
    ///
    /// # Errors
    /// A sentence when it is too short to be secret, or cannot be sent in a header.
    pub fn new(text: &str) -> Result<Self, String> {
        let text = text.trim();
        if !(SHORTEST..=LONGEST).contains(&text.len()) || !text.bytes().all(|b| b.is_ascii_graphic()) {
            return Err(format!("a token is {SHORTEST} to {LONGEST} printable ASCII characters without spaces"));
        }
        Ok(Self(text.to_owned()))
    }

    /// The token itself, to be shown once.
    pub fn reveal(&self) -> &str {
        &self.0
    }

    /// What is stored of it.
    pub fn hash(&self) -> TokenHash {
        TokenHash(blake3::hash(self.0.as_bytes()))
    }
}

/// The hash of a token. Compared in constant time.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct TokenHash(blake3::Hash);

impl TokenHash {
    pub(crate) fn from_bytes(bytes: [u8; 32]) -> Self {
        Self(blake3::Hash::from_bytes(bytes))
    }

    pub(crate) fn as_bytes(&self) -> &[u8; 32] {
        self.0.as_bytes()
    }
}

impl fmt::Debug for TokenHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("TokenHash")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_long_distinct_and_never_shown() {
        let (a, b) = (Secret::random().expect("random"), Secret::random().expect("random"));
        assert!(a.reveal().len() == 72 && a.hash() != b.hash());
        assert!(a.hash() == Secret::new(&format!("  {}\n", a.reveal())).expect("a token").hash());
        assert_eq!(format!("{a:?} {:?}", a.hash()), "Secret TokenHash");
        for bad in ["short", "with a space in the middle of it", "", "ünprintable-ünprintable"] {
            assert!(Secret::new(bad).is_err(), "{bad}");
        }
    }
}
