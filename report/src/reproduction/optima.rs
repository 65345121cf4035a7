//! The optima: Table 5, and the forces of Fig. 8 and Fig. 10.

use std::io;

use manduca_numerics::cases::CASES;
use manduca_numerics::insect::Insect;
use manduca_numerics::parameters::{Point, TABLE};
use manduca_numerics::refine::off_trim;

use super::{Found, Optimum, Study};
use crate::figures;
use crate::flights::Flight;
use crate::markdown::{Document, Table, fixed};

pub(super) fn write(
    study: &Study,
    document: &mut Document,
    figures: &mut Vec<(&'static str, String)>,
) -> io::Result<()> {
    document.heading("The optima (Table 5)");
    document.table(&parameters(study));
    document.table(&means(study));
    for optimum in &study.optima {
        if let Some(prices) = optimum.prices {
            document.paragraph(&format!(
                "{}: P+ rises by {} per unit of lift asked for, {} of drag, {} of moment.",
                optimum.name,
                fixed(prices[0], 3),
                fixed(prices[1], 3),
                fixed(prices[2], 3)
            ));
        }
        if let Some(refining) = &optimum.refining {
            document.paragraph(&format!("{}: {refining}.", optimum.name));
        }
    }
    document.paragraph(
        "Our lattice gives less lift than the paper's at the paper's own strokes (see [verification](verification.md)), \
         so our optima beat faster or pitch otherwise to carry the same weight; where a parameter lies on a bound in \
         both, physics decides, where only one does, the level of lift may.",
    );
    let flown = flown(study)?;
    figures.push(("optimum-forces.svg", figures::forces(&flown, Insect::default().weight_n()).svg()?));
    figures.push(("optimum-angles.svg", figures::angles(&flown).svg()?));
    figures.push(("optimum-tip-paths.svg", figures::tip_paths(&flown).svg()?));
    document.subheading("Forces and angles over a stroke (Fig. 8, Fig. 10)");
    document.figure("figures/optimum-forces.svg", "Lift, drag and power over a stroke of the optima and of the moth");
    document.figure("figures/optimum-angles.svg", "Sweep, elevation and rotation of the optima and of the moth");
    document.figure("figures/optimum-tip-paths.svg", "Paths of the wing tip of the optima and of the moth");
    Ok(())
}

fn parameters(study: &Study) -> Table {
    let mut header = vec!["parameter".to_owned()];
    for optimum in &study.optima {
        header.push(optimum.name.clone());
        header.extend(optimum.refined.map(|_| format!("{}, refined", optimum.name)));
        header.push(format!("paper, {}", optimum.paper.name));
    }
    let mut table = Table::new(header);
    for (i, parameter) in TABLE.iter().enumerate() {
        let mut cells = vec![format!("{} {} {}", parameter.name, parameter.symbol, parameter.unit).trim().to_owned()];
        for optimum in &study.optima {
            cells.push(fixed(optimum.first.point[i], 2));
            cells.extend(optimum.refined.map(|r| fixed(r.point[i], 2)));
            cells.push(fixed(optimum.paper.parameters[i], 2));
        }
        table.row(cells);
    }
    table
}

/// Predicted and simulated means, and simulated power per lift.
fn means(study: &Study) -> Table {
    let header = ["optimum", "", "L+", "D+", "M+", "P+", "off trim", "P/L, W/N", "paper's P/L"];
    let mut table = Table::new(header);
    for optimum in &study.optima {
        rows(&mut table, &optimum.name, &optimum.first, optimum);
        if let Some(refined) = &optimum.refined {
            rows(&mut table, &format!("{}, refined", optimum.name), refined, optimum);
        }
    }
    table
}

fn rows(table: &mut Table, name: &str, found: &Found, optimum: &Optimum) {
    let off = |y: &[f64; 4]| fixed(off_trim(y), 4);
    if let Some(y) = &found.predicted {
        let mut cells = vec![name.to_owned(), "predicted".to_owned()];
        cells.extend(y.iter().map(|v| fixed(*v, 4)));
        cells.push(off(y));
        table.row(cells);
    }
    if let Some((y, se)) = &found.simulated {
        let mut cells = vec![name.to_owned(), "simulated".to_owned()];
        cells.extend(y.iter().zip(se).map(|(v, se)| format!("{} ± {}", fixed(*v, 4), fixed(*se, 4))));
        cells.push(off(y));
        let scales = Insect::default().scales();
        cells.push(fixed(y[3] * scales[3] / (y[0] * scales[0]), 2));
        cells.push(fixed(optimum.paper.paper_power_per_lift, 1));
        table.row(cells);
    }
}

/// The last stroke of the best optima and of the moth as measured.
fn flown(study: &Study) -> io::Result<Vec<figures::Flown>> {
    let moth = CASES.iter().find(|c| c.name == "reference").map(|c| ("moth as measured".to_owned(), c.parameters));
    let best = study.optima.iter().map(|o| (o.name.clone(), o.refined.unwrap_or(o.first).point));
    let fly = |(name, point): (String, Point)| {
        let (_, history) =
            Flight::of(point).fly_with_history().map_err(|e| io::Error::other(format!("{name}: {e}")))?;
        Ok((name, history))
    };
    best.chain(moth).map(fly).collect()
}
