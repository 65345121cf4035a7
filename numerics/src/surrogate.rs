//! Surrogate of the simulation: one hidden layer of sigmoids, linear outputs.
//!
//! A flight simulation costs seconds, the network about half a microsecond, so
//! every optimiser of manduca searches on the network and asks the simulation
//! only to confirm. The architecture, 10-500-4, the 80/10/10 split and early
//! stopping are those of Nguyen, Tran, Han & Lee 2019. Their plain mapping and
//! Levenberg-Marquardt are choices; the defaults are the exact laws of hovering as
//! features, and variable projection.
//!
//! Neither training nor prediction depends on the number of threads. Prediction
//! has the same bits on every machine; training has not quite, because the
//! matrix products of `faer` round by the width of the machine's registers.

mod cholesky;
#[cfg(test)]
mod constant_tests;
mod ensemble;
mod errors;
mod features;
#[cfg(test)]
mod features_tests;
mod gram;
mod infer;
#[cfg(test)]
mod infer_tests;
mod initial;
mod kernel;
mod levenberg;
#[cfg(test)]
mod levenberg_tests;
mod network;
mod normal;
pub mod process;
mod products;
mod projection;
pub(crate) mod random;
mod settings;
pub(crate) mod sharpness;
mod train;
#[cfg(test)]
mod train_tests;

pub use ensemble::Surrogate;
pub use errors::{Errors, errors};
pub use features::{Features, Frame};
pub use infer::Jacobian;
pub use initial::Split;
pub(crate) use network::bad_bounds;
#[cfg(test)]
pub(crate) use network::tests::random_network;
pub use network::{Network, NetworkError};
pub use process::{Process, ProcessOutput};
pub use settings::{Method, Part, TrainError, TrainSettings, check_sizes};
pub use train::{Checkpoint, Dataset, Epoch, Member, Stop, Training, train};

use crate::parameters::Point;

/// One simulated point: what the surrogate learns from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// The ten design parameters in table order and table units.
    pub x: Point,
    /// The scaled stroke means `[L+, D+, M+, P+]`, dimensionless (paper Eq. 4).
    pub y: [f64; 4],
    /// Standard errors of `y`; 0 where unknown.
    pub se: [f64; 4],
}
