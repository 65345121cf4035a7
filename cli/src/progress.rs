//! How far a study is: a bar on a terminal, a line now and then elsewhere.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use manduca_protocol::text::{shown, shown_in_line};
use manduca_protocol::view::{StudyState, StudyView};

use crate::output::{is_quiet, note, speaks_json};

/// Between two lines about the same stage where there is no terminal.
const BETWEEN_LINES: Duration = Duration::from_secs(5);

/// A stage at a glance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Glance {
    /// Stage in words.
    pub stage: &'static str,
    /// Steps done.
    pub done: u64,
    /// Steps in all; 0 where unknown.
    pub total: u64,
    /// Rate, time left, troubles.
    pub detail: String,
    /// Whether it rests: then nothing counts down.
    pub paused: bool,
}

/// What there is to say about the present stage of a study.
pub fn glance(view: &StudyView) -> Glance {
    let paused = view.state == StudyState::Paused;
    let state = if paused { view.paused_from.unwrap_or(view.state) } else { view.state };
    let jobs = &view.stage_jobs;
    let all = jobs.ready + jobs.delayed + jobs.leased + jobs.succeeded + jobs.infeasible + jobs.dead;
    let mut details = Vec::new();
    let (done, total) = match (state, &view.progress) {
        (StudyState::Sampling, _) => (view.samples.succeeded, view.spec.sampling.samples.into()),
        (_, Some(progress)) => {
            details.push(progress.note.clone());
            (progress.done, progress.total)
        }
        _ => (jobs.succeeded + jobs.infeasible, all),
    };
    if state == StudyState::Sampling && !paused {
        details.extend(view.rate_per_s.filter(|&r| r > 0.0).map(|rate| format!("{rate:.1}/s")));
    }
    details.extend(view.eta_s.filter(|_| done < total && !paused).map(|eta| format!("{} left", span(eta))));
    for (count, what) in [(jobs.infeasible, "infeasible"), (jobs.delayed, "to be retried"), (jobs.dead, "given up")] {
        if count > 0 {
            details.push(format!("{count} {what}"));
        }
    }
    if paused {
        details.push("paused".into());
    }
    Glance { stage: state.name(), done, total, detail: details.join(", "), paused }
}

/// Seconds as a person says them.
pub fn span(seconds: f64) -> String {
    let whole = seconds.max(0.0).round() as u64;
    match (whole / 3600, whole / 60 % 60, whole % 60) {
        (0, 0, _) if seconds < 10.0 => format!("{:.1} s", seconds.max(0.0)),
        (0, 0, s) => format!("{s} s"),
        (0, m, s) => format!("{m} min {s:02} s"),
        (h, m, _) => format!("{h} h {m:02} min"),
    }
}

/// Shows one glance after the other.
pub struct Meter {
    bar: Option<ProgressBar>,
    shown: Option<Glance>,
    since: Instant,
    line_at: Instant,
}

impl Meter {
    /// A meter on standard error.
    pub fn new() -> Self {
        let bar = (std::io::stderr().is_terminal() && !is_quiet() && !speaks_json()).then(|| {
            let bar = ProgressBar::new(0);
            if let Ok(style) = ProgressStyle::with_template("{prefix:10} {bar:30} {pos}/{len}  {msg}  [{elapsed}]") {
                bar.set_style(style);
            }
            bar
        });
        Self { bar, shown: None, since: Instant::now(), line_at: Instant::now() }
    }

    /// Shows where a study is.
    pub fn show(&mut self, glance: Glance) {
        let new_stage = self.shown.as_ref().is_none_or(|shown| shown.stage != glance.stage);
        let news = new_stage || self.shown.as_ref().is_some_and(|shown| shown.paused != glance.paused);
        if new_stage {
            self.close_stage();
            self.since = Instant::now();
        }
        match &self.bar {
            Some(bar) => {
                if new_stage {
                    bar.reset_elapsed();
                    bar.enable_steady_tick(Duration::from_millis(500));
                }
                bar.set_prefix(glance.stage);
                bar.set_length(glance.total);
                bar.set_position(glance.done);
                bar.set_message(shown_in_line(&glance.detail).into_owned());
            }
            None if self.shown.as_ref() != Some(&glance) && (news || self.line_at.elapsed() >= BETWEEN_LINES) => {
                note(line(&glance));
                self.line_at = Instant::now();
            }
            None => {}
        }
        self.shown = Some(glance);
    }

    /// Says how a stage went; its last glance may be a moment short of its end.
    fn close_stage(&mut self) {
        let Some(glance) = self.shown.take() else { return };
        let text = format!("{:10} done in {}", glance.stage, span(self.since.elapsed().as_secs_f64()));
        self.say(&text);
    }

    /// Says something without spoiling the bar.
    pub fn say(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.println(shown(text)),
            None => note(text),
        }
    }

    /// Takes the bar away; `done` says whether the last stage came to its end.
    pub fn finish(mut self, done: bool) {
        if done {
            self.close_stage();
        }
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

fn line(glance: &Glance) -> String {
    let detail = if glance.detail.is_empty() { String::new() } else { format!("  {}", glance.detail) };
    format!("{:10} {}/{}{detail}", glance.stage, glance.done, glance.total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use manduca_protocol::ids::StudyId;
    use manduca_protocol::task::Progress;
    use manduca_protocol::trust::AuditVerdicts;
    use manduca_protocol::view::{JobCounts, StageSeconds};

    fn view(state: StudyState) -> StudyView {
        let mut spec = crate::study_file::load("quick").unwrap();
        spec.sampling.samples = 300;
        StudyView {
            audits: JobCounts::default(),
            audit_verdicts: AuditVerdicts::default(),
            distrusted: Vec::new(),
            disowned_results: 0,
            id: StudyId::new(),
            state,
            paused_from: None,
            failure: None,
            created_at: String::new(),
            submitted_by: None,
            steered_by: None,
            spec,
            solver_version: String::new(),
            samples: JobCounts { succeeded: 120, infeasible: 4, leased: 2, ..JobCounts::default() },
            stage_jobs: JobCounts { succeeded: 120, infeasible: 4, leased: 2, ..JobCounts::default() },
            progress: None,
            rate_per_s: Some(12.34),
            eta_s: Some(75.0),
            stages_s: StageSeconds::default(),
            surrogate: None,
            optimisations: Vec::new(),
        }
    }

    #[test]
    fn sampling_counts_feasible_samples() {
        let glance = glance(&view(StudyState::Sampling));
        assert_eq!(line(&glance), "sampling   120/300  12.3/s, 1 min 15 s left, 4 infeasible");
    }

    #[test]
    fn generations_count_their_strokes() {
        let mut flying = view(StudyState::Optimising);
        let note = "five: generation 12 of 50, best fitness 0.93120".into();
        flying.progress = Some(Progress { done: 3400, total: 14000, note });
        flying.stage_jobs = JobCounts { succeeded: 3390, infeasible: 10, ..JobCounts::default() };
        let said =
            "optimising 3400/14000  five: generation 12 of 50, best fitness 0.93120, 1 min 15 s left, 10 infeasible";
        assert_eq!(line(&glance(&flying)), said);
    }

    #[test]
    fn a_paused_study_shows_the_stage_it_rests_in() {
        let mut paused = view(StudyState::Paused);
        paused.paused_from = Some(StudyState::Training);
        paused.stage_jobs = JobCounts::default();
        paused.progress = Some(Progress { done: 3, total: 9, note: "iteration 3".into() });
        // Whatever was estimated before: nothing counts down.
        (paused.eta_s, paused.rate_per_s) = (Some(21.0), Some(4.0));
        assert_eq!(line(&glance(&paused)), "training   3/9  iteration 3, paused");
        (paused.paused_from, paused.progress) = (Some(StudyState::Sampling), None);
        assert_eq!(line(&glance(&paused)), "sampling   120/300  paused");
    }

    #[test]
    fn spans_read_well() {
        assert_eq!(
            [0.04, 9.94, 59.6, 3599.0, 7260.0].map(span),
            ["0.0 s", "9.9 s", "1 min 00 s", "59 min 59 s", "2 h 01 min"]
        );
    }
}
