//! The ready jobs a claim chooses from. A job that failed goes to a worker which has not failed it
//! lately, if there is one.

use std::collections::{BTreeSet, HashMap, HashSet, VecDeque};

use manduca_protocol::ids::WorkerId;
use manduca_protocol::view::JobRole;

use super::blame::list_failed;
use super::claim::{ReadyRow, list_ready};
use super::shares::Offer;
use super::unreadable::of_study;
use super::workers::list_able;
use super::{StoreError, Work};

/// Further jobs looked at in place of failed ones, and workers which could do these.
const MORE: usize = 64;
/// Most roles of studies searched for a job in place of failed ones.
const MOST_OFFERS: usize = 64;

/// A ready job: its role, its row, and how often it failed.
type Listed = (JobRole, ReadyRow, i64);

/// Ready jobs at hand, and who is not to have them.
pub(super) struct Stock {
    rows: HashMap<i64, VecDeque<Listed>>,
    /// By job, the workers which failed it.
    barred: HashMap<i64, BTreeSet<WorkerId>>,
    taken: HashSet<i64>,
}

impl Stock {
    /// Ready jobs of each study in this order, as many as it has places there.
    pub(super) async fn open(work: &mut Work<'_>, offers: &[Offer], order: &[i64]) -> Result<Self, StoreError> {
        let mut rows = list_shared(work, offers, order, 0).await?;
        let mut barred = HashMap::new();
        if rows.values().flatten().any(|(_, _, failures)| *failures > 0) {
            rows = list_shared(work, offers, order, MORE).await?;
            barred = list_barred(work, rows.values().flatten()).await?;
        }
        Ok(Self { rows, barred, taken: HashSet::new() })
    }

    /// A job of a study for a worker.
    pub(super) fn take(&mut self, study: i64, worker: WorkerId) -> Option<(JobRole, ReadyRow)> {
        let barred = &self.barred;
        let rows = self.rows.get_mut(&study)?;
        let place = rows.iter().position(|(_, row, _)| !is_barred(barred, row.0, worker))?;
        let (role, row, _) = rows.remove(place)?;
        if !self.barred.is_empty() {
            self.taken.insert(row.0);
        }
        Some((role, row))
    }

    /// A job of any study for a worker which has failed what its own study has to give.
    pub(super) async fn take_any(
        &mut self,
        work: &mut Work<'_>,
        offers: &[Offer],
        worker: WorkerId,
    ) -> Result<Option<(i64, JobRole, ReadyRow)>, StoreError> {
        if self.barred.is_empty() {
            return Ok(None);
        }
        for offer in offers.iter().take(MOST_OFFERS) {
            let listed = of_study(offer.study, list_ready(work.db, offer.study, offer.role, MORE).await)?;
            let listed: Vec<Listed> = listed.into_iter().map(|(row, failures)| (offer.role, row, failures)).collect();
            let barred = list_barred(work, listed.iter()).await?;
            let fits = |(_, row, _): &Listed| !self.taken.contains(&row.0) && !is_barred(&barred, row.0, worker);
            if let Some((role, row, _)) = listed.into_iter().find(fits) {
                self.taken.insert(row.0);
                return Ok(Some((offer.study, role, row)));
            }
        }
        Ok(None)
    }
}

fn is_barred(barred: &HashMap<i64, BTreeSet<WorkerId>>, job: i64, worker: WorkerId) -> bool {
    barred.get(&job).is_some_and(|those| those.contains(&worker))
}

async fn list_shared(
    work: &mut Work<'_>,
    offers: &[Offer],
    order: &[i64],
    more: usize,
) -> Result<HashMap<i64, VecDeque<Listed>>, StoreError> {
    let mut places: HashMap<i64, usize> = HashMap::new();
    for study in order {
        *places.entry(*study).or_default() += 1;
    }
    let mut found: HashMap<i64, VecDeque<_>> = HashMap::new();
    for offer in offers {
        let Some(left) = places.get_mut(&offer.study).filter(|left| **left > 0) else { continue };
        let rows = of_study(offer.study, list_ready(work.db, offer.study, offer.role, *left + more).await)?;
        *left = left.saturating_sub(rows.len());
        found.entry(offer.study).or_default().extend(rows.into_iter().map(|(row, failed)| (offer.role, row, failed)));
    }
    Ok(found)
}

/// The workers which failed these jobs, where others could do them.
async fn list_barred<'r>(
    work: &mut Work<'_>,
    rows: impl Iterator<Item = &'r Listed>,
) -> Result<HashMap<i64, BTreeSet<WorkerId>>, StoreError> {
    let jobs: Vec<i64> = rows.filter(|(_, _, failures)| *failures > 0).map(|(_, row, _)| row.0).collect();
    if jobs.is_empty() {
        return Ok(HashMap::new());
    }
    let failed = list_failed(work, &jobs).await?;
    let able = list_able(work, MORE).await?;
    let others = |those: &BTreeSet<WorkerId>| able.iter().any(|worker| !those.contains(worker));
    Ok(failed.into_iter().filter(|(_, those)| others(those)).collect())
}
