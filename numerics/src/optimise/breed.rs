//! How one generation of the genetic algorithm begets the next.

use super::genetic::GaSettings;
use crate::parameters::{COUNT, Point};
use crate::surrogate::random::{Streams, normals, shuffle, uniform};
use rand::Rng;
use rayon::prelude::*;

/// Number of the stream, within a generation, which selects the parents.
const SELECTION: u64 = u32::MAX as u64;

/// Individuals which share a stream and a task.
const CHUNK: usize = 512;

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

    /// Stream number `k` of a generation.
    fn stream(&self, generation: usize, k: u64) -> rand_chacha::ChaCha8Rng {
        self.streams.stream((generation as u64) << 32 | k)
    }

    /// The first generation: uniform in the unit box, held parameters at 0.
    pub(super) fn first(&self, count: usize) -> Vec<Point> {
        let mut units = vec![[0.0; COUNT]; count];
        units.par_chunks_mut(CHUNK).enumerate().for_each(|(c, units)| {
            let mut rng = self.stream(0, c as u64);
            for unit in units {
                for &i in &self.free {
                    unit[i] = uniform(&mut rng);
                }
            }
        });
        units
    }

    /// Ranks of the parents, in the order in which they are used.
    ///
    /// Stochastic uniform selection: one random offset, then equal steps along
    /// the wheel, so nobody is chosen a whole time more or less often than
    /// expected; shuffled, or neighbours in rank would mate.
    pub(super) fn parents(&self, generation: usize) -> Vec<u32> {
        let mut rng = self.stream(generation, SELECTION);
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
    /// `order[rank]` is the place of that rank in `units`, `parents` are ranks;
    /// `spread` is the standard deviation of mutation in widths of the box.
    pub(super) fn children(&self, family: &Family<'_>, spread: f64, next: &mut [Point]) {
        let (crossed, mutated) = next.split_at_mut(self.shares.crossed);
        let (couples, singles) = family.parents.split_at(2 * crossed.len());
        let generation = family.generation;
        let parent = |rank: u32| &family.units[family.order[rank as usize] as usize];
        let tasks = crossed.par_chunks_mut(CHUNK).zip(couples.par_chunks(2 * CHUNK)).enumerate();
        tasks.for_each(|(c, (children, couples))| {
            let mut rng = self.stream(generation, 2 * c as u64);
            for (child, couple) in children.iter_mut().zip(couples.chunks(2)) {
                let bits = rng.next_u32();
                let (a, b) = (parent(couple[0]), parent(couple[1]));
                *child = std::array::from_fn(|i| if bits >> i & 1 == 1 { a[i] } else { b[i] });
            }
        });
        let free = self.free.len();
        let tasks = mutated.par_chunks_mut(CHUNK).zip(singles.par_chunks(CHUNK)).enumerate();
        tasks.for_each(|(c, (children, singles))| {
            let mut rng = self.stream(generation, 2 * c as u64 + 1);
            let mut steps = vec![0.0; (free * children.len()).next_multiple_of(2)];
            normals(&mut rng, &mut steps);
            for ((child, rank), steps) in children.iter_mut().zip(singles).zip(steps.chunks(free)) {
                let mut unit = *parent(*rank);
                for (&i, z) in self.free.iter().zip(steps) {
                    unit[i] += spread * z;
                }
                *child = unit;
            }
        });
    }
}

/// Those who beget a generation.
pub(super) struct Family<'a> {
    /// Number of the generation begotten.
    pub(super) generation: usize,
    /// The present generation, unit coordinates.
    pub(super) units: &'a [Point],
    /// Its places by rank.
    pub(super) order: &'a [u32],
    /// Ranks of the parents, in the order in which they are used.
    pub(super) parents: &'a [u32],
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
        let parents = breeder.parents(1);
        let family = Family { generation: 1, units: &units, order: &order, parents: &parents };
        breeder.children(&family, 0.0, &mut next);
        for child in &next[..48] {
            assert!(breeder.free.iter().all(|&i| units.iter().any(|u| u[i] == child[i])));
        }
        for child in &next[48..] {
            assert!(units.contains(child));
        }
        breeder.children(&family, 0.1, &mut next);
        assert!(next[48..].iter().all(|c| !units.contains(c) && c[1] == 0.0));
    }
}
