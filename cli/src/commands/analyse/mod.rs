//! `manduca analyse`: what an optimum depends on, asked of a study's surrogate here.

mod answer;
mod searches;
mod shares;

use std::process::ExitCode;

use anyhow::{Context, Result};
use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::Clearance;
use manduca_numerics::optimise::Problem;
use manduca_numerics::optimise::sqp::Flight;
use manduca_numerics::parameters::{OUTPUTS, Point};
use manduca_numerics::surrogate::Surrogate;
use manduca_protocol::ids::StudyId;
use manduca_protocol::resolve::{self, ResolvedOptimisation};
use manduca_protocol::study::OptimisationSpec;
use manduca_protocol::task::Scaled;
use manduca_protocol::view::PredictionResponse;
use serde_json::{Map, Value};

use self::answer::Answer;
use crate::args::{AnalyseCommand, SubjectArgs};
use crate::exit::refused;
use crate::output::Output;
use crate::render;

/// Fetches a surrogate and asks it.
pub async fn analyse(command: AnalyseCommand) -> Result<ExitCode> {
    let args = match &command {
        AnalyseCommand::Front(args) => &args.subject,
        AnalyseCommand::Sobol(args) => &args.subject,
        AnalyseCommand::Sweep(args) => &args.subject,
        AnalyseCommand::Population(args) => &args.subject,
    };
    let subject = Subject::fetch(args).await?;
    let (csv, json) = (args.csv, args.json);
    let answer = tokio::task::spawn_blocking(move || match &command {
        AnalyseCommand::Front(args) => searches::front(&subject, args),
        AnalyseCommand::Sobol(args) => shares::sobol(&subject, args),
        AnalyseCommand::Sweep(args) => searches::sweep(&subject, args),
        AnalyseCommand::Population(args) => searches::population(&subject, args),
    });
    answer.await??.write(&mut Output::stdout(), csv, json)?;
    Ok(ExitCode::SUCCESS)
}

/// What is analysed.
struct Subject {
    id: StudyId,
    name: String,
    surrogate: Surrogate,
    insect: Insect,
    clearance: Clearance,
    spec: OptimisationSpec,
    how: ResolvedOptimisation,
    seed: u64,
    /// Root mean square errors of the surrogate on its test share.
    test_rmse: Option<Scaled>,
}

impl Subject {
    async fn fetch(args: &SubjectArgs) -> Result<Self> {
        let api = args.coordinator.api()?;
        let id = api.find(&args.study).await?;
        let view = api.study(id).await?;
        let study = resolve::study(&view.spec).map_err(|_| refused("the study is of another version"))?;
        let spec = match &args.optimisation {
            None => OptimisationSpec::whole_box(view.spec.sampling.clearance_margin_mm)?,
            Some(name) => {
                let asked = view.spec.optimisations.iter().find(|o| o.name == *name).cloned();
                asked.ok_or_else(|| refused(format!("study {id} has no optimisation `{name}`")))?
            }
        };
        let seed = args.seed.unwrap_or(view.spec.seed);
        let how = resolve::optimisation(&spec, &study.bounds, seed)
            .map_err(|faults| refused(faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")))?;
        let surrogate = api.model(id).await.context("the study has no surrogate to ask")?;
        let model = study.model;
        let clearance = Clearance::new(&model.insect, model.elevation_phase);
        let (name, test_rmse) = (view.spec.name, view.surrogate.map(|errors| errors.rmse));
        Ok(Self { id, name, surrogate, insect: model.insect, clearance, spec, how, seed, test_rmse })
    }

    fn margin_m(&self) -> f64 {
        self.spec.margin_m()
    }

    fn flight(&self) -> Flight<'_> {
        let (clearance, bounds) = (Some(&self.clearance), self.how.bounds);
        Flight { surrogate: &self.surrogate, clearance, margin_m: self.margin_m(), bounds }
    }

    /// Runs a search on the penalised fitness.
    fn penalised<T>(&self, search: impl FnOnce(&Problem<'_>) -> T) -> T {
        search(&Problem {
            predict: &|points: &[Point], values: &mut [[f64; 4]]| self.surrogate.predict_into(points, values),
            clearance: &|points: &[Point], values: &mut [f64]| self.clearance.of_each(points, values),
            margin_m: self.margin_m(),
            bounds: self.how.bounds,
            penalty_r: self.spec.penalty_r,
            penalty_s: self.spec.penalty_s,
        })
    }

    /// An answer without rows.
    fn answer(&self, analysis: &str, lead: String) -> Answer {
        let within = if self.spec.name == "whole box" { "its bounds".into() } else { format!("`{}`", self.spec.name) };
        let facts: Map<String, Value> = [
            ("by", Value::from(PredictionResponse::BY)),
            ("test_rmse", serde_json::to_value(self.test_rmse).unwrap_or_default()),
            ("analysis", Value::from(analysis)),
            ("study", Value::from(self.id.to_string())),
            ("optimisation", Value::from(self.spec.name.as_str())),
            ("seed", Value::from(self.seed)),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into_iter()
        .collect();
        let errors = self.test_rmse.as_ref().map(render::scaled).map_or_else(String::new, |errors| {
            let each = OUTPUTS.iter().zip(errors).map(|((_, _, symbol, _), e)| format!("{symbol} {e:.4}"));
            format!(", test errors (rms) {}", each.collect::<Vec<_>>().join(", "))
        });
        let lead = format!(
            "{lead}, on the surrogate of {} ({}), within {within}\nBy {}{errors}",
            self.name,
            self.id,
            PredictionResponse::BY
        );
        Answer { facts, lead, columns: Vec::new(), rows: Vec::new() }
    }
}
