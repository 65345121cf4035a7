//! A plain wing in a uniform stream, for the canonical checks.

use manduca_numerics::kinematics::Vector;
use manduca_numerics::uvlm::{Air, Cores, Lattice, Planform, Pose, Solver, Suction, WingLoad};

/// Half of a straight wing of chord 1 in a stream of speed 1; the other half is its mirror image.
#[derive(Debug, Clone, Copy)]
pub struct Wing {
    pub aspect: f64,
    pub sweep: f64,
    pub chordwise: usize,
    pub strips: usize,
    pub cosine: f64,
    pub first_row: f64,
    pub in_plane: f64,
    pub core: f64,
}

impl Default for Wing {
    fn default() -> Self {
        Self {
            aspect: 4.0,
            sweep: 0.0,
            chordwise: 4,
            strips: 12,
            cosine: 0.0,
            first_row: 0.25,
            in_plane: 0.0,
            core: 1e-3,
        }
    }
}

impl Wing {
    pub fn solver(&self, step: f64, rows: usize) -> Solver {
        let planform = Planform::straight(0.0, 0.5 * self.aspect, 1.0, self.sweep, self.strips, self.cosine);
        let behind = vec![self.first_row * step; self.strips + 1];
        let lattice = Lattice::new(&planform, self.chordwise, &behind);
        let suction = Suction { to_lift: 0.0, in_plane: self.in_plane };
        Solver::new(lattice, Air::still(1.0), Cores::uniform(self.core), suction, rows)
    }

    /// The wing flying forward (+x) at incidence, displaced by `travel`.
    pub fn pose(incidence: f64, travel: f64, velocity: Vector, omega: f64) -> Pose {
        let (s, c) = manduca_numerics::math::sin_cos(incidence);
        Pose {
            origin: Vector::new(travel, 0.0, 0.0),
            e_r: Vector::new(0.0, 1.0, 0.0),
            e_c: Vector::new(c, 0.0, s),
            velocity,
            omega: Vector::new(0.0, -omega, 0.0),
        }
    }

    /// Area of one half.
    pub fn area(&self) -> f64 {
        0.5 * self.aspect
    }

    /// Lift coefficient at every step after an impulsive start.
    pub fn sudden_start(&self, incidence: f64, step: f64, length: f64) -> Vec<f64> {
        self.history(incidence, step, length).iter().map(|l| l.force.z / (0.5 * self.area())).collect()
    }

    pub fn history(&self, incidence: f64, step: f64, length: f64) -> Vec<WingLoad> {
        let steps = (length / step).round() as usize + 1;
        let mut solver = self.solver(step, steps);
        (0..steps)
            .map(|i| {
                let pose = Self::pose(incidence, i as f64 * step, Vector::new(1.0, 0.0, 0.0), 0.0);
                solver.step(&pose, step).expect("the lattice holds")
            })
            .collect()
    }

    /// Lift slope per rad after a long run at a small incidence.
    pub fn lift_slope(&self) -> f64 {
        let incidence = 0.02;
        let lift = self.sudden_start(incidence, 0.5, 30.0);
        lift.last().expect("there are steps") / incidence
    }
}
