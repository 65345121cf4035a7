//! How much a body says, counted before anything is made of it. A parsed body takes up to
//! hundreds of times the memory of its text: with these bounds it takes little more.

/// Deepest nesting of a body.
pub(crate) const DEEPEST: usize = 32;
/// Longest text in a body, bytes.
const LONGEST_TEXT: usize = 256 << 10;
/// Most steps of keys, tables and items of a TOML document: each takes about a KiB when it is parsed.
const MOST_STEPS: usize = 32 << 10;

/// Bounds the values, the nesting and the texts of a JSON document.
///
/// What is no JSON is left to the parser, which reads the same tokens up to its first fault.
///
/// # Errors
/// A sentence about the first bound which is passed.
pub(crate) fn json(bytes: &[u8], most_values: usize) -> Result<(), String> {
    let (mut values, mut depth, mut at) = (0, 0_usize, 0);
    while let Some(&byte) = bytes.get(at) {
        at += 1;
        match byte {
            b'"' => {
                let length = text_length(&bytes[at..]);
                if length > LONGEST_TEXT {
                    return Err(format!("has a text of more than {LONGEST_TEXT} bytes"));
                }
                at += length + 1;
            }
            b'{' | b'[' => {
                values += 1;
                depth += 1;
                if depth > DEEPEST {
                    return Err(format!("is nested more than {DEEPEST} deep"));
                }
            }
            b'}' | b']' => depth = depth.saturating_sub(1),
            b',' => values += 1,
            _ => {}
        }
        if values > most_values {
            return Err(format!("has more than {most_values} values"));
        }
    }
    Ok(())
}

/// Bytes of a text up to its closing quote.
fn text_length(bytes: &[u8]) -> usize {
    let mut at = 0;
    while let Some(&byte) = bytes.get(at) {
        match byte {
            b'"' => return at,
            b'\\' => at += 2,
            _ => at += 1,
        }
    }
    bytes.len()
}

/// Bounds the steps of keys, tables and items of a TOML document. Those in texts and comments count
/// too, so that nothing depends on where a text ends.
///
/// # Errors
/// A sentence when there are too many.
pub(crate) fn toml(bytes: &[u8]) -> Result<(), String> {
    let steps = bytes.iter().filter(|byte| b".=[{,".contains(byte)).count();
    if steps > MOST_STEPS { Err(format!("has more than {MOST_STEPS} keys, tables and items")) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_json_says_is_counted_outside_its_texts() {
        assert_eq!(json(br#"{"a":[1,2,{"b":"[[[,,,\",,"}]}"#, 5), Ok(()));
        assert_eq!(json(br#"{"a":[1,2,{"b":"[[[,,,\",,"}]}"#, 4), Err("has more than 4 values".into()));
        let nested = "[".repeat(DEEPEST) + &"]".repeat(DEEPEST);
        assert_eq!(json(nested.as_bytes(), 100), Ok(()));
        assert!(json(format!("[{nested}]").as_bytes(), 100).is_err_and(|why| why.contains("nested")));
        let long = format!("[\"{}\"]", "\\u0061".repeat(LONGEST_TEXT / 6 + 1));
        assert!(json(long.as_bytes(), 100).is_err_and(|why| why.contains("text")));
        // Broken off in a text, and closed more often than opened.
        assert_eq!((json(b"{\"a", 9), json(b"\"\\", 9), json(b"]]]", 9)), (Ok(()), Ok(()), Ok(())));
    }

    #[test]
    fn steps_of_toml_are_counted() {
        assert_eq!(toml(include_bytes!("../../../studies/paper.toml")), Ok(()));
        let dotted = format!("a{}=1\n", ".a".repeat(70)).repeat(1000);
        assert!(toml(dotted.as_bytes()).is_err());
    }
}
