//! Backup and prune.

use std::path::Path;
use std::time::Duration;

use serde::Serialize;
use uuid::Uuid;

use super::check::Findings;
use super::{Offline, OfflineError};
use crate::clock::{Clock, SystemClock, rfc3339};
use crate::config::millis;
use crate::store::{check_file, copy_to, delete_study, find_ended_before, find_last_use, is_ahead, list_ended_before};

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
    /// Writes a compact copy of the database, which may be in use, and checks the copy. It appears under its
    /// name when it is whole and on disk.
    ///
    /// # Errors
    /// When the file is there already or cannot be written, or the copy is not well.
    pub async fn backup(&mut self, file: &Path) -> Result<(), OfflineError> {
        if file.exists() {
            return Err(OfflineError::Refused(format!("{} is there already", file.display())));
        }
        let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // Made for its owner only, and removed if it does not become the copy.
        let copy = tempfile::Builder::new().prefix(".manduca-copy-").tempfile_in(folder)?;
        copy_to(self.file.db(), copy.path()).await?;
        // The copy is written like any file: only this makes it outlive a power cut.
        copy.as_file().sync_all()?;
        let mut written = Self::look(copy.path()).await?;
        // One of an older version is as good as its original, and is looked at by SQLite alone.
        let findings = match self.file.check_version().await {
            Ok(()) => written.check().await?,
            Err(_) => Findings { damage: check_file(written.file.db()).await?, ..Findings::default() },
        };
        written.close().await;
        if !findings.is_well() {
            return Err(OfflineError::Refused(format!("the copy is not well: {findings:?}")));
        }
        copy.persist_noclobber(file).map_err(|error| error.error)?;
        std::fs::File::open(folder)?.sync_all()?;
        Ok(())
    }

    /// The studies which ended longer ago than this, none of which is removed.
    ///
    /// # Errors
    /// When they cannot be read.
    pub async fn prunable(&mut self, older_than: Duration) -> Result<Vec<Pruned>, OfflineError> {
        self.file.check_version().await?;
        let before = SystemClock::start().now_ms().saturating_sub(millis(older_than));
        let rows = list_ended_before(self.file.db(), before).await?;
        let pruned = |(id, name, jobs): (Vec<u8>, String, i64)| Pruned {
            study: Uuid::from_slice(&id).map(|id| id.to_string()).unwrap_or_default(),
            name,
            jobs: u64::try_from(jobs).unwrap_or_default(),
        };
        Ok(rows.into_iter().map(pruned).collect())
    }

    /// Removes the studies which ended longer ago than this, one after the other.
    /// Results which other studies share are kept. A clock far ahead of the last use of the
    /// database is believed only if `trusting`.
    ///
    /// # Errors
    /// When the clock is doubtful, or a removal fails; what was removed before stays removed.
    pub async fn prune(&mut self, older_than: Duration, trusting: bool) -> Result<Vec<Pruned>, OfflineError> {
        let now = SystemClock::start().now_ms();
        let last = find_last_use(self.file.db()).await?;
        if !trusting && is_ahead(last, now) {
            let (now, last) = (rfc3339(now), last.map(rfc3339).unwrap_or_default());
            return Err(OfflineError::Refused(format!(
                "this machine's clock says {now}, and the database was last in use at {last}: if the clock is right, add \
                 --force"
            )));
        }
        let before = now.saturating_sub(millis(older_than));
        let mut removed = Vec::new();
        loop {
            // Each by itself: a running coordinator writes in between.
            let mut transaction = self.file.begin().await?;
            let Some((study, id, name)) = find_ended_before(&mut transaction, before).await? else { break };
            let jobs = delete_study(&mut transaction, study).await?;
            transaction.commit().await?;
            let study = Uuid::from_slice(&id).map(|id| id.to_string()).unwrap_or_default();
            removed.push(Pruned { study, name, jobs });
        }
        self.file.forget_workers(now).await?;
        Ok(removed)
    }
}
