//! The dashboard: a page whose content comes from the routes beside it, and its files,
//! all of them in the binary.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use axum::Router;
use axum::extract::Path;
use axum::extract::rejection::PathRejection;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;

use crate::error::ApiError;
use crate::http::etag;
use crate::http::headers::PAGE_POLICY;
use crate::state::AppState;

/// The page's own files change with the binary under the same name: they are asked for again, and
/// mostly answered with nothing new.
const ASK_AGAIN: &str = "no-cache";
/// A file whose name has its version never changes.
const FOR_EVER: &str = "public, max-age=31536000, immutable";

struct File {
    media_type: &'static str,
    compressed: bool,
    cache: &'static str,
    body: &'static [u8],
    tag: String,
}

impl File {
    fn new(name: &str, body: &'static [u8]) -> Self {
        let (plain, compressed) = name.strip_suffix(".gz").map_or((name, false), |plain| (plain, true));
        let media_type = match plain.rsplit('.').next() {
            Some("html") => "text/html; charset=utf-8",
            Some("js") => "text/javascript; charset=utf-8",
            Some("css") => "text/css; charset=utf-8",
            Some("svg") => "image/svg+xml",
            _ => "text/plain; charset=utf-8",
        };
        let cache = if name.starts_with("vendor/") { FOR_EVER } else { ASK_AGAIN };
        Self { media_type, compressed, cache, body, tag: etag::of(body) }
    }
}

macro_rules! files {
    ($($name:literal)*) => {
        [$(($name, include_bytes!(concat!("../../assets/", $name)).as_slice())),*]
    };
}

/// Every file by its name; those in the binary as they are sent, compressed or not.
static FILES: LazyLock<BTreeMap<&'static str, File>> = LazyLock::new(|| {
    let own = files!(
        "index.html" "style.css" "icon.svg" "main.js" "api.js" "dom.js" "format.js" "charts.js"
        "studies.js" "submit.js" "study.js" "stages.js" "workers.js" "failures.js" "throughput.js"
        "training.js" "explorer.js" "parallel.js" "optimum.js" "front.js" "search.js" "stroke.js" "flight.js" "scene.js" "flat.js" "predictor.js"
        "vendor/plotly-strict-4.1.1.min.js.gz" "vendor/plotly-LICENSE"
    );
    let studies = [
        ("studies/quick.toml", include_bytes!("../../../studies/quick.toml").as_slice()),
        ("studies/paper.toml", include_bytes!("../../../studies/paper.toml").as_slice()),
        ("studies/five.toml", include_bytes!("../../../studies/five.toml").as_slice()),
        ("studies/five-direct.toml", include_bytes!("../../../studies/five-direct.toml").as_slice()),
        ("studies/truth.toml", include_bytes!("../../../studies/truth.toml").as_slice()),
    ];
    own.into_iter().chain(studies).map(|(name, body)| (name, File::new(name, body))).collect()
});

/// Serves the page and its files. They are no part of the API and so not in its document.
pub(crate) fn router() -> Router<AppState> {
    Router::new().route("/", get(page)).route("/assets/{*name}", get(asset))
}

async fn page(headers: HeaderMap) -> Response {
    send("index.html", &headers)
}

async fn asset(name: Result<Path<String>, PathRejection>, headers: HeaderMap) -> Response {
    name.map_or_else(|_| ApiError::NoRoute.into_response(), |Path(name)| send(&name, &headers))
}

fn send(name: &str, headers: &HeaderMap) -> Response {
    let Some(file) = FILES.get(name) else { return ApiError::NoRoute.into_response() };
    let common = [
        (header::ETAG, file.tag.as_str()),
        (header::CACHE_CONTROL, file.cache),
        (header::CONTENT_SECURITY_POLICY, PAGE_POLICY),
    ];
    if etag::matches(headers, &file.tag) {
        return (StatusCode::NOT_MODIFIED, common).into_response();
    }
    let mut response = (common, [(header::CONTENT_TYPE, file.media_type)], file.body).into_response();
    if file.compressed {
        // Every browser takes it; who names no coding takes any (RFC 9110, 12.5.3).
        response.headers_mut().insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    response
}
