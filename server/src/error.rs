//! Every refusal of the API, each with its status. Causes inside the
//! coordinator are logged here, once, and never shown.

use axum::Json;
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use manduca_protocol::problem::{FieldProblem, Problem, bounded};
use manduca_protocol::worker::{OLDEST_PROTOCOL_VERSION, PROTOCOL_VERSION};

use crate::auth::Scope;
use crate::store::{StoreError, Trouble};

/// Why a request was refused.
#[derive(Debug, thiserror::Error)]
pub enum ApiError {
    /// The body is not JSON at all.
    #[error("the body is not valid JSON")]
    MalformedJson(Vec<FieldProblem>),
    /// The body is not TOML at all.
    #[error("the body is not valid TOML")]
    MalformedToml(Vec<FieldProblem>),
    /// The study cannot be accepted.
    #[error("the study is not valid")]
    InvalidStudy(Vec<FieldProblem>),
    /// The body is JSON, but not what this route takes.
    #[error("the request is not valid")]
    InvalidRequest(Vec<FieldProblem>),
    /// The query string is not what this route takes.
    #[error("the query string is not valid")]
    InvalidQuery(Vec<FieldProblem>),
    /// The Idempotency-Key came with another study before.
    #[error("this Idempotency-Key was used for another study")]
    IdempotencyKeyReused,
    /// No token came with it, or one which is not known.
    #[error(
        "this coordinator asks for a token (`Authorization: Bearer ...`); none came, or one that is unknown or revoked"
    )]
    Unauthenticated,
    /// The token does not allow this.
    #[error("the token does not allow this; it needs the scope `{0}`")]
    Forbidden(Scope),
    /// The worker, or the one that holds the job, was registered with another token.
    #[error("{0}")]
    AnotherToken(String),
    /// The token has registered too many workers lately.
    #[error("this token has registered too many workers lately; try again in {wait_s} s")]
    TooManyRegistrations {
        /// How long to wait.
        wait_s: u64,
    },
    /// The request names no host, more than one, or something that is none.
    #[error("the request must name one host: one `Host` header, and the same host in its target if that names one")]
    UnclearHost,
    /// The request is for another host than this coordinator.
    #[error(
        "this coordinator asks for no tokens, and then does not answer as `{0}`: a page of another site could be \
         behind that name. Ask by `localhost`, 127.0.0.1 or [::1], such as through a tunnel; or start it with \
         `--allow-host {0}` if that is its own name, or with `--require-tokens`"
    )]
    ForeignHost(String),
    /// A page of another site asked through a visitor's browser.
    #[error(
        "a page of another site may not ask here through its visitor's browser. Open the coordinator's own page; a \
         proxy before it must pass on the `Host` header as the browser sent it"
    )]
    AnotherSite,
    /// The body is not declared as JSON.
    #[error("the body must be sent as application/json")]
    UnsupportedMediaType,
    /// None of the media types asked for is offered.
    #[error("this is offered as {offered}")]
    NotAcceptable {
        /// What is offered.
        offered: &'static str,
    },
    /// The body is larger than this route takes.
    #[error("the body is larger than {limit} bytes")]
    BodyTooLarge {
        /// Most bytes.
        limit: usize,
    },
    /// The body did not arrive in time.
    #[error("the body did not arrive within {seconds} s")]
    BodyTimeout {
        /// How long it was waited for.
        seconds: u64,
    },
    /// There is no such route.
    #[error("there is nothing here; the routes are listed at /docs")]
    NoRoute,
    /// There is such a route, but not with this method.
    #[error("this method is not allowed here")]
    MethodNotAllowed,
    /// There is no such study.
    #[error("there is no study {0}")]
    UnknownStudy(String),
    /// There is no such job.
    #[error("there is no job {0}")]
    UnknownJob(String),
    /// The study has no such optimisation.
    #[error("the study has no optimisation `{0}`")]
    UnknownOptimisation(String),
    /// The worker is not registered, or said goodbye.
    #[error("worker {0} is not registered here; it must register anew")]
    UnknownWorker(String),
    /// What was asked for does not exist yet.
    #[error("{0}")]
    NotYet(&'static str),
    /// The study's state does not allow this.
    #[error("{0}")]
    WrongState(String),
    /// The worker speaks another version of the exchange.
    #[error(
        "the worker speaks version {theirs} of the exchange, the coordinator versions {OLDEST_PROTOCOL_VERSION} to \
         {PROTOCOL_VERSION}: update the older of the two"
    )]
    ProtocolVersion {
        /// The worker's.
        theirs: u32,
    },
    /// The worker computes other numbers.
    #[error("the worker's solver has version `{theirs}`, the coordinator's `{ours}`")]
    SolverVersion {
        /// The worker's.
        theirs: String,
        /// The coordinator's.
        ours: &'static str,
    },
    /// As many such requests wait as may.
    #[error("as many requests of this kind wait already as may; try again")]
    Busy,
    /// There is no memory for the body now.
    #[error("too many large requests come at once; try again")]
    Crowded,
    /// The coordinator ends before it could answer.
    #[error("the coordinator is stopping; try again")]
    Stopping,
    /// The store could not take or give it now.
    #[error("the store is not available; try again")]
    Unavailable(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// As many watch the changes as may.
    #[error("{most} clients watch already; ask again later, or now and then")]
    TooManyWatchers {
        /// Most clients.
        most: usize,
    },
    /// A fault of the coordinator.
    #[error("the coordinator failed at this request")]
    Internal(#[source] Box<dyn std::error::Error + Send + Sync>),
}

impl ApiError {
    /// One fault of the query string.
    pub fn query(pointer: &str, detail: impl Into<String>) -> Self {
        Self::InvalidQuery(vec![FieldProblem::new(pointer, detail)])
    }

    /// Status, slug of the type, title.
    fn class(&self) -> (StatusCode, &'static str, &'static str) {
        use StatusCode as S;
        match self {
            Self::MalformedJson(_) => (S::BAD_REQUEST, "malformed-json", "Malformed JSON"),
            Self::MalformedToml(_) => (S::BAD_REQUEST, "malformed-toml", "Malformed TOML"),
            Self::InvalidStudy(_) => (S::UNPROCESSABLE_ENTITY, "invalid-study", "Invalid study"),
            Self::InvalidRequest(_) => (S::UNPROCESSABLE_ENTITY, "invalid-request", "Invalid request"),
            Self::InvalidQuery(_) => (S::BAD_REQUEST, "invalid-query", "Invalid query string"),
            Self::IdempotencyKeyReused => (S::UNPROCESSABLE_ENTITY, "idempotency-key-reused", "Idempotency-Key reused"),
            Self::Unauthenticated => (S::UNAUTHORIZED, "unauthenticated", "No valid token"),
            Self::Forbidden(_) => (S::FORBIDDEN, "forbidden", "Not allowed"),
            Self::AnotherToken(_) => (S::FORBIDDEN, "another-token", "Another token's worker"),
            Self::TooManyRegistrations { .. } => {
                (S::TOO_MANY_REQUESTS, "too-many-registrations", "Too many registrations")
            }
            Self::UnclearHost => (S::BAD_REQUEST, "unclear-host", "Unclear host"),
            Self::ForeignHost(_) => (S::MISDIRECTED_REQUEST, "foreign-host", "Another host"),
            Self::AnotherSite => (S::FORBIDDEN, "another-site", "From another site"),
            Self::UnsupportedMediaType => {
                (S::UNSUPPORTED_MEDIA_TYPE, "unsupported-media-type", "Unsupported media type")
            }
            Self::NotAcceptable { .. } => (S::NOT_ACCEPTABLE, "not-acceptable", "Not acceptable"),
            Self::BodyTooLarge { .. } => (S::PAYLOAD_TOO_LARGE, "body-too-large", "Body too large"),
            Self::BodyTimeout { .. } => (S::REQUEST_TIMEOUT, "body-timeout", "Body too slow"),
            Self::NoRoute => (S::NOT_FOUND, "no-route", "No such route"),
            Self::MethodNotAllowed => (S::METHOD_NOT_ALLOWED, "method-not-allowed", "Method not allowed"),
            Self::UnknownStudy(_) => (S::NOT_FOUND, "unknown-study", "Unknown study"),
            Self::UnknownJob(_) => (S::NOT_FOUND, "unknown-job", "Unknown job"),
            Self::UnknownOptimisation(_) => (S::NOT_FOUND, "unknown-optimisation", "Unknown optimisation"),
            Self::UnknownWorker(_) => (S::NOT_FOUND, "unknown-worker", "Unknown worker"),
            Self::NotYet(_) => (S::NOT_FOUND, "not-yet", "Not there yet"),
            Self::WrongState(_) => (S::CONFLICT, "wrong-state", "Wrong state"),
            Self::ProtocolVersion { .. } => {
                (S::UPGRADE_REQUIRED, "protocol-version", "Another version of the exchange")
            }
            Self::SolverVersion { .. } => (S::CONFLICT, "solver-version", "Another version of the solver"),
            Self::Busy => (S::TOO_MANY_REQUESTS, "busy", "Too many wait"),
            Self::Crowded => (S::SERVICE_UNAVAILABLE, "unavailable", "Not available now"),
            Self::Stopping => (S::SERVICE_UNAVAILABLE, "unavailable", "Not available now"),
            Self::Unavailable(_) => (S::SERVICE_UNAVAILABLE, "unavailable", "Not available now"),
            Self::TooManyWatchers { .. } => (S::SERVICE_UNAVAILABLE, "too-many-watchers", "Too many watchers"),
            Self::Internal(_) => (S::INTERNAL_SERVER_ERROR, "internal", "Internal error"),
        }
    }

    /// The fields at fault.
    fn fields(&self) -> Vec<FieldProblem> {
        match self {
            Self::MalformedJson(errors)
            | Self::MalformedToml(errors)
            | Self::InvalidStudy(errors)
            | Self::InvalidRequest(errors)
            | Self::InvalidQuery(errors) => bounded(errors.iter().cloned()),
            Self::IdempotencyKeyReused => {
                vec![FieldProblem::new("/headers/idempotency-key", "came with another study before")]
            }
            Self::ProtocolVersion { .. } => {
                vec![FieldProblem::new("/protocol_version", self.to_string())]
            }
            Self::SolverVersion { .. } => vec![FieldProblem::new("/solver_version", self.to_string())],
            _ => Vec::new(),
        }
    }

    /// What happened; of the store also why, as far as its operator can do something about it.
    fn detail(&self) -> String {
        let (Self::Unavailable(cause) | Self::Internal(cause)) = self else { return self.to_string() };
        match (Trouble::of(cause.as_ref()), cause.downcast_ref()) {
            (Some(trouble), _) => format!("{self}: {}", trouble.what()),
            (None, Some(StoreError::Failing(why))) => format!("{self}: {why}"),
            (None, Some(StoreError::Corrupt(why))) => {
                format!("{self}: what is stored cannot be read, {why}; `manduca db check` says more")
            }
            _ => self.to_string(),
        }
    }

    /// The refusal as sent.
    pub fn problem(&self) -> Problem {
        let (status, slug, title) = self.class();
        Problem {
            kind: format!("urn:manduca:problem:{slug}"),
            title: title.into(),
            status: status.as_u16(),
            detail: self.detail(),
            errors: self.fields(),
        }
    }

    fn log(&self) {
        let (Self::Unavailable(cause) | Self::Internal(cause)) = self else { return };
        tracing::error!(error.cause = %chain(cause.as_ref()), "A request failed inside the coordinator");
    }
}

/// An error with the errors below it, in one line. Many errors end with the words of the one below,
/// which are not repeated.
pub fn chain(error: &(dyn std::error::Error + 'static)) -> String {
    let mut text = error.to_string();
    let mut below = error.source();
    while let Some(cause) = below {
        let words = cause.to_string();
        if !text.contains(&words) {
            text.push_str(": ");
            text.push_str(&words);
        }
        below = cause.source();
    }
    text
}

/// Marks the answer to a request about the worker of another token, for whoever counts such requests.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OfAnotherToken;

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        self.log();
        let (status, ..) = self.class();
        let mut response = (status, Json(self.problem())).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
        if let Some((name, value)) = self.hint() {
            headers.insert(name, value);
        }
        if matches!(self, Self::AnotherToken(_)) {
            response.extensions_mut().insert(OfAnotherToken);
        }
        response
    }
}

impl ApiError {
    /// The header a client needs to do better.
    fn hint(&self) -> Option<(HeaderName, HeaderValue)> {
        match self {
            Self::Unavailable(_) | Self::Busy | Self::Crowded | Self::Stopping => {
                Some((header::RETRY_AFTER, HeaderValue::from_static("1")))
            }
            Self::TooManyRegistrations { wait_s } => Some((header::RETRY_AFTER, HeaderValue::from(*wait_s))),
            Self::TooManyWatchers { .. } => Some((header::RETRY_AFTER, HeaderValue::from_static("10"))),
            Self::Unauthenticated => Some((header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"))),
            Self::ProtocolVersion { .. } => {
                let wanted = HeaderValue::try_from(format!("manduca-exchange/{PROTOCOL_VERSION}")).ok()?;
                Some((header::UPGRADE, wanted))
            }
            _ => None,
        }
    }
}

impl From<StoreError> for ApiError {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::UnknownStudy(id) => Self::UnknownStudy(id.to_string()),
            StoreError::UnknownWorker(id) => Self::UnknownWorker(id.to_string()),
            StoreError::UnknownJob(id) => Self::UnknownJob(id.to_string()),
            StoreError::WrongState(why) => Self::WrongState(why),
            StoreError::AnotherToken(why) => Self::AnotherToken(why),
            StoreError::IdempotencyKeyReused => Self::IdempotencyKeyReused,
            StoreError::Corrupt(_) | StoreError::Unreadable(..) | StoreError::Panicked => {
                Self::Internal(Box::new(error))
            }
            StoreError::Sql(_) | StoreError::Commit(_) | StoreError::Closed | StoreError::Failing(_) => {
                Self::Unavailable(Box::new(error))
            }
        }
    }
}
