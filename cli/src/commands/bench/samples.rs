//! Samples to train on: a stand-in, or a dataset as `manduca dataset` writes it.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};
use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::{Clearance, ElevationPhase};
use manduca_numerics::parameters::{Bounds, OUTPUTS, TABLE};
use manduca_numerics::quasi_steady;
use manduca_numerics::sampling::sample;
use manduca_numerics::simulation::{BodyVelocity, Model, Simulation, simulate};
use manduca_numerics::surrogate::Sample;
use manduca_protocol::task::SimulateOutcome;
use manduca_protocol::view::DatasetRow;

/// Strokes of the paper's box, flown by blade elements: as many numbers as a study has, at no cost.
pub fn stand_in(count: usize) -> Result<Vec<Sample>> {
    let (insect, elevation_phase) = (Insect::default(), ElevationPhase::Plus);
    let clearance = Clearance::new(&insect, elevation_phase);
    let settings = quasi_steady::Settings { blade_elements: 20, steps_per_stroke: 144, ..Default::default() };
    let fly = |index: usize| {
        let x = sample(&Bounds::default(), 1, index as u64, &|x| clearance.of(x) >= 0.0)?;
        let model = Model::QuasiSteady(settings);
        let body_velocity = BodyVelocity::default();
        let stroke = Simulation { model, insect, parameters: x, elevation_phase, elastic_storage: 0.0, body_velocity };
        Some(Sample { x, y: simulate(&stroke).ok()?.scaled.map(|e| e.mean), se: [0.0; 4] })
    };
    (0..count).map(fly).collect::<Option<_>>().context("no stroke of the paper's box is feasible")
}

/// The strokes of a dataset which have means: CSV where the name ends so, else one JSON object per line.
pub fn read(path: &Path) -> Result<Vec<Sample>> {
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let csv = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv"));
    let samples = if csv { from_csv(&text) } else { text.lines().filter_map(|l| from_json(l).transpose()).collect() };
    samples.with_context(|| format!("{} is not a dataset of manduca", path.display()))
}

fn from_json(line: &str) -> Result<Option<Sample>> {
    let row: DatasetRow = serde_json::from_str(line)?;
    let SimulateOutcome::Ok { scaled, .. } = row.result.outcome else { return Ok(None) };
    let all = [scaled.lift, scaled.drag, scaled.pitch_moment, scaled.power];
    Ok(Some(Sample { x: row.parameters.0, y: all.map(|e| e.mean), se: all.map(|e| e.se) }))
}

fn from_csv(text: &str) -> Result<Vec<Sample>> {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().context("no header")?.split(',').collect();
    let place = |name: &str| header.iter().position(|h| *h == name).with_context(|| format!("no column {name}"));
    let xs = TABLE.iter().map(|p| place(p.name)).collect::<Result<Vec<_>>>()?;
    let ys = OUTPUTS.iter().map(|o| place(o.0)).collect::<Result<Vec<_>>>()?;
    let ses = OUTPUTS.iter().map(|o| place(&format!("{}_se", o.0))).collect::<Result<Vec<_>>>()?;
    let outcome = place("outcome")?;
    let mut samples = Vec::new();
    for (number, line) in (2..).zip(lines) {
        let cells: Vec<&str> = line.split(',').collect();
        // A reason with a comma is quoted, and belongs to a stroke without means.
        if cells.get(outcome) != Some(&"ok") {
            continue;
        }
        if cells.len() != header.len() {
            bail!("line {number} has {} cells, not {}", cells.len(), header.len());
        }
        let value = |i: usize| cells[i].parse::<f64>().with_context(|| format!("line {number}, {}", header[i]));
        let mut sample = Sample { x: [0.0; 10], y: [0.0; 4], se: [0.0; 4] };
        let places = [(&xs, &mut sample.x[..]), (&ys, &mut sample.y[..]), (&ses, &mut sample.se[..])];
        for (places, to) in places {
            for (to, i) in to.iter_mut().zip(places) {
                *to = value(*i)?;
            }
        }
        samples.push(sample);
    }
    Ok(samples)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_name_and_strokes_without_means_left_out() {
        let names: Vec<&str> = TABLE.iter().map(|p| p.name).collect();
        let outputs: Vec<String> = OUTPUTS.iter().map(|o| format!("{0},{0}_se", o.0)).collect();
        let header = format!("sample,{},outcome,{}", names.join(","), outputs.join(","));
        let good = "0,1,2,3,4,5,6,7,8,9,10,ok,11,0.1,12,0.2,13,0.3,14,0.4";
        let bad = "1,1,2,3,4,5,6,7,8,9,10,infeasible,,,,,,,,";
        let samples = from_csv(&[&header, good, bad].join("\r\n")).unwrap();
        let x = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0];
        assert_eq!(samples, [Sample { x, y: [11.0, 12.0, 13.0, 14.0], se: [0.1, 0.2, 0.3, 0.4] }]);
        assert!(from_csv("sample,outcome\n").is_err());
        assert!(from_csv(&[&header, &good.replace("12,", "twelve,")[..]].join("\n")).is_err());
    }
}
