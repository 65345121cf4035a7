//! Wagner: lift of a plate after a sudden start.

use std::f64::consts::PI;

use manduca_numerics::math::exp;

use super::scheme::Scheme;
use super::wing::{Wing, interpolated};
use crate::check::{Expected, Group, Row, Setup};
use crate::plot::{Figure, Mark, Panel, Series};

/// Title of the checks.
pub const TITLE: &str = "Wagner: sudden start of a plate";
const SOURCE: &str = "Wagner's function, R. T. Jones, NACA TR 681";
/// Distance in semichords and lift over the steady lift.
pub const PUBLISHED: [(f64, f64); 5] = [(2.0, 0.669), (4.0, 0.758), (6.0, 0.813), (10.0, 0.875), (20.0, 0.937)];
const INCIDENCE: f64 = 0.02;

/// Lift over the steady lift against distance in semichords.
pub fn history(scheme: Scheme) -> Vec<(f64, f64)> {
    let lift = Wing::two_dimensional(scheme).lift(INCIDENCE, 10.5);
    lift.into_iter().map(|(path, lift)| (2.0 * path, lift / (2.0 * PI * INCIDENCE))).collect()
}

/// R. T. Jones's approximation.
fn jones(s: f64) -> f64 {
    1.0 - 0.165 * exp(-0.0455 * s) - 0.335 * exp(-0.3 * s)
}

/// `lattice` names it where it is not the main one.
fn rows(setup: Setup, scheme: Scheme, lattice: &str) -> Vec<Row> {
    let history = history(scheme);
    let row = |(s, value): (f64, f64)| Row {
        what: format!("s = {s} semichords{lattice}"),
        source: SOURCE,
        setup,
        expected: Expected::Within { value, share: 0.03 },
        got: interpolated(&history, s),
    };
    PUBLISHED.map(row).to_vec()
}

/// The checks.
pub fn group() -> Group {
    let production = Scheme::production();
    let mut all = rows(Setup::Fine, Scheme::fine(1e-6, 0.125, 16), "");
    all.extend(rows(Setup::Production, production.with_panels(16).with_step(0.125), ""));
    all.extend(rows(Setup::Flown, production, ""));
    for (panels, step) in [(8, 0.125), (8, 0.25), (16, 0.0625)] {
        let lattice = format!(", {panels} panels, step {step} c");
        all.extend(rows(Setup::Fine, Scheme::fine(1e-6, step, panels), &lattice));
    }
    Group {
        title: TITLE,
        about: format!(
            "Lift over the steady lift of a wing of aspect ratio 2000. It tests how the wake is shed: the first row's \
             place decides it. 16 panels, steps of 0.125 chords, and other lattices as named; as flown: {} panels, steps of \
             {:.3} chords.",
            production.settings.chordwise_panels,
            production.step()
        ),
        rows: all,
    }
}

/// Lift against distance.
pub fn figure() -> Figure {
    let after = |history: Vec<(f64, f64)>| history.into_iter().filter(|p| p.0 >= 0.2 && p.0 <= 20.0);
    let exact = (1..=20).map(f64::from).map(|s| (s, jones(s)));
    let series = vec![
        Series::new("Jones's approximation", Mark::Points, exact),
        Series::new("fine", Mark::Line, after(history(Scheme::fine(1e-6, 0.125, 16)))),
        Series::new(Setup::Flown.name(), Mark::Dashed, after(history(Scheme::production()))),
        Series::new("as flown, small cores", Mark::Dashed, after(history(Scheme::production_without_cores()))),
    ];
    let panel = Panel { x: "distance s, semichords".into(), y: "lift over steady lift".into(), series };
    Figure { panels: vec![panel], columns: 1 }
}
