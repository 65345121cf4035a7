//! `/openapi.json`.

use axum::Router;
use axum::http::header;
use axum::routing::get;
use manduca_protocol::problem::Problem;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;

use crate::state::AppState;

#[derive(OpenApi)]
#[openapi(
    info(
        title = "manduca",
        description = "Finds energy-optimal hovering kinematics. Submit a study, watch it, take its dataset, \
                       network and optima. Every refusal is problem+json (RFC 9457) with a stable `type` and a \
                       JSON pointer per field at fault."
    ),
    components(schemas(Problem))
)]
struct Document;

/// An empty router with the head of the document.
pub(super) fn described() -> OpenApiRouter<AppState> {
    OpenApiRouter::with_openapi(Document::openapi())
}

/// Serves the document, which does not describe itself.
pub(crate) fn router(document: utoipa::openapi::OpenApi) -> Router<AppState> {
    // Nothing in a document of literals fails to serialise; an empty one would show in the tests.
    let json = document.to_json().unwrap_or_default();
    Router::new()
        .route("/openapi.json", get(move || async move { ([(header::CONTENT_TYPE, "application/json")], json) }))
}
