//! Strokes whose wings beat over the wake they have just shed.

use std::io;

use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::{Clearance, ElevationPhase};
use manduca_numerics::parameters::{Bounds, Point, at};
use manduca_numerics::sampling::sample;
use manduca_numerics::uvlm::Settings;

use super::sample::{Flown, SEED, Sample, difference};
use super::trials::{Trial, changed, header, row, trial};
use crate::markdown::{Document, Table, fixed};

/// Elevation amplitudes next to a stroke's own, degrees from it.
const BESIDE: [f64; 3] = [-1.0, 0.0, 1.0];

/// What is flown, and the trial from which its change counts; the first is the default.
const TRIALS: [(usize, Trial); 7] = [
    (0, trial("default", &[])),
    (0, trial("core over the wing halved", &[("core_over_wing", 0.05)])),
    (0, trial("doubled", &[("core_over_wing", 0.2)])),
    (0, trial("left out", &[("core_over_wing", 0.0)])),
    (0, trial("left out, fresh wake 0.03 c", &[("core_over_wing", 0.0), ("fresh_core_on_wing", 0.03)])),
    (0, trial("102 steps", &[("steps_per_stroke", 102.0)])),
    (3, trial("102 steps, both without it", &[("core_over_wing", 0.0), ("steps_per_stroke", 102.0)])),
];
/// Trials whose lift is shown stroke by stroke.
const SHOWN: [(usize, &str); 4] = [(0, "default"), (5, "102 steps"), (3, "left out"), (6, "left out, 102 steps")];

/// Strokes of large elevation amplitude and short sweep, each between its neighbours.
fn strokes(count: u64) -> io::Result<Sample> {
    let mut bounds = Bounds::default();
    bounds.upper[at::SWEEP_AMPLITUDE] = 40.0;
    (bounds.lower[at::ELEVATION_AMPLITUDE], bounds.upper[at::ELEVATION_AMPLITUDE]) = (25.0, 29.0);
    let beside = |x: &Point, by: f64| {
        let mut x = *x;
        x[at::ELEVATION_AMPLITUDE] += by;
        x
    };
    let clearance = Clearance::new(&Insect::default(), ElevationPhase::default());
    let mut strokes = Vec::new();
    for index in 0..count {
        let x = sample(&bounds, SEED + 3, index, &|x| BESIDE.iter().all(|by| clearance.of(&beside(x, *by)) >= 0.0))
            .ok_or_else(|| io::Error::other("too few strokes of large elevation amplitude are feasible"))?;
        strokes.extend(BESIDE.map(|by| (format!("{index}"), beside(&x, by))));
    }
    Ok(Sample { strokes })
}

/// Writes what the core over the wing does to `count` strokes which ask for it.
///
/// # Errors
/// When too few such strokes are feasible.
pub fn write(document: &mut Document, count: u64, settings: Settings) -> io::Result<()> {
    let sample = strokes(count)?;
    let flown: Vec<Flown> = TRIALS.iter().map(|(_, trial)| sample.fly(changed(settings, trial.changes))).collect();
    document.heading("Wings over the wake they have just shed");
    document.paragraph(&format!(
        "{count} random strokes with elevation amplitudes of 25 to 29° and sweep amplitudes below 40° (seed {}), each with \
         two neighbours a degree of elevation amplitude to either side.",
        SEED + 3
    ));
    let mut table = header("change");
    for ((from, trial), means) in TRIALS.iter().zip(&flown) {
        row(&mut table, trial.what, &difference(&flown[*from], means), means);
    }
    document.table(&table);
    document.paragraph("L+ of each stroke between its neighbours, and the largest of their standard errors:");
    let names = SHOWN.iter().flat_map(|(_, what)| [*what, "se"]);
    let mut table = Table::new(["stroke", "φa", "θa"].into_iter().chain(names));
    for (i, (name, x)) in sample.strokes.iter().enumerate().skip(1).step_by(BESIDE.len()) {
        let mut cells = vec![name.clone()];
        cells.extend([x[at::SWEEP_AMPLITUDE], x[at::ELEVATION_AMPLITUDE]].map(|x| fixed(x, 1)));
        for (shown, _) in SHOWN {
            let lifts = [i - 1, i, i + 1].map(|i| flown[shown][i].as_ref().map(|m| m.scaled[0]));
            cells.push(lifts.map(|l| l.map_or("-".into(), |l| fixed(l.mean, 3))).join(" "));
            cells.push(fixed(lifts.iter().flatten().map(|l| l.se).fold(0.0, f64::max), 3));
        }
        table.row(cells);
    }
    document.table(&table);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::sample::coarse;
    use super::*;

    #[test]
    fn strokes_are_flown_between_their_neighbours() {
        let sample = strokes(2).unwrap();
        assert_eq!(sample.strokes.len(), 2 * BESIDE.len());
        let [a, b] = [0, 1].map(|i| sample.strokes[i].1);
        assert!((b[at::ELEVATION_AMPLITUDE] - a[at::ELEVATION_AMPLITUDE] - 1.0).abs() < 1e-12);
        assert!(a[at::SWEEP_AMPLITUDE] < 40.0 && (24.0..=28.0).contains(&a[at::ELEVATION_AMPLITUDE]));
        let mut document = Document::new("x");
        write(&mut document, 2, coarse()).unwrap();
        assert!(document.text().contains("| default | 6 | 0.00 | 0.00 | 0.00 | 0.00 |"), "{}", document.text());
        assert_eq!(document.text().matches("| 102 steps").count(), 3, "{}", document.text());
    }
}
