//! What the genetic algorithm finds on the same surrogate: Table 3 and Fig. 7.

use std::fmt::Display;
use std::io;
use std::ops::ControlFlow;

use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::{Clearance, ElevationPhase};
use manduca_numerics::optimise::analysis::{PopulationRow, Weight, penalty_sweep, population_sweep};
use manduca_numerics::optimise::sqp::{Flight, SqpSettings, minimise};
use manduca_numerics::optimise::{GaSettings, Problem, SimplexSettings};

use super::{Effort, Study};
use crate::figures;
use crate::markdown::{Document, Table, fixed, significant};
use crate::plot::Figure;

/// Table 3 of the paper: r, fitness, penalty.
const PAPER: [(f64, f64, f64); 5] =
    [(2.0, 0.85, 2.6e-4), (10.0, 0.88, 1.5e-10), (20.0, 0.94, 3.1e-11), (50.0, 1.10, 2.4e-5), (100.0, 1.28, 1.0e-10)];

/// Weights of leaving the box.
const BOUNDS: [f64; 5] = [0.2, 1.0, 5.0, 20.0, 100.0];

pub(super) fn write(
    study: &Study,
    effort: &Effort,
    document: &mut Document,
    figures: &mut Vec<(&'static str, String)>,
    tell: &mut dyn FnMut(&str),
) -> io::Result<()> {
    with_problem(study, &mut |problem, power| {
        penalties(problem, study, effort, power, document, tell)?;
        leaving(problem, study, effort, power, document)?;
        tell("sweep of the population");
        let rows = population_rows(problem, study, effort)?;
        populations(&rows, effort, power, document, figures)
    })
}

/// The sweep of the population alone, as a figure.
///
/// # Errors
/// When a search fails.
pub(super) fn population(study: &Study, effort: &Effort) -> io::Result<Figure> {
    let mut figure = None;
    with_problem(study, &mut |problem, power| {
        figure = Some(figures::population(&population_rows(problem, study, effort)?, power));
        Ok(())
    })?;
    figure.ok_or_else(|| failed("no search"))
}

/// Hands on the study's problem as the genetic algorithm sees it, and P+ of its exact optimum.
fn with_problem(study: &Study, search: &mut dyn FnMut(&Problem<'_>, f64) -> io::Result<()>) -> io::Result<()> {
    let clearance = Clearance::new(&Insect::default(), ElevationPhase::Plus);
    let problem = Problem {
        predict: &|points, values| study.surrogate.predict_into(points, values),
        clearance: &|points, values| clearance.of_each(points, values),
        margin_m: 0.0,
        bounds: study.bounds,
        penalty_r: 2.0,
        penalty_s: 5.0,
    };
    let flight =
        Flight { surrogate: &study.surrogate, clearance: Some(&clearance), margin_m: 0.0, bounds: study.bounds };
    let how = SqpSettings { seed: study.seed, ..SqpSettings::default() };
    let exact = minimise(&flight, &how, &mut |_| ControlFlow::Continue(())).map_err(failed)?;
    search(&problem, exact.best().outputs[3])
}

fn penalties(
    problem: &Problem<'_>,
    study: &Study,
    effort: &Effort,
    power: f64,
    document: &mut Document,
    tell: &mut dyn FnMut(&str),
) -> io::Result<()> {
    let ga = GaSettings { population: effort.population, generations: 100, seed: study.seed, ..GaSettings::default() };
    tell("sweep of the penalty");
    let weights = PAPER.map(|row| row.0);
    let rows = penalty_sweep(problem, &ga, &SimplexSettings::default(), (Weight::Trim, &weights), power);
    document.heading("The penalty (Table 3)");
    document.paragraph(&format!(
        "Genetic algorithm, {} individuals, 100 generations, then simplex, on all ten parameters. The exact optimum of \
         the surrogate, by sequential quadratic programming, is P+ = {}: above the largest multiplier the penalty is \
         exact, so no row could differ from it but for the search. What rises with r is what the search leaves lying in \
         a narrower valley, here as in the paper.",
        effort.population,
        fixed(power, 6)
    ));
    let mut table = Table::new(["r", "fitness", "penalty", "above the optimum", "paper's fitness", "paper's penalty"]);
    for (row, (r, fitness, penalty)) in rows.map_err(failed)?.iter().zip(PAPER) {
        table.row([
            fixed(r, 0),
            fixed(row.fitness, 4),
            significant(row.penalty, 2),
            significant(row.excess, 2),
            fixed(fitness, 2),
            significant(penalty, 2),
        ]);
    }
    document.table(&table);
    Ok(())
}

/// The same of s, which the paper sets to 5 and does not sweep.
fn leaving(
    problem: &Problem<'_>,
    study: &Study,
    effort: &Effort,
    power: f64,
    document: &mut Document,
) -> io::Result<()> {
    let ga = GaSettings { population: effort.population, generations: 100, seed: study.seed, ..GaSettings::default() };
    let rows = penalty_sweep(problem, &ga, &SimplexSettings::default(), (Weight::Bounds, &BOUNDS), power);
    document.paragraph(
        "The weight s of leaving the box, with r = 2. Where it is too small a search gains by leaving: a fitness below \
         the exact optimum's would be that of a stroke outside.",
    );
    let mut table = Table::new(["s", "fitness", "penalty", "above the optimum"]);
    for row in rows.map_err(failed)? {
        table.row([
            fixed(row.weight, 1),
            fixed(row.fitness, 4),
            significant(row.penalty, 2),
            significant(row.excess, 2),
        ]);
    }
    document.table(&table);
    Ok(())
}

/// What the genetic algorithm finds with each population.
fn population_rows(problem: &Problem<'_>, study: &Study, effort: &Effort) -> io::Result<Vec<PopulationRow>> {
    let seeds: Vec<u64> = (0..effort.runs).map(|i| study.seed.wrapping_add(i)).collect();
    let ga = GaSettings { generations: 100, ..GaSettings::default() };
    population_sweep(problem, &ga, &SimplexSettings::default(), &effort.populations, &seeds).map_err(failed)
}

fn populations(
    rows: &[PopulationRow],
    effort: &Effort,
    power: f64,
    document: &mut Document,
    figures: &mut Vec<(&'static str, String)>,
) -> io::Result<()> {
    document.heading("The population (Fig. 7)");
    document.paragraph(&format!(
        "Fitness after 100 generations and the simplex, {} runs each from their own seeds; the exact optimum is {}.",
        effort.runs,
        fixed(power, 6)
    ));
    let mut table = Table::new(["population", "least", "mean", "most"]);
    for row in rows {
        let (least, most) =
            row.fitnesses.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), f| (l.min(*f), m.max(*f)));
        let mean = row.fitnesses.iter().sum::<f64>() / row.fitnesses.len() as f64;
        table.row([row.population.to_string(), fixed(least, 4), fixed(mean, 4), fixed(most, 4)]);
    }
    document.table(&table);
    figures.push(("population.svg", figures::population(rows, power).svg()?));
    document.figure("figures/population.svg", "Fitness found against the size of the population");
    Ok(())
}

fn failed(error: impl Display) -> io::Error {
    io::Error::other(error.to_string())
}
