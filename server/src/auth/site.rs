//! Where a request comes from. Without tokens, whatever reaches the port is trusted; a browser reaches it for
//! every page that its user visits. Three things tell such pages from the coordinator's own:
//!
//! * `Host`: a page of a name that its owner pointed here (DNS rebinding) asks for that name.
//! * `Origin`: browsers name the page that sends a change.
//! * `Sec-Fetch-Site`: browsers say of every request whether its page is of the same origin.
//!
//! Programs send the name they were given, and neither of the other two.

use axum::http::{HeaderMap, HeaderName, Method, Uri, header};

use super::host::{Authority, Hosts};
use crate::error::ApiError;

const FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");
const FETCH_MODE: HeaderName = HeaderName::from_static("sec-fetch-mode");
const FETCH_DEST: HeaderName = HeaderName::from_static("sec-fetch-dest");
/// Pages that a link elsewhere may open. They hold nothing that belongs to anybody, and no frame shows them.
const PAGES: [&str; 2] = ["/", "/docs"];

/// What a header says.
enum Said<'r> {
    Nothing,
    Once(&'r str),
    /// More than once, or something that is no text.
    Unclear,
}

fn said<'r>(headers: &'r HeaderMap, name: &HeaderName) -> Said<'r> {
    let mut values = headers.get_all(name).iter();
    match (values.next(), values.next()) {
        (None, _) => Said::Nothing,
        (Some(value), None) => value.to_str().map_or(Said::Unclear, Said::Once),
        (Some(_), Some(_)) => Said::Unclear,
    }
}

/// Checks that a request is meant for this coordinator.
///
/// # Errors
/// Returns 400 if the request does not name one host, and 421 if it names another one.
pub(super) fn right_host(hosts: &Hosts, uri: &Uri, headers: &HeaderMap) -> Result<Authority, ApiError> {
    let Said::Once(text) = said(headers, &header::HOST) else { return Err(ApiError::UnclearHost) };
    let named = Authority::parse(text).ok_or(ApiError::UnclearHost)?;
    // A target may name the host too, and then counts (RFC 9112, 3.2.2): they must agree.
    let other = uri.authority().is_some_and(|target| Authority::parse(target.as_str()).as_ref() != Some(&named));
    if other {
        return Err(ApiError::UnclearHost);
    }
    if hosts.include(&named.host) { Ok(named) } else { Err(ApiError::ForeignHost(named.host.to_string())) }
}

/// Checks that no page of another site sends a request through its visitor's browser.
///
/// # Errors
/// Returns 403 if one does.
pub(super) fn right_site(own: Authority, method: &Method, path: &str, headers: &HeaderMap) -> Result<(), ApiError> {
    let same_origin = match said(headers, &header::ORIGIN) {
        Said::Nothing => true,
        Said::Once(text) => Authority::of_origin(text).is_some_and(|origin| {
            let default = if text.starts_with("https:") { 443 } else { 80 };
            origin == own.or_port(default)
        }),
        Said::Unclear => false,
    };
    let same_site = match said(headers, &FETCH_SITE) {
        Said::Nothing | Said::Once("same-origin" | "none") => true,
        Said::Once(_) => is_visit(method, path, headers),
        Said::Unclear => false,
    };
    if same_origin && same_site { Ok(()) } else { Err(ApiError::AnotherSite) }
}

/// Whether a browser opens one of the pages in a tab of its own, as after a click on a link.
fn is_visit(method: &Method, path: &str, headers: &HeaderMap) -> bool {
    let navigates = matches!(said(headers, &FETCH_MODE), Said::Once("navigate"));
    let shows = matches!(said(headers, &FETCH_DEST), Said::Once("document"));
    method == Method::GET && PAGES.contains(&path) && navigates && shows
}
