//! The round trips of workers. All exchanges which have queued up are taken
//! together: what they say is found, stored and counted by one statement per
//! kind of change, not one per job, because handing a statement to SQLite's
//! thread costs more than most statements do.

mod again;
mod claims;
mod renewals;
pub(super) mod results;

use std::collections::{BTreeSet, HashMap};

use manduca_protocol::ids::{JobId, WorkerId};
use manduca_protocol::task::JobKind;
use manduca_protocol::worker::{Failure, Rejected};

use super::advance::advance_ended;
use super::checkpoint::PreparedRenewal;
use super::claim::Leased;
use super::complete::{NO_JOB, NOT_PRESENT, Outcome, Prepared, find_jobs};
use super::evidence::{Evidence, settle};
use super::fail::{Reported, fail};
use super::workers::{Standing, Tallies, add_to_tallies, list_able, touch, why_unknown};
use super::{StoreError, Work};
use crate::auth::Caller;

/// What a worker says and asks.
pub(crate) struct Exchange {
    pub(crate) worker: WorkerId,
    /// Who speaks for the worker.
    pub(crate) caller: Caller,
    pub(crate) complete: Vec<Prepared>,
    pub(crate) fail: Vec<Failure>,
    pub(crate) renew: Vec<PreparedRenewal>,
    /// Every job it has, after an answer to it was lost.
    pub(crate) have: Option<Vec<JobId>>,
    pub(crate) want: u32,
}

impl Exchange {
    /// One which only asks for jobs.
    pub(crate) fn asking(worker: WorkerId, caller: Caller, want: u32) -> Self {
        Self { worker, caller, complete: Vec::new(), fail: Vec::new(), renew: Vec::new(), have: None, want }
    }

    /// Jobs whose results are checked before they are believed.
    pub(crate) fn large(&self) -> impl Iterator<Item = JobId> {
        let checked = |result: &&Prepared| result.kind != JobKind::Simulate && result.outcome == Outcome::Succeeded;
        self.complete.iter().filter(checked).map(|result| result.job)
    }

    /// How many jobs it touches: commits are bounded by it.
    pub(super) fn weight(&self) -> usize {
        1 + self.complete.len() + self.fail.len() + self.renew.len() + self.want as usize
    }
}

/// What it is told.
#[derive(Debug, Default)]
pub(crate) struct Exchanged {
    pub(crate) accepted: Vec<JobId>,
    pub(crate) rejected: Vec<Rejected>,
    /// Those of the accepted results that are checked from now on.
    pub(crate) unchecked: Vec<JobId>,
    pub(crate) leased: Vec<Leased>,
    pub(crate) cancel: Vec<JobId>,
    pub(crate) drain: bool,
    /// Whether it holds as many jobs as it may: it wants more, but not yet.
    pub(crate) held_back: bool,
}

impl Exchanged {
    /// Whether there is nothing to tell.
    pub(crate) fn is_silent(&self) -> bool {
        self.accepted.is_empty()
            && self.rejected.is_empty()
            && self.leased.is_empty()
            && self.cancel.is_empty()
            && !self.drain
    }
}

/// One of several exchanges with what it will be told.
pub(super) struct Party<'e> {
    pub(super) exchange: &'e Exchange,
    /// Jobs it may be given.
    pub(super) want: usize,
    standing: &'e Standing,
    pub(super) told: Exchanged,
}

impl Party<'_> {
    /// Jobs it may still be given.
    fn left(&self) -> usize {
        self.want.saturating_sub(self.told.leased.len())
    }
}

/// What the exchanges of a group have changed, beyond their own jobs.
#[derive(Default)]
pub(super) struct Effects {
    /// Studies whose jobs ended or failed.
    pub(super) moved: BTreeSet<i64>,
    /// What each worker has finished and failed.
    pub(super) tallies: Tallies,
    /// What is refused.
    pub(super) evidence: Evidence,
}

/// Takes all that a group of exchanges brings, then gives out what they ask for.
/// Each answer stands for itself; an error of the store is an error for all.
pub(super) async fn exchange_all(
    work: &mut Work<'_>,
    exchanges: &[Exchange],
) -> Result<Vec<Result<Exchanged, StoreError>>, StoreError> {
    let known = touch(work, exchanges.iter().map(|e| (e.worker, &e.caller))).await?;
    let is_known = |e: &Exchange| known.get(&e.worker).filter(|own| e.caller.speaks_for(own.token.as_deref()));
    let mut parties: Vec<_> = exchanges
        .iter()
        .filter_map(|exchange| {
            let standing = is_known(exchange)?;
            let want = if standing.may_work() { exchange.want as usize } else { 0 };
            let told = Exchanged { drain: standing.draining, ..Exchanged::default() };
            Some(Party { exchange, want, standing, told })
        })
        .collect();
    let mut effects = Effects::default();
    results::take(work, &mut parties, &mut effects).await?;
    take_failures(work, &mut parties, &mut effects).await?;
    renewals::take(work, &mut parties).await?;
    settle(work, std::mem::take(&mut effects.evidence)).await?;
    add_to_tallies(work, &effects.tallies).await?;
    // Once per study, not per job: all results are in by now.
    advance_ended(work, &effects.moved).await?;
    again::give(work, &mut parties).await?;
    hold_back(work, &mut parties, &effects.tallies).await?;
    // One quarantined just now may still be given jobs: it is only a suspicion, and they are fenced.
    claims::give(work, &mut parties).await?;
    let mut told = parties.into_iter().map(|party| party.told);
    let mut answers = Vec::with_capacity(exchanges.len());
    for exchange in exchanges {
        let answer = is_known(exchange).and_then(|_| told.next());
        answers.push(match answer {
            Some(told) => Ok(told),
            None => Err(why_unknown(work, exchange.worker).await?),
        });
    }
    Ok(answers)
}

/// Bounds what each worker wants by what it may hold, several exchanges of one together.
async fn hold_back(work: &mut Work<'_>, parties: &mut [Party<'_>], tallies: &Tallies) -> Result<(), StoreError> {
    let ended = |party: &Party<'_>| tallies.get(&party.exchange.worker).copied().unwrap_or_default();
    let doubted = parties.iter().any(|party| party.left() > 0 && party.standing.is_doubted(ended(party)));
    // Whether another is there matters only to those in doubt.
    let able = if doubted { list_able(work, 2).await? } else { Vec::new() };
    let mut rooms: HashMap<WorkerId, usize> = HashMap::new();
    for party in parties {
        let (worker, left) = (party.exchange.worker, party.left());
        let room = rooms.entry(worker).or_insert_with(|| {
            let is_alone = able.iter().all(|other| *other == worker);
            party.standing.room(work.config, ended(party), is_alone)
        });
        party.told.held_back = left > 0 && *room == 0;
        let given = left.min(*room);
        *room -= given;
        party.want -= left - given;
    }
    Ok(())
}

/// Takes the failures of all parties. Those that are not the worker's own are refused together.
async fn take_failures(
    work: &mut Work<'_>,
    parties: &mut [Party<'_>],
    effects: &mut Effects,
) -> Result<(), StoreError> {
    let named: Vec<JobId> = parties.iter().flat_map(|p| p.exchange.fail.iter().map(|f| f.job)).collect();
    if named.is_empty() {
        return Ok(());
    }
    let jobs = find_jobs(work.db, &named).await?;
    for party in parties {
        let worker = party.exchange.worker;
        for failure in &party.exchange.fail {
            let reported = match jobs.get(&failure.job) {
                Some(job) if job.is_held_by(worker, failure.attempt) => {
                    fail(work, worker, failure, &mut effects.tallies).await?
                }
                Some(_) => Reported::Refused(NOT_PRESENT.into()),
                None => Reported::Refused(NO_JOB.into()),
            };
            match reported {
                Reported::Counted(study) => {
                    let tally = effects.tallies.entry(worker).or_default();
                    tally.failed += 1;
                    tally.released += 1;
                    effects.moved.insert(study);
                    party.told.accepted.push(failure.job);
                }
                Reported::Known => party.told.accepted.push(failure.job),
                Reported::Refused(reason) => party.told.rejected.push(Rejected { job: failure.job, reason }),
            }
        }
    }
    Ok(())
}
