//! The wing: outline and mass.

mod mass;
mod outline;

pub use mass::WingMass;
pub use outline::Outline;
