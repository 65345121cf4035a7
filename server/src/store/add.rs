//! A study which has ended is asked for a further optimum.

use manduca_protocol::ids::StudyId;
use manduca_protocol::study::OptimisationSpec;

use super::advance::{advance, begin, find_study, read_spec};
use super::control::{find_number, note_steering};
use super::names::{Condition, Stage};
use super::{Operation, StoreError, Work};

/// An optimisation, checked, for a study which has ended.
pub(crate) struct AddOptimisation {
    pub(crate) study: StudyId,
    pub(crate) spec: OptimisationSpec,
    /// Name of the token that asks for it.
    pub(crate) by: Option<String>,
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
        let optimises = matches!(row.stage, Stage::Optimising | Stage::Verifying | Stage::Refining);
        match row.condition {
            Condition::Succeeded => {}
            Condition::Failed if optimises => {}
            _ => {
                let why = "optimisations are added to a study which has ended, with its network if it has \
                           samples; this one has not";
                return Err(StoreError::WrongState(why.into()));
            }
        }
        row.check_numbers()?;
        insert(work, study, row.optimisations, &self.spec).await?;
        work.specs.clear();
        note_steering(work, &row, "add-optimisation", self.by).await?;
        begin(work, &row, Stage::Optimising).await?;
        // Its generations may have been flown for another study.
        advance(work, study).await?;
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
