//! The coordinator of manduca: it takes studies, leases their jobs to workers,
//! keeps what they return and moves each study from stage to stage. It computes
//! nothing itself but predictions of a trained network, and the one stroke or front somebody looks at.
//!
//! [`Hold::take`] makes a process the one coordinator of a database, [`open`] opens it and [`serve`] serves
//! on a listener until told to stop; [`app`] is the service without a socket, for tests.

mod app;
mod auth;
mod beside;
mod changes;
mod check;
mod claims;
mod clock;
mod compose;
mod config;
mod dataset;
mod draw;
mod effort;
mod error;
mod event;
mod fair;
mod heavy;
mod hold;
mod http;
mod large;
mod look;
mod memory;
mod metrics;
mod offline;
mod onnx;
mod prepare;
mod rate;
mod registrations;
mod remark;
// The macro which describes routes spells out paths it need not.
#[allow(unused_qualifications)]
mod routes;
mod serve;
mod state;
mod store;
#[cfg(test)]
mod tests;
mod turn;
mod validity;

pub use app::app;
pub use auth::{Access, Host, Hosts, Scope, Scopes, Secret, TokenHash};
pub use check::{Checked, check};
pub use clock::{Clock, SystemClock};
pub use config::{Config, RunLimits};
pub use error::{ApiError, chain};
pub use hold::{Duty, Hold, Holder, Taken};
pub use offline::check::Findings;
pub use offline::upkeep::Pruned;
pub use offline::{Offline, OfflineError, Token};
pub use routes::document as openapi;
pub use serve::{ServerError, serve};
pub use state::{AppState, open, open_with_clock};
pub use store::OpenError;
