//! A plain HTTP client: answers as they come, bad ones too.

use std::time::Duration;

use reqwest::{Method, RequestBuilder};
use serde_json::Value;
use tokio::runtime::{Builder, Runtime};

/// How long a test waits for an answer.
const PATIENCE: Duration = Duration::from_secs(60);

/// An answer, whatever its status.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Status.
    pub status: u16,
    /// Headers, names in lower case.
    pub headers: Vec<(String, String)>,
    /// Body.
    pub body: String,
}

impl Answer {
    /// A header, empty where it is missing.
    pub fn header(&self, name: &str) -> &str {
        self.headers.iter().find(|(given, _)| given == name).map_or("", |(_, value)| value)
    }

    /// The body as JSON.
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error} in {}: {}", self.status, self.body))
    }

    /// The body as JSON of an answer which must have this status.
    pub fn expect(&self, status: u16) -> Value {
        assert_eq!(self.status, status, "{}", self.body);
        self.json()
    }
}

/// A client of one address. Calls block, so that a test reads from top to bottom.
#[derive(Debug)]
pub struct Client {
    base: String,
    http: reqwest::Client,
    runtime: Runtime,
}

impl Client {
    /// A client of an address such as `http://127.0.0.1:20100`.
    pub fn new(base: &str) -> Self {
        // A second call finds the provider in place, which is as good.
        let _ = rustls::crypto::ring::default_provider().install_default();
        // Connections are not kept: one to a killed coordinator would fail the next call.
        let http = reqwest::Client::builder().no_proxy().timeout(PATIENCE).pool_max_idle_per_host(0);
        // No certificate is ever checked: none has to be on this machine.
        let http = http.tls_certs_only([]);
        Self {
            base: base.to_owned(),
            http: http.build().expect("a client needs nothing from outside"),
            runtime: Builder::new_current_thread().enable_all().build().expect("a runtime needs no permission"),
        }
    }

    /// The address.
    pub fn base(&self) -> &str {
        &self.base
    }

    /// A request of any kind, to be completed and given to [`Client::send`].
    pub fn request(&self, method: &str, path: &str) -> RequestBuilder {
        let method = Method::from_bytes(method.as_bytes()).expect("a method");
        self.http.request(method, format!("{}{path}", self.base))
    }

    /// Sends a request; none when nobody answers.
    pub fn try_send(&self, request: RequestBuilder) -> Result<Answer, reqwest::Error> {
        self.runtime.block_on(async {
            let response = request.send().await?;
            let status = response.status().as_u16();
            let text = |value: &reqwest::header::HeaderValue| String::from_utf8_lossy(value.as_bytes()).into_owned();
            let headers = response.headers().iter().map(|(name, value)| (name.to_string(), text(value))).collect();
            Ok(Answer { status, headers, body: response.text().await? })
        })
    }

    /// Sends a request which must be answered.
    pub fn send(&self, request: RequestBuilder) -> Answer {
        self.try_send(request).unwrap_or_else(|error| panic!("no answer from {}: {error:?}", self.base))
    }

    /// GET, answered as it comes.
    pub fn ask(&self, path: &str) -> Answer {
        self.send(self.request("GET", path))
    }

    /// GET of a JSON document which must be there.
    pub fn get(&self, path: &str) -> Value {
        self.ask(path).expect(200)
    }

    /// POST of JSON.
    pub fn post(&self, path: &str, body: &Value) -> Answer {
        self.send(self.request("POST", path).json(body))
    }
}
