//! A plain wing in a uniform stream. Chord (mean chord), speed and density are one.

use manduca_numerics::kinematics::Vector;
use manduca_numerics::math::sin_cos;
use manduca_numerics::uvlm::{Air, Planform, Pose, Solver, WingLoad, solver_of};

use super::scheme::Scheme;

/// Outline of one half of a wing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Constant chord, quarter-chord line swept back by an angle, rad.
    Straight(f64),
    /// Elliptic chord about a straight quarter-chord line.
    Elliptic,
}

/// Half of a wing; the other half is its mirror image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wing {
    /// Span² over area of both halves.
    pub aspect: f64,
    /// Outline.
    pub shape: Shape,
    /// Panels along one half.
    pub strips: usize,
    /// Spanwise spacing: 0 uniform, 1 cosine.
    pub cosine: f64,
    /// How far the tip of the lattice is drawn in, in widths of the last strip.
    pub inset: f64,
    /// Share of the leading-edge suction in the wing's plane.
    pub in_plane: f64,
    /// Chordwise panels, cores, time step.
    pub scheme: Scheme,
}

impl Wing {
    /// A rectangular wing with uniform strips.
    pub fn rectangular(aspect: f64, strips: usize, scheme: Scheme) -> Self {
        Self { aspect, shape: Shape::Straight(0.0), strips, cosine: 0.0, inset: 0.0, in_plane: 0.0, scheme }
    }

    /// A wing as good as infinite.
    pub fn two_dimensional(scheme: Scheme) -> Self {
        Self::rectangular(2000.0, 1, scheme)
    }

    /// The same with the lattice of the default settings along the span too.
    pub fn with_default_strips(self) -> Self {
        let settings = self.scheme.settings;
        let (strips, cosine) = (settings.spanwise_panels, settings.spanwise_cosine);
        Self { strips, cosine, inset: settings.edge_inset, ..self }
    }

    /// Area of one half, chords².
    pub fn area(&self) -> f64 {
        0.5 * self.aspect
    }

    /// The outline by stations.
    pub fn planform(&self) -> Planform {
        let tip = 0.5 * self.aspect;
        let straight = |sweep| Planform::straight(0.0, tip, 1.0, sweep, self.strips, self.cosine).drawn_in(self.inset);
        match self.shape {
            Shape::Straight(sweep) => straight(sweep),
            Shape::Elliptic => {
                let mut planform = straight(0.0);
                let chords = planform.span.iter().map(|y| 1.0 - (y / tip).powi(2));
                let chords: Vec<f64> = chords.map(|c| 4.0 / std::f64::consts::PI * c.max(0.0).sqrt()).collect();
                planform.leading = chords.iter().map(|c| 0.25 * c).collect();
                planform.trailing = chords.iter().map(|c| -0.75 * c).collect();
                planform
            }
        }
    }

    /// A solver with room for the wake of a path of so many chords.
    pub fn solver(&self, path: f64) -> Solver {
        self.solver_with_edge_speed(path, 1.0)
    }

    /// The same with the first wake row as far behind as if the edge moved at `speed`.
    pub fn solver_with_edge_speed(&self, path: f64, speed: f64) -> Solver {
        let mut settings = self.scheme.settings;
        settings.wake_strokes = path / self.scheme.stroke + 1.0 / settings.steps_per_stroke as f64;
        (settings.suction_to_lift, settings.suction_in_plane) = (0.0, self.in_plane);
        let speeds = vec![speed; self.strips + 1];
        solver_of(&self.planform(), &settings, 1.0, self.scheme.stroke, &speeds, Air::still(1.0))
    }

    /// Loads at every step after a sudden start at an incidence, over a path of so many chords; none when the
    /// lattice blows up.
    pub fn loads(&self, incidence: f64, path: f64) -> Vec<WingLoad> {
        let step = self.scheme.step();
        let steps = (path / step).round() as usize + 1;
        let mut solver = self.solver(path);
        let pose = |i: usize| level(incidence, Vector::new(i as f64 * step, 0.0, 0.0), Vector::x());
        (0..steps).map(|i| solver.step(&pose(i), step)).collect::<Option<_>>().unwrap_or_default()
    }

    /// Lift coefficients of the same, with the path at which each was taken.
    pub fn lift(&self, incidence: f64, path: f64) -> Vec<(f64, f64)> {
        let coefficient = |l: &WingLoad| l.force.z / (0.5 * self.area());
        self.loads(incidence, path)
            .iter()
            .enumerate()
            .map(|(i, l)| (i as f64 * self.scheme.step(), coefficient(l)))
            .collect()
    }

    /// Lift slope per rad at the end of a path at a small incidence.
    pub fn lift_slope(&self, path: f64) -> f64 {
        let incidence = 0.02;
        self.lift(incidence, path).last().map_or(f64::NAN, |l| l.1 / incidence)
    }
}

/// The wing at an incidence, its quarter-chord line (of the root) at `origin`.
pub fn level(incidence: f64, origin: Vector, velocity: Vector) -> Pose {
    let (s, c) = sin_cos(incidence);
    Pose { origin, e_r: Vector::y(), e_c: Vector::new(c, 0.0, s), velocity, omega: Vector::zeros() }
}

/// Value at `x` of points in order of x, linear in between.
pub fn interpolated(points: &[(f64, f64)], x: f64) -> f64 {
    let after = points.partition_point(|p| p.0 < x - 1e-9).clamp(1, points.len().max(2) - 1);
    match (points.get(after - 1), points.get(after)) {
        (Some(a), Some(b)) => a.1 + (b.1 - a.1) * (x - a.0) / (b.0 - a.0),
        _ => f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_between_points_are_linear() {
        let points = [(0.0, 1.0), (1.0, 3.0), (2.0, 3.0)];
        assert_eq!([0.0, 0.5, 1.0, 1.7, 2.0].map(|x| interpolated(&points, x)), [1.0, 2.0, 3.0, 3.0, 3.0]);
        assert!(interpolated(&[], 0.0).is_nan());
    }

    #[test]
    fn an_elliptic_wing_has_unit_mean_chord() {
        let wing =
            Wing { shape: Shape::Elliptic, cosine: 1.0, ..Wing::rectangular(8.0, 400, Scheme::fine(1e-3, 0.25, 4)) };
        let p = wing.planform();
        let chord = |k: usize| p.leading[k] - p.trailing[k];
        let area: f64 = (0..400).map(|k| (p.span[k + 1] - p.span[k]) * 0.5 * (chord(k) + chord(k + 1))).sum();
        assert!((area / wing.area() - 1.0).abs() < 1e-4, "{area}");
        assert!(chord(400).abs() < 1e-12);
    }
}
