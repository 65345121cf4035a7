//! Jobs which no machine ends within their run limit: refused with the study, before anything is flown.

use manduca_numerics::parameters::COUNT;
use manduca_numerics::simulation::Model;
use manduca_numerics::table::Table;
use manduca_numerics::uvlm::Settings;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::resolve::ResolvedStudy;
use manduca_protocol::study::{OptimisationSpec, StudySpec, SurrogateKind};

use crate::config::RunLimits;

/// Vortex segments which act on nodes in a second of one core: four times what the fastest of 2026 does.
const SEGMENTS_PER_S: f64 = 3e9;
/// Multiplications with additions in a second of a training: those of some hundred cores.
const PRODUCTS_PER_S: f64 = 2e12;

/// Every job of a study which cannot end, at the setting which costs most of it.
pub(crate) fn endless(spec: &StudySpec, study: &ResolvedStudy, limits: &RunLimits) -> Vec<FieldProblem> {
    let mut faults = Vec::new();
    let flown = spec.sampling.samples > 0 || spec.optimisations.iter().any(OptimisationSpec::is_direct);
    if flown && let Some(times) = flight_takes(study, 0, limits) {
        faults.push(FieldProblem::new(dearest_setting(study), told("a flight", times, limits.simulate.as_secs_f64())));
    } else {
        let all = spec.optimisations.iter().enumerate();
        faults.extend(all.filter_map(|(i, o)| verification(o, study, limits, &format!("/optimisations/{i}"))));
    }
    faults.extend(training(spec, study, limits));
    faults
}

/// An optimum's flight which cannot end because of its many strokes.
pub(crate) fn verification(
    asked: &OptimisationSpec,
    study: &ResolvedStudy,
    limits: &RunLimits,
    at: &str,
) -> Option<FieldProblem> {
    let times = flight_takes(study, asked.verify_strokes as usize, limits)?;
    Some(FieldProblem::new(
        format!("{at}/verify_strokes"),
        told("the flight of the optimum", times, limits.simulate.as_secs_f64()),
    ))
}

fn told(what: &str, times: f64, limit_s: f64) -> String {
    format!(
        "{what} takes at least {times:.2} times the {limit_s} s which it may take here, on the fastest of machines: ask \
         for fewer panels, steps or strokes, or for a shorter wake"
    )
}

/// By how many times the shortest flight of the study's model exceeds its limit, or `None` if it does not.
fn flight_takes(study: &ResolvedStudy, strokes: usize, limits: &RunLimits) -> Option<f64> {
    let Model::Uvlm(settings) = &study.model.model else { return None };
    let times = work(settings, strokes) / SEGMENTS_PER_S / limits.simulate.as_secs_f64();
    (times > 1.0).then_some(times)
}

/// Work of a flight of at least so many strokes: where no standard error is small enough, of all it may have.
fn work(settings: &Settings, strokes: usize) -> f64 {
    let least = settings.strokes.max(strokes);
    let never_enough = settings.standard_error == 0.0;
    settings.interactions(if never_enough { least.max(settings.strokes_most) } else { least })
}

/// The setting whose default would make the flight shortest.
fn dearest_setting(study: &ResolvedStudy) -> String {
    let Model::Uvlm(settings) = &study.model.model else { return "/model".into() };
    let with_default = |name: &str, default: f64| {
        let mut changed = *settings;
        // What is a default is accepted.
        let _ = changed.set(name, default);
        work(&changed, 0)
    };
    let all = Settings::FIELDS.iter().map(|field| (field.name, with_default(field.name, field.default)));
    let dearest = all.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, less)| *less < work(settings, 0));
    dearest.map_or_else(|| "/model/solver".into(), |(name, _)| format!("/model/solver/{name}"))
}

/// A training whose fewest iterations cannot be made. An iteration forms and factors the products of its Jacobian's
/// columns, one per hidden weight; a network is not given up before `patience` iterations without gain.
fn training(spec: &StudySpec, study: &ResolvedStudy, limits: &RunLimits) -> Option<FieldProblem> {
    let samples = f64::from(spec.sampling.samples);
    if samples == 0.0 || spec.surrogate.kind == SurrogateKind::GaussianProcess {
        return None;
    }
    let settings = &study.surrogate;
    let free = (0..COUNT).filter(|&i| !study.bounds.is_held(i)).count();
    let columns = (settings.neurons * (free + 1)) as f64;
    let least = settings.max_iterations.min(settings.patience) as f64 * settings.ensemble as f64;
    let one = columns * columns * (samples * settings.train_share + columns / 3.0);
    let times = least * one / PRODUCTS_PER_S / limits.train.as_secs_f64();
    let why = || {
        format!(
            "the training takes at least {times:.2} times the {} s which it may take here, even on a hundred cores: ask \
             for fewer neurons, networks, samples, or less patience",
            limits.train.as_secs()
        )
    };
    (times > 1.0).then(|| FieldProblem::new("/surrogate/neurons", why()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use manduca_protocol::resolve;
    use serde_json::{Value, json};

    fn pointers(change: &dyn Fn(&mut Value)) -> Vec<String> {
        let mut study = json!({ "name": "a", "sampling": { "samples": 100 }, "model": { "solver": {} },
                                "surrogate": {}, "optimisations": [{ "name": "b" }] });
        change(&mut study);
        let spec: StudySpec = serde_json::from_value(study).expect("a study");
        let resolved = resolve::study(&spec).expect("a valid study");
        let faults = endless(&spec, &resolved, &RunLimits::default());
        faults.into_iter().map(|fault| fault.pointer).collect()
    }

    #[test]
    fn a_flight_which_no_machine_ends_is_refused_at_its_dearest_setting() {
        assert_eq!(pointers(&|_| {}), [""; 0]);
        for (setting, value, more) in [
            ("wake_joined_after", 20.0, json!({ "wake_strokes": 20, "steps_per_stroke": 720 })),
            ("steps_per_stroke", 720.0, json!({ "chordwise_panels": 32, "spanwise_panels": 48, "strokes": 100 })),
            ("strokes_most", 400.0, json!({ "standard_error": 0, "steps_per_stroke": 300, "spanwise_panels": 48 })),
        ] {
            let found = pointers(&|study| {
                study["model"]["solver"] = more.clone();
                study["model"]["solver"][setting] = json!(value);
            });
            assert_eq!(found.len(), 1, "{setting}: {found:?}");
            assert!(found[0].starts_with("/model/solver/"), "{found:?}");
        }
        // Twenty times the work of the default: slow, and it ends.
        let slow =
            json!({ "chordwise_panels": 12, "spanwise_panels": 30, "steps_per_stroke": 120, "strokes_most": 40 });
        assert_eq!(pointers(&|study| study["model"]["solver"] = slow.clone()), [""; 0]);
    }

    #[test]
    fn so_is_the_flight_of_an_optimum_which_has_too_many_strokes() {
        let long = json!({ "chordwise_panels": 16, "spanwise_panels": 40, "steps_per_stroke": 400, "wake_strokes": 4 });
        let found = pointers(&|study| {
            study["model"]["solver"] = long.clone();
            study["optimisations"][0]["verify_strokes"] = json!(200);
        });
        assert_eq!(found, ["/optimisations/0/verify_strokes"]);
    }

    #[test]
    fn a_training_which_no_machine_ends_is_refused() {
        let large = json!({ "neurons": 1000, "ensemble": 16, "patience": 1000, "max_iterations": 10_000 });
        let with = |samples: u32, kind: &str| {
            pointers(&|study| {
                study["sampling"]["samples"] = json!(samples);
                study["surrogate"] = large.clone();
                study["surrogate"]["kind"] = json!(kind);
            })
        };
        assert_eq!(with(200_000, "network"), ["/surrogate/neurons"]);
        assert_eq!(with(5000, "gaussian-process"), [""; 0]);
        let paper: StudySpec = serde_json::from_value(json!({
            "name": "a", "sampling": { "samples": 200_000 }, "surrogate": { "neurons": 500 }
        }))
        .expect("a study");
        assert!(endless(&paper, &resolve::study(&paper).expect("valid"), &RunLimits::default()).is_empty());
    }
}
