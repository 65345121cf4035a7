//! HTTP towards a coordinator: one place which knows how a call can fail. The
//! command-line client uses it too.

use std::net::IpAddr;
use std::time::Duration;

use manduca_protocol::problem::Problem;
use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue};
use reqwest::{RequestBuilder, Response, StatusCode, Url};
use serde::de::DeserializeOwned;

/// How long a connection may take to open.
const CONNECT: Duration = Duration::from_secs(5);
/// How long a call may take unless it says otherwise.
pub const CALL: Duration = Duration::from_secs(30);

/// How a call failed.
#[derive(Debug, thiserror::Error)]
pub enum CallError {
    /// Nothing answered.
    #[error("cannot reach {url}: {reason}")]
    Unreachable {
        /// What was asked.
        url: String,
        /// The innermost cause.
        reason: String,
    },
    /// It answered with an error status.
    #[error("{0}")]
    Refused(Box<Problem>),
    /// It answered what this version cannot read.
    #[error("{url} answered what this version of manduca cannot read: {reason}")]
    Unreadable {
        /// What was asked.
        url: String,
        /// What is wrong with the answer.
        reason: String,
    },
}

impl CallError {
    /// The status, when there was an answer which says no.
    pub fn status(&self) -> Option<u16> {
        match self {
            Self::Refused(problem) => Some(problem.status),
            _ => None,
        }
    }

    /// Whether the same call may succeed later.
    pub fn is_passing(&self) -> bool {
        match self {
            Self::Unreachable { .. } => true,
            Self::Refused(problem) => problem.status >= 500 || matches!(problem.status, 408 | 425 | 429),
            Self::Unreadable { .. } => false,
        }
    }
}

/// What a coordinator asks for before it answers. It is not shown, not even for debugging.
#[derive(Clone)]
pub struct Token(HeaderValue);

impl Token {
    /// A token, without the white space around it.
    ///
    /// # Errors
    /// A sentence when it cannot be sent in a header.
    pub fn new(text: &str) -> Result<Self, String> {
        let value = HeaderValue::from_str(&format!("Bearer {}", text.trim()));
        let mut value = value.map_err(|_| "the token has characters which no token has".to_owned())?;
        value.set_sensitive(true);
        Ok(Self(value))
    }
}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token")
    }
}

/// A coordinator's address with a connection pool.
#[derive(Debug, Clone)]
pub struct Http {
    client: reqwest::Client,
    base: String,
}

impl Http {
    /// A client of the coordinator at `base`; `http://` may be left out.
    ///
    /// # Errors
    /// A sentence when the address is none.
    pub fn new(base: &str) -> Result<Self, String> {
        Self::with_token(base, None)
    }

    /// [`Http::new`] with a token sent along with every call.
    ///
    /// # Errors
    /// A sentence when the address is none.
    pub fn with_token(base: &str, token: Option<&Token>) -> Result<Self, String> {
        let base = if base.contains("://") { base.to_owned() } else { format!("http://{base}") };
        let url = Url::parse(&base).map_err(|e| format!("`{base}` is not an address: {e}"))?;
        if !matches!(url.scheme(), "http" | "https") || !url.has_host() {
            return Err(format!("`{base}` is not an address of the form http://host:port or https://host"));
        }
        // A second call finds the provider in place, which is as good.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let mut builder = reqwest::Client::builder().connect_timeout(CONNECT).tcp_nodelay(true);
        if let Some(Token(value)) = token {
            builder = builder.default_headers(HeaderMap::from_iter([(AUTHORIZATION, value.clone())]));
        }
        if is_loopback(&url) {
            // A proxy cannot reach our own loopback, whatever HTTP_PROXY says.
            builder = builder.no_proxy();
        }
        let client = builder.build().map_err(|e| format!("cannot set up HTTP: {}", root_cause(&e)))?;
        Ok(Self { client, base: base.trim_end_matches('/').to_owned() })
    }

    /// Whether what is sent can be read by others on the way.
    pub fn is_in_the_clear(&self) -> bool {
        Url::parse(&self.base).is_ok_and(|url| url.scheme() == "http" && !is_loopback(&url))
    }

    /// The address.
    pub fn base(&self) -> &str {
        &self.base
    }

    /// A GET of a path such as `/v1/studies`.
    pub fn get(&self, path: &str) -> RequestBuilder {
        self.client.get(format!("{}{path}", self.base)).timeout(CALL)
    }

    /// A POST.
    pub fn post(&self, path: &str) -> RequestBuilder {
        self.client.post(format!("{}{path}", self.base)).timeout(CALL)
    }

    /// A DELETE.
    pub fn delete(&self, path: &str) -> RequestBuilder {
        self.client.delete(format!("{}{path}", self.base)).timeout(CALL)
    }
}

/// Sends a request and hands back the answer once its status is a good one.
///
/// # Errors
/// When nothing answers or the answer is a refusal.
pub async fn send(request: RequestBuilder) -> Result<Response, CallError> {
    let response = request.send().await.map_err(unreachable)?;
    let status = response.status();
    if status.is_success() {
        return Ok(response);
    }
    let url = response.url().to_string();
    let body = response.text().await.unwrap_or_default();
    Err(CallError::Refused(Box::new(problem(status, &url, &body))))
}

/// Sends a request and reads its answer as JSON.
///
/// # Errors
/// As [`send`], and when the answer is not what it should be.
pub async fn call<T: DeserializeOwned>(request: RequestBuilder) -> Result<T, CallError> {
    let response = send(request).await?;
    let url = response.url().to_string();
    let body = response.bytes().await.map_err(unreachable)?;
    serde_json::from_slice(&body).map_err(|e| CallError::Unreadable { url, reason: e.to_string() })
}

/// Not every error comes from a coordinator: a proxy answers in its own words.
fn problem(status: StatusCode, url: &str, body: &str) -> Problem {
    serde_json::from_str(body).unwrap_or_else(|_| Problem {
        kind: "about:blank".into(),
        title: status.canonical_reason().unwrap_or("refused").into(),
        status: status.as_u16(),
        detail: format!("{url} says: {}", body.chars().take(300).collect::<String>().trim()),
        errors: Vec::new(),
    })
}

fn unreachable(error: reqwest::Error) -> CallError {
    let url = error.url().map_or_else(|| "the coordinator".to_owned(), ToString::to_string);
    CallError::Unreachable { url, reason: root_cause(&error) }
}

/// The innermost cause says what happened; the outer ones repeat the address.
fn root_cause(error: &dyn std::error::Error) -> String {
    let mut cause = error;
    while let Some(inner) = cause.source() {
        cause = inner;
    }
    cause.to_string()
}

fn is_loopback(url: &Url) -> bool {
    let host = url.host_str().unwrap_or_default();
    let host = host.trim_start_matches('[').trim_end_matches(']');
    host == "localhost" || host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_as_people_write_them() {
        assert_eq!(Http::new("127.0.0.1:8080").unwrap().base(), "http://127.0.0.1:8080");
        assert_eq!(Http::new("http://host:80/").unwrap().base(), "http://host:80");
        assert_eq!(Http::new("https://host").unwrap().base(), "https://host");
        assert!(Http::new("ftp://host").is_err());
        assert_eq!(format!("{:?}", Token::new(" secret\n").unwrap()), "Token");
        assert!(Token::new("se\ncret").is_err());
        assert!(Http::new("http://").is_err());
        for address in ["http://[::1]:1", "http://localhost", "http://127.0.0.1"] {
            assert!(is_loopback(&Url::parse(address).unwrap()), "{address}");
        }
        assert!(!is_loopback(&Url::parse("http://10.0.0.1").unwrap()));
    }

    #[test]
    fn a_strangers_error_page_becomes_a_problem() {
        let problem = problem(StatusCode::BAD_GATEWAY, "http://x/", "<h1>oh</h1>");
        assert_eq!((problem.status, problem.title.as_str()), (502, "Bad Gateway"));
        assert!(CallError::Refused(Box::new(problem)).is_passing());
    }
}
