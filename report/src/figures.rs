//! Figures of a study: each is made here once, for documents and for `manduca figures`.

use std::f64::consts::LN_10;

use manduca_numerics::math::ln;
use manduca_numerics::optimise::analysis::PopulationRow;
use manduca_numerics::parameters::{OUTPUTS, Point, TABLE};
use manduca_numerics::simulation::Moment;

use crate::plot::{Figure, Mark, Panel, Series};

/// Most samples drawn as points: more are a blot, and a large file.
const MOST_POINTS: usize = 1000;
/// Bars of a distribution.
const BINS: usize = 20;

/// A sample: its stroke, and `[L+, D+, M+, P+]` simulated and predicted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// The stroke.
    pub point: Point,
    /// Simulated.
    pub simulated: [f64; 4],
    /// Predicted by the surrogate; none before there is one.
    pub predicted: Option<[f64; 4]>,
}

/// A stroke with a name, step by step.
pub type Flown = (String, Vec<Moment>);

fn log10(value: f64) -> f64 {
    ln(value) / LN_10
}

/// Mean squared errors of training, validation and test share by iteration (Fig. 5 of the paper);
/// none without iterations, as of a gaussian process.
pub fn training(curve: &[[f64; 4]]) -> Option<Figure> {
    let line =
        |label: &str, share: usize| Series::new(label, Mark::Line, curve.iter().map(|e| (e[0], log10(e[share]))));
    let series = vec![line("training", 1), line("validation", 2), line("test", 3)];
    let panel = Panel { x: "iteration".into(), y: "log10 of mean squared error".into(), series };
    (!curve.is_empty()).then_some(Figure { panels: vec![panel], columns: 1 })
}

/// Lift, drag and power over a stroke (Fig. 8 and 10 of the paper); forces over `weight_n`.
pub fn forces(flown: &[Flown], weight_n: f64) -> Figure {
    let panels = vec![
        over_stroke(flown, "lift L/W", &|m| m.snapshot.lift_n / weight_n),
        over_stroke(flown, "drag D/W", &|m| m.snapshot.drag_n / weight_n),
        over_stroke(flown, "required power, mW", &|m| {
            1e3 * m.snapshot.joints.iter().map(|j| j.required_w).sum::<f64>()
        }),
    ];
    Figure { panels, columns: 3 }
}

/// The three angles over a stroke.
pub fn angles(flown: &[Flown]) -> Figure {
    let angle = |y: &str, i: usize| over_stroke(flown, y, &|m| m.snapshot.angles[i].value.to_degrees());
    let panels = vec![angle("sweep φ, °", 0), angle("elevation θ, °", 1), angle("rotation α, °", 2)];
    Figure { panels, columns: 3 }
}

fn over_stroke(flown: &[Flown], y: &str, value: &dyn Fn(&Moment) -> f64) -> Panel {
    let line =
        |(name, moments): &Flown| Series::new(name.clone(), Mark::Line, moments.iter().map(|m| (m.phase, value(m))));
    Panel { x: "time t f, strokes".into(), y: y.into(), series: flown.iter().map(line).collect() }
}

/// Where the tip of the wing goes, seen along the stroke plane: elevation over sweep.
pub fn tip_paths(flown: &[Flown]) -> Figure {
    let path = |(name, moments): &Flown| {
        // The last step leads back to the first.
        let closed = moments.iter().chain(moments.first());
        let at = |m: &Moment, i: usize| m.snapshot.angles[i].value.to_degrees();
        Series::new(name.clone(), Mark::Line, closed.map(|m| (at(m, 0), at(m, 1))))
    };
    let series = flown.iter().map(path).collect();
    let panel = Panel { x: "sweep φ, ° (forward to the right)".into(), y: "elevation θ, °".into(), series };
    Figure { panels: vec![panel], columns: 1 }
}

/// What the surrogate says of samples over what the simulation said (Fig. 6 of the paper); none
/// without predictions.
pub fn agreement(samples: &[Sample]) -> Option<Figure> {
    let every = samples.len().div_ceil(MOST_POINTS).max(1);
    let pairs: Vec<_> = samples.iter().step_by(every).filter_map(|s| Some((s.simulated, s.predicted?))).collect();
    let panel = |(k, (name, _, symbol, _)): (usize, &(&str, &str, &str, &str))| {
        let points: Vec<(f64, f64)> = pairs.iter().map(|(x, y)| (x[k], y[k])).collect();
        let (low, high) =
            points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p.0), high.max(p.0)));
        let name = name.replace('_', " ");
        let series = vec![
            Series::new("samples", Mark::Dots, points),
            Series::new("prediction = simulation", Mark::Dashed, [(low, low), (high, high)]),
        ];
        Panel { x: format!("{name} {symbol}, simulated"), y: format!("{name} {symbol}, predicted"), series }
    };
    (!pairs.is_empty()).then(|| Figure { panels: OUTPUTS.iter().enumerate().map(panel).collect(), columns: 2 })
}

/// How the samples' parameters and means are distributed; none without samples.
pub fn distributions(samples: &[Sample]) -> Option<Figure> {
    let parameters = TABLE.iter().enumerate().map(|(i, p)| {
        let unit = if p.unit.is_empty() { String::new() } else { format!(", {}", p.unit) };
        let values = samples.iter().map(|s| s.point[i]).collect();
        histogram(&format!("{}{unit}", p.symbol), "parameter", values)
    });
    let means = OUTPUTS.iter().enumerate().map(|(k, (_, _, symbol, _))| {
        histogram(&format!("simulated {symbol}"), "mean", samples.iter().map(|s| s.simulated[k]).collect())
    });
    (!samples.is_empty()).then(|| Figure { panels: parameters.chain(means).collect(), columns: 5 })
}

/// How many values lie in each of some equal parts of their range, as a stepped line.
fn histogram(x: &str, label: &str, values: Vec<f64>) -> Panel {
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    let wide = if high > low { high - low } else { 1.0 };
    let mut counts = [0_u32; BINS];
    for value in &values {
        counts[(((value - low) / wide * BINS as f64) as usize).min(BINS - 1)] += 1;
    }
    let edge = |i: usize| low + wide * i as f64 / BINS as f64;
    let steps = counts.iter().enumerate().flat_map(|(i, n)| [(edge(i), f64::from(*n)), (edge(i + 1), f64::from(*n))]);
    let points = std::iter::once((low, 0.0)).chain(steps).chain([(low + wide, 0.0)]);
    Panel { x: x.into(), y: "samples".into(), series: vec![Series::new(label, Mark::Line, points)] }
}

/// How optima came nearer to trim while they were refined: distance from trim
/// |1 - L+| + |D+| + |M+|, and P+, after each stroke flown; none where none was refined.
pub fn refining(histories: &[(String, Vec<[f64; 2]>)]) -> Option<Figure> {
    let panel = |y: &str, value: &dyn Fn(&[f64; 2]) -> f64| {
        let line = |(name, history): &(String, Vec<[f64; 2]>)| {
            let points = history.iter().enumerate().map(|(i, h)| ((i + 1) as f64, value(h)));
            Series::new(name.clone(), Mark::Line, points)
        };
        Panel { x: "strokes flown".into(), y: y.into(), series: histories.iter().map(line).collect() }
    };
    // Not below what means are known to.
    let panels = vec![panel("log10 of distance from trim", &|h| log10(h[0].max(1e-6))), panel("power P+", &|h| h[1])];
    histories.iter().any(|(_, h)| !h.is_empty()).then_some(Figure { panels, columns: 2 })
}

/// Fitness found by the genetic algorithm against the size of its population (Fig. 7 of the
/// paper), beside the exact optimum.
pub fn population(rows: &[PopulationRow], exact: f64) -> Figure {
    let digits = |n: usize| log10(n as f64);
    let points = rows.iter().flat_map(|row| row.fitnesses.iter().map(|f| (digits(row.population), *f)));
    let ends = rows.iter().map(|row| (digits(row.population), exact));
    let series = vec![
        Series::new("genetic algorithm and simplex", Mark::Points, points),
        Series::new("exact optimum", Mark::Dashed, ends),
    ];
    let panel = Panel { x: "log10 of population".into(), y: "fitness".into(), series };
    Figure { panels: vec![panel], columns: 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(n: u32) -> Vec<Sample> {
        let sample = |i: u32| {
            let y = [f64::from(i), 1.0, -f64::from(i), 0.5];
            Sample { point: [f64::from(i % 7); 10], simulated: y, predicted: Some(y.map(|v| v + 0.1)) }
        };
        (0..n).map(sample).collect()
    }

    #[test]
    fn what_there_is_nothing_of_has_no_figure() {
        assert_eq!((training(&[]), agreement(&[]), distributions(&[]), refining(&[])), (None, None, None, None));
        let unpredicted = samples(5).into_iter().map(|s| Sample { predicted: None, ..s }).collect::<Vec<_>>();
        assert_eq!(agreement(&unpredicted), None);
    }

    #[test]
    fn a_distribution_counts_every_sample() {
        let figure = distributions(&samples(50)).unwrap();
        assert_eq!((figure.panels.len(), figure.columns), (14, 5));
        for panel in &figure.panels {
            let points = &panel.series[0].points;
            assert_eq!(points.len(), 2 * BINS + 2);
            assert_eq!(points[1..].iter().step_by(2).take(BINS).map(|p| p.1).sum::<f64>(), 50.0, "{}", panel.x);
            assert!(points.iter().all(|p| p.0.is_finite()), "{}", panel.x);
        }
        assert!(figure.svg().is_ok());
    }

    #[test]
    fn samples_lie_about_the_line_where_prediction_is_right() {
        let figure = agreement(&samples(2500)).unwrap();
        let [dots, line] = &figure.panels[0].series[..] else { panic!("two series") };
        assert_eq!((dots.points.len(), dots.points[1]), (834, (3.0, 3.1)));
        assert_eq!(line.points, [(0.0, 0.0), (2499.0, 2499.0)]);
        assert!(figure.svg().unwrap().contains("pitch moment M+, simulated"));
    }
}
