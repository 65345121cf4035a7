//! What the numbers of manduca are worth: checks against published results,
//! flights of the published strokes, and the documents which show both.
//!
//! Tests and documents use the same code: a check is a list of rows
//! ([`check::Row`]), a test asserts them and a document prints them.
#![warn(missing_docs)]

pub mod canonical;
pub mod check;
pub mod convergence;
pub mod difference;
pub mod figures;
pub mod five;
pub mod flights;
pub mod markdown;
pub mod output;
pub mod plot;
pub mod reproduction;
pub mod sensitivity;
pub mod validation;
pub mod verification;
