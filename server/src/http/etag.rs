//! Entity tags: who has the present state already need not be sent it again.

use axum::http::{HeaderMap, header};

/// The weak tag of what a view says, times which merely pass left out.
pub(crate) fn of(stable: &[u8]) -> String {
    let hash = blake3::hash(stable).to_hex();
    format!("W/\"{}\"", &hash.as_str()[..32])
}

/// Whether the client has this state (RFC 9110, 13.1.2; compared weakly).
pub(crate) fn matches(headers: &HeaderMap, tag: &str) -> bool {
    let opaque = |t: &str| t.trim().trim_start_matches("W/").to_owned();
    headers
        .get_all(header::IF_NONE_MATCH)
        .iter()
        .filter_map(|v| v.to_str().ok())
        .any(|given| given.trim() == "*" || given.split(',').any(|t| opaque(t) == opaque(tag)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_compare_weakly_and_in_lists() {
        let tag = of(b"state");
        let mut headers = HeaderMap::new();
        assert!(!matches(&headers, &tag));
        let list = format!("\"other\", {}", tag.trim_start_matches("W/"));
        headers.insert(header::IF_NONE_MATCH, list.parse().expect("a header"));
        assert!(matches(&headers, &tag));
        assert!(!matches(&headers, &of(b"another state")));
    }
}
