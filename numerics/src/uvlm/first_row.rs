//! Where the first row of wake belongs.

use crate::math::ln;

/// How far behind the trailing edge the first row of wake starts, m: `at_one` of the
/// row's displacement in a step, `row`, where that is as long as a chordwise `panel`.
///
/// Bound vortices at a quarter of each panel and wake vortices at a quarter of each
/// step make one even lattice, in which a collocation point lies in the middle
/// between two vortices and an even sheet induces nothing there, as it should. With
/// rows of another length that still holds at the last collocation point, a quarter
/// panel ahead of the edge, if the first row starts δ rows behind it, where
///
/// ψ(δ + ρ/4) = ψ(at_one + 1/4) + ln ρ,  ρ = panel / row
///
/// (ψ digamma: the sum over evenly spaced vortices less the integral over an even
/// sheet). Known answers for 1/4: δ = 0.25 at ρ = 1 and 0 at ρ = 4. Rows much
/// shorter than a panel start ahead of the edge, by at most 0.11 panel; panels shorter
/// than a twentieth of a row, as at a pointed tip, count as that.
pub fn first_row(at_one: f64, panel: f64, row: f64) -> f64 {
    if row <= 1e-6 * panel {
        return LIMIT * panel;
    }
    let ratio = (panel / row).max(SHORTEST);
    let wanted = digamma(at_one + 0.25) + ln(ratio);
    let (mut low, mut high) = (1e-9, 2.0 + ratio);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if digamma(middle) < wanted {
            low = middle;
        } else {
            high = middle;
        }
    }
    (0.5 * (low + high) - 0.25 * ratio) * row
}

/// (e^ψ(1/2) - 1/4) for rows without length: (e^-γ - 1)/4.
const LIMIT: f64 = -0.109_635;

/// Shortest panel, in rows, for which the rule is followed.
const SHORTEST: f64 = 0.05;

/// Digamma function for x > 0: recurrence to x >= 8, then its asymptotic series.
fn digamma(x: f64) -> f64 {
    let (mut x, mut sum) = (x, 0.0);
    while x < 8.0 {
        sum -= 1.0 / x;
        x += 1.0;
    }
    let y = 1.0 / (x * x);
    sum + ln(x) - 0.5 / x - y * (1.0 / 12.0 - y * (1.0 / 120.0 - y * (1.0 / 252.0 - y / 240.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_answers() {
        // Euler's constant, and ψ(1/2) = -γ - 2 ln 2 (Abramowitz & Stegun 6.3.2, 6.3.3).
        let euler = 0.577_215_664_901_532_9;
        assert!((digamma(1.0) + euler).abs() < 1e-10);
        assert!((digamma(0.5) + euler + 2.0 * ln(2.0)).abs() < 1e-10);
        assert!((first_row(0.25, 0.1, 0.1) - 0.025).abs() < 1e-9);
        assert!(first_row(0.25, 0.4, 0.1).abs() < 1e-9);
        // Continuous towards rows without length; as for short panels where there are none.
        assert!((first_row(0.25, 1.0, 1e-4) - LIMIT).abs() < 1e-4);
        assert!((first_row(0.25, 0.0, 1.0) - 0.197).abs() < 0.01, "{}", first_row(0.25, 0.0, 1.0));
    }
}
