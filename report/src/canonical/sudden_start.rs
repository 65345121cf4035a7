//! Lift of finite wings after a sudden start.

use rayon::prelude::*;

use super::scheme::Scheme;
use super::wing::{Wing, interpolated};
use crate::check::{Expected, Group, Row, Setup};
use crate::plot::{Figure, Mark, Panel, Series};

/// Title of the checks.
pub const TITLE: &str = "Sudden start of finite wings";
const SOURCE: &str = "Katz & Plotkin, Low-Speed Aerodynamics, fig. 13.34";
const TIMES: [f64; 5] = [0.5, 1.0, 2.0, 4.0, 8.0];
/// Aspect ratio, and lift coefficient at `TIMES`.
const PUBLISHED: [(f64, [f64; 5]); 2] =
    [(4.0, [0.297, 0.298, 0.306, 0.314, 0.317]), (8.0, [0.346, 0.353, 0.370, 0.388, 0.398])];

/// The published lattice has its first wake row a quarter panel behind the edge, which is
/// one step: where the rule puts a line as far as 1/π of a panel.
fn wing(setup: Setup, aspect: f64) -> Wing {
    match setup {
        Setup::Fine => {
            let mut scheme = Scheme::fine(1e-3, 1.0 / 16.0, 4);
            scheme.settings.first_row = 4.0 / std::f64::consts::PI;
            Wing::rectangular(aspect, 13, scheme)
        }
        Setup::Production => Wing::rectangular(aspect, 1, Scheme::production()).with_default_strips(),
    }
}

/// A wing's start at 5°.
struct Start {
    setup: Setup,
    aspect: f64,
    published: [f64; 5],
    /// Lift coefficient against chords travelled.
    lift: Vec<(f64, f64)>,
}

/// Both wings at both settings.
fn starts() -> Vec<Start> {
    let work: Vec<_> = Setup::BOTH.into_iter().flat_map(|setup| PUBLISHED.map(|wing| (setup, wing))).collect();
    work.into_par_iter()
        .map(|(setup, (aspect, published))| {
            let lift = wing(setup, aspect).lift(5.0_f64.to_radians(), 8.125);
            Start { setup, aspect, published, lift }
        })
        .collect()
}

/// The checks.
pub fn group() -> Group {
    let starts = starts();
    let rows = starts.iter().flat_map(|start| {
        TIMES.into_iter().zip(start.published).map(move |(time, value)| Row {
            what: format!("aspect ratio {}, U t/c = {time}", start.aspect),
            source: SOURCE,
            setup: start.setup,
            // The published lattice's wake also leaves from a quarter panel behind the edge; this one's
            // from the middle of each step, so that the first chord is met less closely.
            expected: Expected::Within { value, share: if time <= 1.0 { 0.055 } else { 0.03 } },
            got: interpolated(&start.lift, time),
        })
    });
    Group {
        title: TITLE,
        about:
            "Lift coefficient at 5°. Fine: the published lattice of 4 x 13 panels per half, steps of 1/16 chord and \
                first wake row. Default: the default lattice, step, first row and cores."
                .to_owned(),
        rows: rows.collect(),
    }
}

/// Lift coefficient against chords travelled.
pub fn figure() -> Figure {
    let starts = starts();
    let panel = |aspect: f64| {
        let mut series = Vec::new();
        for start in starts.iter().filter(|start| start.aspect == aspect) {
            let mark = if start.setup == Setup::Fine { Mark::Line } else { Mark::Dashed };
            // The first step holds the start's impulse.
            let lift = start.lift.iter().copied().filter(|p| p.0 >= 0.3);
            series.push(Series::new(start.setup.name(), mark, lift));
            if start.setup == Setup::Fine {
                series.insert(0, Series::new("published", Mark::Points, TIMES.into_iter().zip(start.published)));
            }
        }
        Panel { x: format!("U t/c, aspect ratio {aspect}"), y: "lift coefficient".into(), series }
    };
    Figure { panels: PUBLISHED.iter().map(|p| panel(p.0)).collect(), columns: 2 }
}
