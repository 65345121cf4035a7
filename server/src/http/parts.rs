//! Ids in paths, values in query strings and media types of headers, with problems for refusals.

use axum::extract::rejection::PathRejection;
use axum::extract::{FromRequestParts, Path, Query};
use axum::http::request::Parts;
use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use serde::de::DeserializeOwned;

use crate::error::ApiError;

/// An id which names a resource: one that cannot be read names none.
pub(crate) trait Named: std::str::FromStr {
    /// There is no such resource.
    fn unknown(text: String) -> ApiError;
}

impl Named for StudyId {
    fn unknown(text: String) -> ApiError {
        ApiError::UnknownStudy(text)
    }
}

impl Named for WorkerId {
    fn unknown(text: String) -> ApiError {
        ApiError::UnknownWorker(text)
    }
}

impl Named for JobId {
    fn unknown(text: String) -> ApiError {
        ApiError::UnknownJob(text)
    }
}

/// The one id in a route's path.
pub(crate) struct Id<T>(pub(crate) T);

impl<S: Send + Sync, T: Named> FromRequestParts<S> for Id<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, ApiError> {
        let text: Result<Path<String>, PathRejection> = Path::from_request_parts(parts, state).await;
        let Path(text) = text.map_err(|_| ApiError::NoRoute)?;
        text.parse().map(Self).map_err(|_| T::unknown(text))
    }
}

/// A query string.
pub(crate) struct Params<T>(pub(crate) T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequestParts<S> for Params<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, ApiError> {
        let Query(params) = Query::<T>::try_from_uri(&parts.uri).map_err(|error| {
            let detail = std::error::Error::source(&error).map_or_else(|| error.to_string(), ToString::to_string);
            // Serde puts the name of the parameter first.
            let name = detail.split_once(": ").map_or("", |(name, _)| name);
            let pointer = if name.is_empty() { String::new() } else { format!("/{name}") };
            ApiError::query(&pointer, detail.clone())
        })?;
        Ok(Self(params))
    }
}

/// The media types of an Accept header in their order, without parameters and weights.
pub(crate) fn media_ranges(accept: &str) -> impl Iterator<Item = &str> {
    accept.split(',').map(|range| range.split(';').next().unwrap_or_default().trim())
}
