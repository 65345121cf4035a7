//! How two sets of means differ, stroke by stroke.

use manduca_numerics::cases::CASES;

use super::sample::{Flown, Sample, difference};
use super::trials::{header, row};
use crate::markdown::{Document, Table, fixed, signed};

/// Writes the differences over all strokes, the published and the random ones, then each stroke's.
pub fn write(document: &mut Document, sample: &Sample, reference: &Flown, flown: &Flown) {
    let published = CASES.len().min(reference.len());
    let mut table = header("which");
    let parts = [("all", 0..reference.len()), ("published", 0..published), ("random", published..reference.len())];
    for (what, range) in parts {
        let (a, b) = (reference[range.clone()].to_vec(), flown[range].to_vec());
        row(&mut table, what, &difference(&a, &b), &b);
    }
    document.table(&table);
    let mut table = Table::new(["stroke", "L+", "D+", "M+", "P+", "change of L+", "of D+", "of M+", "of P+"]);
    for ((name, _), pair) in sample.strokes.iter().zip(reference.iter().zip(flown)) {
        let (Some(a), Some(b)) = pair else { continue };
        let mut cells = vec![name.clone()];
        cells.extend(a.scaled.map(|e| fixed(e.mean, 3)));
        cells.extend((0..4).map(|k| signed(100.0 * (b.scaled[k].mean - a.scaled[k].mean), 2)));
        table.row(cells);
    }
    document.table(&table);
}
