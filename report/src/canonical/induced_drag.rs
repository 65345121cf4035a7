//! Induced drag: what the suction in the wing's plane leaves of the pressure's drag.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::scheme::Scheme;
use super::wing::{Shape, Wing};
use crate::check::{Expected, Group, Row, Setup};

const LIFTING_LINE: &str = "lifting-line theory (elliptic wing)";
const RECTANGULAR: &str = "span efficiencies of Katz & Plotkin, Low-Speed Aerodynamics (rectangular wing)";

/// Step on the fine lattices, chords.
const STEP: f64 = 0.25;

/// Drag over CL²/(π AR) after a path of so many chords.
pub fn drag_over_ideal(wing: Wing, path: f64) -> f64 {
    let Some(load) = wing.loads(0.1, path).last().copied() else { return f64::NAN };
    let (lift, drag) = (load.force.z / (0.5 * wing.area()), -load.force.x / (0.5 * wing.area()));
    drag / (lift * lift / (PI * wing.aspect))
}

fn elliptic(aspect: f64, strips: usize, scheme: Scheme) -> Wing {
    let wing = Wing::rectangular(aspect, strips, scheme);
    Wing { shape: Shape::Elliptic, cosine: 1.0, in_plane: 1.0, ..wing }
}

/// The checks.
pub fn group() -> Group {
    let (fine, production) = (Scheme::fine(1e-3, STEP, 8), Scheme::production());
    let cores = production.with_step(STEP).with_panels(8);
    let rectangle = |scheme| Wing { cosine: 0.5, in_plane: 1.0, ..Wing::rectangular(4.0, 16, scheme) };
    let within = |share| Expected::Within { value: 1.0, share };
    let family = Expected::Between { low: 0.95, high: 1.08 };
    let work = [
        ("elliptic wing, aspect ratio 8", Setup::Fine, within(0.02), elliptic(8.0, 24, fine)),
        ("elliptic wing, aspect ratio 8", Setup::Production, within(0.02), elliptic(8.0, 24, cores)),
        (
            "elliptic wing, aspect ratio 8",
            Setup::Flown,
            within(0.02),
            elliptic(8.0, 1, production).with_default_strips(),
        ),
        ("rectangular wing, aspect ratio 4", Setup::Fine, family, rectangle(fine)),
        ("rectangular wing, aspect ratio 4", Setup::Production, family, rectangle(cores)),
        ("rectangular wing, aspect ratio 4", Setup::Flown, family, rectangle(production).with_default_strips()),
    ];
    let rows = work.into_par_iter().map(|(name, setup, expected, wing)| Row {
        what: name.to_owned(),
        source: if wing.shape == Shape::Elliptic { LIFTING_LINE } else { RECTANGULAR },
        setup,
        expected,
        got: drag_over_ideal(wing, 20.0),
    });
    Group {
        title: "Induced drag",
        about:
            "Drag over CL²/(π AR) with all of the leading-edge suction kept in the wing's plane, 20 chords after the \
                start. 8 x 24 panels (rectangular: 8 x 16) and steps of 0.25 chords."
                .to_owned(),
        rows: rows.collect(),
    }
}
