//! Where the first row of wake belongs.

use crate::math::ln;

/// How far behind the trailing edge the line of the newest wake lies, m, which stands for
/// the sheet shed in a step of length `row`; `share` of that step (1/4) is the place of a
/// line which does to a plate what an even sheet over the step does.
///
/// A vortex at a distance d behind a plate changes its circulation in proportion to d^(-1/2),
/// so that an even sheet from 0 to `row` acts like a line at row/4. A lattice with vortices at
/// a quarter and collocation points at three quarters of each `panel` answers a vortex x panels
/// behind it by Γ(x + 1/4) / Γ(x + 3/4) instead (its matrix is Cauchy's, whose inverse is a
/// product), which is x^(-1/2) far away and too little near by: by a fifth at a sixth of a
/// panel. The line therefore lies where the lattice answers as the plate should,
///
/// Γ(x + 1/4) / Γ(x + 3/4) = (share · row / panel)^(-1/2).
///
/// Known answers: x = 1/4 for share · row / panel = 1/π; x → share · row / panel for long rows.
/// Rows much shorter than a panel lie ahead of the edge, by less than a quarter of a panel.
pub fn first_row(share: f64, panel: f64, row: f64) -> f64 {
    let wanted = share * row;
    if wanted >= LONG * panel {
        return wanted;
    }
    let distance = (wanted / panel).max(SHORTEST);
    let target = -0.5 * ln(distance);
    let (mut low, mut high) = (-0.25 + 1e-9, distance + 1.0);
    for _ in 0..60 {
        let x = 0.5 * (low + high);
        if libm::lgamma(x + 0.25) - libm::lgamma(x + 0.75) > target {
            low = x;
        } else {
            high = x;
        }
    }
    0.5 * (low + high) * panel
}

/// Distance in panels beyond which lattice and plate answer alike.
const LONG: f64 = 1e3;

/// Shortest distance, in panels, which is told from none.
const SHORTEST: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn known_answers() {
        // Γ(1/2) / Γ(1) = π^(1/2).
        assert!((first_row(0.25, 0.1, 0.4 / PI) - 0.025).abs() < 1e-9);
        assert!((first_row(0.25, 0.1, 40.0) - 10.0).abs() < 1e-3);
        assert_eq!(first_row(0.25, 0.0, 1.0), 0.25);
        let shortest = first_row(0.25, 1.0, 0.0);
        assert!(shortest > -0.25 && shortest < -0.23, "{shortest}");
    }

    /// Circulation of a flat plate of chord 1 in the field of a vortex `d` behind it, by a lattice.
    fn answered(panels: usize, d: f64) -> f64 {
        let m = panels as f64;
        let vortex = |j: usize| (j as f64 + 0.25) / m;
        let at = |i: usize| (i as f64 + 0.75) / m;
        let matrix = nalgebra::DMatrix::from_fn(panels, panels, |i, j| 1.0 / (at(i) - vortex(j)));
        let rhs = nalgebra::DVector::from_fn(panels, |i, _| 1.0 / (1.0 + d - at(i)));
        matrix.lu().solve(&rhs).unwrap().sum()
    }

    #[test]
    fn a_lattice_answers_the_line_as_a_plate_answers_the_sheet() {
        // Plate: Γ = (1 + 1/d)^(1/2) - 1; sheet of unit circulation over a row: its mean.
        let (panels, row) = (64, 0.01);
        let sheet =
            (0..10_000).map(|i| (1.0 + 10_000.0 / (row * (f64::from(i) + 0.5))).sqrt() - 1.0).sum::<f64>() / 1e4;
        let answer = answered(panels, first_row(0.25, 1.0 / panels as f64, row));
        assert!((answer / sheet - 1.0).abs() < 0.02, "{answer} {sheet}");
        // A quarter of a row as it is would be far off.
        assert!(answered(panels, 0.25 * row) < 0.87 * sheet);
    }
}
