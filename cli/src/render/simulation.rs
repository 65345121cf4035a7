//! A simulated stroke, beside the paper's where there is one.

use std::collections::BTreeMap;
use std::io;

use manduca_numerics::cases::Case;
use manduca_numerics::parameters::OUTPUTS;
use manduca_numerics::simulation::Model;
use manduca_numerics::table::Table;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::resolve::ResolvedModel;
use manduca_protocol::study::ModelSpec;
use manduca_protocol::task::{JointPower, JointPowers, MeansMessage, ScaledEstimates, SimulateOutcome};
use serde::Serialize;

use super::{dash, estimate, estimates, fixed, label, number};
use crate::output::Output;

/// A simulated stroke, as it is printed with `--json`.
#[derive(Debug, Serialize)]
pub struct Flown {
    /// Case it started from, when it is exactly that case.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub case: Option<&'static str>,
    /// The stroke.
    pub parameters: ParameterValues,
    /// The model as a study's `[model]` says it: with the stroke and the version of the numbers all that decides.
    pub model: ModelSpec,
    /// The model with every default.
    pub settings: Settings,
    /// `ok` or `infeasible`.
    pub outcome: &'static str,
    /// Why it is infeasible.
    pub reason: Option<String>,
    /// SI units.
    pub means: Option<MeansMessage>,
    /// Scaled.
    pub scaled: Option<ScaledEstimates>,
    /// Power per joint.
    pub joints: Option<JointPowers>,
    /// W/N.
    pub power_per_lift_w_per_n: Option<f64>,
    /// Strokes in the means.
    pub strokes_averaged: Option<u32>,
    /// Wall time, s.
    pub wall_s: f64,
    /// Version of the numbers.
    pub solver_version: String,
    /// Instruction level.
    pub level: &'static str,
}

/// Every number of a model.
#[derive(Debug, Clone, Serialize)]
pub struct Settings {
    /// Of the solver.
    pub solver: BTreeMap<&'static str, f64>,
    /// Of the insect, SI units.
    pub insect: BTreeMap<&'static str, f64>,
}

impl Settings {
    /// Of a model, in full.
    pub fn of(model: &ResolvedModel) -> Self {
        Self {
            solver: match &model.model {
                Model::Uvlm(settings) => settings.entries().collect(),
                Model::QuasiSteady(settings) => settings.entries().collect(),
            },
            insect: model.insect.entries().collect(),
        }
    }
}

/// A stroke and the model it is flown with.
#[derive(Debug, Clone, Copy)]
pub struct Asked<'a> {
    /// The case it is exactly, if any.
    pub case: Option<&'static str>,
    /// The stroke.
    pub parameters: ParameterValues,
    /// The model as it was asked for.
    pub spec: &'a ModelSpec,
    /// The same, checked.
    pub model: &'a ResolvedModel,
}

impl Flown {
    /// From what the solver says.
    pub fn new(asked: Asked<'_>, outcome: SimulateOutcome, wall_s: f64) -> Self {
        let mut flown = Self {
            case: asked.case,
            parameters: asked.parameters,
            model: asked.spec.clone(),
            settings: Settings::of(asked.model),
            outcome: "ok",
            reason: None,
            means: None,
            scaled: None,
            joints: None,
            power_per_lift_w_per_n: None,
            strokes_averaged: None,
            wall_s,
            solver_version: manduca_numerics::simulation::SOLVER_VERSION.into(),
            level: manduca_numerics::simulation::level(),
        };
        match outcome {
            SimulateOutcome::Ok { means, scaled, joints, power_per_lift_w_per_n, strokes_averaged } => {
                flown.means = Some(means);
                flown.scaled = Some(scaled);
                flown.joints = Some(joints);
                flown.power_per_lift_w_per_n = power_per_lift_w_per_n;
                flown.strokes_averaged = Some(strokes_averaged);
            }
            SimulateOutcome::Infeasible { reason } => {
                flown.outcome = "infeasible";
                flown.reason = Some(reason);
            }
        }
        flown
    }
}

/// One stroke in full.
pub fn one(out: &mut Output, flown: &Flown, paper: Option<&Case>) -> io::Result<()> {
    let rows: Vec<_> = manduca_numerics::parameters::TABLE
        .iter()
        .zip(flown.parameters.0)
        .map(|(p, x)| vec![label(p), number(x), p.meaning.to_owned()])
        .collect();
    out.table(&["parameter", "value", "meaning"].map(String::from), &rows)?;
    out.line("")?;
    let (Some(means), Some(scaled), Some(joints)) = (&flown.means, &flown.scaled, &flown.joints) else {
        return out.line(format_args!("infeasible: {}", flown.reason.as_deref().unwrap_or("no reason given")));
    };
    let columns = ["mean", "scaled ± se", "SI ± se"].iter().chain(paper.map(|_| &"paper")).map(|s| (*s).to_owned());
    out.table(&columns.collect::<Vec<_>>(), &mean_rows(flown, means, scaled, paper))?;
    out.line("")?;
    out.table(&["power [mW]", "aerodynamic", "inertial", "required"].map(String::from), &joint_rows(joints))?;
    out.line(format_args!(
        "strokes averaged: {}; {:.2} s; solver version {}, {}",
        flown.strokes_averaged.unwrap_or_default(),
        flown.wall_s,
        flown.solver_version,
        flown.level
    ))
}

fn mean_rows(flown: &Flown, means: &MeansMessage, scaled: &ScaledEstimates, paper: Option<&Case>) -> Vec<Vec<String>> {
    let si = [
        (means.lift_n, 1e3, "mN"),
        (means.drag_n, 1e3, "mN"),
        (means.pitch_moment_nm, 1e6, "µN m"),
        (means.power_w, 1e3, "mW"),
    ];
    let published = paper.map_or([const { None }; 4], |case| {
        [Some(format!("{:.3}", case.paper_lift)), None, None, case.paper_power_mw.map(|p| format!("{p:.1} mW"))]
    });
    let rows = OUTPUTS.iter().zip(estimates(scaled)).zip(si).zip(published);
    let mut rows: Vec<Vec<String>> = rows
        .map(|((((name, _, symbol, _), scaled), (e, factor, unit)), published)| {
            let si = format!("{:.3} ± {:.3} {unit}", e.mean * factor, e.se * factor);
            let row = [format!("{symbol} {}", name.replace('_', " ")), estimate(&scaled), si];
            row.into_iter().chain(paper.map(|_| published.unwrap_or_else(dash))).collect()
        })
        .collect();
    let per_lift = flown.power_per_lift_w_per_n.map_or_else(dash, |p| format!("{p:.3} W/N"));
    let theirs = paper.map(|case| format!("{:.2} W/N", case.paper_power_per_lift));
    rows.push(["P/L".into(), dash(), per_lift].into_iter().chain(theirs).collect());
    rows
}

fn joint_rows(joints: &JointPowers) -> Vec<Vec<String>> {
    let all = [("sweep", joints.sweep), ("elevation", joints.elevation), ("rotation", joints.rotation)];
    let row = |name: &str, values: [f64; 3]| {
        std::iter::once(name.to_owned()).chain(values.map(|w| fixed(w * 1e3, 2))).collect::<Vec<_>>()
    };
    let parts = |j: JointPower| [j.aerodynamic_w, j.inertial_w, j.required_w];
    let mut rows: Vec<_> = all.iter().map(|(name, joint)| row(name, parts(*joint))).collect();
    let sum = |i: usize| all.iter().map(|(_, joint)| parts(*joint)[i]).sum();
    rows.push(row("sum", std::array::from_fn(sum)));
    rows
}

/// All cases, one row each.
///
/// The paper's numbers stand beside those of its own model.
pub fn all(out: &mut Output, flown: &[(Flown, &Case, Option<&Case>)]) -> io::Result<()> {
    let header = ["case", "L/W", "paper", "D/W", "M/(W c)", "P [mW]", "paper", "P/L [W/N]", "paper", "seconds"];
    let value = |v: Option<f64>, digits: usize| v.map_or_else(dash, |v| fixed(v, digits));
    let row = |(flown, begun, case): &(Flown, &Case, Option<&Case>)| {
        let scaled = flown.scaled.as_ref();
        vec![
            begun.name.to_owned(),
            value(scaled.map(|s| s.lift.mean), 3),
            value(case.map(|case| case.paper_lift), 3),
            value(scaled.map(|s| s.drag.mean), 3),
            value(scaled.map(|s| s.pitch_moment.mean), 3),
            value(flown.means.as_ref().map(|m| m.power_w.mean * 1e3), 1),
            value(case.and_then(|case| case.paper_power_mw), 1),
            value(flown.power_per_lift_w_per_n, 2),
            value(case.map(|case| case.paper_power_per_lift), 2),
            value(Some(flown.wall_s), 2),
        ]
    };
    out.table(&header.map(String::from), &flown.iter().map(row).collect::<Vec<_>>())?;
    for (flown, begun, _) in flown {
        if let Some(reason) = &flown.reason {
            out.line(format_args!("{}: {reason}", begun.name))?;
        }
    }
    Ok(())
}
