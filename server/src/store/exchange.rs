//! One round trip of a worker: everything it says and asks, in one operation.

use std::collections::BTreeSet;

use manduca_protocol::ids::{JobId, WorkerId};
use manduca_protocol::worker::{Failure, Rejected};

use super::advance::advance;
use super::checkpoint::PreparedRenewal;
use super::claim::{Leased, claim};
use super::complete::{Prepared, Taken, complete};
use super::fail::{Reported, fail};
use super::renew::renew;
use super::workers::{add_to_tally, touch};
use super::{Operation, StoreError, Work};

/// What a worker says and asks.
pub(crate) struct Exchange {
    pub(crate) worker: WorkerId,
    pub(crate) complete: Vec<Prepared>,
    pub(crate) fail: Vec<Failure>,
    pub(crate) renew: Vec<PreparedRenewal>,
    pub(crate) want: u32,
}

/// What it is told.
#[derive(Debug, Default)]
pub(crate) struct Exchanged {
    pub(crate) accepted: Vec<JobId>,
    pub(crate) rejected: Vec<Rejected>,
    pub(crate) leased: Vec<Leased>,
    pub(crate) cancel: Vec<JobId>,
}

impl Exchanged {
    /// Whether there is nothing to tell.
    pub(crate) fn is_silent(&self) -> bool {
        self.accepted.is_empty() && self.rejected.is_empty() && self.leased.is_empty() && self.cancel.is_empty()
    }
}

impl Operation for Exchange {
    type Output = Exchanged;

    async fn apply(self, work: &mut Work<'_>) -> Result<Exchanged, StoreError> {
        touch(work, self.worker).await?;
        let mut told = Exchanged::default();
        let mut moved = BTreeSet::new();
        let completed = self.take_results(work, &mut told, &mut moved).await?;
        let failed = self.take_failures(work, &mut told, &mut moved).await?;
        for renewal in &self.renew {
            if !renew(work, self.worker, renewal).await? {
                told.cancel.push(renewal.renewal.job);
            }
        }
        if completed + failed > 0 {
            add_to_tally(work, self.worker, completed, failed).await?;
        }
        // Once per study and exchange, not per job: all its results are in by now.
        for study in moved {
            advance(work, study).await?;
        }
        told.leased = claim(work, self.worker, self.want).await?;
        Ok(told)
    }
}

impl Exchange {
    async fn take_results(
        &self,
        work: &mut Work<'_>,
        told: &mut Exchanged,
        moved: &mut BTreeSet<i64>,
    ) -> Result<u32, StoreError> {
        let mut completed = 0;
        for result in &self.complete {
            match complete(work, self.worker, result).await? {
                Taken::Stored(studies) => {
                    completed += 1;
                    moved.extend(studies);
                    told.accepted.push(result.job);
                }
                Taken::Replay => told.accepted.push(result.job),
                Taken::Refused(reason, study) => {
                    moved.extend(study);
                    told.rejected.push(Rejected { job: result.job, reason });
                }
            }
        }
        Ok(completed)
    }

    async fn take_failures(
        &self,
        work: &mut Work<'_>,
        told: &mut Exchanged,
        moved: &mut BTreeSet<i64>,
    ) -> Result<u32, StoreError> {
        let mut failed = 0;
        for failure in &self.fail {
            match fail(work, self.worker, failure).await? {
                Reported::Counted(study) => {
                    failed += 1;
                    moved.insert(study);
                    told.accepted.push(failure.job);
                }
                Reported::Known => told.accepted.push(failure.job),
                Reported::Refused(reason) => told.rejected.push(Rejected { job: failure.job, reason }),
            }
        }
        Ok(failed)
    }
}
