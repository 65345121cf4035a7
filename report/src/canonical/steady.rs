//! Steady lift slopes of rectangular and swept wings.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::scheme::Scheme;
use super::wing::{Shape, Wing};
use crate::check::{Expected, Group, Row, Setup};

const JONES_COHEN: &str = "Jones & Cohen, High Speed Wing Theory";
const KATZ_PLOTKIN: &str = "Katz & Plotkin, Low-Speed Aerodynamics";
const BERTIN_SMITH: &str = "Bertin & Smith, Aerodynamics for Engineers, example 7.2";
/// Path after which the lift is taken as steady, chords.
const PATH: f64 = 30.0;
/// Step of the steady runs, chords.
const STEP: f64 = 0.5;

/// Uniform spacing converges as 1/N: two lattices extrapolate.
fn extrapolated(aspect: f64, scheme: Scheme) -> f64 {
    let slope = |panels, strips| Wing::rectangular(aspect, strips, scheme.with_panels(panels)).lift_slope(PATH);
    2.0 * slope(8, 24) - slope(4, 12)
}

fn swept(panels: usize, strips: usize, scheme: Scheme) -> f64 {
    let wing = Wing::rectangular(5.0, strips, scheme.with_panels(panels));
    Wing { shape: Shape::Straight(PI / 4.0), ..wing }.lift_slope(PATH)
}

/// One wing: name, source, expected slope, tolerance, and how it is computed.
type Case = (&'static str, &'static str, f64, f64, fn(Scheme) -> f64);

/// Wings with the published lattices.
const PUBLISHED: [Case; 5] = [
    ("aspect ratio 4, limit of fine lattices", JONES_COHEN, 3.63, 0.01, |s| extrapolated(4.0, s)),
    ("aspect ratio 8, limit of fine lattices", JONES_COHEN, 4.55, 0.01, |s| extrapolated(8.0, s)),
    ("aspect ratio 4, 6 x 12 panels", KATZ_PLOTKIN, 3.72, 0.005, |s| {
        Wing::rectangular(4.0, 12, s.with_panels(6)).lift_slope(PATH)
    }),
    ("aspect ratio 5, swept 45°, 1 x 4 panels", BERTIN_SMITH, 3.443, 0.005, |s| swept(1, 4, s)),
    ("aspect ratio 5, swept 45°, 4 x 12 panels", BERTIN_SMITH, 3.27, 0.01, |s| swept(4, 12, s)),
];

/// Wings with the default lattice and step.
const FLOWN: [Case; 2] = [
    ("aspect ratio 4, limit of fine lattices", JONES_COHEN, 3.63, 0.01, |s| default_lattice(4.0, s)),
    ("aspect ratio 8, limit of fine lattices", JONES_COHEN, 4.55, 0.01, |s| default_lattice(8.0, s)),
];

fn default_lattice(aspect: f64, scheme: Scheme) -> f64 {
    Wing::rectangular(aspect, 1, scheme).with_default_strips().lift_slope(0.5 * PATH)
}

/// The checks.
pub fn group() -> Group {
    let (fine, production) = (Scheme::fine(1e-3, STEP, 4), Scheme::production());
    let mut work: Vec<(Case, Setup, Scheme)> = Vec::new();
    work.extend(PUBLISHED.map(|case| (case, Setup::Fine, fine)));
    work.extend(PUBLISHED.map(|case| (case, Setup::Production, production.with_step(STEP))));
    work.extend(FLOWN.map(|case| (case, Setup::Flown, production)));
    let rows = work.into_par_iter().map(|((what, source, value, share, slope), setup, scheme)| Row {
        what: what.to_owned(),
        source,
        setup,
        expected: Expected::Within { value, share },
        got: slope(scheme),
    });
    Group {
        title: "Steady lift slope",
        about: format!(
            "Per rad, {PATH} chords after a start at a small incidence, with steps of {STEP} chords. The limit is \
             extrapolated from two lattices; as flown, one lattice which is not refined, {} chords after the start.",
            0.5 * PATH
        ),
        rows: rows.collect(),
    }
}
