//! How a file is written: its ending says it, or an option does.

use std::path::Path;

use anyhow::Result;

use crate::exit::refused;

/// What may be written, by the ending which says so; the first ending of a form is its usual one.
pub type Endings<T> = [(&'static str, T)];

/// The form a file is to be written in: as said by `--format`, else by its ending, else `otherwise`.
///
/// # Errors
/// When the ending is that of no form, or of another than the one which was said.
pub fn chosen<T: Copy + PartialEq>(
    option: &str,
    path: Option<&Path>,
    said: Option<T>,
    known: &Endings<T>,
    otherwise: T,
) -> Result<T> {
    let Some((path, ending)) = path.and_then(|path| Some((path, ending(path)?))) else {
        return Ok(said.unwrap_or(otherwise));
    };
    let found = known.iter().find(|(name, _)| *name == ending).map(|(_, form)| *form);
    match (found, said) {
        (Some(found), Some(said)) if found != said => {
            Err(refused(format!("{option} {}: its ending does not say what --format says", path.display())))
        }
        (_, Some(said)) => Ok(said),
        (Some(found), None) => Ok(found),
        (None, None) => {
            let advice = format!("{}, or --format says what goes into it", listed(known));
            Err(refused(format!("{option} {}: cannot write .{ending}; it may end in {advice}", path.display())))
        }
    }
}

/// The form which the ending of a file says, where no option can.
///
/// # Errors
/// When it is that of no form.
pub fn of<T: Copy>(option: &str, path: &Path, known: &Endings<T>) -> Result<T> {
    let ending = ending(path).unwrap_or_default();
    let found = known.iter().find(|(name, _)| *name == ending).map(|(_, form)| *form);
    found.ok_or_else(|| refused(format!("{option} {}: the file must end in {}", path.display(), listed(known))))
}

/// The ending in small letters, or `None` if the name has no ending.
fn ending(path: &Path) -> Option<String> {
    path.extension().map(|ending| ending.to_string_lossy().to_lowercase())
}

fn listed<T>(known: &Endings<T>) -> String {
    let all: Vec<_> = known.iter().map(|(name, _)| format!(".{name}")).collect();
    match all.split_last() {
        Some((last, [])) => last.clone(),
        Some((last, rest)) => format!("{} or {last}", rest.join(", ")),
        None => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: [(&str, u8); 3] = [("csv", 1), ("json", 2), ("jsonl", 2)];

    fn form(path: Option<&str>, said: Option<u8>) -> Result<u8> {
        chosen("-o", path.map(Path::new), said, &KNOWN, 9)
    }

    #[test]
    fn an_ending_or_an_option_says_how() {
        let forms =
            [(Some("a.CSV"), None), (Some("b/a.jsonl"), None), (None, None), (Some("a"), None), (None, Some(1))];
        assert_eq!(forms.map(|(path, said)| form(path, said).unwrap()), [1, 2, 9, 9, 1]);
        assert_eq!([Some("a.txt"), Some("a.csv"), Some("a")].map(|path| form(path, Some(1)).unwrap()), [1; 3]);
    }

    #[test]
    fn an_ending_which_says_nothing_or_something_else_is_refused() {
        for name in ["a.xlsx", "a.csv.gz", "a.txt", "a.csv2"] {
            let told = form(Some(name), None).unwrap_err().to_string();
            assert!(told.contains(".csv, .json or .jsonl") && told.contains(name), "{told}");
            assert!(of("-o", Path::new(name), &KNOWN).is_err());
        }
        assert!(form(Some("a.json"), Some(1)).unwrap_err().to_string().contains("--format"));
        assert!(of("-o", Path::new("csv"), &KNOWN).is_err());
        assert_eq!(of("-o", Path::new("a.Json"), &KNOWN).unwrap(), 2);
    }
}
