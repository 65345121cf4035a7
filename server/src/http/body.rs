//! JSON bodies, read as bytes and parsed so that every refusal names its field.

use axum::body::{Body, HttpBody};
use axum::extract::{FromRequest, Request};
use axum::http::{HeaderMap, header};
use futures_util::StreamExt;
use manduca_protocol::flight::SimulationRequest;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::study::{OptimisationSpec, StudySpec};
use manduca_protocol::view::PredictionRequest;
use manduca_protocol::worker::{ExchangeRequest, RegisterRequest};
use serde::de::DeserializeOwned;
use serde_json::error::Category;
use serde_path_to_error::{Path, Segment};

use crate::config::Config;
use crate::error::ApiError;
use crate::state::AppState;

/// A body some route takes.
pub(crate) trait Accepted: DeserializeOwned {
    /// Most bytes of it.
    fn limit(config: &Config) -> usize {
        config.body_limit
    }

    /// Whether it may be sent as TOML too.
    const TOML: bool = false;

    /// The refusal of one which does not fit.
    fn refuse(errors: Vec<FieldProblem>) -> ApiError {
        ApiError::InvalidRequest(errors)
    }
}

impl Accepted for StudySpec {
    const TOML: bool = true;

    fn limit(config: &Config) -> usize {
        config.study_limit
    }

    fn refuse(errors: Vec<FieldProblem>) -> ApiError {
        ApiError::InvalidStudy(errors)
    }
}

impl Accepted for ExchangeRequest {
    fn limit(config: &Config) -> usize {
        config.exchange_limit
    }
}

impl Accepted for RegisterRequest {}
impl Accepted for PredictionRequest {}
impl Accepted for OptimisationSpec {}
impl Accepted for SimulationRequest {}

/// A JSON body, or one in TOML where the route takes that.
pub(crate) struct JsonBody<T>(pub(crate) T);

impl<T: Accepted> FromRequest<AppState> for JsonBody<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &AppState) -> Result<Self, ApiError> {
        let toml = T::TOML && is(request.headers(), "application/toml");
        if !toml && !is(request.headers(), "application/json") {
            return Err(ApiError::UnsupportedMediaType);
        }
        let bytes = read(request, T::limit(state.config()), state.config()).await?;
        if toml { parse_toml(&bytes) } else { parse(&bytes) }.map(Self)
    }
}

fn is(headers: &HeaderMap, media_type: &str) -> bool {
    let declared = headers.get(header::CONTENT_TYPE).and_then(|v| v.to_str().ok()).unwrap_or_default();
    let essence = declared.split(';').next().unwrap_or_default().trim();
    essence.eq_ignore_ascii_case(media_type)
}

async fn read(request: Request, limit: usize, config: &Config) -> Result<Vec<u8>, ApiError> {
    let timeout = ApiError::BodyTimeout { seconds: config.body_wait.as_secs() };
    tokio::time::timeout(config.body_wait, collect(request.into_body(), limit)).await.map_err(|_| timeout)?
}

/// All of a body, copied as it comes: a part of one byte, kept, would keep the buffer of some KiB
/// which it was received into.
///
/// One which is too large is read on for as much again, and thrown away: a client which still
/// sends when its answer comes finds a broken connection and no reason.
async fn collect(body: Body, limit: usize) -> Result<Vec<u8>, ApiError> {
    let too_large = ApiError::BodyTooLarge { limit };
    let patience = 2 * limit;
    if body.size_hint().lower() > patience as u64 {
        return Err(too_large);
    }
    let (mut all, mut length, mut parts) = (Vec::new(), 0, body.into_data_stream());
    while let Some(part) = parts.next().await {
        let part = part.map_err(|_| ApiError::MalformedJson(vec![FieldProblem::new("", "the body broke off")]))?;
        length += part.len();
        if length > patience {
            return Err(too_large);
        }
        if length <= limit {
            all.extend_from_slice(&part);
        } else {
            all = Vec::new();
        }
    }
    if length > limit { Err(too_large) } else { Ok(all) }
}

/// Parses a whole body.
///
/// # Errors
/// With the JSON pointer of the field at fault.
pub(crate) fn parse<T: Accepted>(bytes: &[u8]) -> Result<T, ApiError> {
    // Serde would read a list as the fields of an object in their order.
    if bytes.trim_ascii_start().starts_with(b"[") {
        return Err(T::refuse(vec![FieldProblem::new("", "must be an object, not an array")]));
    }
    // Following the path costs as much as parsing: only what is refused is parsed with it.
    if let Ok(value) = serde_json::from_slice(bytes) {
        return Ok(value);
    }
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let path = pointer(error.path());
        let cause = error.into_inner();
        let detail = cause.to_string();
        match cause.classify() {
            Category::Data => T::refuse(vec![FieldProblem::new(named_field(path, &detail), detail)]),
            _ => ApiError::MalformedJson(vec![FieldProblem::new(path, detail)]),
        }
    })?;
    deserializer.end().map_err(|e| ApiError::MalformedJson(vec![FieldProblem::new("", e.to_string())]))?;
    Ok(value)
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
    use super::*;

    fn pointer_of(json: &str) -> (String, u16) {
        let problem = parse::<StudySpec>(json.as_bytes()).expect_err("is refused").problem();
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
