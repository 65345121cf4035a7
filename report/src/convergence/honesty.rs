//! Standard errors: how large, and whether they are true.

use std::io;

use manduca_numerics::parameters::OUTPUTS;
use manduca_numerics::simulation::Means;
use manduca_numerics::uvlm::Settings;

use super::sample::{SEED, quantile, random};
use crate::flights::fly_all;
use crate::markdown::{Document, Table, fixed};

/// Seed of these strokes: others than those of the trials.
const OTHER_SEED: u64 = SEED + 1;

/// How much longer the run is whose mean is taken for the truth.
const LONGER: usize = 10;

/// Writes both.
///
/// # Errors
/// When too few strokes of the design box are feasible.
pub fn write(document: &mut Document, count: u64, settings: Settings) -> io::Result<()> {
    let points = (0..count).map(|i| random(OTHER_SEED, i)).collect::<io::Result<Vec<_>>>()?;
    let fly = |settings: &[Settings]| -> Vec<Option<Means>> {
        let flights: Vec<_> = points.iter().zip(settings).map(|(x, settings)| super::flight(x, *settings)).collect();
        fly_all(&flights).into_iter().map(Result::ok).collect()
    };
    let flown = fly(&vec![settings; points.len()]);
    let longer: Vec<_> = flown.iter().map(|means| longer(settings, means.as_ref())).collect();
    let long = fly(&longer);
    let pairs: Vec<_> = flown.iter().zip(&long).filter_map(|(a, b)| Some((a.as_ref()?, b.as_ref()?))).collect();
    let strokes =
        |flown: &[Option<Means>], q: f64| fixed(quantile(flown.iter().flatten().map(|m| m.strokes.len() as f64), q), 0);
    document.heading("Standard errors");
    document.paragraph(&format!(
        "{count} random strokes (seed {OTHER_SEED}), {} of which have means; strokes flown, median {}, most {}. The last \
         column is the share whose mean lies within two standard errors of that of the same flight gone on until {LONGER} \
         times as many strokes were kept, the first among them (median {}, most {} flown).",
        pairs.len(),
        strokes(&flown, 0.5),
        strokes(&flown, 1.0),
        strokes(&long, 0.5),
        strokes(&long, 1.0),
    ));
    let mut table = Table::new(["output", "median se", "90 % below", "largest", "within two se of the long run"]);
    for (k, output) in OUTPUTS.iter().enumerate() {
        let se = |q: f64| format!("{} %", fixed(100.0 * quantile(pairs.iter().map(|(a, _)| a.scaled[k].se), q), 2));
        let within = pairs.iter().filter(|(a, b)| honest(a, b, k)).count() as f64 / pairs.len().max(1) as f64;
        let share = format!("{} %", fixed(100.0 * within, 0));
        table.row([output.2.to_owned(), se(0.5), se(0.9), se(1.0), share]);
    }
    document.table(&table);
    Ok(())
}

/// Settings with which [`LONGER`] times the strokes are kept.
fn longer(settings: Settings, flown: Option<&Means>) -> Settings {
    let kept = flown.map_or(settings.strokes, |means| means.strokes.len()) - settings.strokes_dropped;
    let strokes = LONGER * kept + settings.strokes_dropped;
    Settings { strokes, strokes_most: strokes, ..settings }
}

fn honest(short: &Means, long: &Means, output: usize) -> bool {
    let (a, b) = (short.scaled[output], long.scaled[output]);
    (a.mean - b.mean).abs() <= 2.0 * a.se
}

#[cfg(test)]
mod tests {
    use super::super::sample::coarse;
    use super::*;

    #[test]
    fn a_small_table_has_every_output() {
        let settings = Settings { strokes: 3, strokes_most: 3, ..coarse() };
        let mut document = Document::new("x");
        write(&mut document, 2, settings).unwrap();
        assert!(OUTPUTS.iter().all(|o| document.text().contains(o.2)), "{}", document.text());
        assert!(!document.text().contains("NaN"));
        assert!(document.text().contains("median 3, most 3") && document.text().contains("(median 21, most 21 flown)"));
    }
}
