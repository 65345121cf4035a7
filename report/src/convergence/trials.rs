//! One setting changed at a time, and all of the mesh at once.

use manduca_numerics::table::Table as _;
use manduca_numerics::uvlm::Settings;

use super::sample::{Difference, Flown, Sample, difference, quantile};
use crate::markdown::{Document, Table, fixed, signed, significant};

/// A change of settings and what it tries.
pub(super) struct Trial {
    pub(super) what: &'static str,
    pub(super) changes: &'static [(&'static str, f64)],
}

pub(super) const fn trial(what: &'static str, changes: &'static [(&'static str, f64)]) -> Trial {
    Trial { what, changes }
}

/// The wake as modelled: how long, how it ends, how it is thinned and rounded.
const WAKE: [Trial; 12] = [
    trial("no rows joined", &[("wake_joined_after", 20.0)]),
    trial("rows joined after 0.25 strokes", &[("wake_joined_after", 0.25)]),
    trial("rows joined after 0.5 strokes", &[("wake_joined_after", 0.5)]),
    trial("**wake remembered twice as long**", &[("wake_strokes", 4.0)]),
    trial("wake remembered for 1 stroke", &[("wake_strokes", 1.0)]),
    trial("sinks of 1 c", &[("wake_tail", 1.0)]),
    trial("sinks of 3 c", &[("wake_tail", 3.0)]),
    trial("no sinks", &[("wake_tail", 0.0)]),
    trial("no sinks, wake of 4 strokes", &[("wake_tail", 0.0), ("wake_strokes", 4.0)]),
    trial("no sinks, no spreading", &[("wake_tail", 0.0), ("wake_spreading", 0.0)]),
    trial("no spreading", &[("wake_spreading", 0.0)]),
    trial("no spreading, wake on wake 0.7 c", &[("wake_spreading", 0.0), ("wake_core_on_wake", 0.7)]),
];

/// Cores, each halved.
const CORES: [Trial; 10] = [
    trial("wake on wake, fresh, halved", &[("wake_core_on_wake", 0.0625)]),
    trial("wake on wing, developed, halved", &[("wake_core_on_wing", 0.15)]),
    trial("wake on wing, fresh, halved", &[("fresh_core_on_wing", 0.005)]),
    trial("wake over the wing, halved", &[("core_over_wing", 0.05)]),
    trial("spreading halved", &[("wake_spreading", 0.6)]),
    trial("bound, halved", &[("bound_core", 0.0005)]),
    trial("bound on wake, halved", &[("bound_core_on_wake", 0.05)]),
    trial("growth time halved", &[("core_growth_time", 0.25)]),
    trial(
        "**all cores halved, the spreading kept**",
        &[
            ("wake_core_on_wake", 0.0625),
            ("wake_core_on_wing", 0.15),
            ("fresh_core_on_wing", 0.005),
            ("core_over_wing", 0.05),
            ("bound_core", 0.0005),
            ("bound_core_on_wake", 0.05),
        ],
    ),
    trial(
        "**all cores and the spreading halved**",
        &[
            ("wake_core_on_wake", 0.0625),
            ("wake_core_on_wing", 0.15),
            ("fresh_core_on_wing", 0.005),
            ("core_over_wing", 0.05),
            ("wake_spreading", 0.6),
            ("bound_core", 0.0005),
            ("bound_core_on_wake", 0.05),
        ],
    ),
];

/// The lattice.
const LATTICE: [Trial; 8] = [
    trial("first row at 0.4", &[("first_row", 0.4)]),
    trial("ends not drawn in", &[("edge_inset", 0.0)]),
    trial("uniform strips, ends drawn in by 0.25", &[("spanwise_cosine", 0.0), ("edge_inset", 0.25)]),
    trial("panels along the chord x 2", &[("chordwise_panels", 12.0)]),
    trial("strips x 2", &[("spanwise_panels", 34.0)]),
    trial("48 steps", &[("steps_per_stroke", 48.0)]),
    trial("102 steps", &[("steps_per_stroke", 102.0)]),
    trial("4 panels", &[("chordwise_panels", 4.0)]),
];

/// The settings with some of them changed.
pub(super) fn changed(settings: Settings, changes: &[(&str, f64)]) -> Settings {
    let mut changed = settings;
    for (name, value) in changes {
        let told = changed.set(name, *value);
        debug_assert!(told.is_ok(), "{name}: {told:?}");
    }
    changed
}

/// An empty table of differences.
pub(super) fn header(first: &str) -> Table {
    Table::new([
        first,
        "strokes",
        "L+",
        "D+",
        "M+",
        "P+",
        "mean L+",
        "mean P+",
        "relative L+",
        "relative P+",
        "median se of L+",
    ])
}

/// Adds a difference to it.
pub(super) fn row(table: &mut Table, what: &str, d: &Difference, flown: &Flown) {
    let percent = |x: f64| fixed(100.0 * x, 2);
    let se = quantile(flown.iter().flatten().map(|m| m.scaled[0].se), 0.5);
    let mut cells = vec![what.to_owned(), d.strokes.to_string()];
    cells.extend(d.rms.map(percent));
    cells.extend([d.mean[0], d.mean[3]].map(|x| signed(100.0 * x, 2)));
    cells.extend([d.relative[0], d.relative[3], se].map(percent));
    table.row(cells);
}

fn tabulate(document: &mut Document, trials: &[Trial], sample: &Sample, reference: &Flown, settings: Settings) {
    let mut table = header("change");
    for trial in trials {
        let flown = sample.fly(changed(settings, trial.changes));
        row(&mut table, trial.what, &difference(reference, &flown), &flown);
    }
    document.table(&table);
}

/// Median and largest of the changes of any mean over its standard error.
fn against_errors(a: &Flown, b: &Flown) -> [f64; 2] {
    let pairs = a.iter().zip(b).filter_map(|(a, b)| Some((a.as_ref()?, b.as_ref()?)));
    let shares: Vec<f64> =
        pairs.flat_map(|(a, b)| (0..4).map(|k| (b.scaled[k].mean - a.scaled[k].mean).abs() / a.scaled[k].se)).collect();
    [quantile(shares.iter().copied(), 0.5), quantile(shares, 1.0)]
}

/// Writes what changes of the wake do.
pub fn write_wake(document: &mut Document, sample: &Sample, reference: &Flown, settings: Settings) {
    document.heading("The wake");
    let mut table = header("settings");
    row(&mut table, "default", &difference(reference, reference), reference);
    document.table(&table);
    let double = sample.fly(Settings { single_precision_wake: 0, ..settings });
    let [median, most] = against_errors(reference, &double);
    document.paragraph(&format!(
        "Moving the wake's nodes in double precision changes the means by {} of their standard errors in the median and by \
         {} at most.",
        significant(median, 2),
        significant(most, 2)
    ));
    tabulate(document, &WAKE, sample, reference, settings);
}

/// Writes what smaller cores do.
pub fn write_cores(document: &mut Document, sample: &Sample, reference: &Flown, settings: Settings) {
    document.heading("Cores");
    tabulate(document, &CORES, sample, reference, settings);
}

/// Writes what other lattices do.
pub fn write_lattice(document: &mut Document, sample: &Sample, reference: &Flown, settings: Settings) {
    document.heading("Lattice, one direction at a time");
    tabulate(document, &LATTICE, sample, reference, settings);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_trial_changes_known_settings_within_their_ranges() {
        for trial in WAKE.iter().chain(&CORES).chain(&LATTICE) {
            let mut settings = Settings::default();
            for (name, value) in trial.changes {
                assert_ne!(settings.get(name), Some(*value), "{}: {name} is the default", trial.what);
                settings.set(name, *value).unwrap();
            }
            assert!(settings.check().is_ok(), "{}", trial.what);
            assert_eq!(changed(Settings::default(), trial.changes), settings);
        }
    }
}
