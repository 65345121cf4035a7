//! The published strokes at the default settings, beside what was published.

use std::io;

use manduca_numerics::cases::{CASES, Case};
use manduca_numerics::insect::Insect;
use manduca_numerics::simulation::{Estimate, Means, Moment};
use manduca_numerics::uvlm::Settings;
use rayon::prelude::*;

use crate::flights::Flight;
use crate::markdown::{Table, fixed, percent, signed};
use crate::plot::{Figure, Mark, Panel, Series};

/// A published stroke, flown.
#[derive(Debug, Clone, PartialEq)]
pub struct Flown {
    /// The stroke and what was published about it.
    pub case: &'static Case,
    /// Our means.
    pub means: Means,
    /// Every step of the last stroke.
    pub history: Vec<Moment>,
}

/// Flies the published strokes.
///
/// # Errors
/// When one of them cannot be flown.
pub fn fly(settings: Settings) -> io::Result<Vec<Flown>> {
    let fly = |case: &'static Case| {
        let (means, history) = Flight { settings, ..Flight::of_case(case) }
            .fly_with_history()
            .map_err(|reason| io::Error::other(format!("{}: {reason}", case.name)))?;
        Ok(Flown { case, means, history })
    };
    CASES.par_iter().map(fly).collect()
}

/// A mean with its standard error.
fn estimate(e: &Estimate, scale: f64, decimals: usize) -> String {
    format!("{} ± {}", fixed(scale * e.mean, decimals), fixed(scale * e.se, decimals))
}

fn power_per_lift_error(flown: &Flown) -> f64 {
    flown.means.power_per_lift() / flown.case.paper_power_per_lift - 1.0
}

/// Lift of a stroke over the published lift, less one.
pub fn lift_error(flown: &Flown) -> f64 {
    flown.means.scaled[0].mean / flown.case.paper_lift - 1.0
}

/// Means beside the published ones.
pub fn means(flown: &[Flown]) -> Table {
    let header = ["case", "L+", "paper", "off by", "D+", "M+", "P, mW", "paper", "P/L, W/N", "paper", "off by"];
    let mut table = Table::new(header);
    for f in flown {
        let [lift, drag, moment, _] = &f.means.scaled;
        table.row([
            f.case.name.to_owned(),
            estimate(lift, 1.0, 3),
            fixed(f.case.paper_lift, 3),
            percent(lift_error(f), 0),
            estimate(drag, 1.0, 3),
            estimate(moment, 1.0, 3),
            estimate(&f.means.outputs[3], 1e3, 1),
            f.case.paper_power_mw.map_or("-".to_owned(), |p| fixed(p, 1)),
            fixed(f.means.power_per_lift(), 2),
            fixed(f.case.paper_power_per_lift, 2),
            percent(power_per_lift_error(f), 0),
        ]);
    }
    table
}

/// Power by joints, mW.
pub fn joints(flown: &[Flown]) -> Table {
    let mut header = vec!["case".to_owned()];
    for joint in ["sweep", "elevation", "rotation", "sum"] {
        header.extend(["air", "inertia", "required"].map(|part| format!("{joint}: {part}")));
    }
    let mut table = Table::new(header);
    for f in flown {
        let parts = f.means.joints.map(|j| [j.aerodynamic_w, j.inertial_w, j.required_w]);
        let sum: [f64; 3] = std::array::from_fn(|i| parts.iter().map(|p| p[i]).sum());
        let mut cells = vec![f.case.name.to_owned()];
        cells.extend(parts.iter().chain([&sum]).flatten().map(|watts| fixed(1e3 * watts, 1)));
        table.row(cells);
    }
    table
}

fn curve(flown: &Flown, value: impl Fn(&Moment) -> f64) -> Series {
    Series::new(flown.case.name, Mark::Line, flown.history.iter().map(|m| (m.phase, value(m))))
}

fn panel(flown: &[Flown], y: &str, value: impl Fn(&Moment) -> f64) -> Panel {
    let series = flown.iter().map(|f| curve(f, &value)).collect();
    Panel { x: "time t f, strokes".into(), y: y.into(), series }
}

/// Lift, drag and power over the last stroke.
pub fn forces(flown: &[Flown]) -> Figure {
    let weight = Insect::default().weight_n();
    let power = |m: &Moment| 1e3 * m.snapshot.joints.iter().map(|j| j.required_w).sum::<f64>();
    let air = |m: &Moment| 1e3 * m.snapshot.joints.iter().map(|j| j.aerodynamic_w).sum::<f64>();
    let panels = vec![
        panel(flown, "lift L/W", |m| m.snapshot.lift_n / weight),
        panel(flown, "drag D/W", |m| m.snapshot.drag_n / weight),
        panel(flown, "required power, mW", power),
        panel(flown, "aerodynamic power, mW", air),
    ];
    Figure { panels, columns: 2 }
}

/// Sweep, elevation and rotation over a stroke.
pub fn angles(flown: &[Flown]) -> Figure {
    let angle = |i: usize| move |m: &Moment| m.snapshot.angles[i].value.to_degrees();
    let panels = vec![
        panel(flown, "sweep φ, °", angle(0)),
        panel(flown, "elevation θ, °", angle(1)),
        panel(flown, "rotation α, °", angle(2)),
    ];
    Figure { panels, columns: 3 }
}

/// What the table says, in words.
pub fn words(flown: &[Flown]) -> String {
    let range = |f: &dyn Fn(&Flown) -> f64| {
        flown.iter().map(f).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)))
    };
    let (low, high) = range(&|f| 100.0 * lift_error(f));
    let (least, most) = range(&|f| 100.0 * power_per_lift_error(f));
    let error = range(&|f| f.means.scaled[0].se).1;
    let worst = |i: usize| {
        let trimmed = flown.iter().filter(|f| f.case.name != "reference");
        trimmed.map(|f| f.means.scaled[i].mean.abs()).fold(0.0, f64::max)
    };
    format!(
        "Our lift differs from the paper's by {} to {} %, power per lift by {} to {} %. The standard error of L+ is at \
         most {}. The optima trim in the paper (D = M = 0); here |D+| is at most {} and |M+| at most {}.",
        signed(low, 0),
        signed(high, 0),
        signed(least, 0),
        signed(most, 0),
        fixed(error, 4),
        fixed(worst(1), 3),
        fixed(worst(2), 3),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_and_figures_show_every_stroke() {
        let coarse = Settings {
            chordwise_panels: 4,
            spanwise_panels: 6,
            steps_per_stroke: 24,
            strokes: 4,
            strokes_most: 4,
            strokes_dropped: 2,
            ..Settings::default()
        };
        let flown = fly(coarse).unwrap();
        for table in [means(&flown).to_string(), joints(&flown).to_string()] {
            assert_eq!(table.lines().count(), 2 + CASES.len());
            assert!(CASES.iter().all(|case| table.contains(case.name)), "{table}");
            assert!(!table.contains("NaN"), "{table}");
        }
        // Inertia only carries power from joint to joint.
        let sums = flown.iter().map(|f| f.means.joints.iter().map(|j| j.inertial_w).sum::<f64>());
        assert!(sums.map(f64::abs).fold(0.0, f64::max) < 1e-6);
        for figure in [forces(&flown), angles(&flown)] {
            let svg = figure.svg().unwrap();
            assert!(CASES.iter().all(|case| svg.contains(case.name)));
        }
        let least = flown.iter().map(lift_error).fold(f64::INFINITY, f64::min);
        assert!(words(&flown).contains(&format!("by {} to", signed(100.0 * least, 0))), "{}", words(&flown));
    }
}
