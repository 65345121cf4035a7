//! A study with a network is asked for a further optimum.

use manduca_protocol::ids::StudyId;
use manduca_protocol::study::OptimisationSpec;
use manduca_protocol::view::JobRole;

use super::advance::{find_study, insert_jobs, read_spec, set_stage};
use super::control::find_number;
use super::names::{Condition, Stage};
use super::{Operation, StoreError, Work};
use crate::event::Event;

/// An optimisation, checked, for a study which has ended with a network.
pub(crate) struct AddOptimisation {
    pub(crate) study: StudyId,
    pub(crate) spec: OptimisationSpec,
}

impl Operation for AddOptimisation {
    /// Whether it was added: false when the study has this very one.
    type Output = bool;

    async fn apply(self, work: &mut Work<'_>) -> Result<bool, StoreError> {
        let study = find_number(work.db, self.study).await?;
        let row = find_study(work.db, study).await?;
        let asked = read_spec(work.db, study).await?;
        if let Some(same) = asked.optimisations.iter().find(|o| o.name == self.spec.name) {
            if *same == self.spec {
                return Ok(false);
            }
            return Err(StoreError::WrongState("the study has another optimisation of this name".into()));
        }
        let has_network = matches!(row.stage, Stage::Optimising | Stage::Verifying | Stage::Refining);
        match row.condition {
            Condition::Succeeded => {}
            Condition::Failed if has_network => {}
            _ => {
                let why = "optimisations are added to a study which has ended with a network; this one has not";
                return Err(StoreError::WrongState(why.into()));
            }
        }
        insert(work, study, row.optimisations, &self.spec).await?;
        work.specs.clear();
        set_stage(work, &row, Stage::Optimising).await?;
        insert_jobs(work.db, study, JobRole::Optimise, row.optimisations + 1).await?;
        work.events.push(Event::Ready);
        Ok(true)
    }
}

async fn insert(work: &mut Work<'_>, study: i64, ordinal: i64, spec: &OptimisationSpec) -> Result<(), StoreError> {
    let json = serde_json::to_string(spec).map_err(|e| StoreError::Corrupt(e.to_string()))?;
    sqlx::query("insert into added_optimisations (study, ordinal, spec, added_ms) values (?, ?, ?, ?)")
        .bind(study)
        .bind(ordinal)
        .bind(json)
        .bind(work.now)
        .execute(&mut *work.db)
        .await?;
    sqlx::query("update studies set optimisations = optimisations + 1 where study = ?")
        .bind(study)
        .execute(&mut *work.db)
        .await?;
    Ok(())
}
