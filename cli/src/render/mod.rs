//! Answers as tables.

pub mod simulation;
pub mod study;
pub mod trust;

use manduca_numerics::parameters::{Parameter, TABLE};
use manduca_protocol::task::{Estimate, Scaled, ScaledEstimates};

/// Name and unit of a parameter.
fn label(p: &Parameter) -> String {
    let unit = if p.unit.is_empty() { String::new() } else { format!(" [{}]", p.unit) };
    format!("{} {}{unit}", p.name, p.symbol)
}

/// Rows of the ten parameters, one column per point.
fn parameter_rows(points: &[Option<[f64; 10]>]) -> Vec<Vec<String>> {
    let row = |(i, p): (usize, &Parameter)| {
        let values = points.iter().map(|point| point.map_or_else(dash, |x| number(x[i])));
        std::iter::once(label(p)).chain(values).collect()
    };
    TABLE.iter().enumerate().map(row).collect()
}

/// A parameter as people write it: four digits, no trailing zeros, no negative zero.
fn number(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}

/// A number with so many digits; what rounds to nothing has no sign.
pub fn fixed(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    if text.trim_start_matches(['-', '0', '.']).is_empty() { text.replace('-', "") } else { text }
}

fn estimate(e: &Estimate) -> String {
    format!("{} ± {:.4}", fixed(e.mean, 4), e.se)
}

fn dash() -> String {
    "-".into()
}

/// L+, D+, M+, P+ in their order.
pub fn scaled(s: &Scaled) -> [f64; 4] {
    [s.lift, s.drag, s.pitch_moment, s.power]
}

/// L+, D+, M+, P+ in their order.
pub fn estimates(s: &ScaledEstimates) -> [Estimate; 4] {
    [s.lift, s.drag, s.pitch_moment, s.power]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        assert_eq!([25.0, -0.0001, 7.25, 0.12345].map(number), ["25", "0", "7.25", "0.123"]);
        assert_eq!([-0.001, -0.006, 12.346].map(|v| fixed(v, 2)), ["0.00", "-0.01", "12.35"]);
    }
}
