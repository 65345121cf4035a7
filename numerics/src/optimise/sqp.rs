//! Sequential quadratic programming: the optimum of a smooth surrogate, exactly.
//!
//! The paper's penalty is exact for any weight above the largest multiplier, so the
//! optimum of its Eq. 8 is that of the constrained problem solved here, which a
//! search by values alone only approaches: the penalty is a narrow valley with a kink.

mod clear;
mod flight;
#[cfg(test)]
mod flight_tests;
mod linear;
mod machine;
mod quadratic;
mod starts;
#[cfg(test)]
mod tests;

pub use clear::cleared;
pub use flight::{Differentiable, Flight};
pub use linear::{Linear, Multipliers};
pub use machine::{Sqp, SqpStop};
pub use starts::{LocalOptimum, SqpOptimum, SqpProgress, SqpSettings, minimise};
