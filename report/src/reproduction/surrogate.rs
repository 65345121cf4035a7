//! How well the surrogate learnt: Fig. 5 and the errors of Fig. 6.

use std::io;

use manduca_numerics::parameters::at;
use manduca_numerics::surrogate::{Sample, errors};

use super::Study;
use crate::figures;
use crate::markdown::{Document, Table, significant};

/// Root mean square errors the paper found on 100 new simulations, of L, D, M, P.
const PAPER: [f64; 4] = [0.024, 0.023, 0.027, 0.029];
/// Standard errors up to which a fresh stroke counts as known.
const KNOWN: f64 = 0.002;
/// Elevation amplitude from which wings beat through their own wake, degrees.
const HIGH: f64 = 20.0;

/// Strokes whose four standard errors are small.
fn known(fresh: &[Sample]) -> Vec<Sample> {
    fresh.iter().filter(|s| s.se.iter().all(|se| *se <= KNOWN)).copied().collect()
}

/// Fresh strokes as the figure takes them.
fn drawn(study: &Study) -> Vec<figures::Sample> {
    let drawn =
        |s: &Sample| figures::Sample { point: s.x, simulated: s.y, predicted: Some(study.surrogate.predict(&s.x)) };
    study.fresh.iter().map(drawn).collect()
}

pub(super) fn write(
    study: &Study,
    document: &mut Document,
    figures: &mut Vec<(&'static str, String)>,
) -> io::Result<()> {
    document.heading("The surrogate (Fig. 5, Fig. 6)");
    let mut table = Table::new(["root mean square error", "L+", "D+", "M+", "P+"]);
    let row = |name: &str, errors: &[f64; 4]| {
        std::iter::once(name.to_owned()).chain(errors.iter().map(|e| significant(*e, 2))).collect::<Vec<_>>()
    };
    if let Some(errors) = &study.errors {
        table.row(row("here, test share of the samples", errors));
    }
    let (known, fresh) = (known(&study.fresh), &study.fresh);
    let low: Vec<_> = known.iter().filter(|s| s.x[at::ELEVATION_AMPLITUDE] < HIGH).copied().collect();
    for (name, samples) in [
        (format!("here, {} strokes flown long", fresh.len()), fresh),
        (format!("here, the {} of them known to {} hundredths", known.len(), 100.0 * KNOWN), &known),
        (format!("of these, the {} with elevation amplitudes below {HIGH}°", low.len()), &low),
    ] {
        if !samples.is_empty() {
            table.row(row(&name, &errors(&study.surrogate, samples).rmse));
        }
    }
    table.row(row("paper, 100 new simulations", &PAPER));
    document.table(&table);
    document.paragraph(
        "Units are W, W, W c and P0 = 84.2 mW; the paper's are of its own scales. Errors by features, method and number \
         of samples are printed by `manduca bench accuracy`.",
    );
    if let Some(agreement) = figures::agreement(&drawn(study)) {
        figures.push(("agreement.svg", agreement.svg()?));
        document.figure("figures/agreement.svg", "Predicted over simulated means of strokes the network has not seen");
    }
    // A gaussian process has no iterations to draw.
    let Some(training) = figures::training(&study.curve) else { return Ok(()) };
    figures.push(("training.svg", training.svg()?));
    document.figure("figures/training.svg", "Mean squared errors while the network is trained");
    document.paragraph(
        "The paper's best validation error came at iteration 105: 9.7e-5 training, 1.0e-3 validation, 1.3e-3 test.",
    );
    Ok(())
}
