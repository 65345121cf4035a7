//! How far the means are from those of finer lattices.

use manduca_numerics::uvlm::Settings;

use super::sample::{Sample, difference};
use super::strokes;
use super::trials::{header, row};
use crate::markdown::{Document, significant};

/// Panels along the chord, strips and steps.
type Mesh = [usize; 3];

/// What others are compared with: nine times as many panels as the default, and twice its steps.
const FINEST: Mesh = [20, 46, 144];

/// Meshes of about the default's work, then dearer ones.
const MESHES: [Mesh; 12] = [
    [6, 17, 68],
    [6, 17, 64],
    [6, 14, 68],
    [8, 17, 68],
    [8, 12, 64],
    [8, 10, 64],
    [7, 16, 48],
    [8, 16, 80],
    [12, 34, 102],
    [16, 20, 96],
    [14, 32, 72],
    [20, 46, 96],
];

fn on([chordwise_panels, spanwise_panels, steps_per_stroke]: Mesh, settings: Settings) -> Settings {
    Settings { chordwise_panels, spanwise_panels, steps_per_stroke, ..settings }
}

fn refined([panels, strips, steps]: Mesh) -> Mesh {
    [2 * panels, 2 * strips, steps * 3 / 2]
}

fn named([panels, strips, steps]: Mesh) -> String {
    format!("{panels} x {strips} x {steps}")
}

/// Writes how far meshes are from a much finer one, and what refining them would have told.
pub fn write_meshes(document: &mut Document, sample: &Sample, settings: Settings) {
    let short = Settings { wake_strokes: 0.5, strokes: 4, strokes_most: 4, strokes_dropped: 2, ..settings };
    let work = |s: Settings| s.interactions(s.strokes);
    let finest = sample.fly(on(FINEST, short));
    let flown = MESHES.map(|mesh| (mesh, sample.fly(on(mesh, short))));
    document.heading("Distance from a fine lattice");
    document.paragraph(&format!(
        "Panels along the chord x strips x steps, against {}. Two strokes after two with a wake of half a stroke, which \
         shows the same errors in a small part of the time; work is that with the whole wake, the default's being 1.",
        named(FINEST)
    ));
    let mut table = header("mesh (work)");
    for (mesh, means) in &flown {
        let share = work(on(*mesh, settings)) / work(settings);
        let what = format!("{} ({})", named(*mesh), significant(share, 2));
        row(&mut table, &what, &difference(means, &finest), means);
    }
    document.table(&table);
    document.paragraph(
        "The same flights, each mesh against twice its panels both ways and one and a half times its steps:",
    );
    let mut table = header("mesh");
    for (mesh, means) in &flown {
        let Some((finer, against)) = flown.iter().find(|(other, _)| *other == refined(*mesh)) else { continue };
        row(&mut table, &format!("{} to {}", named(*mesh), named(*finer)), &difference(means, against), against);
    }
    document.table(&table);
}

/// Writes what twice the panels both ways with one and a half times the steps do.
pub fn write_refinement(document: &mut Document, sample: &Sample, settings: Settings) {
    let settings = Settings { standard_error: 0.002, strokes_most: 30, ..settings };
    let reference = sample.fly(settings);
    let mesh = [settings.chordwise_panels, settings.spanwise_panels, settings.steps_per_stroke];
    let fine = on(refined(mesh), settings);
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
    strokes::write(document, sample, &reference, &flown);
}
