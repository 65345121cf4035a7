//! HTTP towards a coordinator: one place which knows how a call can fail. The
//! command-line client uses it too.

mod answer;
mod error;

use std::net::IpAddr;
use std::time::Duration;

use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue};
use reqwest::redirect::Policy;
use reqwest::{ClientBuilder, RequestBuilder, Url};

pub use answer::{call, call_for_status, open, send, send_expecting};
pub use error::CallError;
pub(crate) use error::Class;
pub use reqwest::StatusCode;

/// How long a connection may take to open.
const CONNECT: Duration = Duration::from_secs(5);
/// How long a call may take unless it says otherwise.
pub const CALL: Duration = Duration::from_secs(30);
/// Variables which may name a proxy for `http://`.
const PROXIES: [&str; 4] = ["http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"];

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
    /// A sentence when the address is none, or when it is `https` and this machine has no certificates to
    /// check the other side's with.
    pub fn new(base: &str) -> Result<Self, String> {
        Self::with_token(base, None)
    }

    /// [`Http::new`] with a token sent along with every call.
    ///
    /// # Errors
    /// As [`Http::new`].
    pub fn with_token(base: &str, token: Option<&Token>) -> Result<Self, String> {
        let base = if base.contains("://") { base.to_owned() } else { format!("http://{base}") };
        let url = Url::parse(&base).map_err(|e| format!("`{base}` is not an address: {e}"))?;
        if !matches!(url.scheme(), "http" | "https") || !url.has_host() {
            return Err(format!("`{base}` is not an address of the form http://host:port or https://host"));
        }
        // A second call finds the provider in place, which is as good.
        let _ = rustls::crypto::ring::default_provider().install_default();
        // A token is for one address: a redirection is reported, not followed.
        let mut builder = ClientBuilder::new().connect_timeout(CONNECT).tcp_nodelay(true).redirect(Policy::none());
        if let Some(Token(value)) = token {
            builder = builder.default_headers(HeaderMap::from_iter([(AUTHORIZATION, value.clone())]));
        }
        if is_loopback(&url) {
            // A proxy cannot reach our own loopback, whatever HTTP_PROXY says.
            builder = builder.no_proxy();
        }
        if !needs_certificates(&url) {
            // Else the system's certificates are loaded, and it is an error where there are none.
            builder = builder.tls_certs_only([]);
        }
        let client = builder.build().map_err(|e| {
            let cause = error::root_cause(&e);
            format!(
                "cannot set up TLS for {base}: {cause}; install the system's certificates (the package is usually called \
                 ca-certificates), or name a PEM file in SSL_CERT_FILE"
            )
        })?;
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

/// Whether any certificate is checked: the coordinator's, or that of a proxy on the way to it.
fn needs_certificates(url: &Url) -> bool {
    let is_tls = |name: &str| std::env::var(name).is_ok_and(|proxy| proxy.trim().starts_with("https:"));
    url.scheme() == "https" || (!is_loopback(url) && PROXIES.iter().any(|name| is_tls(name)))
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
}
