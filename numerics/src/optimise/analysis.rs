//! What the optimum depends on: the search's own settings, bounds given up, and the
//! parameters' shares in the outputs.

mod front;
mod indices;
mod sweep;
#[cfg(test)]
mod tests;

pub use front::{FrontPoint, Side, WholeFront, even_limits, front, held, whole_front};
pub use indices::{Indices, indices};
pub use sweep::{PenaltyRow, PopulationRow, Weight, penalty_sweep, population_sweep};
