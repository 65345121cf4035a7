//! A database is checked: the file, what must hold between its tables, and every value that follows from
//! others or has to be read.

use std::collections::{BTreeMap, HashMap};
use std::fmt::Display;

use manduca_numerics::parameters::Point;
use manduca_numerics::simulation::SOLVER_VERSION;
use manduca_protocol::study::{OptimisationSpec, StudySpec};
use manduca_protocol::task::{
    Checkpoint, OptimiseResult, Progress, SimulateOutcome, SimulateResult, Task, TrainResult,
};
use manduca_protocol::view::{JobRole, JobState, SearchView, SurrogateView};
use serde::Serialize;
use serde::de::DeserializeOwned;
use sqlx::sqlite::SqliteConnection;
use uuid::Uuid;

use super::{Offline, OfflineError};
use crate::auth::Scopes;
use crate::compose;
use crate::store::{Condition, Stage, inspect, kind_of, list_breaches, named, unpack};

/// What a check found. All is well where both lists are empty.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Findings {
    /// What SQLite says of the file.
    pub damage: Vec<String>,
    /// Rules within and between the tables which are broken, in sentences.
    pub breaches: Vec<String>,
    /// Results whose digest was computed anew.
    pub results: u64,
    /// Simulations whose key was computed anew.
    pub keys: u64,
}

impl Findings {
    /// Whether nothing is wrong.
    pub fn is_well(&self) -> bool {
        self.damage.is_empty() && self.breaches.is_empty()
    }
}

/// Most attempts at a file that others change while it is read.
const MOST_TRIES: u32 = 3;

impl Offline {
    /// Checks the file, what must hold between its tables, and every value that follows from others.
    ///
    /// # Errors
    /// When the database is of another version, or cannot be read at all.
    pub async fn check(&mut self) -> Result<Findings, OfflineError> {
        for _ in 1..MOST_TRIES {
            let findings = self.check_once().await?;
            if self.file.is_undisturbed() {
                return Ok(findings);
            }
            // A coordinator has started meanwhile, and what was read may be half old and half new.
            self.file.look_again().await?;
        }
        self.check_once().await
    }

    async fn check_once(&mut self) -> Result<Findings, OfflineError> {
        self.file.check_version().await?;
        let mut check = Check::default();
        let db = self.file.db();
        match crate::store::check_file(db).await {
            Ok(damage) => check.findings.damage = damage,
            Err(error) => check.unreadable("the file", &error),
        }
        match list_breaches(db).await {
            Ok(broken) => check.findings.breaches = broken.into_iter().map(|(rule, n)| format!("{n} {rule}")).collect(),
            Err(error) => check.unreadable("some table", &error),
        }
        // Each by itself: where one table is damaged the others are still looked at.
        let parts = [
            ("studies", check.studies(db).await),
            ("studies, study_counts, workers or refused_results", check.numbers(db).await),
            ("jobs", check.jobs(db).await),
            ("results", check.results(db).await),
            ("refused_results", check.refused(db).await),
            ("checkpoints", check.checkpoints(db).await),
            ("tokens, workers or study_stages", check.others(db).await),
        ];
        for (table, outcome) in parts {
            if let Err(error) = outcome {
                check.unreadable(table, &error);
            }
        }
        Ok(check.end())
    }
}

/// A rule and how often it is broken.
#[derive(Default)]
struct Broken {
    times: u64,
    first: String,
}

#[derive(Default)]
struct Check {
    findings: Findings,
    broken: BTreeMap<&'static str, Broken>,
    specs: HashMap<i64, StudySpec>,
}

/// Whether bytes are the JSON of this.
fn parses<T: DeserializeOwned>(bytes: &[u8]) -> bool {
    serde_json::from_slice::<T>(bytes).is_ok()
}

/// What a column's text names.
fn name<T: DeserializeOwned>(bytes: &[u8]) -> Option<T> {
    named(std::str::from_utf8(bytes).ok()?).ok()
}

fn is_text(bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes).is_ok_and(|text| !text.is_empty())
}

fn is_uuid(bytes: &[u8]) -> bool {
    Uuid::from_slice(bytes).is_ok_and(|id| id.get_version_num() == 7)
}

impl Check {
    fn unreadable(&mut self, what: &str, error: &sqlx::Error) {
        self.findings.damage.push(format!("{what} cannot be read: {}", crate::error::chain(error)));
    }

    /// Notes a broken rule, of which `row` is an example.
    fn expect(&mut self, holds: bool, rule: &'static str, row: impl Display) {
        if holds {
            return;
        }
        let broken = self.broken.entry(rule).or_default();
        broken.times += 1;
        if broken.times == 1 {
            broken.first = row.to_string();
        }
    }

    fn end(mut self) -> Findings {
        let sentence = |(rule, b): (&str, &Broken)| format!("{} {rule} (the first: {})", b.times, b.first);
        let sentences = self.broken.iter().map(|(rule, broken)| sentence((rule, broken)));
        self.findings.breaches.extend(sentences);
        self.findings
    }

    async fn studies(&mut self, db: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        let mut added: HashMap<i64, Vec<OptimisationSpec>> = HashMap::new();
        for (study, ordinal, spec) in inspect::list_added(db).await? {
            let spec = serde_json::from_slice(&spec).ok();
            self.expect(
                spec.is_some(),
                "added_optimisations have a spec that cannot be read",
                format_args!("study {study}, {ordinal}"),
            );
            added.entry(study).or_default().extend(spec);
        }
        for row in inspect::list_studies(db).await? {
            let study = row.study;
            let row_name = format!("study {study}, {}", Uuid::from_slice(&row.id).unwrap_or_default());
            self.expect(is_uuid(&row.id), "studies have an id that is none", &row_name);
            self.expect(name::<Stage>(&row.stage).is_some(), "studies have a stage that is none", &row_name);
            self.expect(
                name::<Condition>(&row.condition).is_some(),
                "studies have a condition that is none",
                &row_name,
            );
            let digest = blake3::hash(&row.spec);
            self.expect(
                digest.as_bytes()[..] == row.spec_digest,
                "studies have a spec that differs from its digest",
                &row_name,
            );
            let version =
                row.solver_version.as_deref().is_none_or(|v| is_text(v) && v.iter().all(u8::is_ascii_graphic));
            self.expect(version, "studies have a solver_version that is none", &row_name);
            self.expect(row.next_sample >= row.samples, "studies have a next_sample before their samples", &row_name);
            let Ok(mut spec) = serde_json::from_slice::<StudySpec>(&row.spec) else {
                self.expect(false, "studies have a spec that cannot be read", &row_name);
                continue;
            };
            self.expect(
                spec.name.as_bytes() == row.name,
                "studies have a name that differs from their spec's",
                &row_name,
            );
            let samples = i64::from(spec.sampling.samples) == row.samples;
            self.expect(samples, "studies have other samples than their spec", &row_name);
            spec.optimisations.extend(added.remove(&study).unwrap_or_default());
            let optimisations = spec.optimisations.len() as i64 == row.optimisations;
            self.expect(optimisations, "studies have other optimisations than their spec", &row_name);
            // Keys of another version's simulations are made with that version.
            if row.solver_version.as_deref() == Some(SOLVER_VERSION.as_bytes()) {
                self.specs.insert(study, spec);
            }
        }
        Ok(())
    }

    /// What nothing else follows from, but without which a row cannot be shown or worked with.
    async fn numbers(&mut self, db: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        let cut = sqlx::query_scalar("select study from studies where length(secret) is not 32 order by study");
        let cut: Vec<i64> = cut.fetch_all(&mut *db).await?;
        for study in cut {
            self.expect(false, "studies have a secret that is cut", format_args!("study {study}"));
        }
        let below = sqlx::query_scalar("select study from study_counts where n < 0 order by study");
        let below: Vec<i64> = below.fetch_all(&mut *db).await?;
        for study in below {
            self.expect(false, "counters are negative", format_args!("study {study}"));
        }
        let workers = sqlx::query_scalar(
            "select cast(name as blob) from workers
             where min(slots, completed, failed, strikes) < 0 or max(slots, strikes) > 4294967295 order by id",
        );
        let workers: Vec<Vec<u8>> = workers.fetch_all(&mut *db).await?;
        for name in workers {
            self.expect(false, "workers have a number that is none", String::from_utf8_lossy(&name));
        }
        let refused = sqlx::query_scalar(
            "select refused from refused_results
             where attempt not between 0 and 4294967295 or length(worker) <> 16 order by refused",
        );
        let refused: Vec<i64> = refused.fetch_all(&mut *db).await?;
        for row in refused {
            self.expect(
                false,
                "refused_results have an attempt or worker that is none",
                format_args!("evidence {row}"),
            );
        }
        Ok(())
    }

    async fn jobs(&mut self, db: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        let mut after = i64::MIN;
        loop {
            let rows = inspect::list_jobs(db, after).await?;
            let Some(last) = rows.last() else { return Ok(()) };
            after = last.job;
            for row in rows {
                self.job(&row);
            }
        }
    }

    fn job(&mut self, row: &inspect::JobRow) {
        let at = format!("job {}", row.job);
        self.expect(name::<JobState>(&row.state).is_some(), "jobs have a state that is none", &at);
        let counts = [row.ordinal, row.attempt, row.failures, row.losses];
        let counted = counts.into_iter().all(|n| u32::try_from(n).is_ok());
        self.expect(counted, "jobs have an ordinal, attempt or count that is none", &at);
        self.expect(row.worker.as_deref().is_none_or(is_uuid), "jobs have a worker that is none", &at);
        self.expect(
            row.progress.as_deref().is_none_or(parses::<Progress>),
            "jobs have a progress that cannot be read",
            &at,
        );
        self.expect(
            row.reason.as_deref().is_none_or(|r| std::str::from_utf8(r).is_ok()),
            "jobs have a reason that is no text",
            &at,
        );
        let Some(role) = name::<JobRole>(&row.role) else {
            return self.expect(false, "jobs have a role that is none", &at);
        };
        if row.shares {
            self.expect(row.key == row.shared_key, "jobs share the result of another simulation", &at);
        }
        let flies = kind_of(role) == manduca_protocol::task::JobKind::Simulate;
        let point = row.parameters.as_deref().map(parses::<Point>);
        self.expect(point == flies.then_some(true), "jobs have parameters that cannot be read", &at);
        let keyed = flies && role != JobRole::Audit;
        self.expect(row.key.is_some() == keyed, "jobs lack their key, or have one without need", &at);
        let (Some(parameters), Some(spec), Ok(ordinal)) =
            (row.parameters.as_deref(), self.specs.get(&row.study), u32::try_from(row.ordinal))
        else {
            return;
        };
        let text = String::from_utf8_lossy(parameters);
        let Ok(Task::Simulate(task)) = compose::simulation(spec, role, ordinal, &text) else { return };
        if keyed {
            self.findings.keys += 1;
            let same = row.key.as_deref() == Some(&task.key()[..]);
            self.expect(same, "jobs have a key that is not that of their parameters and study", &at);
        }
    }

    async fn results(&mut self, db: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        let mut after = i64::MIN;
        loop {
            let rows = inspect::list_results(db, after).await?;
            let Some(last) = rows.last() else { return Ok(()) };
            after = last.job;
            for row in rows {
                self.findings.results += 1;
                self.result(row);
            }
        }
    }

    fn result(&mut self, row: inspect::ResultRow) {
        let at = format!("job {}", row.job);
        let body = unpack(row.body).unwrap_or_default();
        self.expect(blake3::hash(&body).as_bytes()[..] == row.digest, "results differ from their digest", &at);
        self.expect(row.wall_s.is_finite() && row.wall_s >= 0.0, "results have a wall_s that is no duration", &at);
        self.expect(is_text(&row.level), "results have a level that is none", &at);
        self.expect(is_uuid(&row.worker), "results have a worker that is none", &at);
        self.expect(u32::try_from(row.attempt).is_ok_and(|n| n > 0), "results have an attempt that is none", &at);
        let Some(role) = row.role.as_deref().and_then(name::<JobRole>) else { return };
        let summary = row.summary.as_deref();
        let (body_reads, summary_reads) = match role {
            JobRole::Train => (parses::<TrainResult>(&body), summary.is_some_and(parses::<SurrogateView>)),
            JobRole::Optimise => (parses::<OptimiseResult>(&body), summary.is_none()),
            JobRole::Search | JobRole::Generation => {
                (parses::<manduca_protocol::search::SearchResult>(&body), summary.is_some_and(parses::<SearchView>))
            }
            _ => (parses::<SimulateResult>(&body), summary.is_none()),
        };
        self.expect(body_reads, "results have a body that cannot be read", &at);
        self.expect(summary_reads, "results have a summary that cannot be read", &at);
        if let Ok(SimulateResult { outcome: SimulateOutcome::Infeasible { reason }, .. }) =
            serde_json::from_slice(&body)
        {
            let same = row.reason.as_deref() == Some(reason.as_bytes());
            let state = row.state.as_deref() == Some(b"infeasible");
            self.expect(same && state, "jobs have another outcome or reason than their result", &at);
        }
    }

    async fn refused(&mut self, db: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        let mut after = i64::MIN;
        loop {
            let rows = inspect::list_refused(db, after).await?;
            let Some(last) = rows.last() else { return Ok(()) };
            after = last.0;
            for (refused, digest, body) in rows {
                let same = unpack(body).is_ok_and(|json| blake3::hash(&json).as_bytes()[..] == digest);
                self.expect(
                    same,
                    "refused_results have a body that differs from its digest",
                    format_args!("evidence {refused}"),
                );
            }
        }
    }

    async fn checkpoints(&mut self, db: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        let mut after = i64::MIN;
        while let Some((job, body)) = inspect::list_checkpoints(db, after).await?.pop() {
            after = job;
            let reads = unpack(body).is_ok_and(|json| parses::<Checkpoint>(&json));
            self.expect(reads, "checkpoints have a body that cannot be read", format_args!("job {job}"));
        }
        Ok(())
    }

    async fn others(&mut self, db: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        for (token, scopes, hash) in inspect::list_token_rows(db).await? {
            let at = String::from_utf8_lossy(&token);
            let known = std::str::from_utf8(&scopes)
                .is_ok_and(|text| Scopes::parse(text).is_ok_and(|s| s != Scopes::default()));
            self.expect(known, "tokens have scopes that are none", &at);
            self.expect(hash == 32, "tokens have a hash that is cut", &at);
            self.expect(is_text(&token), "tokens have a name that is no text", &at);
        }
        for (id, worker, level, version) in inspect::list_worker_rows(db).await? {
            let at = String::from_utf8_lossy(&worker);
            let texts = is_text(&worker) && is_text(&level) && version.as_deref().is_none_or(is_text);
            self.expect(texts, "workers have a name, level or solver_version that is no text", &at);
            self.expect(is_uuid(&id), "workers have an id that is none", &at);
        }
        for (study, stage, is_reversed) in inspect::list_stage_rows(db).await? {
            let at = format!("study {study}");
            self.expect(name::<Stage>(&stage).is_some(), "study_stages have a stage that is none", &at);
            self.expect(!is_reversed, "study_stages end before they begin", &at);
        }
        Ok(())
    }
}
