//! Errors as RFC 9457 problem details.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Most faults told of one request; how many more there are is told in one line.
pub const MOST_FAULTS: usize = 100;
/// Longest pointer told, characters.
const LONGEST_POINTER: usize = 300;
/// Longest detail told, characters.
const LONGEST_DETAIL: usize = 1000;
/// What the types of a coordinator's problems begin with.
pub const URN: &str = "urn:manduca:problem:";

/// One bad field.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FieldProblem {
    /// JSON pointer (RFC 6901) of the field, `` for the whole body.
    pub pointer: String,
    /// What is wrong with it, for a person.
    pub detail: String,
}

impl FieldProblem {
    /// A problem at a pointer. Either text is cut where it is longer than anyone reads: names come from the client.
    pub fn new(pointer: impl Into<String>, detail: impl Into<String>) -> Self {
        Self { pointer: cut(pointer.into(), LONGEST_POINTER), detail: cut(detail.into(), LONGEST_DETAIL) }
    }

    /// Tells that there are so many faults beside those listed.
    pub fn more(count: usize) -> Self {
        Self::new("", format!("and {count} more"))
    }

    fn is_more(&self) -> bool {
        self.pointer.is_empty() && self.detail.starts_with("and ") && self.detail.ends_with(" more")
    }
}

/// A text of at most so many characters and an ellipsis.
fn cut(mut text: String, most: usize) -> String {
    if let Some((end, _)) = text.char_indices().nth(most) {
        text.truncate(end);
        text.push('…');
        text.shrink_to_fit();
    }
    text
}

/// The first [`MOST_FAULTS`] of these, and how many more there are.
pub fn bounded(faults: impl IntoIterator<Item = FieldProblem>) -> Vec<FieldProblem> {
    let mut faults = faults.into_iter();
    let mut told: Vec<_> = faults.by_ref().take(MOST_FAULTS).collect();
    let rest: Vec<_> = faults.by_ref().take(1).collect();
    match (rest.len() + faults.count(), rest.into_iter().next()) {
        (0, _) => {}
        // Bounded before.
        (1, Some(last)) if last.is_more() => told.push(last),
        (more, _) => told.push(FieldProblem::more(more)),
    }
    told
}

impl std::fmt::Display for FieldProblem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let pointer = if self.pointer.is_empty() { "/" } else { &self.pointer };
        write!(f, "{pointer}: {}", self.detail)
    }
}

/// A refusal, as `application/problem+json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// Stable name of the kind of problem, such as `urn:manduca:problem:invalid-study`.
    #[serde(rename = "type")]
    pub kind: String,
    /// The kind in words.
    pub title: String,
    /// HTTP status.
    pub status: u16,
    /// This occurrence in words.
    pub detail: String,
    /// The fields at fault.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<FieldProblem>,
}

impl Problem {
    /// Whether a coordinator says this: its types begin with [`URN`].
    pub fn is_a_coordinators(&self) -> bool {
        self.kind.starts_with(URN)
    }

    /// Whether it is of the type with this last part, such as `unknown-worker`.
    pub fn is(&self, slug: &str) -> bool {
        self.kind.strip_prefix(URN) == Some(slug)
    }
}

impl std::fmt::Display for Problem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({}): {}", self.title, self.status, self.detail)?;
        for error in &self.errors {
            write!(f, "\n  {error}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hundred_faults_are_told_and_the_rest_counted() {
        let faults = |n: usize| (0..n).map(|i| FieldProblem::new(format!("/{i}"), "is wrong"));
        assert_eq!(bounded(faults(100)).len(), 100);
        assert_eq!(bounded(faults(101))[100].detail, "and 1 more");
        let told = bounded(faults(60_000));
        assert_eq!((told.len(), told[100].to_string().as_str()), (101, "/: and 59900 more"));
        assert_eq!(bounded(told.clone()), told, "once bounded, it stays as it is");
    }

    #[test]
    fn names_as_long_as_a_body_are_cut() {
        let told = FieldProblem::new("ü".repeat(100_000), "x".repeat(100_000));
        assert_eq!((told.pointer.chars().count(), told.detail.chars().count()), (301, 1001));
    }
}
