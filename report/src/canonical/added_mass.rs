//! Added mass of a plate moving along its normal.

use std::f64::consts::PI;

use manduca_numerics::kinematics::Vector;
use rayon::prelude::*;

use super::scheme::Scheme;
use super::wing::{Wing, level};
use crate::check::{Expected, Group, Row, Setup};

const SOURCE: &str = "Meyerhoff 1970, J. Ship Research 14";
/// Aspect ratio, coefficient.
const PUBLISHED: [(f64, f64); 3] = [(1.0, 0.579), (2.0, 0.757), (4.0, 0.872)];
const TOLERANCE: f64 = 0.005;

/// Momentum of the air around a plate set moving along its normal, over that of the
/// cylinder of air around its chord, π ρ c² b / 4.
pub fn coefficient(wing: Wing) -> f64 {
    let panels = wing.scheme.settings.chordwise_panels;
    // A closed plate: the last ring ends a quarter panel behind the edge, where the lattice has its edge.
    let edge_speed = 1.0 / (PI * panels as f64 * wing.scheme.settings.first_row * wing.scheme.step());
    let mut solver = wing.solver_with_edge_speed(wing.scheme.step(), edge_speed);
    if solver.step(&level(0.0, Vector::zeros(), -Vector::z()), 1.0).is_none() {
        return f64::NAN;
    }
    // ρ ∫ Γ dA over both halves, the area as the loads count it.
    let panels = &solver.lattice().panels;
    let momentum: f64 = solver.circulation().iter().zip(panels).map(|(g, panel)| 2.0 * g * panel.area).sum();
    momentum / (0.25 * PI * wing.aspect)
}

/// Three lattices of square panels, which converge as 1/N with a 1/N² remainder, extrapolated.
fn extrapolated(aspect: f64, scheme: Scheme) -> f64 {
    let base = 6;
    let [a, b, c] = [1, 2, 3].map(|scale| {
        let strips = ((base * scale) as f64 * 0.5 * aspect).round() as usize;
        coefficient(Wing::rectangular(aspect, strips, scheme.with_panels(base * scale)))
    });
    0.5 * a - 4.0 * b + 4.5 * c
}

/// The checks.
pub fn group() -> Group {
    let (fine, production) = (Scheme::fine(1e-6, 0.125, 8), Scheme::production());
    let row = |what: String, setup, value, got| {
        let expected = Expected::Within { value, share: TOLERANCE };
        Row { what, source: SOURCE, setup, expected, got }
    };
    let rows = PUBLISHED.into_par_iter().flat_map_iter(|(aspect, value)| {
        let what = || format!("aspect ratio {aspect}");
        let whole = Wing::rectangular(aspect, 1, production).with_default_strips();
        [
            row(what(), Setup::Fine, value, extrapolated(aspect, fine)),
            row(what(), Setup::Production, value, extrapolated(aspect, production)),
            row(what(), Setup::Flown, value, coefficient(whole)),
        ]
    });
    Group {
        title: "Added mass of rectangular plates",
        about:
            "Over π ρ c² b/4, b the span. Three lattices extrapolated, with small and with default cores; as flown, \
                one lattice which is not refined, with about 1/N too much for N panels."
                .to_owned(),
        rows: rows.collect(),
    }
}
