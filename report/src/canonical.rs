//! Checks any vortex lattice must pass, against published numbers and exact laws.

pub mod added_mass;
pub mod induced_drag;
pub mod invariants;
pub mod oscillation;
pub mod other_code;
pub mod plate;
pub mod scheme;
pub mod steady;
pub mod sudden_start;
pub mod symmetries;
pub mod wagner;
pub mod wing;

use rayon::prelude::*;

use crate::check::Group;

/// All checks, computed on all cores.
pub fn all() -> Vec<Group> {
    let groups: [fn() -> Group; 10] = [
        plate::group,
        wagner::group,
        oscillation::group,
        added_mass::group,
        steady::group,
        sudden_start::group,
        induced_drag::group,
        invariants::group,
        symmetries::group,
        other_code::group,
    ];
    groups.par_iter().map(|group| group()).collect()
}
