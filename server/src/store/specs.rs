//! What the writer has at hand of studies: every lease needs the specification of its study, every result
//! its limits.

use std::collections::HashMap;
use std::sync::Arc;

use manduca_protocol::ids::StudyId;
use manduca_protocol::study::StudySpec;
use sqlx::sqlite::SqliteConnection;

use super::limits::Limits;
use super::names::uuid;
use super::{StoreError, body};

/// Most studies kept.
const MOST: usize = 64;

/// A study as the writer knows it.
#[derive(Debug)]
pub(crate) struct Known {
    pub(crate) id: StudyId,
    pub(crate) spec: Arc<StudySpec>,
    /// What decides which samples are audited.
    pub(super) secret: [u8; 32],
    /// What results must agree with; none of a study whose model this version does not know.
    pub(super) limits: Option<Limits>,
}

/// Studies by their short number. Whoever changes a specification forgets it here; so does the writer
/// when anything is rolled back.
#[derive(Debug, Default)]
pub(crate) struct Specs {
    studies: HashMap<i64, Arc<Known>>,
}

impl Specs {
    /// A study's public id and specification.
    pub(super) async fn of(
        &mut self,
        db: &mut SqliteConnection,
        study: i64,
    ) -> Result<(StudyId, Arc<StudySpec>), StoreError> {
        let known = self.known(db, study).await?;
        Ok((known.id, known.spec.clone()))
    }

    /// All that is kept of a study.
    pub(super) async fn known(&mut self, db: &mut SqliteConnection, study: i64) -> Result<Arc<Known>, StoreError> {
        if let Some(known) = self.studies.get(&study) {
            return Ok(known.clone());
        }
        let (id, spec, secret): (Vec<u8>, String, Vec<u8>) = sqlx::query_as(
            "select a.id, a.spec, s.secret from study_specs as a join studies as s on s.study = a.study
             where a.study = ?",
        )
        .bind(study)
        .fetch_one(db)
        .await?;
        let spec: StudySpec = body::from_json(spec.as_bytes()).map_err(|error| match error {
            StoreError::Corrupt(why) => StoreError::Corrupt(format!("its specification cannot be read: {why}")),
            error => error,
        })?;
        let secret = secret.try_into().map_err(|_| StoreError::Corrupt("the secret of a study is cut".into()))?;
        let limits = Limits::of(&spec);
        let known = Arc::new(Known { id: StudyId(uuid(&id)?), spec: Arc::new(spec), secret, limits });
        if self.studies.len() >= MOST {
            self.studies.clear();
        }
        self.studies.insert(study, known.clone());
        Ok(known)
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.studies.clear();
    }
}
