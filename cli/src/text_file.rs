//! Text files which people write: study files and optimisations.

use std::fs;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result};

use crate::exit::refused;

/// Largest file read, bytes: more than any study has.
const MOST: u64 = 16 << 20;

/// Reads a file, which may be a pipe such as `/dev/fd/63` of `manduca run <(...)`, as text without byte-order mark.
///
/// # Errors
/// When it cannot be read, is a folder, or is no UTF-8 text: the error says what to do.
pub fn read(path: &Path) -> Result<String> {
    let name = path.display();
    let told = || format!("cannot read {name}");
    let file = fs::File::open(path).with_context(told)?;
    if file.metadata().with_context(told)?.is_dir() {
        return Err(refused(format!("{name} is a folder: name a file in it")));
    }
    let mut bytes = Vec::new();
    file.take(MOST + 1).read_to_end(&mut bytes).with_context(told)?;
    if bytes.len() as u64 > MOST {
        return Err(refused(format!("{name} has more than {} MiB", MOST >> 20)));
    }
    text(bytes).map_err(|what| refused(format!("{name} {what}: save it as UTF-8")))
}

/// Bytes as text without byte-order mark, or what else they are.
fn text(bytes: Vec<u8>) -> Result<String, &'static str> {
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) || bytes.iter().take(4).any(|b| *b == 0) {
        return Err("is text in UTF-16 or UTF-32");
    }
    let text = String::from_utf8(bytes).map_err(|_| "is not text in UTF-8")?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// Whether a text is JSON, by the ending of its file, or where that says nothing by how it begins.
pub fn is_json(path: &Path, text: &str) -> bool {
    match path.extension() {
        Some(ending) if ending.eq_ignore_ascii_case("json") => true,
        Some(ending) if ending.eq_ignore_ascii_case("toml") => false,
        _ => text.trim_start().starts_with('{'),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_byte_order_mark_is_no_part_of_the_text() {
        assert_eq!(text(b"\xef\xbb\xbf{}".to_vec()), Ok("{}".into()));
        assert_eq!(text(b"{}".to_vec()), Ok("{}".into()));
        assert_eq!(text(Vec::new()), Ok(String::new()));
    }

    #[test]
    fn other_encodings_are_named() {
        for bytes in [&b"\xff\xfen\0a\0"[..], b"\xfe\xff\0n\0a", b"n\0a\0", b"\0n\0a"] {
            assert!(text(bytes.to_vec()).unwrap_err().contains("UTF-16"), "{bytes:?}");
        }
        assert!(text(b"name = \"caf\xe9\"".to_vec()).unwrap_err().contains("not text"));
    }

    #[test]
    fn a_folder_is_said_to_be_one() {
        let folder = tempfile::tempdir().unwrap();
        assert!(read(folder.path()).unwrap_err().to_string().contains("is a folder"));
    }

    #[test]
    fn json_is_known_by_ending_or_beginning() {
        let json = |name: &str, text: &str| is_json(Path::new(name), text);
        assert!(json("a.JSON", "") && json("/dev/fd/63", " {}") && json("a", "{"));
        assert!(!json("a.toml", "{}") && !json("/dev/fd/63", "name = 1") && !json("a.txt", ""));
    }
}
