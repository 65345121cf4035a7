//! Backup, check and prune.

use std::path::Path;
use std::time::Duration;

use serde::Serialize;
use uuid::Uuid;

use super::{Offline, OfflineError};
use crate::clock::{Clock, SystemClock};
use crate::config::millis;
use crate::store::{check, copy_to, delete_study, find_ended_before, list_digests, unpack};

/// Results looked at in one read.
const CHUNK: u32 = 500;

/// What a check found. All is well where both lists are empty.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Findings {
    /// What SQLite says of the file.
    pub damage: Vec<String>,
    /// Rules between the tables which are broken, in sentences.
    pub breaches: Vec<String>,
    /// Results whose digest was computed anew.
    pub results: u64,
}

impl Findings {
    /// Whether nothing is wrong.
    pub fn is_well(&self) -> bool {
        self.damage.is_empty() && self.breaches.is_empty()
    }
}

/// A study removed.
#[derive(Debug, Clone, Serialize)]
pub struct Pruned {
    /// Its id.
    pub study: String,
    /// Its name.
    pub name: String,
    /// Its jobs.
    pub jobs: u64,
}

impl Offline {
    /// Writes a compact copy of the database, which may be in use, and checks the copy.
    ///
    /// # Errors
    /// When the file is there already or cannot be written, or the copy is not well.
    pub async fn backup(&mut self, file: &Path) -> Result<(), OfflineError> {
        if file.exists() {
            return Err(OfflineError::Refused(format!("{} is there already", file.display())));
        }
        copy_to(self.file.db(), file).await?;
        // The copy is written like any file: only this makes it outlive a power cut.
        std::fs::File::open(file)?.sync_all()?;
        let mut copy = Self::open(file).await?;
        let findings = copy.check().await?;
        copy.close().await;
        if findings.is_well() {
            return Ok(());
        }
        Err(OfflineError::Refused(format!("the copy is not well: {findings:?}")))
    }

    /// Checks the file, what must hold between its tables, and every result against its digest.
    ///
    /// # Errors
    /// When it cannot be read.
    pub async fn check(&mut self) -> Result<Findings, OfflineError> {
        let (damage, breaches) = check(self.file.db()).await?;
        let breaches = breaches.into_iter().map(|(rule, n)| format!("{n} {rule}")).collect();
        let mut findings = Findings { damage, breaches, results: 0 };
        let (mut after, mut wrong) = (-1, 0_u64);
        loop {
            let rows = list_digests(self.file.db(), after, CHUNK).await?;
            let Some(last) = rows.last() else { break };
            after = last.0;
            for (_, body, digest) in rows {
                findings.results += 1;
                wrong += u64::from(!unpack(body).is_ok_and(|json| blake3::hash(&json).as_bytes()[..] == digest));
            }
        }
        if wrong > 0 {
            findings.breaches.push(format!("{wrong} results differ from their digest"));
        }
        Ok(findings)
    }

    /// Removes the studies which ended longer ago than this, one after the other.
    /// Results which other studies share are kept.
    ///
    /// # Errors
    /// When a removal fails; what was removed before stays removed.
    pub async fn prune(&mut self, older_than: Duration, dry_run: bool) -> Result<Vec<Pruned>, OfflineError> {
        let before = SystemClock::start().now_ms().saturating_sub(millis(older_than));
        let mut removed = Vec::new();
        let mut transaction = self.file.begin().await?;
        while let Some((study, id, name)) = find_ended_before(&mut transaction, before).await? {
            let jobs = delete_study(&mut transaction, study).await?;
            let study = Uuid::from_slice(&id).map(|id| id.to_string()).unwrap_or_default();
            removed.push(Pruned { study, name, jobs });
            if !dry_run {
                // Each by itself: a running coordinator writes in between.
                transaction.commit().await?;
                transaction = self.file.begin().await?;
            }
        }
        // Of a dry run all is taken back.
        transaction.rollback().await?;
        if !dry_run {
            self.file.forget_workers(SystemClock::start().now_ms()).await?;
        }
        Ok(removed)
    }
}
