//! The genetic algorithm on simulations themselves: one generation is one batch of strokes.
//!
//! [`step`] knows nothing of queues: strokes flown go in, strokes to fly come out, and
//! what is carried from one to the next can be stored.

use std::collections::{HashMap, HashSet};

use super::{Fitness, Ga, GaSettings, GaSnapshot, GaStop, Generation, OptimiseError, Score, clamped};
use crate::parameters::{COUNT, Point};

/// What is sought and how.
pub struct Direct<'a> {
    /// The fitness of what was simulated.
    pub fitness: Fitness,
    /// The genetic algorithm.
    pub ga: GaSettings,
    /// Clearance of a stroke, in metres; where it is negative the wings collide and nothing is flown.
    pub clearance: &'a dyn Fn(&Point) -> f64,
}

/// A stroke and what was simulated of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Champion {
    /// The stroke, inside the box.
    pub point: Point,
    /// How it fares, by simulation.
    pub score: Score,
}

/// Between two generations.
#[derive(Debug, Clone, PartialEq)]
pub struct Bred {
    /// The genetic algorithm.
    pub ga: GaSnapshot,
    /// The best stroke flown so far.
    pub champion: Option<Champion>,
}

/// What follows a generation.
#[derive(Debug, Clone, PartialEq)]
pub enum Bearing {
    /// Fly these and come back with their means, in any order.
    Fly {
        /// To be handed in again.
        bred: Bred,
        /// Strokes inside the box, none of them twice.
        strokes: Vec<Point>,
    },
    /// The search has ended.
    Done {
        /// The best stroke flown.
        champion: Champion,
        /// Why.
        stop: GaStop,
        /// Best and mean fitness of every generation.
        history: Vec<Generation>,
    },
}

/// One round: judges the generation flown and begets the next, or begins where there is none.
///
/// `flown` are `[L+, D+, M+, P+]` of the strokes asked for, none of those which could not be
/// flown. These, and those whose wings collide, have the worst fitness. An individual outside
/// the box is flown at the nearest point inside, and its excess costs as [`Fitness`] says. The
/// elite are not flown again.
///
/// # Errors
/// When settings or `bred` are out of range, or no stroke of any generation could be flown.
pub fn step(
    direct: &Direct<'_>,
    bred: Option<Bred>,
    flown: &[(Point, Option<[f64; 4]>)],
) -> Result<Bearing, OptimiseError> {
    let bounds = direct.fitness.bounds;
    let Some(bred) = bred else {
        let search = Ga::new(bounds, direct.ga)?;
        let strokes = strokes(direct, search.ask());
        return advance(direct, search, None, strokes);
    };
    let mut search = Ga::restore(bounds, direct.ga, bred.ga)?;
    let known: HashMap<[u64; COUNT], [f64; 4]> =
        flown.iter().filter_map(|(x, means)| means.map(|means| (bits(x), means))).collect();
    let mut champion = bred.champion;
    let mut fitnesses = Vec::with_capacity(search.ask().len());
    for x in search.ask() {
        let point = clamped(&bounds, x);
        let Some(means) = known.get(&bits(&point)) else {
            fitnesses.push(f64::NAN);
            continue;
        };
        let clearance = (direct.clearance)(&point);
        fitnesses.push(direct.fitness.judge(x, *means, clearance).fitness);
        let score = direct.fitness.judge(&point, *means, clearance);
        if champion.is_none_or(|known| score.fitness < known.score.fitness) {
            champion = Some(Champion { point, score });
        }
    }
    search.tell(&fitnesses)?;
    let strokes = strokes(direct, search.ask());
    advance(direct, search, champion, strokes)
}

/// Goes on to strokes there are to fly: a generation without any has ended as it began.
fn advance(
    direct: &Direct<'_>,
    mut search: Ga,
    champion: Option<Champion>,
    mut strokes: Vec<Point>,
) -> Result<Bearing, OptimiseError> {
    loop {
        if let Some(stop) = search.finished() {
            let champion = champion.ok_or(OptimiseError::NothingFinite)?;
            return Ok(Bearing::Done { champion, stop, history: search.history().to_vec() });
        }
        if !search.history().is_empty() && champion.is_none() {
            return Err(OptimiseError::NothingFinite);
        }
        if !strokes.is_empty() {
            return Ok(Bearing::Fly { bred: Bred { ga: search.snapshot(), champion }, strokes });
        }
        let nothing = vec![f64::NAN; search.ask().len()];
        search.tell(&nothing)?;
        strokes = self::strokes(direct, search.ask());
    }
}

/// What there is to fly of the individuals asked for.
fn strokes(direct: &Direct<'_>, asked: &[Point]) -> Vec<Point> {
    let mut met = HashSet::new();
    let inside = asked.iter().map(|x| clamped(&direct.fitness.bounds, x));
    inside.filter(|x| met.insert(bits(x)) && (direct.clearance)(x) >= 0.0).collect()
}

fn bits(x: &Point) -> [u64; COUNT] {
    x.map(f64::to_bits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optimise::{Phase, Problem, SimplexSettings, optimise};
    use crate::parameters::Bounds;
    use std::ops::ControlFlow;

    fn bounds() -> Bounds {
        let mut bounds = Bounds::default();
        bounds.upper[4..].copy_from_slice(&bounds.lower[4..]);
        bounds
    }

    fn fitness() -> Fitness {
        Fitness { bounds: bounds(), margin_m: 0.0, penalty_r: 2.0, penalty_s: 5.0 }
    }

    fn fly(x: &Point) -> [f64; 4] {
        let u = bounds().to_unit(x);
        [0.5 + u[0], u[1] - 0.3, u[2] - u[1], 1.0 + u[0].powi(2) + (u[3] - 0.9).powi(2)]
    }

    /// Rounds until done: how many strokes were flown, and the end.
    fn flown(direct: &Direct<'_>, fly: &dyn Fn(&Point) -> Option<[f64; 4]>) -> (usize, Bearing) {
        let (mut bred, mut last, mut count) = (None, Vec::new(), 0);
        loop {
            match step(direct, bred, &last).unwrap() {
                Bearing::Fly { bred: next, strokes } => {
                    let met: HashSet<_> = strokes.iter().map(bits).collect();
                    assert_eq!(met.len(), strokes.len());
                    assert!(strokes.iter().all(|x| clamped(&bounds(), x) == *x));
                    count += strokes.len();
                    // In another order than asked for.
                    last = strokes.iter().rev().map(|x| (*x, fly(x))).collect();
                    bred = Some(next);
                }
                done => return (count, done),
            }
        }
    }

    #[test]
    fn it_is_the_genetic_algorithm_of_a_surrogate_which_is_exact() {
        let ga = GaSettings { population: 60, generations: 25, seed: 3, ..Default::default() };
        let direct = Direct { fitness: fitness(), ga, clearance: &|_| 1.0 };
        let (count, done) = flown(&direct, &|x| Some(fly(x)));
        let Bearing::Done { champion, stop, history } = done else { panic!("not done") };
        let predict = |xs: &[Point], out: &mut [[f64; 4]]| out.iter_mut().zip(xs).for_each(|(y, x)| *y = fly(x));
        let problem = Problem {
            predict: &predict,
            clearance: &|_, out| out.fill(1.0),
            margin_m: 0.0,
            bounds: bounds(),
            penalty_r: 2.0,
            penalty_s: 5.0,
        };
        let mut no_simplex = |at: &crate::optimise::Progress| match at.phase {
            Phase::Genetic => ControlFlow::Continue(()),
            Phase::Simplex => ControlFlow::Break(()),
        };
        let bred = optimise(&problem, &ga, &SimplexSettings::default(), &mut no_simplex).unwrap();
        assert_eq!((history, stop), (bred.history, GaStop::Generations));
        assert!(champion.score.fitness <= bred.simplex_start_fitness);
        assert_eq!(champion.score.outputs, fly(&champion.point));
        // Strokes are flown once: corners of the box are asked for by many individuals.
        assert!(count <= ga.most_asked() && count > ga.most_asked() / 2, "{count} of {}", ga.most_asked());
    }

    #[test]
    fn what_cannot_be_flown_is_worst_and_what_collides_is_not_flown() {
        let ga = GaSettings { population: 40, generations: 20, seed: 4, ..Default::default() };
        let clearance = |x: &Point| if bounds().to_unit(x)[3] > 0.5 { -1e-3 } else { 1e-3 };
        let direct = Direct { fitness: fitness(), ga, clearance: &clearance };
        let (_, done) = flown(&direct, &|x| {
            assert!(clearance(x) > 0.0);
            (bounds().to_unit(x)[0] < 0.45).then(|| fly(x))
        });
        let Bearing::Done { champion, .. } = done else { panic!("not done") };
        let u = bounds().to_unit(&champion.point);
        assert!(u[0] < 0.45 && u[3] <= 0.5, "{u:?}");
    }

    #[test]
    fn where_nothing_can_be_flown_nothing_is_found() {
        let ga = GaSettings { population: 20, generations: 5, ..Default::default() };
        let collide = Direct { fitness: fitness(), ga, clearance: &|_| -1.0 };
        assert_eq!(step(&collide, None, &[]), Err(OptimiseError::NothingFinite));
        let direct = Direct { clearance: &|_| 1.0, ..collide };
        let Ok(Bearing::Fly { bred, strokes }) = step(&direct, None, &[]) else { panic!("nothing to fly") };
        let none: Vec<_> = strokes.iter().map(|x| (*x, None)).collect();
        assert_eq!(step(&direct, Some(bred), &none), Err(OptimiseError::NothingFinite));
    }
}
