//! A study's samples with what the simulations said.

use manduca_numerics::parameters::Point;
use manduca_protocol::ids::StudyId;
use manduca_protocol::point::ParameterValues;
use manduca_protocol::task::{Provenance, SimulateOutcome, SimulateResult, TrainSample};
use manduca_protocol::view::DatasetRow;

use super::names::unsigned;
use super::read_jobs::RawOrigin;
use super::{Store, StoreError, body};

/// Samples read at once for a training.
const CHUNK: u32 = 5000;

/// A sample as stored.
#[derive(Debug, sqlx::FromRow)]
pub(crate) struct SampleRow {
    pub(crate) ordinal: i64,
    parameters: String,
    body: Vec<u8>,
    #[sqlx(default)]
    wall_s: f64,
    #[sqlx(default)]
    level: String,
    #[sqlx(flatten)]
    origin: RawOrigin,
}

impl SampleRow {
    /// As users see it, with its origin if asked for.
    pub(crate) fn parse(self, provenance: bool) -> Result<DatasetRow, StoreError> {
        let point: Point = body::from_json(self.parameters.as_bytes())?;
        Ok(DatasetRow {
            sample: unsigned(self.ordinal)?,
            parameters: ParameterValues(point),
            result: body::parse::<SimulateResult>(self.body)?,
            computed_by: if provenance { self.origin.view()? } else { None },
            provenance: provenance.then_some(Provenance { wall_s: self.wall_s, level: self.level }),
        })
    }
}

impl Store {
    /// The next samples with an answer after the one of this index; none once the study is removed. The
    /// number of a removed study may be given to another one: readers who take their time name its id too.
    pub(crate) async fn samples_after(
        &self,
        study: i64,
        id: Option<StudyId>,
        after: i64,
        limit: u32,
    ) -> Result<Vec<SampleRow>, StoreError> {
        let rows = sqlx::query_as(
            "select j.ordinal, j.parameters, r.body, r.wall_s, r.level,
                    r.job as origin_job, r.worker as origin_worker, w.name as origin_name, w.token as origin_token
             from jobs as j join results as r on r.job = coalesce(j.result_of, j.job)
             left join workers as w on w.id = r.worker
             where j.study = (select study from studies where study = ?1 and (?2 is null or id = ?2))
               and j.role = 'sample' and j.ordinal > ?3 and j.state in ('succeeded', 'infeasible')
             order by j.ordinal limit ?4",
        )
        .bind(study)
        .bind(id.map(|id| id.0.as_bytes().to_vec()))
        .bind(after)
        .bind(limit)
        .fetch_all(self.readers())
        .await?;
        Ok(rows)
    }

    /// How many samples of a study have an answer.
    pub(crate) async fn answered_samples(&self, study: i64) -> Result<u64, StoreError> {
        let counts = self.sample_counts(study).await?;
        Ok(counts.succeeded + counts.infeasible)
    }

    /// The next samples which have means after the one of this index, as the trainer sees them, and the
    /// index of the last one looked at, or `None` if there are no more.
    pub(crate) async fn train_samples_after(
        &self,
        study: i64,
        after: i64,
    ) -> Result<Option<(Vec<TrainSample>, i64)>, StoreError> {
        let rows = self.samples_after(study, None, after, CHUNK).await?;
        let Some(last) = rows.last().map(|row| row.ordinal) else { return Ok(None) };
        // Thousands of results are parsed: not on the threads which serve.
        let parsed = tokio::task::spawn_blocking(move || train_rows(rows)).await;
        Ok(Some((parsed.map_err(|e| StoreError::Corrupt(e.to_string()))??, last)))
    }
}

fn train_rows(rows: Vec<SampleRow>) -> Result<Vec<TrainSample>, StoreError> {
    let mut samples = Vec::with_capacity(rows.len());
    for row in rows {
        let row = row.parse(false)?;
        if let SimulateOutcome::Ok { scaled, .. } = row.result.outcome {
            let y = scaled.means();
            let se = [scaled.lift.se, scaled.drag.se, scaled.pitch_moment.se, scaled.power.se];
            samples.push(TrainSample { x: row.parameters.0, y, se });
        }
    }
    Ok(samples)
}
