//! `manduca simulate`.

use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result};
use manduca_numerics::cases::{CASES, Case};
use manduca_numerics::parameters::find;
use manduca_protocol::names::unknown_parameter;
use manduca_protocol::paper;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::resolve;
use manduca_protocol::task::SimulateOutcome;
use serde::Serialize;

use super::record::Records;
use crate::args::SimulateArgs;
use crate::exit::refused;
use crate::output::Output;
use crate::render::simulation::{Asked, Flown, all, one};

/// Flies one case, or all of them.
pub fn simulate(args: &SimulateArgs) -> Result<ExitCode> {
    let spec = args.model.spec();
    let model = resolve::model(&spec, "").map_err(|faults| told(&faults))?;
    let wanted: Vec<&Case> = CASES.iter().filter(|case| args.case == "all" || case.name == args.case).collect();
    let records = Records::new(&args.record, wanted.len() > 1)?;
    let mut flown = Vec::new();
    for case in wanted {
        let parameters = changed(case, &args.set)?;
        resolve::parameters(&parameters, "").map_err(|faults| told(&faults))?;
        let unchanged = (parameters.0 == case.parameters).then_some(case.name);
        let asked = Asked { case: unchanged, parameters, spec: &spec, model: &model };
        // A changed stroke is no longer the one the paper has numbers for, nor is that of another animal.
        let paper = Some(case).filter(|_| unchanged.is_some() && paper::is_papers(&model));
        flown.push((fly(asked, case, &records)?, case, paper));
    }
    let mut out = Output::stdout();
    match &flown[..] {
        [(flown, ..)] if args.json => out.json(flown)?,
        _ if args.json => {
            #[derive(Serialize)]
            struct Cases<'a> {
                cases: Vec<&'a Flown>,
            }
            out.json(&Cases { cases: flown.iter().map(|(flown, ..)| flown).collect() })?;
        }
        [(flown, _, paper)] => one(&mut out, flown, *paper)?,
        _ => all(&mut out, &flown)?,
    }
    Ok(ExitCode::SUCCESS)
}

fn told(faults: &[FieldProblem]) -> anyhow::Error {
    refused(
        faults.iter().map(|f| f.to_string().trim_start_matches('/').to_owned()).collect::<Vec<_>>().join("\n       "),
    )
}

fn changed(case: &Case, set: &[(String, f64)]) -> Result<ParameterValues> {
    let mut parameters = case.parameters;
    for (name, value) in set {
        let place = find(name).ok_or_else(|| refused(format!("--set {name}: {}", unknown_parameter(name))))?;
        parameters[place] = *value;
    }
    Ok(ParameterValues(parameters))
}

fn fly(asked: Asked<'_>, case: &Case, records: &Records) -> Result<Flown> {
    let start = Instant::now();
    let simulation = asked.model.simulation(&asked.parameters);
    let outcome = SimulateOutcome::of(records.fly(&simulation, case.name)?).context("non-finite result")?;
    Ok(Flown::new(asked, outcome, start.elapsed().as_secs_f64()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_go_by_name_or_symbol() {
        let set = [("f".to_owned(), 30.0), ("K".to_owned(), 0.5), ("beta".to_owned(), 7.0)];
        let parameters = changed(&CASES[0], &set).unwrap().0;
        assert_eq!((parameters[0], parameters[8], parameters[1]), (30.0, 0.5, 7.0));
        assert!(changed(&CASES[0], &[("colour".into(), 1.0)]).unwrap_err().to_string().contains("sweep_shape"));
    }
}
