//! Small strictly convex quadratic programs.

use crate::parameters::COUNT;

/// Most variables: the ten parameters and the relaxation.
pub(super) const MOST: usize = COUNT + 1;

/// A row of as many numbers as there may be variables.
pub(super) type Row = [f64; MOST];

/// Violations up to this share of a row's size count as none.
const TOLERANCE: f64 = 1e-14;

/// One constraint `normal . d >= bound`, or `=`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Constraint {
    pub(super) normal: Row,
    pub(super) bound: f64,
    pub(super) equality: bool,
}

/// Minimise `1/2 d' B d + g' d` under constraints.
pub(super) struct Quadratic<'a> {
    /// Variables that count, at most [`MOST`].
    pub(super) n: usize,
    /// Symmetric and positive definite.
    pub(super) hessian: &'a [Row; MOST],
    pub(super) gradient: Row,
    pub(super) constraints: &'a [Constraint],
}

/// A minimum.
#[derive(Debug, Clone)]
pub(super) struct Minimum {
    pub(super) step: Row,
    /// One per constraint, `B d + g = sum multiplier normal`; those of inequalities are >= 0.
    pub(super) multipliers: Vec<f64>,
}

/// The dual active-set method of Goldfarb & Idnani 1983 (Math. Program. 27).
///
/// It starts from the free minimum and adds the most violated constraint, so no
/// feasible point has to be known. Its factors: `J` with `J J' = B^-1`, turned so
/// that its first `q` columns span the active normals, and the triangle `R`.
struct Active<'a> {
    problem: &'a Quadratic<'a>,
    j: [Row; MOST],
    r: [Row; MOST],
    q: usize,
    /// Place of each active constraint and the sign its normal was taken with.
    members: [(usize, f64); MOST],
    duals: Row,
    d: Row,
}

/// The minimum; none where the constraints contradict each other or the Hessian is not
/// positive definite.
pub(super) fn minimise(problem: &Quadratic<'_>) -> Option<Minimum> {
    let mut active = Active::new(problem)?;
    // Each turn raises the dual objective; the limit only guards against rounding.
    for _ in 0..40 * (MOST + problem.constraints.len()) {
        let Some((p, sign, slack)) = active.most_violated() else { return Some(active.minimum()) };
        active.add(p, sign, slack)?;
    }
    None
}

fn dot(a: &Row, b: &Row, n: usize) -> f64 {
    (0..n).map(|i| a[i] * b[i]).sum()
}

impl<'a> Active<'a> {
    fn new(problem: &'a Quadratic<'a>) -> Option<Self> {
        let n = problem.n;
        let lower = cholesky(problem.hessian, n)?;
        // J = L^-T, column by column of L^-1's rows.
        let mut j = [[0.0; MOST]; MOST];
        for (c, j) in j.iter_mut().enumerate().take(n) {
            for i in c..n {
                let sum: f64 = (c..i).map(|k| lower[i][k] * j[k]).sum();
                let unit = if i == c { 1.0 } else { 0.0 };
                j[i] = (unit - sum) / lower[i][i];
            }
        }
        let mut d = [0.0; MOST];
        let turned: Row = std::array::from_fn(|k| (0..n).map(|i| j[i][k] * problem.gradient[i]).sum());
        for (i, d) in d.iter_mut().enumerate().take(n) {
            *d = -dot(&j[i], &turned, n);
        }
        d.iter().all(|v| v.is_finite()).then_some(Self {
            problem,
            j,
            r: [[0.0; MOST]; MOST],
            q: 0,
            members: [(0, 1.0); MOST],
            duals: [0.0; MOST],
            d,
        })
    }

    /// The constraint violated most for its size, the sign which makes it `>=`, and its slack.
    fn most_violated(&self) -> Option<(usize, f64, f64)> {
        let n = self.problem.n;
        let mut worst = None;
        let mut most = TOLERANCE;
        for (i, c) in self.problem.constraints.iter().enumerate() {
            if self.members[..self.q].iter().any(|(m, _)| *m == i) {
                continue;
            }
            let slack = dot(&c.normal, &self.d, n) - c.bound;
            let sign = if c.equality && slack > 0.0 { -1.0 } else { 1.0 };
            let size = dot(&c.normal, &c.normal, n).sqrt().max(f64::MIN_POSITIVE);
            let violation = -sign * slack / (size * (1.0 + c.bound.abs() / size));
            if violation > most {
                (worst, most) = (Some((i, sign, sign * slack)), violation);
            }
        }
        worst
    }

    /// Moves until constraint `p` holds, letting go of others on the way.
    fn add(&mut self, p: usize, sign: f64, mut slack: f64) -> Option<()> {
        let n = self.problem.n;
        let normal = self.problem.constraints[p].normal.map(|v| sign * v);
        let mut dual = 0.0;
        loop {
            let turned: Row = std::array::from_fn(|k| (0..n).map(|i| self.j[i][k] * normal[i]).sum());
            let mut z = [0.0; MOST];
            for (i, z) in z.iter_mut().enumerate().take(n) {
                *z = (self.q..n).map(|k| self.j[i][k] * turned[k]).sum();
            }
            let r = self.solve(&turned);
            let (partial, blocking) = self.longest_dual(&r);
            let progress = dot(&z, &normal, n);
            let free: f64 = (self.q..n).map(|k| turned[k] * turned[k]).sum();
            let all: f64 = turned[..n].iter().map(|t| t * t).sum();
            let full = if free > 1e-24 * all { -slack / progress } else { f64::INFINITY };
            let t = partial.min(full);
            if !t.is_finite() {
                return None;
            }
            for (dual, r) in self.duals[..self.q].iter_mut().zip(r) {
                *dual -= t * r;
            }
            dual += t;
            if full.is_finite() {
                for (d, z) in self.d.iter_mut().zip(z) {
                    *d += t * z;
                }
                slack += t * progress;
            }
            if full <= partial {
                self.enter(p, sign, dual, turned);
                return Some(());
            }
            self.leave(blocking);
        }
    }

    /// R^-1 of the first q numbers.
    fn solve(&self, turned: &Row) -> Row {
        let mut r = [0.0; MOST];
        for i in (0..self.q).rev() {
            let sum: f64 = (i + 1..self.q).map(|k| self.r[i][k] * r[k]).sum();
            r[i] = (turned[i] - sum) / self.r[i][i];
        }
        r
    }

    /// How far the dual step can go before an inequality's multiplier is 0, and whose.
    fn longest_dual(&self, r: &Row) -> (f64, usize) {
        let (mut t, mut which) = (f64::INFINITY, 0);
        for (i, ((place, _), (dual, r))) in self.members.iter().zip(self.duals.iter().zip(r)).enumerate().take(self.q) {
            if !self.problem.constraints[*place].equality && *r > 0.0 && dual / r < t {
                (t, which) = (dual / r, i);
            }
        }
        (t, which)
    }

    /// Makes `p` active: rotations turn its normal into the first q + 1 columns.
    fn enter(&mut self, p: usize, sign: f64, dual: f64, mut turned: Row) {
        for k in (self.q + 1..self.problem.n).rev() {
            let (a, b) = (turned[k - 1], turned[k]);
            let length = (a * a + b * b).sqrt();
            if length > 0.0 {
                turned[k - 1] = length;
                self.rotate(k - 1, a / length, b / length);
            }
        }
        for (row, turned) in self.r.iter_mut().zip(turned).take(self.q + 1) {
            row[self.q] = turned;
        }
        (self.members[self.q], self.duals[self.q]) = ((p, sign), dual);
        self.q += 1;
    }

    /// Lets go of the active constraint at `place`.
    fn leave(&mut self, place: usize) {
        for c in place + 1..self.q {
            for i in 0..=c {
                self.r[i][c - 1] = self.r[i][c];
            }
            (self.members[c - 1], self.duals[c - 1]) = (self.members[c], self.duals[c]);
        }
        self.q -= 1;
        for c in place..self.q {
            let (a, b) = (self.r[c][c], self.r[c + 1][c]);
            let length = (a * a + b * b).sqrt();
            if length > 0.0 {
                let (cos, sin) = (a / length, b / length);
                for k in c..self.q {
                    let (x, y) = (self.r[c][k], self.r[c + 1][k]);
                    (self.r[c][k], self.r[c + 1][k]) = (cos * x + sin * y, cos * y - sin * x);
                }
                self.rotate(c, cos, sin);
            }
        }
    }

    /// Turns columns k and k + 1 of J.
    fn rotate(&mut self, k: usize, cos: f64, sin: f64) {
        for row in &mut self.j[..self.problem.n] {
            let (x, y) = (row[k], row[k + 1]);
            (row[k], row[k + 1]) = (cos * x + sin * y, cos * y - sin * x);
        }
    }

    fn minimum(&self) -> Minimum {
        let mut multipliers = vec![0.0; self.problem.constraints.len()];
        for ((place, sign), dual) in self.members[..self.q].iter().zip(self.duals) {
            multipliers[*place] = sign * dual;
        }
        Minimum { step: self.d, multipliers }
    }
}

/// The lower factor of a symmetric matrix; none where it is not positive definite.
fn cholesky(a: &[Row; MOST], n: usize) -> Option<[Row; MOST]> {
    let mut l = [[0.0; MOST]; MOST];
    for i in 0..n {
        for j in 0..=i {
            let sum = a[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            if i > j {
                l[i][j] = sum / l[j][j];
            } else if sum > 0.0 {
                l[i][i] = sum.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(l)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surrogate::random::{Streams, uniform};

    fn constraint(normal: &[f64], bound: f64, equality: bool) -> Constraint {
        let mut row = [0.0; MOST];
        row[..normal.len()].copy_from_slice(normal);
        Constraint { normal: row, bound, equality }
    }

    /// The example of Goldfarb & Idnani's own paper, section 4: minimum at (1/2, 3/2).
    #[test]
    fn a_published_example() {
        let mut hessian = [[0.0; MOST]; MOST];
        (hessian[0][0], hessian[0][1], hessian[1][0], hessian[1][1]) = (4.0, -2.0, -2.0, 4.0);
        let mut gradient = [0.0; MOST];
        gradient[0] = 6.0;
        let constraints = [
            constraint(&[1.0, 0.0], 0.0, false),
            constraint(&[0.0, 1.0], 0.0, false),
            constraint(&[1.0, 1.0], 2.0, false),
        ];
        let found = minimise(&Quadratic { n: 2, hessian: &hessian, gradient, constraints: &constraints }).unwrap();
        assert!((found.step[0] - 0.5).abs() < 1e-14 && (found.step[1] - 1.5).abs() < 1e-14);
        assert!((found.multipliers[2] - 5.0).abs() < 1e-13 && found.multipliers[0] == 0.0);
    }

    /// Random programs in eleven variables meet the conditions of Karush, Kuhn and Tucker.
    #[test]
    fn random_programs_are_optimal() {
        let mut rng = Streams::new(5).stream(0);
        let mut draw = || 2.0 * uniform(&mut rng) - 1.0;
        for _ in 0..200 {
            let factor: [Row; MOST] = std::array::from_fn(|_| std::array::from_fn(|_| draw()));
            let hessian: [Row; MOST] = std::array::from_fn(|i| {
                std::array::from_fn(|j| dot(&factor[i], &factor[j], MOST) + if i == j { 0.01 } else { 0.0 })
            });
            let gradient: Row = std::array::from_fn(|_| draw());
            // A point inside makes them consistent.
            let inside: Row = std::array::from_fn(|_| draw());
            let mut constraints: Vec<Constraint> = (0..18)
                .map(|i| {
                    let normal: Row = std::array::from_fn(|_| draw());
                    let room = if i < 3 { 0.0 } else { 0.1 * (1.0 + draw()) };
                    Constraint { normal, bound: dot(&normal, &inside, MOST) - room, equality: i < 3 }
                })
                .collect();
            let problem = Quadratic { n: MOST, hessian: &hessian, gradient, constraints: &constraints };
            let found = minimise(&problem).unwrap();
            for i in 0..MOST {
                let forces = constraints.iter().zip(&found.multipliers).map(|(c, m)| m * c.normal[i]).sum::<f64>();
                assert!((dot(&hessian[i], &found.step, MOST) + gradient[i] - forces).abs() < 1e-8);
            }
            for (c, m) in constraints.iter().zip(&found.multipliers) {
                let slack = dot(&c.normal, &found.step, MOST) - c.bound;
                assert!(if c.equality { slack.abs() < 1e-9 } else { slack > -1e-9 && *m >= 0.0 });
                assert!(c.equality || (m * slack).abs() < 1e-8);
            }
            // The opposite of one of them, made strict, leaves nothing.
            let last = constraints[17];
            constraints.push(Constraint { normal: last.normal.map(|v| -v), bound: 1e-3 - last.bound, ..last });
            let empty = Quadratic { n: MOST, hessian: &hessian, gradient, constraints: &constraints };
            assert!(minimise(&empty).is_none());
        }
    }
}
