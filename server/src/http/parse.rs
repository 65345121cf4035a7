//! Bodies parsed so that every refusal names its field.

use manduca_protocol::problem::FieldProblem;
use serde_json::error::Category;
use serde_path_to_error::{Path, Segment};

use super::body::Accepted;
use super::scan;
use crate::error::ApiError;

/// Largest body which is parsed again to find the field at fault, bytes.
const SEARCHED: usize = 1 << 20;

/// How a body is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Language {
    Json,
    Toml,
}

/// Parses a whole body of at most so many values.
///
/// # Errors
/// With the JSON pointer of the field at fault.
pub(super) fn parse<T: Accepted>(bytes: &[u8], language: Language, most_values: usize) -> Result<T, ApiError> {
    let refused = |why| T::refuse(vec![FieldProblem::new("", why)]);
    match language {
        Language::Json => {
            scan::json(bytes, most_values).map_err(refused)?;
            parse_json(bytes)
        }
        Language::Toml => {
            scan::toml(bytes).map_err(refused)?;
            parse_toml(bytes)
        }
    }
}

fn parse_json<T: Accepted>(bytes: &[u8]) -> Result<T, ApiError> {
    // Serde would read a list as the fields of an object in their order.
    if bytes.trim_ascii_start().starts_with(b"[") {
        return Err(T::refuse(vec![FieldProblem::new("", "must be an object, not an array")]));
    }
    // Following the path costs as much as parsing: only what is refused is parsed with it.
    let error = match serde_json::from_slice(bytes) {
        Ok(value) => return Ok(value),
        Err(error) => error,
    };
    if bytes.len() > SEARCHED {
        return Err(refusal::<T>("", &error));
    }
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let value = serde_path_to_error::deserialize(&mut deserializer)
        .map_err(|error| refusal::<T>(&pointer(error.path()), error.inner()))?;
    deserializer.end().map_err(|error| refusal::<T>("", &error))?;
    Ok(value)
}

/// What is said of a body the parser does not take.
fn refusal<T: Accepted>(path: &str, error: &serde_json::Error) -> ApiError {
    let detail = error.to_string();
    match error.classify() {
        Category::Data => T::refuse(vec![FieldProblem::new(named_field(path.to_owned(), &detail), detail)]),
        _ => ApiError::MalformedJson(vec![FieldProblem::new(path, detail)]),
    }
}

/// Parses a whole body in TOML; faults are told with their line too.
fn parse_toml<T: Accepted>(bytes: &[u8]) -> Result<T, ApiError> {
    let malformed = |detail: String| ApiError::MalformedToml(vec![FieldProblem::new("", detail)]);
    let text = std::str::from_utf8(bytes).map_err(|_| malformed("it is not text in UTF-8".into()))?;
    let told = |error: &toml::de::Error| {
        let before = error.span().and_then(|span| text.get(..span.start));
        let line = before.map_or_else(String::new, |before| format!("line {}: ", before.matches('\n').count() + 1));
        line + error.message()
    };
    let document = toml::de::Deserializer::parse(text).map_err(|error| malformed(told(&error)))?;
    serde_path_to_error::deserialize(document).map_err(|error| {
        let at = named_field(pointer(error.path()), error.inner().message());
        T::refuse(vec![FieldProblem::new(at, told(error.inner()))])
    })
}

/// The JSON pointer of a path (RFC 6901).
fn pointer(path: &Path) -> String {
    let mut pointer = String::new();
    for segment in path {
        let token = match segment {
            Segment::Seq { index } => index.to_string(),
            Segment::Map { key } => key.replace('~', "~0").replace('/', "~1"),
            // The name of an enum's variant is no step into the document.
            Segment::Enum { .. } | Segment::Unknown => continue,
        };
        pointer.push('/');
        pointer.push_str(&token);
    }
    pointer
}

/// Serde places a missing, unknown or repeated field at its object; the field itself is
/// only in the message.
fn named_field(object: String, detail: &str) -> String {
    for start in ["missing field `", "unknown field `", "duplicate field `", "unknown parameter `", "parameter `"] {
        if let Some(rest) = detail.strip_prefix(start)
            && let Some((field, _)) = rest.split_once('`')
        {
            let token = field.replace('~', "~0").replace('/', "~1");
            let last = format!("/{token}");
            return if object.ends_with(&last) { object } else { object + &last };
        }
    }
    object
}

#[cfg(test)]
mod tests {
    use manduca_protocol::study::StudySpec;

    use super::*;

    fn pointer_of(json: &str) -> (String, u16) {
        let refused = parse::<StudySpec>(json.as_bytes(), Language::Json, 1000);
        let problem = refused.expect_err("is refused").problem();
        (problem.errors[0].pointer.clone(), problem.status)
    }

    #[test]
    fn the_field_at_fault_is_named() {
        let cases = [
            (r#"{"sampling":{"samples":30}}"#, "/name"),
            (r#"{"name":"a","sampling":{}}"#, "/sampling/samples"),
            (r#"{"name":"a","sampling":{"samples":30,"colour":1}}"#, "/sampling/colour"),
            (r#"{"name":"a","sampling":{"samples":-1}}"#, "/sampling/samples"),
            (r#"{"name":"a","sampling":{"samples":30},"model":{"kind":"cfd"}}"#, "/model/kind"),
            (
                r#"{"name":"a","sampling":{"samples":30},"parameters":{"frequency_hz":"fast"}}"#,
                "/parameters/frequency_hz",
            ),
            (
                r#"{"name":"a","sampling":{"samples":30},"optimisations":[{"name":"x","penalty_r":[]}]}"#,
                "/optimisations/0/penalty_r",
            ),
            (r#"{"name":"a","sampling":[30,0]}"#, "/sampling"),
            (r#"{"name":"a","sampling":{"samples":30},"optimisations":[["x"]]}"#, "/optimisations/0"),
            (
                r#"{"name":"a","sampling":{"samples":30},"model":{"solver":{"strokes":4,"strokes":8}}}"#,
                "/model/solver/strokes",
            ),
        ];
        for (json, expected) in cases {
            assert_eq!(pointer_of(json), (expected.to_owned(), 422), "{json}");
        }
    }

    #[test]
    fn toml_is_refused_by_field_and_line() {
        let refused = |text: &str| {
            let problem = parse_toml::<StudySpec>(text.as_bytes()).expect_err("is refused").problem();
            (problem.status, problem.errors[0].pointer.clone(), problem.errors[0].detail.clone())
        };
        let (status, pointer, detail) = refused("name = \"a\"\n[sampling]\nsamples = \"many\"\n");
        assert_eq!((status, pointer.as_str()), (422, "/sampling/samples"));
        assert!(detail.starts_with("line 3: "), "{detail}");
        let (_, pointer, _) = refused("name = \"a\"\n[sampling]\nsamples = 30\ncolour = 1\n");
        assert_eq!(pointer, "/sampling/colour");
        let (status, pointer, detail) = refused("name = \"a\"\nname = \"b\"\n");
        assert!(status == 400 && pointer.is_empty() && detail.starts_with("line 2: "), "{detail}");
        assert!(parse_toml::<StudySpec>(include_bytes!("../../../studies/paper.toml")).is_ok());
    }

    #[test]
    fn what_is_not_json_is_malformed() {
        for json in ["", "{", r#"{"name":NaN}"#, r#"{"name":"a","sampling":{"samples":30}} x"#] {
            assert_eq!(pointer_of(json).1, 400, "{json}");
        }
    }
}
