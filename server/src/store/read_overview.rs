//! Sums and thinned samples of one study, for pages which show all of it at once.

use std::collections::BTreeMap;

use manduca_protocol::ids::JobId;
use manduca_protocol::overview::FailureGroup;
use manduca_protocol::view::DatasetRow;

use super::names::{named, unsigned};
use super::read_dataset::SampleRow;
use super::{Store, StoreError, body};

/// Most groups of failures told.
const MOST_GROUPS: usize = 50;

#[derive(sqlx::FromRow)]
struct RawFailures {
    state: String,
    role: String,
    reason: String,
    jobs: i64,
    example: i64,
}

impl Store {
    /// Indices of the samples which have means, in their order: as the trainer counts them.
    pub(crate) async fn flown_samples(&self, study: i64) -> Result<Vec<u32>, StoreError> {
        // One row of many numbers is read many times faster than many rows of one.
        let list: String = sqlx::query_scalar(
            "select json_group_array(ordinal) from (
                 select ordinal from jobs where study = ? and role = 'sample' and state = 'succeeded' order by ordinal)",
        )
        .bind(study)
        .fetch_one(self.readers())
        .await?;
        body::from_json(list.as_bytes())
    }

    /// These samples of a study, in the order of their indices.
    pub(crate) async fn samples_at(&self, study: i64, ordinals: &[u32]) -> Result<Vec<DatasetRow>, StoreError> {
        let list = serde_json::to_string(ordinals).map_err(|e| StoreError::Corrupt(e.to_string()))?;
        let rows: Vec<SampleRow> = sqlx::query_as(
            "select j.ordinal, j.parameters, r.body
             from json_each(?2) as d
             cross join jobs as j on j.study = ?1 and j.role = 'sample' and j.ordinal = d.value
             cross join results as r on r.job = coalesce(j.result_of, j.job)
             order by d.key",
        )
        .bind(study)
        .bind(list)
        .fetch_all(self.readers())
        .await?;
        rows.into_iter().map(|row| row.parse(false)).collect()
    }

    /// When each result of a study came in, ms, in no order; those shared with other jobs left out.
    pub(crate) async fn finish_times(&self, study: i64) -> Result<Vec<i64>, StoreError> {
        let list: String = sqlx::query_scalar(
            "select json_group_array(r.finished_ms) from jobs as j join results as r on r.job = j.job where j.study = ?",
        )
        .bind(study)
        .fetch_one(self.readers())
        .await?;
        body::from_json(list.as_bytes())
    }

    /// Jobs which failed or cannot be flown, alike ones together, the largest group first.
    pub(crate) async fn failures(&self, study: i64) -> Result<Vec<FailureGroup>, StoreError> {
        let any: bool = sqlx::query_scalar(
            "select exists (select 1 from study_counts
                            where study = ? and n > 0 and state in ('infeasible', 'dead', 'delayed'))",
        )
        .bind(study)
        .fetch_one(self.readers())
        .await?;
        if !any {
            return Ok(Vec::new());
        }
        let rows: Vec<RawFailures> = sqlx::query_as(
            "select state, role, coalesce(reason, 'no reason is known') as reason, count(*) as jobs, min(job) as example
             from jobs where study = ? and state in ('infeasible', 'dead', 'delayed') group by 1, 2, 3 order by example",
        )
        .bind(study)
        .fetch_all(self.readers())
        .await?;
        grouped(rows)
    }
}

/// Rows which differ in numbers only, together.
fn grouped(rows: Vec<RawFailures>) -> Result<Vec<FailureGroup>, StoreError> {
    let mut groups: BTreeMap<(String, String, String), FailureGroup> = BTreeMap::new();
    for row in rows {
        let jobs = unsigned(row.jobs)?;
        let key = (row.state, row.role, without_numbers(&row.reason));
        if let Some(group) = groups.get_mut(&key) {
            group.jobs += jobs;
            continue;
        }
        let group = FailureGroup {
            state: named(&key.0)?,
            role: named(&key.1)?,
            reason: key.2.clone(),
            jobs,
            example: JobId(row.example),
            example_reason: row.reason,
        };
        groups.insert(key, group);
    }
    let mut groups: Vec<_> = groups.into_values().collect();
    groups.sort_by_key(|group| std::cmp::Reverse(group.jobs));
    groups.truncate(MOST_GROUPS);
    Ok(groups)
}

/// A reason with an ellipsis for each number.
fn without_numbers(reason: &str) -> String {
    let mut told = String::with_capacity(reason.len());
    let mut characters = reason.chars().peekable();
    while let Some(character) = characters.next() {
        if !character.is_ascii_digit() {
            told.push(character);
            continue;
        }
        while characters.next_if(|c| c.is_ascii_digit() || *c == '.').is_some() {}
        told.push('…');
    }
    told
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_differ_by_words_not_by_numbers() {
        let at = |state: &str, reason: &str, jobs, example| RawFailures {
            state: state.into(),
            role: "sample".into(),
            reason: reason.into(),
            jobs,
            example,
        };
        let rows = vec![
            at("infeasible", "cross by 1.25 mm", 1, 3),
            at("dead", "exit 1", 1, 4),
            at("infeasible", "cross by 10 mm", 2, 5),
            at("dead", "exit 2", 1, 6),
        ];
        let groups = grouped(rows).expect("groups");
        let told: Vec<_> = groups.iter().map(|g| (g.reason.as_str(), g.jobs, g.example.0)).collect();
        assert_eq!(told, [("cross by … mm", 3, 3), ("exit …", 2, 4)]);
        assert_eq!(groups[0].example_reason, "cross by 1.25 mm");
    }
}
