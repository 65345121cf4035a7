//! `manduca analyse front`, `sweep` and `population`.

use std::ops::ControlFlow;

use anyhow::{Context, Result};
use manduca_numerics::optimise::GaSettings;
use manduca_numerics::optimise::analysis::{
    FrontPoint, Side, Weight, even_limits, penalty_sweep, population_sweep, whole_front,
};
use manduca_numerics::optimise::sqp::{LocalOptimum, minimise};
use manduca_numerics::parameters::TABLE;

use super::Subject;
use super::answer::{Answer, Cell, Column};
use crate::args::{FrontArgs, PopulationArgs, SweepArgs, WeightChoice};
use crate::exit::refused;
use crate::output::note;

const NOT_IN_TRIM: &str = "the surrogate knows no stroke in trim within these bounds";

/// Least power against a bound.
pub fn front(subject: &Subject, args: &FrontArgs) -> Result<Answer> {
    let parameter = &TABLE[args.quantity];
    let bounds = &subject.how.bounds;
    let (lower, upper) = (bounds.lower[args.quantity], bounds.upper[args.quantity]);
    if bounds.is_held(args.quantity) {
        return Err(refused(format!("{} is held at {lower}: there is no front", parameter.name)));
    }
    let limits = if args.limits.is_empty() { even_limits((lower, upper), args.points) } else { args.limits.clone() };
    if let Some(limit) = limits.iter().find(|limit| !(lower..=upper).contains(*limit)) {
        return Err(refused(format!("limit {limit} of {} is outside {lower} to {upper}", parameter.name)));
    }
    let front = whole_front(&subject.flight(), &subject.how.sqp, args.quantity, &limits, &|| true);
    let (optimum, points) = front.context(NOT_IN_TRIM)?.context(NOT_IN_TRIM)?;
    let lead = format!("Least power against {}; free, it is {:.4}", parameter.name, optimum.point[args.quantity]);
    let mut answer = subject.answer("front", format!("{lead} with P+ = {:.5}", optimum.outputs[3]));
    answer.facts.insert("quantity".into(), parameter.name.into());
    answer.facts.insert("least_power".into(), optimum.outputs[3].into());
    answer.columns = vec![
        Column::new("limit", "limit", 3),
        Column::new("side", "side", 0),
        Column::new("power", "P+", 5),
        Column::new("power_w", "P [W]", 5),
        Column::new("price", "price", 5),
    ];
    answer.columns.extend(TABLE.iter().map(|p| Column::new(p.name, p.symbol, 2)));
    let row = |(side, point): &(Side, FrontPoint)| {
        let width = if *side == Side::Upper { point.limit - lower } else { upper - point.limit };
        let found = |of: &dyn Fn(&LocalOptimum) -> f64| Cell::Number(point.optimum.as_ref().map(of));
        let price = |o: &LocalOptimum| o.bound_multipliers[args.quantity] / width;
        let mut row = vec![
            point.limit.into(),
            Cell::Word(if *side == Side::Upper { "at-most" } else { "at-least" }),
            found(&|o| o.outputs[3]),
            found(&|o| o.outputs[3] * subject.insect.power_scale_w),
            point.optimum.as_ref().map_or(Cell::Number(None), |o| price(o).into()),
        ];
        row.extend((0..TABLE.len()).map(|i| found(&|o| o.point[i])));
        row
    };
    answer.rows = points.iter().map(row).collect();
    Ok(answer)
}

/// Least power by the surrogate, exactly.
fn least_power(subject: &Subject) -> Result<f64> {
    let found = minimise(&subject.flight(), &subject.how.sqp, &mut |_| ControlFlow::Continue(()));
    Ok(found.context(NOT_IN_TRIM)?.best().outputs[3])
}

/// The genetic algorithm with other weights.
pub fn sweep(subject: &Subject, args: &SweepArgs) -> Result<Answer> {
    let power = least_power(subject)?;
    let (weight, name) = match args.weight {
        WeightChoice::R => (Weight::Trim, "r"),
        WeightChoice::S => (Weight::Bounds, "s"),
    };
    let ga = GaSettings { population: args.population, generations: args.generations, ..subject.how.ga };
    let mut answer = subject.answer("sweep", format!("Fitness against {name}; the exact optimum is {power:.6}"));
    let facts = [("weight", name.into()), ("least_power", power.into()), ("population", args.population.into())];
    answer.facts.extend(facts.map(|(name, value)| (name.to_owned(), value)));
    answer.facts.insert("generations".into(), args.generations.into());
    answer.columns = vec![
        Column::new(name, name, 2),
        Column::new("fitness", "fitness", 5),
        Column::new("penalty", "penalty", 7),
        Column::new("above_the_optimum", "above the optimum", 6),
    ];
    for value in &args.weights {
        note(format_args!("{name} = {value}"));
        let only = (weight, std::slice::from_ref(value));
        let rows = subject.penalised(|p| penalty_sweep(p, &ga, &subject.how.simplex, only, power))?;
        answer.rows.extend(rows.iter().map(|r| [r.weight, r.fitness, r.penalty, r.excess].map(Cell::from).to_vec()));
    }
    Ok(answer)
}

/// The genetic algorithm with other populations.
pub fn population(subject: &Subject, args: &PopulationArgs) -> Result<Answer> {
    let power = least_power(subject)?;
    let ga = GaSettings { generations: args.generations, ..subject.how.ga };
    let seeds: Vec<u64> = (0..args.runs).map(|run| subject.seed.wrapping_add(run)).collect();
    let lead = format!("Fitness against the population, {} runs each; the exact optimum is {power:.6}", args.runs);
    let mut answer = subject.answer("population", lead);
    answer.facts.insert("least_power".into(), power.into());
    answer.facts.insert("generations".into(), args.generations.into());
    let wide = ["least", "mean", "most"].map(|name| Column::new(name, name, 5));
    answer.columns = std::iter::once(Column::new("population", "population", 0)).chain(wide).collect();
    answer.columns.extend(seeds.iter().map(|seed| Column::new(format!("seed_{seed}"), format!("seed {seed}"), 5)));
    for population in &args.populations {
        note(format_args!("population {population}"));
        let only = std::slice::from_ref(population);
        for row in subject.penalised(|p| population_sweep(p, &ga, &subject.how.simplex, only, &seeds))? {
            let all = &row.fitnesses;
            let (least, most) = all.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), f| (l.min(*f), m.max(*f)));
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            let numbers = [row.population as f64, least, mean, most];
            answer.rows.push(numbers.iter().chain(all).map(|v| Cell::from(*v)).collect());
        }
    }
    Ok(answer)
}
