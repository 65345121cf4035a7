//! A study's answer, beside the paper's.

use std::io;

use manduca_numerics::cases::{Case, case};
use manduca_numerics::parameters::OUTPUTS;
use manduca_protocol::search::Standing;
use manduca_protocol::task::Optimality;
use manduca_protocol::view::{OptimumResult, SearchView, StageSeconds, StudyResult};

use super::{dash, estimate, estimates, fixed, parameter_rows, scaled};
use crate::output::{Output, counted};
use crate::progress::span;

/// Gap of prediction and simulation, scaled, from which on an optimum is to be doubted.
const DOUBTFUL: f64 = 0.1;
/// P0 of the paper's hawkmoth, mW, by which its powers are divided here.
const PAPER_P0_MW: f64 = 84.2;

/// Optima beside the paper's, then what they took.
pub fn result(out: &mut Output, result: &StudyResult) -> io::Result<()> {
    for optimum in &result.optimisations {
        one(out, optimum)?;
        out.line("")?;
    }
    if let Some(surrogate) = &result.surrogate {
        let errors =
            OUTPUTS.iter().zip(scaled(&surrogate.rmse)).map(|((_, _, symbol, _), e)| format!("{symbol} {e:.4}"));
        out.line(format_args!("surrogate test errors (rms): {}", errors.collect::<Vec<_>>().join(", ")))?;
    }
    let counts = result.samples;
    let mut samples = format!("samples   {} flown", counts.succeeded);
    for (count, what) in [(counts.infeasible, "infeasible"), (counts.dead, "given up")] {
        if count > 0 {
            samples += &format!(", {count} {what}");
        }
    }
    if counts.succeeded + counts.infeasible + counts.dead > 0 {
        out.line(samples)?;
    }
    out.line(format_args!("time      {}", stages(&result.stages_s)))?;
    disowned(out, result.disowned_results)
}

/// Says so where an answer rests on results that are not believed.
pub fn disowned(out: &mut Output, results: u64) -> io::Result<()> {
    if results == 0 {
        return Ok(());
    }
    out.line(format_args!("DOUBTFUL  all of this rests on {} that are disowned", counted(results, "result")))
}

/// Wall time of each stage.
pub fn stages(s: &StageSeconds) -> String {
    let all = [
        ("sampling", s.sampling),
        ("training", s.training),
        ("optimising", s.optimising),
        ("verifying", s.verifying),
        ("refining", s.refining),
    ];
    let known = all.into_iter().filter_map(|(name, time)| Some(format!("{name} {}", span(time?))));
    known.collect::<Vec<_>>().join(", ")
}

fn one(out: &mut Output, optimum: &OptimumResult) -> io::Result<()> {
    let paper = optimum.paper.as_deref().and_then(case);
    match paper {
        Some(paper) => out.heading(format_args!("{} beside {}", optimum.name, paper.title))?,
        None => out.heading(&optimum.name)?,
    }
    let found = optimum.parameters.map(|p| p.0);
    let refined = optimum.refined.as_ref().and_then(|r| r.standing.best.as_ref());
    let refined = refined.map(|best| Some(best.parameters.0));
    let points: Vec<_> = [found].into_iter().chain(refined).chain(paper.map(|p| Some(p.parameters))).collect();
    let first = if optimum.breeding.is_some() { "generations'" } else { "surrogate's" };
    let columns = if refined.is_some() { vec![first, "refined"] } else { vec!["this study"] };
    out.table(&header("parameter", &columns, paper), &parameter_rows(&points))?;
    out.line("")?;
    // Generations do not predict, they fly.
    let predicted = if optimum.breeding.is_some() { "searching" } else { "predicted" };
    let columns = match refined {
        Some(_) => vec![predicted, "simulated ± se", "refined: predicted", "simulated ± se"],
        None => vec![predicted, "simulated ± se"],
    };
    out.table(&header("mean", &columns, paper), &means(optimum, paper))?;
    for warning in &optimum.warnings {
        out.line(format_args!("warning: {warning}"))?;
    }
    if let Some(search) = &optimum.breeding {
        out.line(breeding(search))?;
    }
    if let Some(reason) = &optimum.infeasible {
        out.line(format_args!("the optimum cannot be flown: {reason}"))?;
    }
    if let Some(doubt) = doubt(optimum) {
        out.line(doubt)?;
    }
    // Each line names the stroke it is of.
    let of = format!("{first} optimum");
    if let Some(known) = &optimum.optimality {
        optimality(out, &of, known)?;
    }
    room(out, &of, optimum.clearance_mm)?;
    if let Some(search) = &optimum.refined {
        out.line(refinement(search))?;
        if let Some(line) = trimmed(search) {
            out.line(format_args!("refined optimum: {line}"))?;
        }
    }
    room(out, "refined optimum", optimum.refined_clearance_mm)
}

/// How far the wings stay apart.
fn room(out: &mut Output, of: &str, clearance_mm: Option<f64>) -> io::Result<()> {
    match clearance_mm {
        Some(mm) if mm < 0.0 => out.line(format_args!("{of}: the wings cross the plane of symmetry by {:.2} mm", -mm)),
        Some(mm) => out.line(format_args!("{of}: the wings keep {mm:.2} mm from the plane of symmetry")),
        None => Ok(()),
    }
}

/// What constraints cost and how exact the optimum is.
fn optimality(out: &mut Output, of: &str, known: &Optimality) -> io::Result<()> {
    let prices = &known.multipliers;
    out.line(format_args!(
        "{of}: P+ rises by {} per unit of L+, {} of D+, {} of M+, {} per mm of clearance",
        fixed(prices.lift, 4),
        fixed(prices.drag, 4),
        fixed(prices.pitch_moment, 4),
        fixed(prices.clearance_per_mm, 4)
    ))?;
    out.line(format_args!(
        "{of}: {} of {} descents converged, to {} {}; KKT residual {:.1e}, violation {:.1e}",
        known.converged,
        known.starts,
        known.optima.len(),
        if known.optima.len() == 1 { "optimum" } else { "optima" },
        known.kkt_residual,
        known.violation
    ))
}

fn header(first: &str, columns: &[&str], paper: Option<&Case>) -> Vec<String> {
    [first].iter().chain(columns).chain(paper.map(|_| &"paper")).map(|s| (*s).to_owned()).collect()
}

/// What generations cost and how they ended.
pub fn breeding(search: &SearchView) -> String {
    let Standing { rounds, simulations, fitness, .. } = &search.standing;
    let best = fitness.map_or_else(String::new, |f| format!(", best fitness {f:.5}"));
    let ended = search.ended.as_deref().unwrap_or("they go on");
    format!("{rounds} generations, {simulations} strokes flown{best}: {ended}")
}

/// Power at exact trim, and what trim costs.
pub fn trimmed(search: &SearchView) -> Option<String> {
    let (power, prices) = search.standing.trimmed_power.zip(search.standing.prices.as_ref())?;
    let [lift, drag, moment] = [prices.lift, prices.drag, prices.pitch_moment].map(|p| fixed(p, 3));
    Some(format!("P+ in exact trim {power:.4}: it rises by {lift} per unit of L+, {drag} of D+, {moment} of M+"))
}

/// What refining cost and how it ended.
pub fn refinement(search: &SearchView) -> String {
    let Standing { rounds, simulations, .. } = &search.standing;
    let ended = search.ended.as_deref().unwrap_or("it goes on");
    let (flown, rounds) = (counted((*simulations).into(), "simulation"), counted((*rounds).into(), "round"));
    format!("refined by {flown} in {rounds}: {ended}")
}

/// An optimum is worth what the network knew there, and the re-simulation tells.
fn doubt(optimum: &OptimumResult) -> Option<String> {
    if optimum.breeding.is_some() || optimum.refined.as_ref().is_some_and(|r| r.converged) {
        return None;
    }
    let (predicted, simulated) = (scaled(optimum.predicted.as_ref()?), estimates(optimum.simulated.as_ref()?));
    let gaps = predicted.iter().zip(&simulated).map(|(p, s)| (p - s.mean).abs());
    let worst = gaps.fold(0.0, f64::max);
    (worst > DOUBTFUL)
        .then(|| format!("the network is off by {worst:.2} here: more samples would make a better optimum"))
}

fn means(optimum: &OptimumResult, paper: Option<&Case>) -> Vec<Vec<String>> {
    let predicted = optimum.predicted.as_ref().map(scaled);
    let simulated = optimum.simulated.as_ref().map(estimates);
    let standing = optimum.refined.as_ref().map(|r| &r.standing);
    let again = standing.map(|s| {
        let simulated = s.best.as_ref().and_then(|best| best.scaled.as_ref()).map(estimates);
        (s.predicted.as_ref().map(scaled), simulated)
    });
    let published = paper
        .map(|paper| [Some(paper.paper_lift), Some(0.0), Some(0.0), paper.paper_power_mw.map(|p| p / PAPER_P0_MW)]);
    let mut rows: Vec<Vec<String>> = OUTPUTS
        .iter()
        .enumerate()
        .map(|(i, (name, _, symbol, _))| {
            let mut row = vec![
                format!("{symbol} {}", name.replace('_', " ")),
                predicted.map_or_else(dash, |p| fixed(p[i], 4)),
                simulated.map_or_else(dash, |s| estimate(&s[i])),
            ];
            if let Some((predicted, simulated)) = &again {
                row.push(predicted.map_or_else(dash, |p| fixed(p[i], 4)));
                row.push(simulated.as_ref().map_or_else(dash, |s| estimate(&s[i])));
            }
            row.extend(published.map(|published| published[i].map_or_else(dash, |p| format!("{p:.3}"))));
            row
        })
        .collect();
    let per_lift = optimum.power_per_lift_w_per_n.map_or_else(dash, |p| format!("{p:.3}"));
    let mut last = vec!["P/L [W/N]".into(), dash(), per_lift];
    if again.is_some() {
        last.push(dash());
        last.push(standing.and_then(|s| s.power_per_lift_w_per_n).map_or_else(dash, |p| format!("{p:.3}")));
    }
    last.extend(paper.map(|paper| format!("{:.2}", paper.paper_power_per_lift)));
    rows.push(last);
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::capture;
    use manduca_protocol::ids::StudyId;
    use manduca_protocol::point::ParameterValues;
    use manduca_protocol::task::{Estimate, Prices, Scaled, ScaledEstimates};
    use manduca_protocol::view::{OptimumStatus, SampleCounts, StudyState};

    #[test]
    fn the_answer_stands_beside_the_papers() {
        let at = |mean| Estimate { mean, se: 0.002 };
        let optimum = OptimumResult {
            name: "case-I".into(),
            status: OptimumStatus::Verified,
            parameters: Some(ParameterValues([26.0, 1.5, -4.0, 15.0, 1.0, 60.0, 0.0, 59.0, 0.02, 1.25])),
            predicted: Some(Scaled { lift: 1.0, drag: 0.0, pitch_moment: 0.0, power: 0.81 }),
            simulated: Some(ScaledEstimates {
                lift: at(0.98),
                drag: at(0.01),
                pitch_moment: at(-0.02),
                power: at(0.8),
            }),
            infeasible: None,
            power_per_lift_w_per_n: Some(4.56),
            stopped: None,
            clearance_mm: Some(0.5),
            refined_clearance_mm: None,
            clearance_margin_mm: Some(0.0),
            paper: Some("optimum-1".into()),
            warnings: vec!["no stroke in trim was found".into()],
            breeding: None,
            optimality: Some(Optimality {
                multipliers: Prices {
                    lift: 0.6012,
                    drag: 0.1,
                    pitch_moment: -0.2,
                    clearance_per_mm: 0.013,
                    bounds: ParameterValues([0.0; 10]),
                },
                kkt_residual: 3e-11,
                violation: 1e-12,
                starts: 200,
                converged: 190,
                optima: Vec::new(),
            }),
            refined: None,
        };
        assert_eq!(doubt(&optimum), None);
        let wrong = Some(Scaled { lift: 1.2, drag: 0.0, pitch_moment: 0.0, power: 0.81 });
        assert!(doubt(&OptimumResult { predicted: wrong, ..optimum.clone() }).unwrap().contains("0.22"));
        let study = StudyResult {
            study: StudyId::new(),
            state: StudyState::Succeeded,
            samples: SampleCounts { succeeded: 300, infeasible: 2, dead: 0 },
            surrogate: None,
            optimisations: vec![optimum],
            stages_s: StageSeconds { sampling: Some(61.0), ..StageSeconds::default() },
            solver_version: "1".into(),
            disowned_results: 3,
        };
        let (mut out, captured) = capture::output();
        result(&mut out, &study).unwrap();
        let text = captured.text();
        for part in [
            "25.3",
            "0.9800 ± 0.0020",
            "4.560",
            "4.50",
            "300 flown, 2 infeasible",
            "0.6012 per unit of L+",
            "surrogate's optimum: 190 of 200 descents",
            "surrogate's optimum: the wings keep 0.50 mm",
            "warning: no stroke in trim was found",
            "beside optimum I",
            "3.0e-11",
            "sampling 1 min 01 s",
            "3 results",
        ] {
            assert!(text.contains(part), "{part} in\n{text}");
        }
    }
}
