//! The strokes the literature gives numbers for.

use crate::parameters::Point;

/// A published stroke of the preset `hawkmoth` with its published means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    /// Name, as an option takes it.
    pub name: &'static str,
    /// Name for people.
    pub title: &'static str,
    /// The stroke, table order.
    pub parameters: Point,
    /// Published lift over weight.
    pub paper_lift: f64,
    /// Published power, mW.
    pub paper_power_mw: Option<f64>,
    /// Published power per lift, W/N.
    pub paper_power_per_lift: f64,
}

/// Nguyen et al. 2019: the two optima, the measured stroke (Willmott & Ellington
/// 1997) and Table 4's optima of five parameters. All but the measured stroke
/// trim in the paper: drag and moment are zero.
pub const CASES: [Case; 5] = [
    Case {
        name: "optimum-1",
        title: "optimum I, ten parameters free",
        parameters: [25.3, 0.9, -4.2, 15.8, 1.0, 60.0, 0.0, 60.0, 0.0, 1.0],
        paper_lift: 1.0,
        paper_power_mw: None,
        paper_power_per_lift: 4.5,
    },
    Case {
        name: "optimum-2",
        title: "optimum II, with the moth's stroke plane and elevation",
        parameters: [25.7, 15.0, -8.8, 0.0, 7.9, 60.0, 7.0, 53.4, 0.0, 1.3],
        paper_lift: 1.0,
        paper_power_mw: None,
        paper_power_per_lift: 5.8,
    },
    Case {
        name: "reference",
        title: "the hovering moth as measured",
        parameters: [26.1, 15.0, -9.2, -0.5, 9.6, 57.2, 7.1, 58.0, 0.0, 1.0],
        paper_lift: 0.954,
        paper_power_mw: Some(84.2),
        paper_power_per_lift: 5.7,
    },
    Case {
        name: "five-direct",
        title: "five parameters, optimised on the solver itself",
        parameters: [27.2, 0.0, -4.2, 0.0, -0.6, 60.0, 0.0, 62.6, 0.0, 0.0],
        paper_lift: 1.0,
        paper_power_mw: Some(82.7),
        paper_power_per_lift: 5.34,
    },
    Case {
        name: "five-ann",
        title: "five parameters, optimised on the network",
        parameters: [26.8, 0.0, -3.4, 0.0, 0.8, 60.0, 0.0, 60.5, 0.0, 0.0],
        paper_lift: 1.0,
        paper_power_mw: Some(79.6),
        paper_power_per_lift: 5.14,
    },
];

/// A case by name.
///
/// ```
/// assert_eq!(manduca_numerics::cases::case("reference").map(|c| c.paper_lift), Some(0.954));
/// ```
pub fn case(name: &str) -> Option<&'static Case> {
    CASES.iter().find(|c| c.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::TABLE;

    #[test]
    fn the_cases_are_what_the_model_accepts() {
        for case in &CASES {
            for (p, x) in TABLE.iter().zip(case.parameters) {
                assert!((p.least..=p.most).contains(&x), "{}: {}", case.name, p.name);
            }
        }
    }
}
