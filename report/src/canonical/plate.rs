//! The two-dimensional plate: the lattice's bound segments and collocation points (at one and three
//! quarters of each panel) are exact for any number of panels.

use std::f64::consts::{PI, TAU};

use manduca_numerics::math::sin;
use manduca_numerics::uvlm::{Lattice, Settings, SuctionFit};
use nalgebra::{DMatrix, DVector};

use super::scheme::Scheme;
use super::wing::Wing;
use crate::check::{Expected, Group, Row, Setup};

const INCIDENCE: f64 = 0.3;

/// Circulations of a plate of unit chord at `INCIDENCE` in a stream of unit speed, front first.
fn circulations(panels: usize) -> Option<DVector<f64>> {
    let wing = Wing::two_dimensional(Scheme::fine(1e-6, 0.125, panels));
    let lattice = Lattice::new(&wing.planform(), panels, &[0.0; 2]);
    // Endless vortices where the bound segments are; the chord's axis points forward.
    let behind = |i: usize, j: usize| lattice.panels[j].bound.y - lattice.panels[i].collocation.y;
    let influence = DMatrix::from_fn(panels, panels, |i, j| 1.0 / (TAU * behind(i, j)));
    influence.lu().solve(&DVector::from_element(panels, sin(INCIDENCE)))
}

/// Total circulation, and suction over ½ ρ U² c by the solver's fit.
pub fn circulation_and_suction(panels: usize) -> (f64, f64) {
    let Some(circulation) = circulations(panels) else { return (f64::NAN, f64::NAN) };
    let w0 = SuctionFit::new(panels).singularity(circulation.iter().copied());
    (circulation.sum(), TAU * w0 * w0)
}

/// The checks.
pub fn group() -> Group {
    let default = Settings::default().chordwise_panels;
    let mut numbers = vec![1, 2, 4, 6, 8, 10, 16];
    if !numbers.contains(&default) {
        numbers.push(default);
    }
    let sine = sin(INCIDENCE);
    let rows = numbers.into_iter().flat_map(|panels| {
        let (circulation, suction) = circulation_and_suction(panels);
        let setup = if panels == default { Setup::Production } else { Setup::Fine };
        let row = |what: String, source, value: f64, distance, got| Row {
            what,
            source,
            setup,
            expected: Expected::Near { value, distance },
            got,
        };
        [
            row(format!("Γ/(U c), N = {panels}"), "thin aerofoil theory", PI * sine, 1e-10, circulation),
            row(format!("suction/(½ρU²c), N = {panels}"), "thin aerofoil theory", TAU * sine * sine, 1e-6, suction),
        ]
    });
    Group {
        title: "Two-dimensional plate",
        about: format!(
            "A flat plate at {INCIDENCE} rad: circulation π U c sin α and leading-edge suction 2π sin²α, \
             with any number N of panels; default: N = {default}."
        ),
        rows: rows.collect(),
    }
}
