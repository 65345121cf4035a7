//! What the spreading of the wake is worth, stroke by stroke.

use manduca_numerics::uvlm::Settings;

use super::sample::{Flown, Sample, difference};
use super::strokes;
use super::trials::{header, row};
use crate::markdown::{Document, Table, fixed, significant};

/// Spreadings at which the strokes it moves most are flown besides, in shares of the default.
const SHARES: [f64; 4] = [1.25, 0.875, 0.75, 0.625];
/// Spreadings which could be the default instead, chords in a stroke.
const OTHERS: [f64; 3] = [0.8, 1.0, 1.4];

/// The stroke whose mean `k` of L+, D+, M+, P+ changes most.
fn most_moved(a: &Flown, b: &Flown, k: usize) -> Option<usize> {
    let change = |i: usize| Some((b[i].as_ref()?.scaled[k].mean - a[i].as_ref()?.scaled[k].mean).abs());
    let changes = (0..a.len()).filter_map(|i| Some((i, change(i)?)));
    changes.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
}

/// Flown until the means are known.
fn long(settings: Settings) -> Settings {
    Settings { standard_error: 0.002, strokes_most: 64, ..settings }
}

/// Writes what half of other spreadings does, and what a longer wake does with them: whether another default would be
/// less of a choice.
fn write_others(document: &mut Document, sample: &Sample, settings: Settings) {
    document
        .paragraph("With another spreading as the default, its half and a wake remembered twice as long would move:");
    let mut table = header("default, change");
    for spreading in OTHERS {
        let settings = Settings { wake_spreading: spreading, ..settings };
        let reference = sample.fly(settings);
        let changes = [
            ("halved", Settings { wake_spreading: 0.5 * spreading, ..settings }),
            ("wake twice as long", Settings { wake_strokes: 2.0 * settings.wake_strokes, ..settings }),
        ];
        for (what, settings) in changes {
            let flown = sample.fly(settings);
            row(
                &mut table,
                &format!("{} c, {what}", significant(spreading, 3)),
                &difference(&reference, &flown),
                &flown,
            );
        }
    }
    document.table(&table);
}

/// Writes what half of the spreading does to each stroke, how the strokes it moves most depend on it, and whether
/// another spreading would be less of a choice.
pub fn write(document: &mut Document, sample: &Sample, settings: Settings) {
    let settings = long(settings);
    let at = |share: f64| Settings { wake_spreading: share * settings.wake_spreading, ..settings };
    let (reference, halved) = (sample.fly(settings), sample.fly(at(0.5)));
    document.heading("Spreading halved, stroke by stroke");
    document.paragraph(
        "The row *spreading halved* of Cores again, but both flown until the standard errors are below 0.2 % (64 strokes \
         at most): a wake which spreads less is less calm, and errors of the means then count as changes.",
    );
    strokes::write(document, sample, &reference, &halved);
    document.paragraph("The strokes whose L+ and D+ it moves most, at other spreadings:");
    let mut table = Table::new(["stroke, spreading", "L+", "D+", "M+", "P+"]);
    let moved: Vec<_> = [0, 1].into_iter().filter_map(|k| most_moved(&reference, &halved, k)).collect();
    let few = Sample { strokes: moved.iter().map(|i| sample.strokes[*i].clone()).collect() };
    let known = |flown: &Flown| moved.iter().map(|i| flown[*i].clone()).collect();
    let mut flown = vec![(1.0, known(&reference)), (0.5, known(&halved))];
    flown.extend(SHARES.map(|share| (share, few.fly(at(share)))));
    flown.sort_by(|a, b| b.0.total_cmp(&a.0));
    for (i, (name, _)) in few.strokes.iter().enumerate() {
        for (share, means) in &flown {
            let Some(means) = &means[i] else { continue };
            let mut cells = vec![format!("{name}, {} c", significant(at(*share).wake_spreading, 3))];
            cells.extend(means.scaled.map(|e| format!("{} ± {}", fixed(e.mean, 3), fixed(e.se, 3))));
            table.row(cells);
        }
    }
    document.table(&table);
    write_others(document, sample, settings);
}

#[cfg(test)]
mod tests {
    use super::super::sample::coarse;
    use super::*;

    #[test]
    fn the_strokes_it_moves_most_are_flown_at_all_spreadings() {
        let coarse = long(coarse());
        let sample = Sample::new(1).unwrap();
        let mut document = Document::new("x");
        write(&mut document, &sample, coarse);
        let (a, b) = (sample.fly(coarse), sample.fly(Settings { wake_spreading: 0.6, ..coarse }));
        let name = &sample.strokes[most_moved(&a, &b, 0).unwrap()].0;
        for part in [
            format!("| {name}, 0.600 c |"),
            format!("| {name}, 1.50 c |"),
            "| random 0 | ".into(),
            "| 1.00 c, halved | 6 |".into(),
        ] {
            assert!(document.text().contains(&part), "{part} in {}", document.text());
        }
    }
}
