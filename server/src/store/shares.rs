//! Who is given the next jobs: studies share what workers can do, and so do those who submit them.

use std::collections::{BTreeMap, HashMap};

use manduca_protocol::view::JobRole;

/// Most studies whose last turn is remembered; then all are forgotten, and ties go to the older study.
const MOST: usize = 10_000;

/// Ready jobs of one role of a running study.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Offer {
    pub(super) study: i64,
    pub(super) role: JobRole,
    pub(super) ready: usize,
    /// Jobs of the study, of whatever role, which workers have.
    pub(super) leased: u64,
    /// The token that submitted the study. Each study without one stands for itself.
    pub(super) owner: Option<String>,
}

/// When each study had its last turn.
#[derive(Debug, Default)]
pub(crate) struct Rota {
    turns: u64,
    last: HashMap<i64, u64>,
}

/// A study among those which share: what it offers, in its order, and what it has.
struct Share {
    study: i64,
    ready: usize,
    has: u64,
    last: u64,
}

/// All studies of one owner.
struct Group {
    has: u64,
    shares: Vec<Share>,
}

impl Group {
    /// The study with the least, of equal ones that whose turn is longest ago.
    fn next(&self) -> Option<usize> {
        let open = self.shares.iter().enumerate().filter(|(_, share)| share.ready > 0);
        open.min_by_key(|(_, share)| (share.has, share.last, share.study)).map(|(i, _)| i)
    }
}

impl Rota {
    /// Gives each of so many places to a study: that whose owner has the fewest jobs, then that which
    /// itself has the fewest, then that whose turn is longest ago. Fewer places where less is ready.
    pub(super) fn share(&mut self, offers: &[Offer], places: usize) -> Vec<i64> {
        let mut groups = self.groups(offers);
        let mut given = Vec::with_capacity(places.min(offers.iter().map(|offer| offer.ready).sum()));
        if self.last.len() > MOST {
            self.last.clear();
        }
        while given.len() < places {
            let next = groups.iter().enumerate().filter_map(|(i, group)| {
                let share = group.next()?;
                Some(((group.has, group.shares[share].last), i, share))
            });
            let Some((_, group, share)) = next.min() else { break };
            self.turns += 1;
            let group = &mut groups[group];
            let share = &mut group.shares[share];
            (group.has, share.has, share.ready, share.last) =
                (group.has + 1, share.has + 1, share.ready - 1, self.turns);
            self.last.insert(share.study, self.turns);
            given.push(share.study);
        }
        given
    }

    fn groups(&self, offers: &[Offer]) -> Vec<Group> {
        let mut studies: BTreeMap<i64, (Share, &Option<String>)> = BTreeMap::new();
        for offer in offers {
            let last = self.last.get(&offer.study).copied().unwrap_or_default();
            let share = Share { study: offer.study, ready: 0, has: offer.leased, last };
            studies.entry(offer.study).or_insert((share, &offer.owner)).0.ready += offer.ready;
        }
        let mut owners: HashMap<&str, usize> = HashMap::new();
        let mut groups: Vec<Group> = Vec::new();
        for (share, owner) in studies.into_values() {
            let new = groups.len();
            let place = owner.as_deref().map_or(new, |owner| *owners.entry(owner).or_insert(new));
            if place == new {
                groups.push(Group { has: 0, shares: Vec::new() });
            }
            groups[place].has += share.has;
            groups[place].shares.push(share);
        }
        groups
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offer(study: i64, ready: usize, leased: u64, owner: Option<&str>) -> Offer {
        Offer { study, role: JobRole::Sample, ready, leased, owner: owner.map(Into::into) }
    }

    #[test]
    fn a_small_study_behind_a_large_one_has_its_share_at_once() {
        let given = Rota::default().share(&[offer(1, 50_000, 0, None), offer(2, 20, 0, None)], 1000);
        assert_eq!(given[..6], [1, 2, 1, 2, 1, 2]);
        assert_eq!((given.len(), given.iter().filter(|study| **study == 2).count()), (1000, 20));
        // What is leased already counts: the second is given what the first has ahead.
        let given = Rota::default().share(&[offer(1, 50_000, 8, None), offer(2, 50_000, 2, None)], 10);
        assert_eq!((given[..6].iter().all(|study| *study == 2), given[6..].len()), (true, 4));
    }

    #[test]
    fn studies_which_have_as_much_take_turns_between_claims() {
        let mut rota = Rota::default();
        let offers = [offer(1, 9, 0, None), offer(2, 9, 0, None), offer(3, 9, 0, None)];
        let given: Vec<_> = (0..7).flat_map(|_| rota.share(&offers, 1)).collect();
        assert_eq!(given, [1, 2, 3, 1, 2, 3, 1]);
    }

    #[test]
    fn those_who_submit_share_before_their_studies_do() {
        let offers = [offer(1, 100, 0, Some("ada")), offer(2, 100, 0, Some("ada")), offer(3, 100, 0, Some("bob"))];
        let given = Rota::default().share(&offers, 40);
        let count = |study| given.iter().filter(|given| **given == study).count();
        assert_eq!([count(1), count(2), count(3)], [10, 10, 20]);
        // What one leaves, the others have.
        let given = Rota::default().share(&[offer(1, 3, 0, Some("ada")), offer(3, 100, 9, Some("bob"))], 50);
        assert_eq!((given.len(), given[..3].iter().all(|study| *study == 1)), (50, true));
        assert!(Rota::default().share(&[], 5).is_empty());
    }
}
