//! A finished study beside the paper it repeats: Nguyen et al. 2019.

mod baseline;
mod optima;
mod searches;
mod surrogate;

use std::io;

use manduca_numerics::cases::Case;
use manduca_numerics::parameters::{Bounds, Point};
use manduca_numerics::surrogate::{Sample, Surrogate};

use crate::markdown::Document;
use crate::output::Report;
use crate::plot::Figure;

/// A study as it ended.
#[derive(Debug, Clone)]
pub struct Study {
    /// What was asked and what it took, in words: name and value.
    pub facts: Vec<(String, String)>,
    /// Iteration, then mean squared errors of training, validation and test share, of the first network.
    pub curve: Vec<[f64; 4]>,
    /// Root mean square errors of L+, D+, M+, P+ on the test share.
    pub errors: Option<[f64; 4]>,
    /// Strokes it has not seen, flown long, to judge it by; may be none.
    pub fresh: Vec<Sample>,
    /// The surrogate.
    pub surrogate: Surrogate,
    /// The sampled box.
    pub bounds: Bounds,
    /// Seed of the study.
    pub seed: u64,
    /// Its optima.
    pub optima: Vec<Optimum>,
}

/// An optimum as found, flown again, and refined.
#[derive(Debug, Clone)]
pub struct Optimum {
    /// Name in the study.
    pub name: String,
    /// What the paper has beside it.
    pub paper: &'static Case,
    /// The surrogate's optimum.
    pub first: Found,
    /// The one after refining.
    pub refined: Option<Found>,
    /// What refining cost and why it ended.
    pub refining: Option<String>,
    /// Change of P+ per unit of L+, D+ and M+ asked for, at the refined optimum where there is one.
    pub prices: Option<[f64; 3]>,
}

/// A stroke with what was predicted and simulated of `[L+, D+, M+, P+]`.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// The stroke.
    pub point: Point,
    /// Predicted.
    pub predicted: Option<[f64; 4]>,
    /// Simulated: means and standard errors.
    pub simulated: Option<([f64; 4], [f64; 4])>,
}

/// How much is searched again.
#[derive(Debug, Clone, PartialEq)]
pub struct Effort {
    /// Population of the sweep of the penalty.
    pub population: usize,
    /// Populations of Fig. 7.
    pub populations: Vec<usize>,
    /// Runs of each.
    pub runs: u64,
}

impl Default for Effort {
    /// The paper's.
    fn default() -> Self {
        Self { population: 100_000, populations: vec![1_000, 10_000, 100_000, 500_000], runs: 5 }
    }
}

/// Computes the document of a study.
///
/// # Errors
/// When a search or a flight fails, or a figure cannot be drawn.
pub fn compute(study: &Study, effort: &Effort, tell: &mut dyn FnMut(&str)) -> io::Result<Report> {
    let mut document = Document::new("The paper's study, repeated");
    document.paragraph(
        "`manduca report reproduction STUDY` computes and writes this page from a finished study of a coordinator; \
         `manduca run paper` is the study. Beside each table is what Nguyen, Tran, Han & Lee 2019 published (J. \
         Bionic Eng. 16). The optima there were never flown again; here every optimum was, and then refined until \
         prediction and simulation agree.",
    );
    document.heading("The study");
    let mut facts = crate::markdown::Table::new(["what", "value"]);
    for (name, value) in &study.facts {
        facts.row([name.clone(), value.clone()]);
    }
    document.table(&facts);
    let mut figures = Vec::new();
    tell("the model beside blade elements");
    baseline::write(&mut document, &mut figures)?;
    surrogate::write(study, &mut document, &mut figures)?;
    tell("optima");
    optima::write(study, &mut document, &mut figures)?;
    searches::write(study, effort, &mut document, &mut figures, tell)?;
    Ok(Report { name: "reproduction.md", text: document.text().to_owned(), figures })
}

/// The sweep of the population on a study's surrogate (Fig. 7 of the paper): minutes of searching.
///
/// # Errors
/// When a search fails.
pub fn population(study: &Study, effort: &Effort) -> io::Result<Figure> {
    searches::population(study, effort)
}

#[cfg(test)]
mod tests {
    use manduca_numerics::cases::CASES;
    use manduca_numerics::surrogate::Network;

    use super::*;

    /// Four neurons, each of one parameter and one output: P+ = tanh f, L+ = 1 + tanh beta,
    /// D+ = tanh phi0, M+ = tanh theta0, parameters scaled to [-1, 1]. The optimum is P+ = tanh(-1).
    fn surrogate() -> Surrogate {
        let mut hidden_weights = vec![0.0; 40];
        let mut output_weights = vec![0.0; 16];
        for (neuron, output) in [3, 0, 1, 2].into_iter().enumerate() {
            hidden_weights[10 * neuron + neuron] = 1.0;
            output_weights[4 * output + neuron] = 1.0;
        }
        let biases = [1.0, 0.0, 0.0, 0.0];
        let network =
            Network::new_checked(Bounds::default(), hidden_weights, vec![0.0; 4], output_weights, biases).unwrap();
        Surrogate::of(network)
    }

    #[test]
    fn a_study_becomes_a_page_beside_the_papers_tables() {
        let found = |point, power: f64| Found {
            point,
            predicted: Some([1.0, 0.0, 0.0, power]),
            simulated: Some(([0.9, 0.02, -0.01, power], [0.001; 4])),
        };
        // Off by 0.02 in lift; every third is known badly.
        let fresh = |i: u32| {
            let x = Bounds::default().from_unit(&[f64::from(i) / 30.0; 10]);
            let mut y = surrogate().predict(&x);
            y[0] += 0.02;
            Sample { x, y, se: [if i.is_multiple_of(3) { 0.01 } else { 0.001 }; 4] }
        };
        let optimum = Optimum {
            name: "case-I".into(),
            paper: &CASES[0],
            first: found(CASES[1].parameters, 0.8),
            refined: Some(found(CASES[2].parameters, 0.82)),
            refining: Some("refined by 40 simulations in 5 rounds: prediction and simulation agree".into()),
            prices: Some([0.61, 0.02, -0.03]),
        };
        let study = Study {
            facts: vec![("seed".into(), "2019".into())],
            curve: (0..5).map(|i| [f64::from(i), 0.1, 0.2, 0.3]).collect(),
            errors: Some([0.0123, 0.02, 0.03, 0.04]),
            fresh: (0..30).map(fresh).collect(),
            surrogate: surrogate(),
            bounds: Bounds::default(),
            seed: 3,
            optima: vec![optimum],
        };
        let effort = Effort { population: 60, populations: vec![20, 60], runs: 2 };
        let report = compute(&study, &effort, &mut |_| {}).unwrap();
        // tanh(-1), the exact optimum, beside Table 3's first row and the paper's errors.
        for text in [
            "-0.761594",
            "| 2 | ",
            "2.6e-4",
            "0.012",
            "0.024",
            "25.30",
            "30 strokes flown long | 0.020 | 0 | 0 | 0 |",
            "the 20 of them known to 0.2 hundredths | 0.020 |",
            "the 13 with elevation amplitudes below 20° | 0.020 |",
            "of leaving the box",
            "refined by 40 simulations",
            "0.610 per unit of lift",
        ] {
            assert!(report.text.contains(text), "{text} in\n{}", report.text);
        }
        assert_eq!(report.figures.len(), 7);
    }
}
