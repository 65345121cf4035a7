//! Extended unsteady vortex-lattice method: a rigid thin wing of vortex rings, a
//! free wake, the other wing by mirror, leading-edge suction turned into lift.

mod cores;
mod first_row;
mod flapping;
mod geometry;
mod influence;
pub mod kernel;
mod level;
mod limit;
mod loads;
pub mod probe;
mod settings;
mod sheet;
mod single;
mod solver;
mod suction;
mod tail;
mod wake;

pub use cores::Cores;
pub use flapping::{fly, solver_of};
pub use geometry::{Lattice, Planform, Pose};
pub use loads::WingLoad;
pub use settings::Settings;
pub use single::SingleWake;
pub use solver::{Air, Solver, Suction};
pub use suction::SuctionFit;
pub use wake::Rings;
