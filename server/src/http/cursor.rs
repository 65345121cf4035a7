//! Opaque cursors: where a list goes on, in a form nobody is tempted to build.

use crate::error::ApiError;

/// A cursor for this text.
pub(crate) fn encode(text: &str) -> String {
    hex(text.as_bytes())
}

/// Bytes as hexadecimal digits.
pub(crate) fn hex(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 16] = b"0123456789abcdef";
    let digits = bytes.iter().flat_map(|b| [b >> 4, b & 15]);
    digits.map(|digit| char::from(DIGITS[usize::from(digit)])).collect()
}

/// The text of a cursor.
///
/// # Errors
/// When it is not one of ours.
pub(crate) fn decode(cursor: &str) -> Result<String, ApiError> {
    let refused = || ApiError::query("/cursor", "is not a cursor of this list");
    if !cursor.is_ascii() || !cursor.len().is_multiple_of(2) || cursor.len() > 200 {
        return Err(refused());
    }
    let bytes = (0..cursor.len()).step_by(2).map(|i| u8::from_str_radix(&cursor[i..i + 2], 16));
    let bytes: Vec<u8> = bytes.collect::<Result<_, _>>().map_err(|_| refused())?;
    String::from_utf8(bytes).map_err(|_| refused())
}

/// Most and default number of items of a page.
const MOST: u32 = 1000;
const DEFAULT: u32 = 100;

/// A page's length as asked.
///
/// # Errors
/// When it is not within 1 to 1000.
pub(crate) fn limit(asked: Option<u32>) -> Result<u32, ApiError> {
    let limit = asked.unwrap_or(DEFAULT);
    if (1..=MOST).contains(&limit) {
        Ok(limit)
    } else {
        Err(ApiError::query("/limit", format!("{limit} is outside 1 to {MOST}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_comes_back_and_a_made_up_one_is_refused() {
        assert_eq!(decode(&encode("sample:12")).expect("is one"), "sample:12");
        for made_up in ["zz", "123", "ü1", "ff"] {
            assert!(decode(made_up).is_err(), "{made_up}");
        }
        assert!(limit(Some(0)).is_err() && limit(Some(1001)).is_err());
        assert_eq!(limit(None).expect("default"), 100);
    }
}
