//! Smoothness along lines through the design box.

use std::io;

use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::{Clearance, ElevationPhase};
use manduca_numerics::parameters::{Bounds, Point};
use manduca_numerics::simulation::Means;
use manduca_numerics::uvlm::Settings;

use super::sample::{SEED, random};
use crate::flights::fly_all;
use crate::markdown::{Document, Table, fixed};
use crate::plot::{Figure, Mark, Panel, Series};

/// Points on a line.
const POINTS: usize = 41;
/// Neighbours to which a quadratic is fitted.
const NEIGHBOURS: usize = 11;
/// Length of a line in lengths of the box.
const LENGTH: f64 = 0.1;

/// A line from one random stroke towards another, a tenth of the box long, all of
/// whose points are feasible.
fn line(number: u64) -> io::Result<Vec<Point>> {
    let bounds = Bounds::default();
    let clearance = Clearance::new(&Insect::default(), ElevationPhase::default());
    let seed = SEED + 2;
    for attempt in 0..1000 {
        let [a, b] = [random(seed, 2 * (1000 * number + attempt))?, random(seed, 2 * (1000 * number + attempt) + 1)?];
        let width = |i: usize| bounds.upper[i] - bounds.lower[i];
        let apart = (0..a.len()).map(|i| ((b[i] - a[i]) / width(i)).powi(2)).sum::<f64>().sqrt();
        let diagonal = (a.len() as f64).sqrt();
        let at =
            |share: f64| -> Point { std::array::from_fn(|i| a[i] + (b[i] - a[i]) * share * LENGTH * diagonal / apart) };
        let points: Vec<Point> = (0..POINTS).map(|i| at(i as f64 / (POINTS - 1) as f64)).collect();
        let inside = |x: &Point| (0..x.len()).all(|i| (bounds.lower[i]..=bounds.upper[i]).contains(&x[i]));
        if points.iter().all(|x| inside(x) && clearance.of(x) >= 0.0) {
            return Ok(points);
        }
    }
    Err(io::Error::other("no line of feasible strokes found"))
}

/// Distance of each value whose neighbours are all numbers from the quadratic through them (least
/// squares, Savitzky & Golay 1964).
fn residuals(values: &[f64]) -> Vec<f64> {
    let half = (NEIGHBOURS / 2) as i64;
    let n = NEIGHBOURS as f64;
    let square: f64 = (-half..=half).map(|i| (i * i) as f64).sum();
    let fourth: f64 = (-half..=half).map(|i| (i * i * i * i) as f64).sum();
    values
        .windows(NEIGHBOURS)
        .filter(|window| window.iter().all(|v| v.is_finite()))
        .map(|window| {
            let sum: f64 = window.iter().sum();
            let curved: f64 = window.iter().zip(-half..=half).map(|(v, i)| v * (i * i) as f64).sum();
            let middle = (fourth * sum - square * curved) / (n * fourth - square * square);
            window[NEIGHBOURS / 2] - middle
        })
        .collect()
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// Writes a table and returns the figure of the lines.
///
/// # Errors
/// When no line is feasible or the figure cannot be drawn.
pub fn write(document: &mut Document, count: u64, settings: Settings) -> io::Result<(&'static str, String)> {
    let lines = (0..count).map(line).collect::<io::Result<Vec<_>>>()?;
    let flights: Vec<_> = lines.iter().flatten().map(|x| super::flight(x, settings)).collect();
    let flown: Vec<Option<Means>> = fly_all(&flights).into_iter().map(Result::ok).collect();
    document.heading("Smoothness");
    document.paragraph(&format!(
        "{POINTS} strokes on each of {count} random lines of a tenth of the box's diagonal; distance in hundredths of each \
         mean from the quadratic fitted to {NEIGHBOURS} neighbours, root mean square."
    ));
    let mut table = Table::new(["line", "L+ from", "to", "L+", "D+", "M+", "P+"]);
    let (mut all, mut series) = (vec![Vec::new(); 4], Vec::new());
    for (number, means) in flown.chunks(POINTS).enumerate() {
        let mean = |means: &Option<Means>, k: usize| means.as_ref().map_or(f64::NAN, |m| m.scaled[k].mean);
        let values = |k: usize| means.iter().map(|m| mean(m, k)).collect::<Vec<_>>();
        let lift = values(0);
        let (low, high) =
            (lift.iter().copied().fold(f64::MAX, f64::min), lift.iter().copied().fold(f64::MIN, f64::max));
        let mut cells = vec![(number + 1).to_string(), fixed(low, 3), fixed(high, 3)];
        for (k, all) in all.iter_mut().enumerate() {
            let residuals = residuals(&values(k));
            cells.push(fixed(100.0 * rms(&residuals), 2));
            all.extend(residuals);
        }
        table.row(cells);
        let points = lift.iter().enumerate().map(|(i, l)| (i as f64 / (POINTS - 1) as f64, *l));
        let points = points.filter(|p| p.1.is_finite()).collect::<Vec<_>>();
        series.push(Series::new(format!("line {}", number + 1), Mark::Line, points));
    }
    let mut cells = vec!["all".to_owned(), String::new(), String::new()];
    cells.extend(all.iter().map(|r| fixed(100.0 * rms(r), 2)));
    table.row(cells);
    document.table(&table);
    document.figure("figures/smoothness.svg", "Lift along random lines through the design box");
    let panel = Panel { x: "along the line".into(), y: "L+".into(), series };
    let figure = Figure { panels: vec![panel], columns: 1 };
    Ok(("smoothness.svg", figure.svg()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quadratic_leaves_no_residual_and_a_step_does() {
        let values: Vec<f64> = (0..POINTS).map(|i| 1.0 + 0.3 * i as f64 - 0.01 * (i * i) as f64).collect();
        let left = residuals(&values);
        assert_eq!(left.len(), POINTS - NEIGHBOURS + 1);
        assert!(rms(&left) < 1e-12, "{}", rms(&left));
        let mut gap = values;
        gap[20] = f64::NAN;
        assert_eq!(residuals(&gap).len(), left.len() - NEIGHBOURS);
        assert!(rms(&residuals(&gap)) < 1e-12);
        let step: Vec<f64> = (0..POINTS).map(|i| f64::from(i > 20)).collect();
        assert!(rms(&residuals(&step)) > 0.1);
    }

    #[test]
    fn lines_are_feasible_and_a_tenth_of_the_box_long() {
        let line = line(0).unwrap();
        let bounds = Bounds::default();
        let length = (0..10)
            .map(|i| ((line[POINTS - 1][i] - line[0][i]) / (bounds.upper[i] - bounds.lower[i])).powi(2))
            .sum::<f64>()
            .sqrt();
        assert!((length - LENGTH * 10.0_f64.sqrt()).abs() < 1e-12, "{length}");
    }
}
