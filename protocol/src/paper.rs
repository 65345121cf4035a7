//! Which published stroke answers the question an optimisation asks.

use manduca_numerics::cases::{CASES, Case};
use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::{Clearance, ElevationPhase};
use manduca_numerics::parameters::{Bounds, at};
use manduca_numerics::simulation::Model;

use crate::resolve::ResolvedModel;

/// Whether a model is the paper's: its insect, the vortex lattice, no spring, the elevation's sign. Panels and steps may
/// be others, and the moment of inertia, on which nothing depends.
pub fn is_papers(model: &ResolvedModel) -> bool {
    let hawkmoth = Insect::default();
    let insect = Insect { body_pitch_inertia_kg_m2: hawkmoth.body_pitch_inertia_kg_m2, ..model.insect };
    insect == hawkmoth
        && matches!(model.model, Model::Uvlm(_))
        && model.elevation_phase == ElevationPhase::Plus
        && model.elastic_storage == 0.0
}

/// The published optimum of the same question: that of the same model whose stroke lies within these bounds and keeps
/// the margin, while the bounds lie within those of its own search. In other bounds another stroke may be best.
pub fn comparable(model: &ResolvedModel, bounds: &Bounds, margin_m: f64, direct: bool) -> Option<&'static Case> {
    if !is_papers(model) {
        return None;
    }
    let clearance = Clearance::new(&model.insect, model.elevation_phase);
    let twin = if direct { "five-ann" } else { "five-direct" };
    CASES.iter().filter(|case| case.name != twin).find(|case| {
        let Some(searched) = searched(case.name) else { return false };
        let within = |i: usize| {
            let (lower, upper) = (bounds.lower[i], bounds.upper[i]);
            searched.lower[i] <= lower && upper <= searched.upper[i] && (lower..=upper).contains(&case.parameters[i])
        };
        (0..bounds.lower.len()).all(within) && clearance.of(&case.parameters) >= margin_m
    })
}

/// The bounds within which the paper found an optimum; none of the stroke which was measured.
fn searched(name: &str) -> Option<Bounds> {
    let held: &[(usize, f64)] = match name {
        "optimum-1" => &[],
        "optimum-2" => &[(at::STROKE_PLANE, 15.0), (at::ELEVATION_MEAN, 0.0), (at::ELEVATION_AMPLITUDE, 7.0)],
        "five-direct" | "five-ann" => &[
            (at::STROKE_PLANE, 0.0),
            (at::ELEVATION_MEAN, 0.0),
            (at::ELEVATION_AMPLITUDE, 0.0),
            (at::SWEEP_SHAPE, 0.0),
            (at::ROTATION_SHAPE, 0.0),
        ],
        _ => return None,
    };
    let mut bounds = Bounds::default();
    for &(i, value) in held {
        (bounds.lower[i], bounds.upper[i]) = (value, value);
    }
    Some(bounds)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resolve;
    use crate::study::{Method, StudySpec};

    fn paper(text: &str, change: &dyn Fn(&mut StudySpec)) -> Vec<Option<&'static str>> {
        let mut spec: StudySpec = toml::from_str(text).unwrap();
        change(&mut spec);
        let study = resolve::study(&spec).unwrap();
        let both = spec.optimisations.iter().zip(&study.optimisations);
        let found = both.map(|(o, how)| comparable(&study.model, &how.bounds, o.margin_m(), o.is_direct()));
        found.map(|case| case.map(|case| case.name)).collect()
    }

    const PAPER: &str = include_str!("../../studies/paper.toml");

    #[test]
    fn the_papers_questions_have_the_papers_answers() {
        assert_eq!(paper(PAPER, &|_| {}), [Some("optimum-1"), Some("optimum-2")]);
        assert_eq!(paper(include_str!("../../studies/quick.toml"), &|_| {}), [Some("optimum-1")]);
        assert_eq!(paper(include_str!("../../studies/five.toml"), &|_| {}), [Some("five-ann")]);
        assert_eq!(paper(include_str!("../../studies/five-direct.toml"), &|_| {}), [Some("five-direct")]);
        // A method, a name and the panels make no other question.
        let same = |spec: &mut StudySpec| {
            spec.optimisations[1].method = Method::Paper;
            spec.optimisations[1].name = "mine".into();
            spec.model.solver.insert("chordwise_panels".into(), 4.0);
        };
        assert_eq!(paper(PAPER, &same), [Some("optimum-1"), Some("optimum-2")]);
    }

    #[test]
    fn other_questions_have_none() {
        let insect = |spec: &mut StudySpec| {
            spec.model.insect_changes.insert("mass_kg".into(), 1e-6);
        };
        let preset = |spec: &mut StudySpec| spec.model.insect = "hawkmoth-f1".into();
        let blades = |spec: &mut StudySpec| spec.model.kind = crate::study::ModelKind::QuasiSteady;
        let spring = |spec: &mut StudySpec| spec.model.elastic_storage = 1.0;
        let phase = |spec: &mut StudySpec| spec.model.elevation_phase = crate::study::ElevationPhase::Minus;
        let margin = |spec: &mut StudySpec| spec.optimisations.iter_mut().for_each(|o| o.clearance_margin_mm = 9.0);
        for change in [&insect as &dyn Fn(&mut StudySpec), &preset, &blades, &spring, &phase, &margin] {
            assert_eq!(paper(PAPER, change), [None, None]);
        }
        // Bounds without the paper's stroke, and bounds beyond those it searched in.
        for range in [[26.0, 40.0], [10.0, 40.0]] {
            let range = crate::study::Range::Between(range);
            let narrow = |spec: &mut StudySpec| {
                spec.parameters.insert("frequency_hz".into(), range);
            };
            assert_eq!(paper(PAPER, &narrow)[0], None);
        }
    }
}
