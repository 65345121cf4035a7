//! What is to be known before an optimum is believed: one wording for pages, tables and scripts.

use crate::answer::OptimumView;
use crate::study::{Method, OptimisationSpec};
use crate::task::{Scaled, ScaledEstimates};

/// |1 - L+| + |D+| + |M+| up to which a stroke counts as in trim.
const IN_TRIM: f64 = 0.01;
/// Lack of clearance which is worth a word, mm.
const LACK_MM: f64 = 1e-6;

/// Sentences on an optimum: no stroke in trim was found, or a margin is not kept.
pub fn remarks(asked: &OptimisationSpec, optimum: &OptimumView) -> Vec<String> {
    trim(asked, optimum).into_iter().chain(margins(asked, optimum)).collect()
}

fn off_trim(lift: f64, drag: f64, moment: f64) -> f64 {
    (1.0 - lift).abs() + drag.abs() + moment.abs()
}

fn trim(asked: &OptimisationSpec, optimum: &OptimumView) -> Option<String> {
    let found = optimum.optimum.as_ref()?;
    let predicted = |s: &Scaled| off_trim(s.lift, s.drag, s.pitch_moment);
    let flown = |s: &ScaledEstimates| {
        (off_trim(s.lift.mean, s.drag.mean, s.pitch_moment.mean), 2.0 * (s.lift.se + s.drag.se + s.pitch_moment.se))
    };
    let searched_in_trim = found.optimality.is_some() || predicted(&found.predicted) <= IN_TRIM;
    let refined = optimum.search.as_ref().and_then(|s| s.standing.best.as_ref()?.scaled);
    let (off, doubt) = refined.or(optimum.simulated_scaled()).map_or((predicted(&found.predicted), 0.0), |s| flown(&s));
    if searched_in_trim || off <= IN_TRIM + doubt {
        return None;
    }
    let off = format!("|1 - L+| + |D+| + |M+| is {off:.3}");
    Some(match asked.method {
        // The penalised search answers where no descent did.
        Method::Sqp => format!("no stroke in trim was found within these bounds ({}): {off}", found.stopped),
        Method::Paper | Method::Direct => format!("the stroke is not in trim: {off}"),
    })
}

fn margins(asked: &OptimisationSpec, optimum: &OptimumView) -> Vec<String> {
    let margin_mm = 1e3 * asked.margin_m();
    let of = if asked.is_direct() { "the generations' best stroke" } else { "the surrogate's optimum" };
    let all =
        [(of, optimum.optimum.as_ref().map(|o| o.clearance_mm)), ("the refined optimum", optimum.refined_clearance_mm)];
    let lacking = all.into_iter().filter_map(|(of, kept)| {
        let kept = kept.filter(|kept| *kept < margin_mm - LACK_MM)?;
        Some(format!("{of} keeps the wings {kept:.2} mm from the plane of symmetry, not the {margin_mm} mm asked for"))
    });
    lacking.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::answer::{OptimumStatus, SearchView};
    use serde_json::{Value, json};

    fn asked(method: &str, margin_mm: f64) -> OptimisationSpec {
        serde_json::from_value(json!({ "name": "a", "method": method, "clearance_margin_mm": margin_mm })).unwrap()
    }

    fn estimates(lift: f64) -> Value {
        let at = |mean: f64| json!({ "mean": mean, "se": 0.001 });
        json!({ "lift": at(lift), "drag": at(0.0), "pitch_moment": at(0.0), "power": at(0.9) })
    }

    /// An optimum predicted with so much lift, and refined to so much.
    fn optimum(lift: f64, refined: Option<f64>) -> OptimumView {
        let parameters = crate::point::ParameterValues([1.0; 10]);
        let found = json!({
            "parameters": parameters, "predicted": { "lift": lift, "drag": 0.0, "pitch_moment": 0.0, "power": 0.9 },
            "fitness": 1.0, "penalty": 0.1, "clearance_mm": 1.25, "history": [], "evaluations": 9, "solver_version": "9",
            "stopped": "none of 10 descents reached an optimum within the constraints; the least of the penalised \
                        fitness instead",
        });
        let standing = |lift| {
            json!({
                "rounds": 1, "simulations": 1, "radius": 0.1, "history": [], "predicted": null,
                "power_per_lift_w_per_n": null, "best": { "parameters": parameters, "scaled": estimates(lift) },
            })
        };
        let search = refined.map(|lift| SearchView {
            standing: serde_json::from_value(standing(lift)).unwrap(),
            ended: None,
            converged: false,
        });
        OptimumView {
            name: "a".into(),
            status: OptimumStatus::Optimised,
            optimum: Some(serde_json::from_value(found).unwrap()),
            simulated: None,
            gap: None,
            breeding: None,
            search,
            refined_clearance_mm: refined.map(|_| 4.0),
            paper: None,
            warnings: Vec::new(),
        }
    }

    #[test]
    fn that_no_stroke_is_in_trim_is_said() {
        let told = remarks(&asked("sqp", 0.0), &optimum(0.0004, None));
        assert_eq!(told.len(), 1);
        assert!(
            told[0].starts_with("no stroke in trim was found") && told[0].contains("none of 10 descents"),
            "{told:?}"
        );
        assert!(told[0].contains("is 1.000"), "{told:?}");
        assert_eq!(remarks(&asked("sqp", 0.0), &optimum(0.2, Some(0.3))).len(), 1);
        assert!(remarks(&asked("paper", 0.0), &optimum(0.9, None))[0].starts_with("the stroke is not in trim"));
        // Refining found one after all; the penalty held it well enough.
        assert_eq!(remarks(&asked("sqp", 0.0), &optimum(0.5, Some(1.001))), [""; 0]);
        assert_eq!(remarks(&asked("paper", 0.0), &optimum(0.995, None)), [""; 0]);
    }

    #[test]
    fn a_margin_which_is_not_kept_is_said_of_each_stroke() {
        let of = |margin| remarks(&asked("paper", margin), &optimum(1.0, Some(1.0)));
        assert_eq!((of(1.25), of(-5.0)), (vec![], vec![]));
        let told = of(3.0);
        assert!(told.len() == 1 && told[0].contains("the surrogate's optimum keeps the wings 1.25 mm"), "{told:?}");
        assert!(told[0].contains("not the 3 mm asked for"), "{told:?}");
        assert!(of(4.5).len() == 2 && of(4.5)[1].starts_with("the refined optimum keeps the wings 4.00 mm"));
    }
}
