//! `manduca simulate`.

use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result};
use manduca_numerics::cases::{CASES, Case};
use manduca_numerics::parameters::{TABLE, index};
use manduca_protocol::point::ParameterValues;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::resolve::{self, ResolvedModel};
use manduca_protocol::task::SimulateOutcome;
use serde::Serialize;

use super::record::Records;
use crate::args::SimulateArgs;
use crate::exit::refused;
use crate::output::Output;
use crate::render::simulation::{Flown, all, one};

/// Flies one case, or all of them.
pub fn simulate(args: &SimulateArgs) -> Result<ExitCode> {
    let model = resolve::model(&args.model.spec(), "").map_err(|faults| told(&faults))?;
    let wanted: Vec<&Case> = CASES.iter().filter(|case| args.case == "all" || case.name == args.case).collect();
    let records = Records::new(&args.record, wanted.len() > 1)?;
    let mut flown = Vec::new();
    for case in wanted {
        let changed = changed(case, &args.set)?;
        resolve::parameters(&changed, "").map_err(|faults| told(&faults))?;
        flown.push((fly(&model, case, changed, &records)?, case));
    }
    let mut out = Output::stdout();
    match &flown[..] {
        [(flown, _)] if args.json => out.json(flown)?,
        _ if args.json => {
            #[derive(Serialize)]
            struct Cases<'a> {
                cases: Vec<&'a Flown>,
            }
            out.json(&Cases { cases: flown.iter().map(|(flown, _)| flown).collect() })?;
        }
        // A changed stroke is no longer the one the paper has numbers for.
        [(flown, case)] => one(&mut out, flown, flown.case.and(Some(case)))?,
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
        let place = index(name).or_else(|| TABLE.iter().position(|p| p.symbol == name));
        let place = place.ok_or_else(|| {
            let known: Vec<_> = TABLE.iter().map(|p| p.name).collect();
            refused(format!("--set {name}: unknown parameter; known are {}", known.join(", ")))
        })?;
        parameters[place] = *value;
    }
    Ok(ParameterValues(parameters))
}

fn fly(model: &ResolvedModel, case: &Case, parameters: ParameterValues, records: &Records) -> Result<Flown> {
    let start = Instant::now();
    let outcome =
        SimulateOutcome::of(records.fly(&model.simulation(&parameters), case.name)?).context("non-finite result")?;
    let unchanged = (parameters.0 == case.parameters).then_some(case.name);
    Ok(Flown::new(unchanged, parameters, outcome, start.elapsed().as_secs_f64()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_go_by_name_or_symbol() {
        let set = [("frequency_hz".to_owned(), 30.0), ("K".to_owned(), 0.5)];
        let parameters = changed(&CASES[0], &set).unwrap().0;
        assert_eq!((parameters[0], parameters[8], parameters[1]), (30.0, 0.5, CASES[0].parameters[1]));
        assert!(changed(&CASES[0], &[("colour".into(), 1.0)]).unwrap_err().to_string().contains("sweep_shape"));
    }
}
