//! What strokes flown near an optimum say of its neighbourhood: a surrogate where there is none.

use nalgebra::{DMatrix, DVector};

use super::region::Flown;
use crate::math::exp;
use crate::optimise::sqp::Differentiable;
use crate::parameters::{Bounds, COUNT, Point};
use crate::surrogate::Jacobian;

/// Most strokes a model rests on, the nearest.
const MOST: usize = 400;
/// Least length over which strokes lose weight, in widths of the box: the first trust region.
const LEAST_REACH: f64 = 0.1;
/// Strokes inside that length per coefficient, where there are so many.
const PER_COEFFICIENT: usize = 3;
/// What holds coefficients which no stroke decides at zero, as a share of the weights' sum.
const RIDGE: f64 = 1e-4;

/// A quadratic of `[L+, D+, M+, P+]` about a point.
///
/// ```text
/// y(d) = a + Σ_i b_i d_i + Σ_{i<=j} c_ij d_i d_j,   d = (u - u_0) / ρ
/// least squares with weights exp(-|d|²/2)
/// ```
///
/// u is the stroke in the unit box, held parameters left out; ρ is the distance within
/// which there are three strokes per coefficient, at least 0.1. Coefficients which the
/// strokes leave open, as where all lie on a bound, are held small by a ridge.
#[derive(Debug, Clone)]
pub struct Local {
    bounds: Bounds,
    centre: Point,
    reach: f64,
    free: Vec<usize>,
    /// Per output: constant, slopes, then the upper triangle of the quadratic part by rows.
    coefficients: [Vec<f64>; 4],
}

impl Local {
    /// The strokes nearest to a point on which a model about it would rest, the nearest
    /// first: those flown to their end, at most 400.
    pub fn nearest(bounds: &Bounds, centre: &Point, flown: &[Flown]) -> Vec<usize> {
        let centre = bounds.to_unit(centre);
        let known = flown.iter().enumerate().filter(|(_, f)| f.means.is_some());
        let mut near: Vec<(f64, usize)> = known.map(|(i, f)| (distance(&bounds.to_unit(&f.x), &centre), i)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.into_iter().take(MOST).map(|(_, i)| i).collect()
    }

    /// The model about a point of the strokes nearest to it. `None` where none was flown to its end.
    pub fn fit(bounds: &Bounds, centre: &Point, flown: &[Flown]) -> Option<Self> {
        let near = Self::nearest(bounds, centre, flown);
        let free: Vec<usize> = (0..COUNT).filter(|&i| !bounds.is_held(i)).collect();
        let count = 1 + free.len() + free.len() * (free.len() + 1) / 2;
        let unit = bounds.to_unit(centre);
        let away = |i: usize| distance(&bounds.to_unit(&flown[i].x), &unit);
        let farthest = *near.get(PER_COEFFICIENT * count).or(near.last())?;
        let reach = away(farthest).max(LEAST_REACH);
        let mut model =
            Self { bounds: *bounds, centre: unit, reach, free, coefficients: std::array::from_fn(|_| Vec::new()) };
        let mut normal = DMatrix::<f64>::zeros(count, count);
        let mut right: [DVector<f64>; 4] = std::array::from_fn(|_| DVector::zeros(count));
        let mut weights = 0.0;
        for &i in &near {
            let Some((y, _)) = flown[i].means else { continue };
            let weight = exp(-0.5 * (away(i) / reach).powi(2));
            let terms = DVector::from_vec(model.terms(&model.offset(&flown[i].x)));
            normal.ger(weight, &terms, &terms, 1.0);
            for (right, y) in right.iter_mut().zip(y) {
                right.axpy(weight * y, &terms, 1.0);
            }
            weights += weight;
        }
        for i in 1..count {
            normal[(i, i)] += RIDGE * weights;
        }
        let factor = normal.cholesky()?;
        model.coefficients = right.map(|right| factor.solve(&right).as_slice().to_vec());
        Some(model)
    }

    /// d of a point in table units, over the free parameters.
    fn offset(&self, x: &Point) -> Vec<f64> {
        let unit = self.bounds.to_unit(x);
        self.free.iter().map(|&i| (unit[i] - self.centre[i]) / self.reach).collect()
    }

    /// 1, d_i, d_i d_j: what the coefficients multiply.
    fn terms(&self, d: &[f64]) -> Vec<f64> {
        let pairs = (0..d.len()).flat_map(|i| (i..d.len()).map(move |j| d[i] * d[j]));
        std::iter::once(1.0).chain(d.iter().copied()).chain(pairs).collect()
    }

    fn jacobian(&self, x: &Point) -> Jacobian {
        let d = self.offset(x);
        let terms = self.terms(&d);
        let (mut y, mut slopes) = ([0.0; 4], [[0.0; COUNT]; 4]);
        for (k, c) in self.coefficients.iter().enumerate() {
            y[k] = c.iter().zip(&terms).map(|(c, t)| c * t).sum();
            let mut by_d: Vec<f64> = c[1..=d.len()].to_vec();
            let pairs = (0..d.len()).flat_map(|i| (i..d.len()).map(move |j| (i, j)));
            for ((i, j), c) in pairs.zip(&c[1 + d.len()..]) {
                by_d[i] += c * d[j];
                by_d[j] += c * d[i];
            }
            for (&i, slope) in self.free.iter().zip(by_d) {
                slopes[k][i] = slope / (self.reach * (self.bounds.upper[i] - self.bounds.lower[i]));
            }
        }
        (y, slopes)
    }
}

impl Differentiable for Local {
    fn jacobians_into(&self, xs: &[Point], out: &mut [Jacobian]) {
        for (x, place) in xs.iter().zip(out) {
            *place = self.jacobian(x);
        }
    }
}

fn distance(a: &Point, b: &Point) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds() -> Bounds {
        let mut bounds = Bounds::default();
        // Five parameters held.
        for i in [1, 3, 6, 8, 9] {
            bounds.upper[i] = bounds.lower[i];
        }
        bounds
    }

    /// A quadratic of each output.
    fn truth(x: &Point) -> [f64; 4] {
        let u = bounds().to_unit(x);
        [
            0.4 + u[0] - 0.3 * u[0] * u[7],
            u[2] - 0.5 + 0.1 * u[4].powi(2),
            u[4] * u[5] - 0.2,
            u[0].powi(2) + 0.5 * u[5] + 1.0,
        ]
    }

    fn flown(n: u64) -> Vec<Flown> {
        let points = (0..n).filter_map(|i| crate::sampling::sample(&bounds(), 3, i, &|_| true));
        points.map(|x| Flown { x, means: Some((truth(&x), [0.0; 4])) }).collect()
    }

    fn at(model: &Local, x: &Point) -> Jacobian {
        let mut out = [([0.0; 4], [[0.0; COUNT]; 4])];
        model.jacobians_into(std::slice::from_ref(x), &mut out);
        out[0]
    }

    #[test]
    fn a_quadratic_is_found_with_its_slopes() {
        let centre = bounds().from_unit(&[0.5; COUNT]);
        let model = Local::fit(&bounds(), &centre, &flown(300)).expect("a model");
        let x = flown(301)[300].x;
        let (y, slopes) = at(&model, &x);
        assert!((0..4).all(|k| (y[k] - truth(&x)[k]).abs() < 2e-3), "{y:?} {:?}", truth(&x));
        for i in 0..COUNT {
            let step = 1e-4 * (bounds().upper[i] - bounds().lower[i]);
            let moved = |sign: f64| {
                let mut x = x;
                x[i] += sign * step;
                at(&model, &x).0
            };
            let (up, down) = (moved(1.0), moved(-1.0));
            for k in 0..4 {
                let slope = if step > 0.0 { (up[k] - down[k]) / (2.0 * step) } else { 0.0 };
                assert!((slopes[k][i] - slope).abs() < 1e-9 + 1e-6 * slope.abs(), "{k} {i}");
            }
        }
    }

    #[test]
    fn what_no_stroke_decides_stays_small() {
        // All lie on a bound of one parameter, as where an optimum does; and they are few.
        let mut few = flown(12);
        for f in &mut few {
            f.x[5] = bounds().upper[5];
            f.means = Some((truth(&f.x), [0.0; 4]));
        }
        let model = Local::fit(&bounds(), &few[0].x, &few).expect("a model");
        let (y, slopes) = at(&model, &few[0].x);
        assert!((0..4).all(|k| (y[k] - truth(&few[0].x)[k]).abs() < 0.02), "{y:?}");
        assert!(slopes.iter().all(|s| s[5].abs() < 1e-12));
        few.iter_mut().for_each(|f| f.means = None);
        assert!(Local::fit(&bounds(), &few[0].x, &few).is_none() && Local::fit(&bounds(), &few[0].x, &[]).is_none());
    }

    #[test]
    fn only_strokes_flown_to_their_end_are_near() {
        let mut all = flown(500);
        all[7].means = None;
        let near = Local::nearest(&bounds(), &all[7].x, &all);
        assert_eq!(near.len(), MOST);
        assert!(!near.contains(&7));
        assert_eq!(Local::nearest(&bounds(), &all[8].x, &all)[0], 8);
    }
}
