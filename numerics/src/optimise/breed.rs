//! How one generation of the genetic algorithm begets the next.

use super::genetic::GaSettings;
use crate::parameters::{COUNT, Point};
use crate::surrogate::random::{Streams, normal_pair, shuffle, uniform};
use rand::Rng;
use rayon::prelude::*;

/// Number of the stream, within a generation, which selects the parents.
const SELECTION: u64 = u32::MAX as u64;

/// How many of a generation are begotten in which way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shares {
    pub(super) elite: usize,
    pub(super) crossed: usize,
    pub(super) mutated: usize,
}

impl Shares {
    /// As MATLAB's `ga`: the crossover share counts those who are not elite.
    pub(super) fn new(settings: &GaSettings) -> Self {
        let population = settings.population;
        let elite = (settings.elite_share * population as f64).ceil() as usize;
        let elite = elite.min(population - 1);
        let others = population - elite;
        let crossed = (settings.crossover_share * others as f64).round() as usize;
        let crossed = crossed.min(others);
        Self { elite, crossed, mutated: others - crossed }
    }
}

/// What all generations of one run share.
#[derive(Debug, Clone)]
pub(super) struct Breeder {
    pub(super) streams: Streams,
    pub(super) shares: Shares,
    pub(super) free: Vec<usize>,
    /// Running sums of 1/sqrt(rank), the roulette wheel by rank.
    wheel: Vec<f64>,
}

impl Breeder {
    pub(super) fn new(settings: &GaSettings, free: Vec<usize>) -> Self {
        let mut sum = 0.0;
        let wheel = (1..=settings.population)
            .map(|rank| {
                sum += 1.0 / (rank as f64).sqrt();
                sum
            })
            .collect();
        let streams = Streams::new(settings.seed);
        Self { streams, shares: Shares::new(settings), free, wheel }
    }

    /// The stream of individual `k` of a generation.
    fn individual(&self, generation: usize, k: usize) -> rand_chacha::ChaCha8Rng {
        self.streams.stream((generation as u64) << 32 | k as u64)
    }

    /// The first generation: uniform in the unit box, held parameters at 0.
    pub(super) fn first(&self, count: usize) -> Vec<Point> {
        (0..count)
            .into_par_iter()
            .map(|k| {
                let mut rng = self.individual(0, k);
                let mut unit = [0.0; COUNT];
                for &i in &self.free {
                    unit[i] = uniform(&mut rng);
                }
                unit
            })
            .collect()
    }

    /// Ranks of the parents, in the order in which they are used.
    ///
    /// Stochastic uniform selection: one random offset, then equal steps along
    /// the wheel, so nobody is chosen a whole time more or less often than
    /// expected; shuffled, or neighbours in rank would mate.
    pub(super) fn parents(&self, generation: usize) -> Vec<u32> {
        let mut rng = self.individual(generation, SELECTION as usize);
        let count = 2 * self.shares.crossed + self.shares.mutated;
        let total = self.wheel.last().copied().unwrap_or(0.0);
        let step = total / count as f64;
        let offset = uniform(&mut rng);
        let mut rank = 0;
        let mut parents: Vec<u32> = (0..count)
            .map(|i| {
                let position = step * (i as f64 + offset);
                while rank + 1 < self.wheel.len() && self.wheel[rank] <= position {
                    rank += 1;
                }
                rank as u32
            })
            .collect();
        shuffle(&mut parents, &mut rng);
        parents
    }

    /// Fills `next` behind the elite with the children of `units`.
    ///
    /// `order[rank]` is the place of that rank in `units`; `spread` the standard
    /// deviation of mutation in widths of the box.
    pub(super) fn children(&self, generation: usize, units: &[Point], order: &[u32], spread: f64, next: &mut [Point]) {
        let parents = self.parents(generation);
        let parent = |i: usize| &units[order[parents[i] as usize] as usize];
        let crossed = self.shares.crossed;
        next.par_iter_mut().enumerate().with_min_len(256).for_each(|(k, child)| {
            let mut rng = self.individual(generation, k);
            *child = if k < crossed {
                let bits = rng.next_u32();
                let (a, b) = (parent(2 * k), parent(2 * k + 1));
                std::array::from_fn(|i| if bits >> i & 1 == 1 { a[i] } else { b[i] })
            } else {
                let mut unit = *parent(crossed + k);
                for pair in self.free.chunks(2) {
                    for (&i, z) in pair.iter().zip(normal_pair(&mut rng)) {
                        unit[i] = spread.mul_add(z, unit[i]);
                    }
                }
                unit
            };
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn breeder() -> Breeder {
        let settings = GaSettings { population: 100, ..Default::default() };
        Breeder::new(&settings, vec![0, 4, 9])
    }

    #[test]
    fn shares_are_those_of_matlab() {
        let shares = breeder().shares;
        assert_eq!(shares, Shares { elite: 5, crossed: 48, mutated: 47 });
    }

    #[test]
    fn everybody_is_chosen_about_as_often_as_expected() {
        let breeder = breeder();
        let parents = breeder.parents(3);
        assert_eq!(parents.len(), 143);
        let total: f64 = (1..=100).map(|r| 1.0 / f64::from(r).sqrt()).sum();
        for rank in 0..100u32 {
            let expected = 143.0 / f64::from(rank + 1).sqrt() / total;
            let found = parents.iter().filter(|p| **p == rank).count() as f64;
            assert!((found - expected).abs() < 1.0 + 1e-9, "{rank}: {found} {expected}");
        }
    }

    #[test]
    fn children_mix_two_parents_or_spread_about_one() {
        let breeder = breeder();
        let units = breeder.first(100);
        let order: Vec<u32> = (0..100).collect();
        let mut next = vec![[0.0; COUNT]; 95];
        breeder.children(1, &units, &order, 0.0, &mut next);
        for child in &next[..48] {
            assert!(breeder.free.iter().all(|&i| units.iter().any(|u| u[i] == child[i])));
        }
        for child in &next[48..] {
            assert!(units.contains(child));
        }
        breeder.children(1, &units, &order, 0.1, &mut next);
        assert!(next[48..].iter().all(|c| !units.contains(c) && c[1] == 0.0));
    }
}
