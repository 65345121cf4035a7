//! Strokes whose wings beat over the wake they have just shed.

use std::io;

use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::{Clearance, ElevationPhase};
use manduca_numerics::parameters::{Bounds, Point, at};
use manduca_numerics::sampling::sample;
use manduca_numerics::simulation::Means;
use manduca_numerics::uvlm::Settings;

use super::sample::{Flown, SEED, Sample, difference};
use crate::markdown::{Document, Table, fixed};

/// Elevation amplitudes next to a stroke's own, degrees from it.
const BESIDE: [f64; 3] = [-1.0, 0.0, 1.0];

/// What is changed.
const TRIALS: [(&str, &[(&str, f64)]); 7] = [
    ("default", &[]),
    ("core over the wing left out", &[("core_over_wing", 0.0)]),
    ("halved", &[("core_over_wing", 0.05)]),
    ("doubled", &[("core_over_wing", 0.2)]),
    ("left out, fresh wake 0.03 c", &[("core_over_wing", 0.0), ("fresh_core_on_wing", 0.03)]),
    ("102 steps", &[("steps_per_stroke", 102.0)]),
    ("left out, 102 steps", &[("core_over_wing", 0.0), ("steps_per_stroke", 102.0)]),
];

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

/// By how much means turn: root mean square of their second differences over the three neighbours.
fn turn(flown: &Flown) -> [f64; 4] {
    let known: Vec<_> = flown
        .chunks_exact(BESIDE.len())
        .filter_map(|three| Some([three[0].as_ref()?, three[1].as_ref()?, three[2].as_ref()?]))
        .collect();
    std::array::from_fn(|k| {
        let square = |[a, b, c]: &[&Means; 3]| (a.scaled[k].mean - 2.0 * b.scaled[k].mean + c.scaled[k].mean).powi(2);
        (known.iter().map(square).sum::<f64>() / known.len().max(1) as f64).sqrt()
    })
}

/// Writes what the core over the wing does to `count` strokes which ask for it.
///
/// # Errors
/// When too few such strokes are feasible.
pub fn write(document: &mut Document, count: u64, settings: Settings) -> io::Result<()> {
    let sample = strokes(count)?;
    let flown: Vec<Flown> =
        TRIALS.iter().map(|(_, changes)| sample.fly(super::trials::changed(settings, changes))).collect();
    document.heading("Wings over the wake they have just shed");
    document.paragraph(&format!(
        "{count} random strokes with elevation amplitudes of 25 to 29° and sweep amplitudes below 40° (seed {}), each with \
         two neighbours a degree of elevation amplitude to either side: change of the means from the default, and how \
         sharply they turn from neighbour to neighbour (second difference), in hundredths, root mean squares.",
        SEED + 3
    ));
    let mut table =
        Table::new(["settings", "strokes", "L+", "D+", "M+", "P+", "turn of L+", "of D+", "of M+", "of P+"]);
    for ((what, _), means) in TRIALS.iter().zip(&flown) {
        let d = difference(&flown[0], means);
        let mut cells = vec![(*what).to_owned(), d.strokes.to_string()];
        cells.extend(d.rms.iter().chain(&turn(means)).map(|x| fixed(100.0 * x, 2)));
        table.row(cells);
    }
    document.table(&table);
    document.paragraph("L+ of each stroke between its neighbours:");
    let shown = [0, 1, 5, 6];
    let mut table = Table::new(["stroke", "φa", "θa"].into_iter().chain(shown.map(|i| TRIALS[i].0)));
    for (i, (name, x)) in sample.strokes.iter().enumerate().skip(1).step_by(BESIDE.len()) {
        let mut cells = vec![name.clone()];
        cells.extend([x[at::SWEEP_AMPLITUDE], x[at::ELEVATION_AMPLITUDE]].map(|x| fixed(x, 1)));
        let lift = |means: &Flown, i: usize| means[i].as_ref().map_or("-".into(), |m| fixed(m.scaled[0].mean, 3));
        cells.extend(shown.map(|s| [i - 1, i, i + 1].map(|i| lift(&flown[s], i)).join(" ")));
        table.row(cells);
    }
    document.table(&table);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strokes_are_flown_between_their_neighbours() {
        let coarse = Settings {
            chordwise_panels: 2,
            spanwise_panels: 4,
            steps_per_stroke: 12,
            strokes: 2,
            strokes_most: 2,
            strokes_dropped: 1,
            ..Settings::default()
        };
        let sample = strokes(2).unwrap();
        assert_eq!(sample.strokes.len(), 2 * BESIDE.len());
        let [a, b] = [0, 1].map(|i| sample.strokes[i].1);
        assert!((b[at::ELEVATION_AMPLITUDE] - a[at::ELEVATION_AMPLITUDE] - 1.0).abs() < 1e-12);
        assert!(a[at::SWEEP_AMPLITUDE] < 40.0 && (24.0..=28.0).contains(&a[at::ELEVATION_AMPLITUDE]));
        let mut document = Document::new("x");
        write(&mut document, 2, coarse).unwrap();
        assert!(document.text().contains("| default | 6 | 0.00 | 0.00 | 0.00 | 0.00 |"), "{}", document.text());
        // A stroke thrice does not turn; two with a leap between them do.
        let mut flown = sample.fly(coarse);
        flown.truncate(3);
        (flown[1], flown[2]) = (flown[0].clone(), flown[0].clone());
        assert_eq!(turn(&flown), [0.0; 4]);
        flown[2].as_mut().unwrap().scaled[1].mean += 0.1;
        assert!((turn(&flown)[1] - 0.1).abs() < 1e-12);
    }
}
