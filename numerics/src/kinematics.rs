//! How the wings move: the three Euler angles, the axes they turn and the room
//! they leave between the wings.

mod clearance;
mod clock;
mod contact;
mod frame;
mod stroke;

pub use clearance::{Clearance, clearance};
pub use clock::Clock;
pub use contact::{Contact, MOST_CONTACTS};
pub use frame::{Attitude, Vector};
pub use stroke::{Angle, ElevationPhase, Stroke};
