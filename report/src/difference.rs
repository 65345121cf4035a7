//! What makes our lift differ from the paper's, in words whose numbers are computed.

use manduca_numerics::kinematics::ElevationPhase;
use manduca_numerics::uvlm::Settings;

use crate::canonical::other_code;
use crate::check::{Expected, Group, Setup};
use crate::markdown::{fixed, percent, signed};
use crate::sensitivity::{Change, Study};
use crate::validation::Flown;

/// What may be changed, as the end of a sentence.
fn levers() -> [(&'static str, Change); 11] {
    [
        ("all suction turned into lift", Change::SuctionToLift(1.0)),
        ("no suction turned into lift", Change::SuctionToLift(0.0)),
        ("10 % more area", Change::Area(1.1)),
        ("10 % less area", Change::Area(0.9)),
        ("half of every core", Change::Cores(0.5)),
        ("twice every core", Change::Cores(2.0)),
        ("feathering axis at 0.22 c", Change::Axis(0.22)),
        ("feathering axis at 0.32 c", Change::Axis(0.32)),
        ("hinges 6 mm off the plane of symmetry", Change::Hinge(0.006)),
        ("hinges 10 mm off it", Change::Hinge(0.01)),
        ("the other sign of the elevation", Change::Elevation(ElevationPhase::Minus)),
    ]
}

/// Published less our L+, mean over the strokes.
fn gap(flown: &[Flown]) -> f64 {
    flown.iter().map(|f| f.case.paper_lift - f.means.scaled[0].mean).sum::<f64>() / flown.len() as f64
}

/// The levers by the size of what they do to L+, those which can be flown.
fn sorted(study: &Study) -> Vec<(&'static str, f64)> {
    let mut changes: Vec<_> = levers()
        .into_iter()
        .map(|(name, change)| (name, study.lift_change(change)))
        .filter(|c| c.1.is_finite())
        .collect();
    changes.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    changes
}

/// Paragraphs on the difference in lift.
pub fn paragraphs(flown: &[Flown], study: &Study, other: &Group) -> Vec<String> {
    let gap = gap(flown);
    let side = if gap >= 0.0 { "below" } else { "above" };
    let mut texts = vec![format!(
        "The mean L+ of the five strokes is {} {side} the paper's. What moves it, in order of size: {}.",
        fixed(gap.abs(), 3),
        listed(sorted(study).iter().map(|(name, change)| format!("{name} {}", signed(*change, 3))))
    )];
    texts.push(closing(&sorted(study), gap));
    let powers = levers().map(|(_, change)| study.power_per_lift_change(change));
    texts.push(format!(
        "Half of the suction is the paper's own choice (here suction_to_lift = {}); the area is a misprint in the paper \
         and is the specimen's here, axis and hinges are not given there. Power follows lift: of these changes none moves \
         the power per lift of any stroke by more than {} %.",
        Settings::default().suction_to_lift,
        fixed((100.0 * powers.into_iter().filter(|p| p.is_finite()).fold(0.0, f64::max)).ceil(), 0),
    ));
    texts.extend(like_with_like(study, other));
    texts
}

/// Which changes would close the difference alone.
fn closing(changes: &[(&str, f64)], gap: f64) -> String {
    let share = |change: f64| change / gap;
    let alone: Vec<_> = changes.iter().filter(|c| share(c.1) >= 1.0).map(|c| c.0.to_owned()).collect();
    let greatest = changes.iter().max_by(|a, b| share(a.1).total_cmp(&share(b.1)));
    match (alone.is_empty(), greatest) {
        (false, _) => format!("What would close the difference alone: {}.", listed(alone.into_iter())),
        (true, Some((name, change))) => format!(
            "None of them alone closes the difference; the most is done by {name}: {} % of it.",
            fixed(100.0 * share(*change), 0)
        ),
        (true, None) => String::new(),
    }
}

/// The comparison with codes which keep all suction in the wing's plane.
fn like_with_like(study: &Study, other: &Group) -> Option<String> {
    let fine = other.rows.iter().find(|r| r.setup == Setup::Fine)?;
    let default = other.rows.iter().find(|r| r.setup == Setup::Flown)?;
    let Expected::Between { low, high } = default.expected else { return None };
    let middle = 0.5 * (low + high);
    Some(format!(
        "Like with like: public codes keep the suction in the wing's plane. In the flight they share ({}) we have {} mN \
         with all cores 0.05 c and {} mN with the default lattice and cores, against {} to {} mN, whose middle they \
         differ from by {} and {}. The five strokes with all suction in the plane change L+ by {} on average.",
        other_code::SHORT,
        fixed(fine.got, 1),
        fixed(default.got, 1),
        fixed(low, 1),
        fixed(high, 1),
        percent(fine.got / middle - 1.0, 0),
        percent(default.got / middle - 1.0, 0),
        signed(study.lift_change(Change::SuctionInPlane), 3),
    ))
}

/// "a, b and c".
fn listed(items: impl Iterator<Item = String>) -> String {
    let items: Vec<_> = items.collect();
    match items.split_last() {
        Some((last, [])) => last.clone(),
        Some((last, rest)) => format!("{} and {last}", rest.join(", ")),
        None => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::Row;
    use crate::validation;

    #[test]
    fn paragraphs_have_the_computed_numbers() {
        let coarse = Settings {
            chordwise_panels: 2,
            spanwise_panels: 4,
            steps_per_stroke: 16,
            strokes: 2,
            strokes_most: 2,
            strokes_dropped: 1,
            ..Settings::default()
        };
        let (flown, study) = (validation::fly(coarse).unwrap(), Study::fly(coarse));
        let row = |setup, got| Row {
            what: "x".into(),
            source: "codes",
            setup,
            expected: Expected::Between { low: 10.0, high: 30.0 },
            got,
        };
        let rows = vec![row(Setup::Fine, 21.0), row(Setup::Flown, 16.0)];
        let text = paragraphs(&flown, &study, &Group { title: "t", about: String::new(), rows }).join("\n");
        let suction =
            format!("all suction turned into lift {}", signed(study.lift_change(Change::SuctionToLift(1.0)), 3));
        for part in [&fixed(gap(&flown).abs(), 3), &suction, "by +5 % and -20 %"] {
            assert!(text.contains(part), "{part} in {text}");
        }
        assert!(!text.contains("NaN"), "{text}");
    }

    #[test]
    fn sentences_follow_the_numbers() {
        let changes = [("more area", 0.08), ("less suction", -0.09)];
        assert!(closing(&changes, 0.07).contains("difference alone: more area."));
        assert_eq!(
            closing(&changes, 0.16),
            "None of them alone closes the difference; the most is done by more area: 50 % of it."
        );
        // Where we lift too much it is less suction which would help.
        assert!(closing(&changes, -0.05).contains("less suction"));
        assert_eq!(listed(["a", "b", "c"].into_iter().map(String::from)), "a, b and c");
    }
}
