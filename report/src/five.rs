//! The paper's five-parameter case with and without a surrogate: Table 4.
//!
//! A document of its own, for the direct search flies 12500 strokes: more than all other studies of the documents.

use manduca_numerics::cases::case;
use manduca_numerics::insect::Insect;
use manduca_numerics::parameters::{TABLE, at};
use manduca_numerics::refine::trimmed_power;

use crate::markdown::{Document, Table, fixed, percent};
use crate::output::Report;
use crate::reproduction::{Found, Optimum};

/// The case, searched both ways.
#[derive(Debug, Clone)]
pub struct Five {
    /// By direct search: its first stroke is the best of the generations.
    pub direct: Side,
    /// On a surrogate.
    pub surrogate: Side,
}

/// One of the two.
#[derive(Debug, Clone)]
pub struct Side {
    /// What it took, in words: name and value.
    pub facts: Vec<(String, String)>,
    /// What it found.
    pub optimum: Optimum,
}

/// The free parameters.
const FREE: [usize; 5] =
    [at::FREQUENCY, at::SWEEP_MEAN, at::ROTATION_MEAN, at::SWEEP_AMPLITUDE, at::ROTATION_AMPLITUDE];

/// The document. Nothing is computed again: both studies are finished.
#[must_use]
pub fn document(five: &Five) -> Report {
    let mut document = Document::new("Five parameters, with and without a surrogate");
    document.paragraph(
        "`manduca report five DIRECT SURROGATE` writes this page from two finished studies of a coordinator; `manduca \
         run five-direct` and `manduca run five` are the studies. Beside them is Table 4 of Nguyen, Tran, Han & Lee 2019 \
         (J. Bionic Eng. 16).",
    );
    document.paragraph(
        "Frequency, mean sweep, mean rotation and both amplitudes are free, the rest is held at 0. The direct search is \
         the paper's: a genetic algorithm whose every individual is flown. Its best stroke is then refined on a quadratic \
         through what was flown near it, the network's optimum on the network; either is flown again until it is in trim \
         as predicted. All means are simulated, over as many strokes as verified optima are. Power in exact trim is the \
         simulated power and what is missing to L = W, D = M = 0 at its price: P + p_L (1 - L/W) - p_D D/W - p_M M/(W c).",
    );
    document.heading("The strokes");
    document.table(&strokes(five));
    for side in [&five.direct, &five.surrogate] {
        if let Some([lift, drag, moment]) = side.optimum.prices {
            document.paragraph(&format!(
                "{}: P+ rises by {} per unit of L+ asked for, {} of D+, {} of M+.",
                side.optimum.name,
                fixed(lift, 3),
                fixed(drag, 3),
                fixed(moment, 3)
            ));
        }
    }
    if let Some(sentence) = compared(five) {
        document.paragraph(&sentence);
    }
    document.heading("What they took");
    document.table(&costs(five));
    Report { name: "five.md", text: document.text().to_owned(), figures: Vec::new() }
}

/// The stroke and the means of a column; none of what is only published.
struct Column {
    name: String,
    parameters: [f64; 10],
    /// Means and standard errors.
    simulated: Option<([f64; 4], [f64; 4])>,
    power_mw: Option<f64>,
    per_lift: Option<f64>,
    trimmed_mw: Option<f64>,
}

fn columns(five: &Five) -> Vec<Column> {
    let mut columns = Vec::new();
    for (side, first, paper) in [(&five.direct, "generations", "five-direct"), (&five.surrogate, "network", "five-ann")]
    {
        let optimum = &side.optimum;
        columns.push(flown(&format!("{}, {first}", optimum.name), &optimum.first, optimum));
        columns.extend(optimum.refined.as_ref().map(|r| flown(&format!("{}, refined", optimum.name), r, optimum)));
        columns.extend(case(paper).map(|published| Column {
            name: format!("paper, {}", if paper == "five-direct" { "direct" } else { "network" }),
            parameters: published.parameters,
            simulated: None,
            power_mw: published.paper_power_mw,
            per_lift: Some(published.paper_power_per_lift),
            trimmed_mw: None,
        }));
    }
    columns
}

/// Milliwatts of a scaled power.
fn milliwatts(power: f64) -> f64 {
    1e3 * power * Insect::default().scales()[3]
}

fn flown(name: &str, found: &Found, optimum: &Optimum) -> Column {
    let scales = Insect::default().scales();
    let y = found.simulated.map(|(y, _)| y);
    Column {
        name: name.to_owned(),
        parameters: found.point,
        simulated: found.simulated,
        power_mw: y.map(|y| milliwatts(y[3])),
        per_lift: y.map(|y| y[3] * scales[3] / (y[0] * scales[0])),
        trimmed_mw: y.zip(optimum.prices).map(|(y, prices)| milliwatts(trimmed_power(&y, &prices))),
    }
}

fn strokes(five: &Five) -> Table {
    let columns = columns(five);
    let mut table = Table::new(std::iter::once(String::new()).chain(columns.iter().map(|c| c.name.clone())));
    let row = |name: String, cell: &dyn Fn(&Column) -> Option<String>| {
        std::iter::once(name).chain(columns.iter().map(|c| cell(c).unwrap_or_default())).collect::<Vec<_>>()
    };
    for i in FREE {
        let p = &TABLE[i];
        table.row(row(format!("{} {} {}", p.name, p.symbol, p.unit), &|c| Some(fixed(c.parameters[i], 2))));
    }
    for (k, name) in ["L/W", "D/W", "M/(W c)"].into_iter().enumerate() {
        table
            .row(row(name.into(), &|c| c.simulated.map(|(y, se)| format!("{} ± {}", fixed(y[k], 4), fixed(se[k], 4)))));
    }
    table.row(row("P, mW".into(), &|c| {
        let se = c.simulated.map(|(_, se)| format!(" ± {}", fixed(milliwatts(se[3]), 2)));
        c.power_mw.map(|p| fixed(p, 2) + &se.unwrap_or_default())
    }));
    table.row(row("P/L, W/N".into(), &|c| c.per_lift.map(|p| fixed(p, 2))));
    table.row(row("P in exact trim, mW".into(), &|c| c.trimmed_mw.map(|p| fixed(p, 2))));
    table
}

fn costs(five: &Five) -> Table {
    let mut table = Table::new(["study", "what", "value"]);
    for side in [&five.direct, &five.surrogate] {
        for (name, value) in &side.facts {
            table.row([side.optimum.name.clone(), name.clone(), value.clone()]);
        }
        if let Some(refining) = &side.optimum.refining {
            table.row([side.optimum.name.clone(), "refining".into(), refining.clone()]);
        }
    }
    table
}

/// Power in exact trim of the better stroke of a side.
fn trimmed(side: &Side) -> Option<f64> {
    let optimum = &side.optimum;
    flown("", &optimum.refined.unwrap_or(optimum.first), optimum).trimmed_mw
}

fn compared(five: &Five) -> Option<String> {
    let (direct, surrogate) = (trimmed(&five.direct)?, trimmed(&five.surrogate)?);
    let paper = |name: &str| case(name).and_then(|c| c.paper_power_mw);
    let (theirs, network) = (paper("five-direct")?, paper("five-ann")?);
    Some(format!(
        "In exact trim the surrogate's optimum costs {} mW, the one searched directly {} mW: a ratio of {}, {}. The \
         paper's {network} mW and {theirs} mW have {}, {}; neither of its optima was flown again.",
        fixed(surrogate, 2),
        fixed(direct, 2),
        fixed(surrogate / direct, 4),
        percent(surrogate / direct - 1.0, 2),
        fixed(network / theirs, 4),
        percent(network / theirs - 1.0, 2)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn side(name: &str, lift: f64, power: f64) -> Side {
        let published = case(name).unwrap();
        let found = |lift: f64, power: f64| Found {
            point: published.parameters,
            predicted: None,
            simulated: Some(([lift, 0.001, -0.002, power], [0.0003; 4])),
        };
        Side {
            facts: vec![("wall time".into(), "2 h".into())],
            optimum: Optimum {
                name: name.into(),
                paper: published,
                first: found(0.99, 0.9),
                refined: Some(found(lift, power)),
                refining: Some("refined by 20 simulations".into()),
                prices: Some([1.5, 0.1, -0.2]),
            },
        }
    }

    #[test]
    fn both_optima_stand_beside_the_papers_in_exact_trim() {
        let five = Five { direct: side("five-direct", 0.998, 0.95), surrogate: side("five-ann", 1.002, 0.96) };
        let report = document(&five);
        // 84.2 (0.95 + 1.5 x 0.002 - 0.1 x 0.001 - 0.2 x 0.002), and with -0.002 and 0.96.
        let (direct, surrogate) = (84.2 * 0.9525, 84.2 * 0.9565);
        let text = report.text.split_whitespace().collect::<Vec<_>>().join(" ");
        for part in [
            format!("| {direct:.2} |"),
            format!("costs {surrogate:.2} mW, the one searched directly {direct:.2} mW"),
            format!("a ratio of {:.4}, +0.42 %", surrogate / direct),
            "have 0.9625, -3.75 %".into(),
            "79.6 mW and 82.7 mW".into(),
            "0.9980 ± 0.0003".into(),
            "1.500 per unit of L+".into(),
            "refined by 20 simulations".into(),
        ] {
            assert!(text.contains(&part), "{part} in {text}");
        }
        let unpriced = Optimum { prices: None, ..five.direct.optimum.clone() };
        assert_eq!(compared(&Five { direct: Side { optimum: unpriced, ..five.direct }, ..five }), None);
    }
}
