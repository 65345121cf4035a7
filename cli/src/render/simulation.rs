//! A simulated stroke, beside the paper's where there is one.

use std::io;

use manduca_numerics::cases::Case;
use manduca_numerics::parameters::OUTPUTS;
use manduca_protocol::point::ParameterValues;
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

impl Flown {
    /// From what the solver says.
    pub fn new(case: Option<&'static str>, parameters: ParameterValues, outcome: SimulateOutcome, wall_s: f64) -> Self {
        let mut flown = Self {
            case,
            parameters,
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
    out.table(&["mean", "scaled ± se", "SI ± se", "paper"].map(String::from), &mean_rows(flown, means, scaled, paper))?;
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
            vec![format!("{symbol} {}", name.replace('_', " ")), estimate(&scaled), si, published.unwrap_or_else(dash)]
        })
        .collect();
    rows.push(vec![
        "P/L".into(),
        dash(),
        flown.power_per_lift_w_per_n.map_or_else(dash, |p| format!("{p:.3} W/N")),
        paper.map_or_else(dash, |case| format!("{:.2} W/N", case.paper_power_per_lift)),
    ]);
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
pub fn all(out: &mut Output, flown: &[(Flown, &Case)]) -> io::Result<()> {
    let header = ["case", "L/W", "paper", "D/W", "M/(W c)", "P [mW]", "paper", "P/L [W/N]", "paper", "seconds"];
    let row = |(flown, case): &(Flown, &Case)| {
        let scaled = flown.scaled.as_ref();
        let value = |v: Option<f64>, digits: usize| v.map_or_else(dash, |v| fixed(v, digits));
        vec![
            case.name.to_owned(),
            value(scaled.map(|s| s.lift.mean), 3),
            value(Some(case.paper_lift), 3),
            value(scaled.map(|s| s.drag.mean), 3),
            value(scaled.map(|s| s.pitch_moment.mean), 3),
            value(flown.means.as_ref().map(|m| m.power_w.mean * 1e3), 1),
            value(case.paper_power_mw, 1),
            value(flown.power_per_lift_w_per_n, 2),
            value(Some(case.paper_power_per_lift), 2),
            value(Some(flown.wall_s), 2),
        ]
    };
    out.table(&header.map(String::from), &flown.iter().map(row).collect::<Vec<_>>())?;
    for (flown, case) in flown {
        if let Some(reason) = &flown.reason {
            out.line(format_args!("{}: {reason}", case.name))?;
        }
    }
    Ok(())
}
