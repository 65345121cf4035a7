//! Jobs given out to a group of exchanges.

use manduca_protocol::ids::WorkerId;

use super::Party;
use crate::event::Event;
use crate::store::claim::claim;
use crate::store::{StoreError, Work};

/// Leases ready jobs to those who want some, first come, first served.
pub(super) async fn give(work: &mut Work<'_>, parties: &mut [Party<'_>]) -> Result<(), StoreError> {
    // One place in the queue per job wanted.
    let places = |party: &Party<'_>| std::iter::repeat_n(party.exchange.worker, party.left());
    let wanted: Vec<WorkerId> = parties.iter().flat_map(places).collect();
    let mut given = claim(work, &wanted).await?.into_iter();
    for party in parties {
        party.told.leased.extend(given.by_ref().take(party.left()).flatten());
        if !party.told.leased.is_empty() {
            work.events.push(Event::Leased { worker: party.exchange.worker, jobs: party.told.leased.len() });
        }
    }
    Ok(())
}
