//! The science of manduca: kinematics, aerodynamics, surrogate and optimisers,
//! free of clocks, disks, networks and logs.

pub mod balance;
pub mod cases;
pub mod history;
pub mod insect;
pub mod kinematics;
mod lanes;
pub mod math;
pub mod optimise;
pub mod parameters;
pub mod quasi_steady;
pub mod refine;
pub mod sampling;
pub mod simulation;
pub mod surrogate;
pub mod table;
pub mod uvlm;
pub mod wing;
