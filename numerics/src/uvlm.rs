//! Extended unsteady vortex-lattice method: a rigid thin wing of vortex rings, a
//! free wake, the other wing by mirror, leading-edge suction turned into lift.

mod flapping;
mod geometry;
mod influence;
pub mod kernel;
mod loads;
pub mod probe;
mod settings;
mod solver;
mod suction;
mod wake;

pub use flapping::{fly, solver_of};
pub use geometry::{Lattice, Planform, Pose};
pub use loads::WingLoad;
pub use settings::Settings;
pub use solver::{Air, Cores, Solver, Suction};
pub use suction::SuctionFit;
pub use wake::Rings;
