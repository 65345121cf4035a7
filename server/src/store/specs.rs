//! Specifications the writer has at hand: every lease needs its study's.

use std::collections::HashMap;
use std::sync::Arc;

use manduca_protocol::ids::StudyId;
use manduca_protocol::study::StudySpec;
use sqlx::sqlite::SqliteConnection;

use super::names::uuid;
use super::{StoreError, body};

/// Most studies kept.
const MOST: usize = 64;

/// The public id of a study, as it is stored, and its specification.
async fn read(db: &mut SqliteConnection, study: i64) -> Result<(Vec<u8>, StudySpec), StoreError> {
    let (id, spec): (Vec<u8>, String) =
        sqlx::query_as("select id, spec from study_specs where study = ?").bind(study).fetch_one(db).await?;
    Ok((id, body::from_json(spec.as_bytes())?))
}

/// Specifications by the short number of their study. Whoever changes one
/// forgets it here; so does the writer when anything is rolled back.
#[derive(Debug, Default)]
pub(crate) struct Specs {
    studies: HashMap<i64, (StudyId, Arc<StudySpec>)>,
}

impl Specs {
    /// A study's public id and specification.
    pub(super) async fn of(
        &mut self,
        db: &mut SqliteConnection,
        study: i64,
    ) -> Result<(StudyId, Arc<StudySpec>), StoreError> {
        if let Some(known) = self.studies.get(&study) {
            return Ok(known.clone());
        }
        let (id, spec) = read(db, study).await.map_err(|error| match error {
            StoreError::Corrupt(why) => StoreError::Corrupt(format!("its specification cannot be read: {why}")),
            error => error,
        })?;
        let found = (StudyId(uuid(&id)?), Arc::new(spec));
        if self.studies.len() >= MOST {
            self.studies.clear();
        }
        self.studies.insert(study, found.clone());
        Ok(found)
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.studies.clear();
    }
}
