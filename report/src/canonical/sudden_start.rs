//! Lift of finite wings after a sudden start.

use manduca_numerics::math::exp;
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

/// On which lattice a start is flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum On {
    /// The published one, with one small core.
    Published,
    /// The published one, with the default cores.
    PublishedWithCores,
    /// The default one, with the default step and cores.
    Default,
}

impl On {
    const ALL: [Self; 3] = [Self::Published, Self::PublishedWithCores, Self::Default];

    fn setup(self) -> Setup {
        match self {
            Self::Published => Setup::Fine,
            Self::PublishedWithCores => Setup::Production,
            Self::Default => Setup::Flown,
        }
    }

    /// Its name and line in the figure.
    fn curve(self) -> (&'static str, Mark) {
        match self {
            Self::Published => (Setup::Fine.name(), Mark::Line),
            Self::PublishedWithCores => (Setup::Production.name(), Mark::Dashed),
            Self::Default => (Setup::Flown.name(), Mark::Dashed),
        }
    }

    /// The published lattice has its first wake row a quarter panel behind the edge, which is
    /// one step: where the rule puts a line as far as 1/π of a panel.
    fn wing(self, aspect: f64) -> Wing {
        let published = |mut scheme: Scheme| {
            scheme.settings.first_row = 4.0 / std::f64::consts::PI;
            Wing::rectangular(aspect, STRIPS, scheme.with_panels(PANELS))
        };
        match self {
            Self::Published => published(Scheme::fine(1e-3, STEP, PANELS)),
            Self::PublishedWithCores => published(Scheme::production().with_step(STEP)),
            Self::Default => Wing::rectangular(aspect, 1, Scheme::production()).with_default_strips(),
        }
    }
}

/// Panels, strips of one half and step (chords) of the published lattice.
const PANELS: usize = 4;
const STRIPS: usize = 13;
const STEP: f64 = 1.0 / 16.0;

/// A wing's start at 5°.
struct Start {
    on: On,
    aspect: f64,
    published: [f64; 5],
    /// Lift coefficient against chords travelled.
    lift: Vec<(f64, f64)>,
}

/// Both wings on each lattice.
fn starts() -> Vec<Start> {
    let work: Vec<_> = On::ALL.into_iter().flat_map(|on| PUBLISHED.map(|wing| (on, wing))).collect();
    work.into_par_iter()
        .map(|(on, (aspect, published))| {
            let lift = on.wing(aspect).lift(5.0_f64.to_radians(), 8.125);
            Start { on, aspect, published, lift }
        })
        .collect()
}

/// Share of the steady lift half a chord after the start, by Jones's lift a - b exp(-c s) after s semichords.
fn jones(a: f64, b: f64, c: f64) -> f64 {
    1.0 - b / a * exp(-c)
}

/// The checks.
pub fn group() -> Group {
    let starts = starts();
    let begun = |on: On, aspect: f64| {
        let lift = starts.iter().find(|start| start.on == on && start.aspect == aspect).map(|start| &start.lift);
        lift.map_or_else(String::new, |lift| format!("{:.2}", interpolated(lift, 0.5) / interpolated(lift, 8.0)))
    };
    let rows = starts.iter().flat_map(|start| {
        TIMES.into_iter().zip(start.published).map(move |(time, value)| Row {
            what: format!("aspect ratio {}, U t/c = {time}", start.aspect),
            source: SOURCE,
            setup: start.on.setup(),
            // The published lattice's wake also leaves from a quarter panel behind the edge; this one's
            // from the middle of each step, so that the first chord is met less closely.
            expected: Expected::Within { value, share: if time <= 1.0 { 0.055 } else { 0.03 } },
            got: interpolated(&start.lift, time),
        })
    });
    Group {
        title: TITLE,
        about: format!(
            "Lift coefficient at 5°, published for a lattice of {PANELS} x {STRIPS} panels per half, steps of 1/16 chord \
             and a first wake row a quarter panel behind the edge: on that lattice with small and with default cores; as \
             flown, on the default lattice with its own step and first row. Such coarse lattices start with too much lift: half a \
             chord after the start it is {} of that after 8 chords at aspect ratio 4, {} at 8, as flown {} and \
             {}. R. T. Jones's theory of elliptic wings (NACA TR 681) has {:.2} of the steady lift at aspect ratio 3 and {:.2} \
             at 6.",
            begun(On::Published, 4.0),
            begun(On::Published, 8.0),
            begun(On::Default, 4.0),
            begun(On::Default, 8.0),
            jones(0.600, 0.170, 0.540),
            jones(0.740, 0.267, 0.381),
        ),
        rows: rows.collect(),
    }
}

/// Lift coefficient against chords travelled.
pub fn figure() -> Figure {
    let starts = starts();
    let panel = |aspect: f64| {
        let mut series = Vec::new();
        for start in starts.iter().filter(|start| start.aspect == aspect) {
            let (name, mark) = start.on.curve();
            // The first step holds the start's impulse.
            let lift = start.lift.iter().copied().filter(|p| p.0 >= 0.3);
            series.push(Series::new(name, mark, lift));
            if start.on == On::Published {
                series.insert(0, Series::new("published", Mark::Points, TIMES.into_iter().zip(start.published)));
            }
        }
        Panel { x: format!("U t/c, aspect ratio {aspect}"), y: "lift coefficient".into(), series }
    };
    Figure { panels: PUBLISHED.iter().map(|p| panel(p.0)).collect(), columns: 2 }
}
