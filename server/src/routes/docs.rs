//! `/docs`: the document of all routes as a page to read and try, offline.
//!
//! Swagger UI of `server/assets/swagger-ui`, of npm's `swagger-ui-dist`, unchanged but for the
//! compression; it is a part of the binary, and the page asks nobody but this coordinator.

use axum::Router;
use axum::http::header;
use axum::response::IntoResponse;
use axum::routing::get;

use crate::http::headers::PAGE_POLICY;
use crate::state::AppState;

/// Addresses are relative, so that the page works behind a proxy's prefix too.
const PAGE: &str = r#"<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>manduca: REST interface</title>
<link rel="icon" href="data:,">
<link rel="stylesheet" href="docs/swagger-ui.css">
</head>
<body>
<div id="swagger-ui"></div>
<script src="docs/swagger-ui-bundle.js"></script>
<script src="docs/start.js"></script>
</body>
</html>
"#;
const START: &str = r##"SwaggerUIBundle({
  url: "openapi.json",
  dom_id: "#swagger-ui",
  deepLinking: true,
  docExpansion: "list",
  defaultModelsExpandDepth: 0,
  // Nobody outside is asked whether the document is valid.
  validatorUrl: null,
});
"##;
const SCRIPT: &[u8] = include_bytes!("../../assets/swagger-ui/swagger-ui-bundle.js.gz");
const STYLE: &[u8] = include_bytes!("../../assets/swagger-ui/swagger-ui.css.gz");

/// Serves the page; the document does not describe it.
pub(crate) fn router() -> Router<AppState> {
    Router::new()
        .route("/docs", get(|| async { text("text/html; charset=utf-8", PAGE) }))
        .route("/docs/start.js", get(|| async { text("text/javascript; charset=utf-8", START) }))
        .route("/docs/swagger-ui-bundle.js", get(|| async { packed("text/javascript; charset=utf-8", SCRIPT) }))
        .route("/docs/swagger-ui.css", get(|| async { packed("text/css; charset=utf-8", STYLE) }))
}

fn text(media_type: &'static str, text: &'static str) -> impl IntoResponse {
    ([(header::CONTENT_TYPE, media_type), (header::CONTENT_SECURITY_POLICY, PAGE_POLICY)], text)
}

/// Every browser unpacks these.
fn packed(media_type: &'static str, file: &'static [u8]) -> impl IntoResponse {
    let headers = [
        (header::CONTENT_TYPE, media_type),
        (header::CONTENT_ENCODING, "gzip"),
        (header::CACHE_CONTROL, "max-age=86400"),
    ];
    (headers, file)
}
