//! The genetic algorithm, asked for points and told their fitnesses.

use super::breed::{Breeder, Family, Shares};
use super::{OptimiseError, check, free};
use crate::parameters::{Bounds, Point};
use rayon::prelude::*;

/// Settings of the genetic algorithm, after MATLAB's `ga`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaSettings {
    /// Individuals of a generation.
    pub population: usize,
    /// Most generations, the first random one included.
    pub generations: usize,
    /// Share of the population which survives unchanged, 0 to 1.
    pub elite_share: f64,
    /// Share of the others begotten by crossover; the rest by mutation, 0 to 1.
    pub crossover_share: f64,
    /// Standard deviation of mutation in the first generation, in widths of the box.
    pub mutation_scale: f64,
    /// By which share of itself that deviation has shrunk in the last generation.
    pub mutation_shrink: f64,
    /// Stop when the mean relative change of the best fitness per generation is
    /// at most this...
    pub tolerance: f64,
    /// ...over so many generations.
    pub stall_generations: usize,
    /// Seed of all randomness.
    pub seed: u64,
}

impl Default for GaSettings {
    /// Population, shares and tolerance of the paper.
    fn default() -> Self {
        Self {
            population: 100_000,
            generations: 300,
            elite_share: 0.05,
            crossover_share: 0.5,
            mutation_scale: 1.0,
            mutation_shrink: 1.0,
            tolerance: 1e-6,
            stall_generations: 50,
            seed: 0,
        }
    }
}

impl GaSettings {
    /// Most points a whole run asks for: the elite of each generation are not asked for again.
    pub fn most_asked(&self) -> usize {
        let elite = Shares::new(self).elite;
        self.population + self.generations.saturating_sub(1) * (self.population - elite)
    }

    fn check(&self) -> Result<(), OptimiseError> {
        check("population", self.population as f64, 2.0..=1e8, "2 to 1e8")?;
        check("generations", self.generations as f64, 1.0..=1e9, "1 to 1e9")?;
        check("elite_share", self.elite_share, 0.0..=1.0, "0 to 1")?;
        check("crossover_share", self.crossover_share, 0.0..=1.0, "0 to 1")?;
        check("mutation_scale", self.mutation_scale, 0.0..=1e6, "0 to 1e6")?;
        check("mutation_shrink", self.mutation_shrink, 0.0..=1.0, "0 to 1")?;
        check("tolerance", self.tolerance, 0.0..=1e9, "0 to 1e9")?;
        check("stall_generations", self.stall_generations as f64, 1.0..=1e9, "1 to 1e9")
    }
}

/// Why the genetic algorithm ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GaStop {
    /// The best fitness no longer changes.
    Stalled,
    /// The most generations were made.
    Generations,
    /// The observer asked to stop.
    Interrupted,
}

/// What became of a generation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Generation {
    /// Smallest fitness.
    pub best: f64,
    /// Mean of the finite fitnesses, elite included.
    pub mean: f64,
}

/// All that a genetic algorithm between [`Ga::tell`] and [`Ga::ask`] cannot compute again from
/// bounds and settings.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GaSnapshot {
    /// Every individual in unit coordinates, the elite first.
    pub units: Vec<Point>,
    /// Fitnesses of the elite, in their order; infinite where there is none.
    pub elite: Vec<f64>,
    /// One entry per generation told.
    pub history: Vec<Generation>,
    /// The best point told so far, in table units, and its fitness.
    pub best: Option<(Point, f64)>,
}

/// The genetic algorithm as a machine: [`Ga::ask`], evaluate, [`Ga::tell`], repeat.
///
/// Rank scaling 1/sqrt(rank), stochastic uniform selection, scattered crossover,
/// Gaussian mutation whose spread shrinks linearly with the generations. Genes
/// are unit coordinates; mutants may leave the box, which the fitness must
/// punish. The elite keep their fitness and are not asked for again.
#[derive(Debug, Clone)]
pub struct Ga {
    bounds: Bounds,
    settings: GaSettings,
    breeder: Breeder,
    /// Unit coordinates, the elite first.
    units: Vec<Point>,
    /// Fitnesses of the same individuals; those of the asked are stale.
    fitnesses: Vec<f64>,
    /// Table coordinates of the individuals asked for: all but the elite.
    asked: Vec<Point>,
    /// Memory of the generation being begotten.
    next: Vec<Point>,
    history: Vec<Generation>,
    best: Option<(Point, f64)>,
    finished: Option<GaStop>,
}

impl Ga {
    /// A first generation, uniform in the box.
    ///
    /// # Errors
    /// When bounds or settings are out of range.
    pub fn new(bounds: Bounds, settings: GaSettings) -> Result<Self, OptimiseError> {
        settings.check()?;
        let breeder = Breeder::new(&settings, free(&bounds)?);
        let units = breeder.first(settings.population);
        let asked = units.iter().map(|u| bounds.from_unit(u)).collect();
        Ok(Self {
            bounds,
            settings,
            breeder,
            fitnesses: vec![f64::INFINITY; units.len()],
            next: units.clone(),
            units,
            asked,
            history: Vec::new(),
            best: None,
            finished: None,
        })
    }

    /// Where it stands, to be taken up by [`Ga::restore`]. A finished one leaves nothing to take up.
    pub fn snapshot(&self) -> GaSnapshot {
        let elite = self.units.len() - self.asked.len();
        GaSnapshot {
            units: self.units.clone(),
            elite: self.fitnesses[..elite].to_vec(),
            history: self.history.clone(),
            best: self.best,
        }
    }

    /// The machine of a snapshot, under the bounds and settings it was made with: what
    /// follows has the bits of a run never interrupted.
    ///
    /// # Errors
    /// When bounds or settings are out of range, or the snapshot is not of such a search.
    pub fn restore(bounds: Bounds, settings: GaSettings, snapshot: GaSnapshot) -> Result<Self, OptimiseError> {
        settings.check()?;
        let breeder = Breeder::new(&settings, free(&bounds)?);
        let GaSnapshot { units, elite, history, best } = snapshot;
        if units.len() != settings.population || !units.iter().flatten().all(|u| u.is_finite()) {
            return Err(OptimiseError::Snapshot("its individuals are not those of the population"));
        }
        let begun = !history.is_empty();
        if elite.len() != if begun { breeder.shares.elite } else { 0 } || history.len() >= settings.generations {
            return Err(OptimiseError::Snapshot("its elite or its generations do not fit the settings"));
        }
        let asked = units[elite.len()..].iter().map(|u| bounds.from_unit(u)).collect();
        let mut fitnesses = elite;
        fitnesses.resize(units.len(), f64::INFINITY);
        let next = units.clone();
        Ok(Self { bounds, settings, breeder, units, fitnesses, asked, next, history, best, finished: None })
    }

    /// The points whose fitness is wanted, in table units; empty once finished.
    pub fn ask(&self) -> &[Point] {
        &self.asked
    }

    /// Takes the fitnesses of the points asked, in their order; NaN counts as
    /// infinitely bad. Begets the next generation unless finished.
    ///
    /// # Errors
    /// When the number of fitnesses is not that of the points.
    pub fn tell(&mut self, scores: &[f64]) -> Result<(), OptimiseError> {
        if scores.len() != self.asked.len() {
            let (asked, told) = (self.asked.len(), scores.len());
            return Err(OptimiseError::Told { asked, told });
        }
        if self.finished.is_some() {
            return Ok(());
        }
        let old = self.units.len() - scores.len();
        for (to, score) in self.fitnesses[old..].iter_mut().zip(scores) {
            *to = if score.is_nan() { f64::INFINITY } else { *score };
        }
        // Who is chosen is known by rank before it is known who has which rank.
        let (order, parents) = rayon::join(|| self.order(), || self.breeder.parents(self.history.len() + 1));
        self.record(order[0] as usize);
        self.finished = self.stop();
        if self.finished.is_some() {
            self.asked.clear();
        } else {
            self.beget(&order, &parents);
        }
        Ok(())
    }

    /// Places by rank, the best first; equals keep their order.
    fn order(&self) -> Vec<u32> {
        // Fitness and place together: to look the fitnesses up while sorting would
        // take several times as long. Integers in this form are ordered as `total_cmp`.
        let key = |(place, fitness): (usize, &f64)| {
            let bits = fitness.to_bits() as i64;
            (bits ^ ((bits >> 63) as u64 >> 1) as i64, place as u32)
        };
        let mut keys: Vec<(i64, u32)> = self.fitnesses.iter().enumerate().map(key).collect();
        keys.par_sort_unstable();
        keys.into_iter().map(|(_, place)| place).collect()
    }

    fn record(&mut self, first: usize) {
        let best = self.fitnesses[first];
        if best.is_finite() && self.best.is_none_or(|(_, known)| best < known) {
            self.best = Some((self.bounds.from_unit(&self.units[first]), best));
        }
        let finite = self.fitnesses.iter().filter(|f| f.is_finite());
        let (sum, count) = finite.fold((0.0, 0usize), |(sum, n), f| (sum + f, n + 1));
        let mean = if count > 0 { sum / count as f64 } else { f64::INFINITY };
        self.history.push(Generation { best, mean });
    }

    fn stop(&self) -> Option<GaStop> {
        let (now, window) = (self.history.len(), self.settings.stall_generations);
        if now > window {
            let (new, old) = (self.history[now - 1].best, self.history[now - 1 - window].best);
            let change = (old - new).abs() / new.abs().max(1.0) / window as f64;
            if change <= self.settings.tolerance {
                return Some(GaStop::Stalled);
            }
        }
        (now >= self.settings.generations).then_some(GaStop::Generations)
    }

    fn beget(&mut self, order: &[u32], parents: &[u32]) {
        let elite = self.breeder.shares.elite;
        let generation = self.history.len();
        for (rank, &place) in order[..elite].iter().enumerate() {
            self.next[rank] = self.units[place as usize];
        }
        let kept: Vec<f64> = order[..elite].iter().map(|&i| self.fitnesses[i as usize]).collect();
        self.fitnesses[..elite].copy_from_slice(&kept);
        let past = (generation - 1) as f64 / self.settings.generations as f64;
        let spread = self.settings.mutation_scale * (1.0 - self.settings.mutation_shrink * past);
        let family = Family { generation, units: &self.units, order, parents };
        self.breeder.children(&family, spread, &mut self.next[elite..]);
        std::mem::swap(&mut self.units, &mut self.next);
        let bounds = self.bounds;
        let children = self.units[elite..].par_iter().map(|u| bounds.from_unit(u));
        children.collect_into_vec(&mut self.asked);
    }

    /// Why it ended, once it has.
    pub fn finished(&self) -> Option<GaStop> {
        self.finished
    }

    /// The best point told so far, in table units, and its fitness; none as long
    /// as no fitness was finite. It may lie outside the box.
    pub fn best(&self) -> Option<(Point, f64)> {
        self.best
    }

    /// One entry per generation told.
    pub fn history(&self) -> &[Generation] {
        &self.history
    }
}
