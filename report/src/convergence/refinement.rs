//! Twice the panels both ways with one and a half times the steps.

use manduca_numerics::uvlm::Settings;

use super::sample::{Sample, difference};
use super::trials::{header, row};
use crate::markdown::{Document, Table, fixed, signed, significant};

/// Panels along the chord, strips and steps whose refinement is compared at short wakes.
const MESHES: [[usize; 3]; 8] =
    [[8, 10, 64], [8, 12, 48], [8, 14, 48], [8, 16, 48], [6, 16, 48], [7, 16, 48], [7, 16, 40], [10, 14, 48]];

fn refined(settings: Settings) -> Settings {
    Settings {
        chordwise_panels: 2 * settings.chordwise_panels,
        spanwise_panels: 2 * settings.spanwise_panels,
        steps_per_stroke: settings.steps_per_stroke * 3 / 2,
        ..settings
    }
}

/// Writes which panels, strips and steps are worth their work.
pub fn write_meshes(document: &mut Document, sample: &Sample, settings: Settings) {
    let short = Settings { wake_strokes: 0.5, strokes: 4, strokes_most: 4, strokes_dropped: 2, ..settings };
    let work = |s: Settings| s.interactions(s.strokes);
    document.heading("Panels, strips and steps");
    document.paragraph(
        "Each mesh against twice its panels both ways and one and a half times its steps. Two strokes after two with a wake \
         of half a stroke, which shows the same errors in a twentieth of the time; work is that of the coarser mesh \
         with the whole wake, the default's being 1.",
    );
    let mut table = header("panels x strips x steps (work)");
    for [chordwise_panels, spanwise_panels, steps_per_stroke] in MESHES {
        let mesh = |s: Settings| Settings { chordwise_panels, spanwise_panels, steps_per_stroke, ..s };
        let (reference, flown) = (sample.fly(mesh(short)), sample.fly(refined(mesh(short))));
        let share = work(mesh(settings)) / work(settings);
        let what = format!("{chordwise_panels} x {spanwise_panels} x {steps_per_stroke} ({})", significant(share, 2));
        row(&mut table, &what, &difference(&reference, &flown), &flown);
    }
    document.table(&table);
}

/// Writes what twice the panels both ways with one and a half times the steps do.
pub fn write_refinement(document: &mut Document, sample: &Sample, settings: Settings) {
    let settings = Settings { standard_error: 0.002, strokes_most: 30, ..settings };
    let reference = sample.fly(settings);
    let fine = refined(settings);
    let flown = sample.fly(fine);
    document.heading("Refinement of everything");
    document.paragraph(&format!(
        "Default {} x {} panels and {} steps against {} x {} and {}, both flown until the standard errors are below 0.2 % \
         (30 strokes at most). Published strokes are smooth; what is left there is \
         below the error of any input. Violent ones (flips within a tenth of a stroke, 35 to 40 Hz) are moved by more, \
         their power above all.",
        settings.chordwise_panels,
        settings.spanwise_panels,
        settings.steps_per_stroke,
        fine.chordwise_panels,
        fine.spanwise_panels,
        fine.steps_per_stroke
    ));
    let published = 5.min(reference.len());
    let mut table = header("strokes");
    let parts = [("all", 0..reference.len()), ("published", 0..published), ("random", published..reference.len())];
    for (what, range) in parts {
        let (a, b) = (reference[range.clone()].to_vec(), flown[range].to_vec());
        row(&mut table, what, &difference(&a, &b), &b);
    }
    document.table(&table);
    let mut table = Table::new(["stroke", "L+", "D+", "M+", "P+", "change of L+", "of D+", "of M+", "of P+"]);
    for ((name, _), pair) in sample.strokes.iter().zip(reference.iter().zip(&flown)) {
        let (Some(a), Some(b)) = pair else { continue };
        let mut cells = vec![name.clone()];
        cells.extend(a.scaled.map(|e| fixed(e.mean, 3)));
        cells.extend((0..4).map(|k| signed(100.0 * (b.scaled[k].mean - a.scaled[k].mean), 2)));
        table.row(cells);
    }
    document.table(&table);
}
