//! The simplex of Nelder & Mead 1965, asked for points and told their fitnesses.

use super::{OptimiseError, check, free};
use crate::parameters::{Bounds, Point};

/// Settings of the simplex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimplexSettings {
    /// Coefficient of reflection.
    pub reflection: f64,
    /// Coefficient of expansion.
    pub expansion: f64,
    /// Coefficient of contraction.
    pub contraction: f64,
    /// Coefficient of shrinking.
    pub shrink: f64,
    /// Converged when the vertices agree within this in fitness and in every
    /// unit coordinate.
    pub tolerance: f64,
    /// Edge of the first simplex, in widths of the box.
    pub edge: f64,
    /// How often to start afresh from the best vertex with an edge a fifth as
    /// long: in a non-smooth valley a simplex collapses before the minimum.
    pub restarts: usize,
    /// Most evaluations in all.
    pub max_evaluations: usize,
}

impl Default for SimplexSettings {
    /// The usual coefficients and the paper's tolerance.
    fn default() -> Self {
        Self {
            reflection: 1.0,
            expansion: 2.0,
            contraction: 0.5,
            shrink: 0.5,
            tolerance: 1e-10,
            edge: 0.05,
            restarts: 2,
            max_evaluations: 50_000,
        }
    }
}

/// Edge of a fresh simplex over that of the one before.
const SMALLER: f64 = 0.2;

impl SimplexSettings {
    fn check(&self) -> Result<(), OptimiseError> {
        check("reflection", self.reflection, 1e-6..=100.0, "1e-6 to 100")?;
        check("expansion", self.expansion, 1.0..=100.0, "1 to 100")?;
        check("contraction", self.contraction, 1e-6..=0.999, "1e-6 to 0.999")?;
        check("shrink", self.shrink, 1e-6..=0.999, "1e-6 to 0.999")?;
        check("tolerance", self.tolerance, 0.0..=1.0, "0 to 1")?;
        check("edge", self.edge, 1e-12..=1.0, "1e-12 to 1")?;
        check("max_evaluations", self.max_evaluations as f64, 1.0..=1e12, "1 to 1e12")
    }
}

/// Why the simplex ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SimplexStop {
    /// The last simplex shrank below the tolerance.
    Converged,
    /// The most evaluations were made.
    Evaluations,
}

/// What the points being asked for are.
#[derive(Debug, Clone, PartialEq)]
enum Move {
    Start,
    Reflect,
    Expand(Vertex),
    ContractOutside(Vertex),
    ContractInside,
    Shrink,
    Done,
}

/// A point in unit coordinates of the free parameters, and its fitness.
#[derive(Debug, Clone, PartialEq)]
struct Vertex {
    unit: Vec<f64>,
    fitness: f64,
}

/// The simplex as a machine: [`NelderMead::ask`], evaluate, [`NelderMead::tell`], repeat.
///
/// It moves the free parameters alone, in unit coordinates; it may leave the
/// box, which the fitness must punish.
#[derive(Debug, Clone)]
pub struct NelderMead {
    bounds: Bounds,
    settings: SimplexSettings,
    free: Vec<usize>,
    /// Sorted, the best first, between moves.
    vertices: Vec<Vertex>,
    /// Unit coordinates asked for, and the same in table units.
    trial: Vec<Vec<f64>>,
    asked: Vec<Point>,
    doing: Move,
    edge: f64,
    restarts: usize,
    evaluations: usize,
    finished: Option<SimplexStop>,
}

impl NelderMead {
    /// A first simplex about `start`, given in table units.
    ///
    /// # Errors
    /// When bounds, settings or the start are out of range.
    pub fn new(bounds: Bounds, settings: SimplexSettings, start: &Point) -> Result<Self, OptimiseError> {
        settings.check()?;
        let free = free(&bounds)?;
        for x in start {
            check("start", *x, -1e300..=1e300, "finite")?;
        }
        let unit = bounds.to_unit(start);
        let unit: Vec<f64> = free.iter().map(|&i| unit[i]).collect();
        let mut simplex = Self {
            bounds,
            settings,
            free,
            vertices: Vec::new(),
            trial: Vec::new(),
            asked: Vec::new(),
            doing: Move::Start,
            edge: settings.edge,
            restarts: settings.restarts,
            evaluations: 0,
            finished: None,
        };
        simplex.start(unit);
        Ok(simplex)
    }

    /// Asks for a point and one neighbour along each axis, on the side with room.
    fn start(&mut self, unit: Vec<f64>) {
        let mut trial = vec![unit.clone()];
        for i in 0..unit.len() {
            let mut vertex = unit.clone();
            vertex[i] += if vertex[i] + self.edge <= 1.0 { self.edge } else { -self.edge };
            trial.push(vertex);
        }
        self.request(Move::Start, trial);
    }

    fn request(&mut self, doing: Move, trial: Vec<Vec<f64>>) {
        self.doing = doing;
        self.asked.clear();
        for unit in &trial {
            let mut full = [0.0; crate::parameters::COUNT];
            for (&i, u) in self.free.iter().zip(unit) {
                full[i] = *u;
            }
            self.asked.push(self.bounds.from_unit(&full));
        }
        self.trial = trial;
    }

    /// The points whose fitness is wanted, in table units; empty once finished.
    pub fn ask(&self) -> &[Point] {
        &self.asked
    }

    /// Takes the fitnesses of the points asked, in their order; NaN counts as
    /// infinitely bad.
    ///
    /// # Errors
    /// When the number of fitnesses is not that of the points.
    pub fn tell(&mut self, scores: &[f64]) -> Result<(), OptimiseError> {
        if scores.len() != self.asked.len() {
            let (asked, told) = (self.asked.len(), scores.len());
            return Err(OptimiseError::Told { asked, told });
        }
        self.evaluations += scores.len();
        let trial = std::mem::take(&mut self.trial);
        let mut told: Vec<Vertex> = trial
            .into_iter()
            .zip(scores)
            .map(|(unit, f)| Vertex { unit, fitness: if f.is_nan() { f64::INFINITY } else { *f } })
            .collect();
        match std::mem::replace(&mut self.doing, Move::Done) {
            Move::Done => {}
            Move::Start => {
                self.vertices = told;
                self.advance();
            }
            Move::Shrink => {
                self.vertices.truncate(1);
                self.vertices.append(&mut told);
                self.advance();
            }
            doing => {
                if let Some(tried) = told.pop() {
                    self.judge(doing, tried);
                }
            }
        }
        Ok(())
    }

    /// Decides on a single point tried.
    fn judge(&mut self, doing: Move, tried: Vertex) {
        let last = self.vertices.len() - 1;
        let (best, worst) = (self.vertices[0].fitness, self.vertices[last].fitness);
        let second = self.vertices[last.saturating_sub(1)].fitness;
        match doing {
            Move::Reflect if tried.fitness < best => {
                let far = self.along(self.settings.reflection * self.settings.expansion);
                self.request(Move::Expand(tried), vec![far]);
            }
            Move::Reflect if tried.fitness < second => self.replace(tried),
            Move::Reflect if tried.fitness < worst => {
                let near = self.along(self.settings.reflection * self.settings.contraction);
                self.request(Move::ContractOutside(tried), vec![near]);
            }
            Move::Reflect => {
                let near = self.along(-self.settings.contraction);
                self.request(Move::ContractInside, vec![near]);
            }
            Move::Expand(reflected) => {
                self.replace(if tried.fitness < reflected.fitness { tried } else { reflected });
            }
            Move::ContractOutside(reflected) if tried.fitness <= reflected.fitness => {
                self.replace(tried);
            }
            Move::ContractInside if tried.fitness < worst => self.replace(tried),
            _ => self.shrink(),
        }
    }

    /// The point on the line from the worst vertex through the centre of the
    /// others, `t` times their distance beyond the centre.
    fn along(&self, t: f64) -> Vec<f64> {
        let last = self.vertices.len() - 1;
        let worst = &self.vertices[last].unit;
        (0..worst.len())
            .map(|i| {
                let centre = self.vertices[..last].iter().map(|v| v.unit[i]).sum::<f64>() / last as f64;
                t.mul_add(centre - worst[i], centre)
            })
            .collect()
    }

    fn replace(&mut self, vertex: Vertex) {
        self.vertices.pop();
        self.vertices.push(vertex);
        self.advance();
    }

    fn shrink(&mut self) {
        let factor = self.settings.shrink;
        let best = &self.vertices[0].unit;
        let towards =
            |v: &Vertex| -> Vec<f64> { best.iter().zip(&v.unit).map(|(b, u)| factor.mul_add(u - b, *b)).collect() };
        let trial = self.vertices[1..].iter().map(towards).collect();
        self.request(Move::Shrink, trial);
    }

    /// Sorts and decides how to go on.
    fn advance(&mut self) {
        // Stable: of equals the older vertex counts as the better.
        self.vertices.sort_by(|a, b| a.fitness.total_cmp(&b.fitness));
        if self.evaluations >= self.settings.max_evaluations {
            self.end(SimplexStop::Evaluations);
        } else if !self.collapsed() {
            let reflected = self.along(self.settings.reflection);
            self.request(Move::Reflect, vec![reflected]);
        } else if self.restarts > 0 {
            self.restarts -= 1;
            self.edge *= SMALLER;
            self.start(self.vertices[0].unit.clone());
        } else {
            self.end(SimplexStop::Converged);
        }
    }

    fn collapsed(&self) -> bool {
        let best = &self.vertices[0];
        let tolerance = self.settings.tolerance;
        self.vertices[1..].iter().all(|v| {
            let apart = v.unit.iter().zip(&best.unit).map(|(a, b)| (a - b).abs());
            // Two infinities agree; their difference is NaN.
            let agree = v.fitness == best.fitness || v.fitness - best.fitness <= tolerance;
            agree && apart.fold(0.0, f64::max) <= tolerance
        })
    }

    fn end(&mut self, stop: SimplexStop) {
        self.finished = Some(stop);
        self.request(Move::Done, Vec::new());
    }

    /// Why it ended, once it has.
    pub fn finished(&self) -> Option<SimplexStop> {
        self.finished
    }

    /// The best vertex, in table units, and its fitness; none before the first
    /// simplex is told or as long as no fitness was finite.
    pub fn best(&self) -> Option<(Point, f64)> {
        let best = self.vertices.iter().min_by(|a, b| a.fitness.total_cmp(&b.fitness))?;
        if !best.fitness.is_finite() {
            return None;
        }
        let mut full = [0.0; crate::parameters::COUNT];
        for (&i, u) in self.free.iter().zip(&best.unit) {
            full[i] = *u;
        }
        Some((self.bounds.from_unit(&full), best.fitness))
    }

    /// How many fitnesses were told.
    pub fn evaluations(&self) -> usize {
        self.evaluations
    }
}
