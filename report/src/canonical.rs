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

use crate::check::{Group, Setup};

/// What the settings of the checks are, for the document.
pub fn settings() -> String {
    let (production, fine) = (scheme::Scheme::production(), Setup::Fine.name());
    let s = production.settings;
    format!(
        "`{fine}`: one small core for everything, and the lattice and step the expected value is for, or converged \
         ones; it tells whether the method is right. `{}`: the default cores, newest wake and shedding on such a lattice \
         and step; it tells whether the settings are right. `{}`: {} x {} panels and the step of a hawkmoth's stroke as \
         well; it tells what the lattice in use costs, measured with the same tolerances. Lengths are in mean chords; a \
         stroke is the path of the station at r2 in a stroke of the measured hawkmoth, 4 φa r2 R/c = {:.2} chords, \
         so that a step is {:.3} chords and the cores develop within {:.2} chords. No wake is forgotten.",
        Setup::Production.name(),
        Setup::Flown.name(),
        s.chordwise_panels,
        s.spanwise_panels,
        production.stroke,
        production.step(),
        s.core_growth_time * production.stroke,
    )
}

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
