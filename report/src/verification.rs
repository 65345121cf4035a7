//! The document on verification and validation.

use std::io;

use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_numerics::uvlm::Settings;

use crate::canonical::{self, oscillation, other_code, sudden_start, wagner};
use crate::check::{Group, Setup};
use crate::markdown::{Document, Table};
use crate::output::Report;
use crate::plot::Figure;
use crate::sensitivity::Study;
use crate::validation::Flown;
use crate::{difference, validation};

/// A document under way with its figures.
struct Draft {
    document: Document,
    figures: Vec<(&'static str, String)>,
}

/// Computes everything; `tell` hears what is being done.
///
/// # Errors
/// When a figure cannot be drawn or a published stroke cannot be flown.
pub fn compute(tell: &mut dyn FnMut(&str)) -> io::Result<Report> {
    let mut draft = Draft { document: Document::new("Verification and validation"), figures: Vec::new() };
    tell("canonical checks");
    let groups = canonical::all();
    draft.introduction(&groups);
    draft.canonical(&groups)?;
    tell("published strokes");
    let flown = validation::fly(Settings::default())?;
    draft.validation(&flown)?;
    tell("sensitivities");
    let study = Study::fly(Settings::default());
    draft.sensitivity(&study);
    draft.document.heading("What makes the lift differ from the paper's");
    let other = groups.iter().find(|group| group.title == other_code::TITLE);
    for text in other.map(|other| difference::paragraphs(&flown, &study, other)).unwrap_or_default() {
        draft.document.paragraph(&text);
    }
    Ok(Report { name: "verification.md", text: draft.document.text().to_owned(), figures: draft.figures })
}

impl Draft {
    fn figure(&mut self, name: &'static str, words: &str, figure: &Figure) -> io::Result<()> {
        self.document.figure(&format!("figures/{name}"), words);
        self.figures.push((name, figure.svg()?));
        Ok(())
    }

    fn introduction(&mut self, groups: &[Group]) {
        self.document.paragraph(&format!(
            "`manduca report verification` computes and writes this page (solver_version {SOLVER_VERSION}); the tests of \
             the crate `report` assert the same checks. The physics is in [model.md](model.md)."
        ));
        let counted = |setup: Setup| {
            let rows: Vec<_> = groups.iter().flat_map(|g| &g.rows).filter(|r| r.setup == setup).collect();
            format!("{} of {}", rows.iter().filter(|r| r.pass()).count(), rows.len())
        };
        self.document.paragraph(&format!(
            "With small cores {} checks pass, with the default settings on lattices and steps the published values are \
             for {}, with the default lattice and the step of a hawkmoth's stroke as well {}. Those which fail, by their \
             worst:",
            counted(Setup::Fine),
            counted(Setup::Production),
            counted(Setup::Flown)
        ));
        self.document.table(&failures(groups));
    }

    fn canonical(&mut self, groups: &[Group]) -> io::Result<()> {
        self.document.heading("Canonical checks");
        self.document.paragraph(&canonical::settings());
        for group in groups {
            self.document.subheading(group.title);
            self.document.paragraph(&format!("{} Source: {}.", group.about, group.sources().join("; ")));
            self.document.table(&group.table());
            match group.title {
                wagner::TITLE => {
                    self.figure("wagner.svg", "Lift of a plate after a sudden start", &wagner::figure())?
                }
                oscillation::TITLE => {
                    self.figure("theodorsen.svg", "Lift of a plunging plate", &oscillation::figure())?;
                }
                sudden_start::TITLE => {
                    self.figure("sudden-start.svg", "Lift of wings after a sudden start", &sudden_start::figure())?;
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn validation(&mut self, flown: &[Flown]) -> io::Result<()> {
        let s = Settings::default();
        self.document.heading("The published strokes");
        self.document.paragraph(&format!(
            "Nguyen et al. 2019 beside our means at the default settings: {} x {} panels, {} steps, the last {} of {} \
             strokes, mean ± standard error.",
            s.chordwise_panels,
            s.spanwise_panels,
            s.steps_per_stroke,
            s.strokes_kept(),
            s.strokes
        ));
        self.document.table(&validation::means(flown));
        self.document.paragraph(&validation::words(flown));
        self.document.paragraph(
            "Power by joints, mW, both wings: against the air, against the wing's inertia (signed means), and required, \
             the mean of what is positive of their sum.",
        );
        self.document.table(&validation::joints(flown));
        self.document.paragraph("The last stroke. Downstroke 0 to 0.5, upstroke 0.5 to 1.");
        self.figure("stroke-forces.svg", "Lift, drag and power over a stroke", &validation::forces(flown))?;
        self.figure("stroke-angles.svg", "Sweep, elevation and rotation over a stroke", &validation::angles(flown))
    }

    fn sensitivity(&mut self, study: &Study) {
        self.document.heading("Sensitivities");
        self.document.paragraph(
            "Change of the means when one thing is changed from its default: mean over the five strokes, in brackets \
             least and greatest. Area is changed by the mean chord at the same length and wing mass; cores are all \
             but for growth time and spreading.",
        );
        self.document.table(&study.changes());
        self.document.paragraph("L+ and P/L (W/N) of each stroke:");
        self.document.table(&study.by_case());
    }
}

/// The worst failure of each group at each setting.
fn failures(groups: &[Group]) -> Table {
    let mut table = Table::new(["checks", "settings", "fail", "worst", "expected", "got"]);
    for group in groups {
        for setup in Setup::ALL {
            let failed: Vec<_> = group.rows.iter().filter(|r| r.setup == setup && !r.pass()).collect();
            let worst = failed.iter().max_by(|a, b| a.excess().total_cmp(&b.excess()));
            let Some(worst) = worst else { continue };
            let all = group.rows.iter().filter(|r| r.setup == setup).count();
            let [expected, _] = worst.wanted();
            let [got, ..] = worst.found();
            table.row([
                group.title.to_owned(),
                setup.name().to_owned(),
                format!("{} of {all}", failed.len()),
                worst.what.clone(),
                expected,
                got,
            ]);
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{Expected, Row};

    #[test]
    fn the_worst_failure_is_told() {
        let row = |what: &str, got| Row {
            what: what.into(),
            source: "book",
            setup: Setup::Production,
            expected: Expected::Within { value: 1.0, share: 0.1 },
            got,
        };
        let group = Group { title: "g", about: String::new(), rows: vec![row("a", 1.2), row("b", 0.7), row("c", 1.0)] };
        let text = failures(&[group]).to_string();
        assert!(text.contains("| g | default | 2 of 3 | b | 1.000 | 0.7000 |"), "{text}");
    }
}
