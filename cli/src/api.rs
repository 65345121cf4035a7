//! A coordinator as the command line sees it.

use anyhow::{Context, Result, anyhow};
use manduca_numerics::surrogate::Surrogate;
use manduca_protocol::ids::{JobId, StudyId, WorkerId};
use manduca_protocol::network;
use manduca_protocol::study::{OptimisationSpec, StudySpec};
use manduca_protocol::task::SurrogateMessage;
use manduca_protocol::view::{JobView, OptimumView, Page, StudyResult, StudySummary, StudyView, SurrogateView};
use manduca_protocol::watch::{Explanation, ScalingView};
use manduca_protocol::who::WorkerView;
use manduca_worker::http::{self, CallError, Http, StatusCode};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::exit::refused;

/// Studies asked for per page of the list.
const PAGE: &str = "1000";

/// The part of any answer about a study which names it.
#[derive(Deserialize)]
struct Named {
    id: StudyId,
}

/// A list of workers: a page, or of an older coordinator all at once.
#[derive(Deserialize)]
#[serde(untagged)]
enum Workers {
    Page(Page<WorkerView>),
    All(Vec<WorkerView>),
}

/// A coordinator.
#[derive(Debug, Clone)]
pub struct Api {
    http: Http,
}

impl Api {
    /// The coordinator a client is of.
    pub fn of(http: Http) -> Self {
        Self { http }
    }

    /// Submits a study; submissions with one key are one study.
    pub async fn submit(&self, spec: &StudySpec, key: Option<&str>) -> Result<StudyId> {
        Ok(self.submit_new(spec, key).await?.0)
    }

    /// [`Api::submit`], which also tells whether the study is new.
    pub async fn submit_new(&self, spec: &StudySpec, key: Option<&str>) -> Result<(StudyId, bool)> {
        let mut request = self.http.post("/v1/studies").json(spec);
        if let Some(key) = key {
            request = request.header("idempotency-key", key);
        }
        let (status, Named { id }) = http::call_for_status(request).await.context("cannot submit the study")?;
        Ok((id, status == StatusCode::CREATED))
    }

    /// All studies, the oldest first.
    pub async fn studies(&self) -> Result<Vec<StudySummary>, CallError> {
        let mut all: Vec<StudySummary> = self.pages("/v1/studies").await?;
        // Ids are made from the clock, so they sort by age.
        all.sort_by_key(|study| study.id);
        Ok(all)
    }

    /// All jobs of a study which succeeded.
    pub async fn jobs_done(&self, id: StudyId) -> Result<Vec<JobView>, CallError> {
        self.pages(&format!("/v1/studies/{id}/jobs?state=succeeded")).await
    }

    /// All pages of a list.
    async fn pages<T: DeserializeOwned>(&self, path: &str) -> Result<Vec<T>, CallError> {
        let mut all = Vec::new();
        let mut cursor: Option<String> = None;
        loop {
            let mut request = self.http.get(path).query(&[("limit", PAGE)]);
            if let Some(cursor) = &cursor {
                request = request.query(&[("cursor", cursor)]);
            }
            let page: Page<T> = http::call(request).await?;
            all.extend(page.items);
            cursor = page.next_cursor;
            if cursor.is_none() {
                return Ok(all);
            }
        }
    }

    /// A study.
    pub async fn study(&self, id: StudyId) -> Result<StudyView, CallError> {
        http::call(self.http.get(&format!("/v1/studies/{id}"))).await
    }

    /// Its optima.
    pub async fn result(&self, id: StudyId) -> Result<StudyResult, CallError> {
        http::call(self.http.get(&format!("/v1/studies/{id}/optimum"))).await
    }

    /// Its training.
    pub async fn surrogate(&self, id: StudyId) -> Result<SurrogateView, CallError> {
        http::call(self.http.get(&format!("/v1/studies/{id}/surrogate"))).await
    }

    /// Its surrogate, with all its numbers.
    pub async fn model(&self, id: StudyId) -> Result<Surrogate> {
        let message: SurrogateMessage = http::call(self.http.get(&format!("/v1/studies/{id}/surrogate/model"))).await?;
        network::surrogate(&message).map_err(|why| anyhow!("the surrogate of study {id} is of another version: {why}"))
    }

    /// Whether it has a surrogate already.
    pub async fn model_so_far(&self, id: StudyId) -> Result<bool, CallError> {
        match http::send(self.http.get(&format!("/v1/studies/{id}/surrogate/model"))).await {
            Ok(_) => Ok(true),
            Err(error) if error.is_problem("not-yet") => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Asks for a further optimum on its network.
    pub async fn add_optimisation(&self, id: StudyId, spec: &OptimisationSpec) -> Result<OptimumView, CallError> {
        http::call(self.http.post(&format!("/v1/studies/{id}/optimisations")).json(spec)).await
    }

    /// The workers heard of within a day, by name.
    pub async fn workers(&self) -> Result<Vec<WorkerView>, CallError> {
        self.list_workers(None).await
    }

    /// Those of them with this name or id.
    pub async fn workers_called(&self, name: &str) -> Result<Vec<WorkerView>, CallError> {
        self.list_workers(Some(name)).await
    }

    async fn list_workers(&self, find: Option<&str>) -> Result<Vec<WorkerView>, CallError> {
        let (mut all, mut cursor): (Vec<WorkerView>, Option<String>) = (Vec::new(), None);
        loop {
            let mut request = self.http.get("/v1/workers").query(&[("limit", PAGE)]);
            for (name, value) in [("find", find), ("cursor", cursor.as_deref())] {
                request = match value {
                    Some(value) => request.query(&[(name, value)]),
                    None => request,
                };
            }
            cursor = match http::call(request).await? {
                Workers::Page(page) => {
                    all.extend(page.items);
                    page.next_cursor
                }
                Workers::All(workers) => {
                    all = workers;
                    None
                }
            };
            if cursor.is_none() {
                break;
            }
        }
        let meant = |w: &WorkerView| find.is_none_or(|text| w.name == text || w.id.to_string() == text);
        all.retain(meant);
        all.sort_by(|a, b| (&a.name, a.id).cmp(&(&b.name, b.id)));
        Ok(all)
    }

    /// How much there is to do, and for how many slots.
    pub async fn scaling(&self) -> Result<ScalingView, CallError> {
        http::call(self.http.get("/v1/scaling")).await
    }

    /// The coordinator's address.
    pub fn address(&self) -> &str {
        self.http.base()
    }

    /// Asks a worker to finish what it has and leave.
    pub async fn drain(&self, worker: WorkerId) -> Result<(), CallError> {
        http::send_expecting(self.http.post(&format!("/v1/workers/{worker}/drain")), StatusCode::ACCEPTED).await
    }

    /// Sets a worker aside and disowns its results.
    pub async fn disown(&self, worker: WorkerId) -> Result<(), CallError> {
        http::send(self.http.post(&format!("/v1/workers/{worker}/disown"))).await.map(drop)
    }

    /// Gives jobs again to a worker that was set aside.
    pub async fn readmit(&self, worker: WorkerId) -> Result<(), CallError> {
        http::send(self.http.post(&format!("/v1/workers/{worker}/readmit"))).await.map(drop)
    }

    /// Why a job is where it is.
    pub async fn explain(&self, job: JobId) -> Result<Explanation, CallError> {
        http::call(self.http.get(&format!("/v1/jobs/{job}/explain"))).await
    }

    /// `pause`, `resume`, `cancel` or `retry-failed`.
    pub async fn act(&self, id: StudyId, action: &str) -> Result<(), CallError> {
        http::call::<Named>(self.http.post(&format!("/v1/studies/{id}/{action}"))).await.map(drop)
    }

    /// A part of a study, such as `dataset`, in a media type, as it comes.
    pub async fn part(&self, id: StudyId, part: &str, media_type: &str) -> Result<reqwest::Response, CallError> {
        let request = self.http.get(&format!("/v1/studies/{id}/{part}"));
        let request = request.header("accept", media_type).timeout(std::time::Duration::from_secs(3600));
        http::open(request, media_type).await
    }

    /// The study a person means by a whole id, the end of one, or `latest`.
    pub async fn find(&self, text: &str) -> Result<StudyId> {
        if let Ok(id) = text.parse() {
            return Ok(id);
        }
        pick(text, &self.studies().await?)
    }
}

/// The beginnings of ids made on one day are all alike: their ends tell them apart.
fn pick(text: &str, studies: &[StudySummary]) -> Result<StudyId> {
    if text == "latest" {
        return studies.iter().map(|s| s.id).max().ok_or_else(|| refused("there are no studies yet"));
    }
    let wanted = text.to_ascii_lowercase();
    let ends = |s: &&StudySummary| !wanted.is_empty() && s.id.to_string().ends_with(&wanted);
    let matching: Vec<_> = studies.iter().filter(ends).collect();
    match matching[..] {
        [study] => Ok(study.id),
        [] => Err(refused(format!("no study's id is or ends with `{text}` (`manduca study list` shows them)"))),
        _ => Err(refused(format!("{} studies' ids end with `{text}`: give more of it", matching.len()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use manduca_protocol::view::StudyState;

    fn study(id: &str) -> StudySummary {
        StudySummary {
            id: id.parse().unwrap(),
            name: "x".into(),
            state: StudyState::Sampling,
            created_at: String::new(),
            samples: 1,
            samples_succeeded: 0,
            submitted_by: None,
        }
    }

    #[test]
    fn a_study_is_found_by_the_end_of_its_id() {
        let studies = [study("01890000-0000-7000-8000-00000000abcd"), study("01890000-0000-7000-8000-00000001abcd")];
        assert_eq!(pick("1ABCD", &studies).unwrap(), studies[1].id);
        assert_eq!(pick("latest", &studies).unwrap(), studies[1].id);
        assert!(pick("abcd", &studies).unwrap_err().to_string().contains("2 studies"));
        assert!(pick("ffff", &studies).is_err());
        assert!(pick("", &studies).is_err());
        assert!(pick("latest", &[]).is_err());
    }
}
