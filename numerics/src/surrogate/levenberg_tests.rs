//! The structured step against the plain one with a dense Jacobian.

use super::kernel::scaled;
use super::levenberg::{Change, Levenberg, Model, Outcome};
use super::network::Network;
use super::network::tests::{random_network, random_points};
use super::normal::{Data, Normal};
use crate::parameters::{Bounds, COUNT, Point};
use faer::Mat;
use faer::prelude::Solve;

const H: usize = 6;

/// The textbook way: every derivative of every residual in one matrix.
struct Dense {
    zs: Vec<Point>,
    targets: Vec<[f64; 4]>,
    jacobian: Mat<f64>,
    residual: Mat<f64>,
}

impl Dense {
    fn new(zs: Vec<Point>, targets: Vec<[f64; 4]>) -> Self {
        Self { zs, targets, jacobian: Mat::new(), residual: Mat::new() }
    }
}

impl Model for Dense {
    fn linearise(&mut self, net: &Network) -> f64 {
        let weights = 15 * H + 4;
        let n = self.zs.len();
        self.jacobian = Mat::zeros(4 * n, weights);
        self.residual = Mat::zeros(4 * n, 1);
        for (s, z) in self.zs.iter().enumerate() {
            for k in 0..4 {
                let row = 4 * s + k;
                let mut y = net.output_biases[k];
                for j in 0..H {
                    let w = &net.hidden_weights[COUNT * j..COUNT * (j + 1)];
                    let sum: f64 = w.iter().zip(z).map(|(w, z)| w * z).sum();
                    let a = crate::math::tanh(sum + net.hidden_biases[j]);
                    let v = net.output_weights[k * H + j];
                    y += v * a;
                    for (i, z) in z.iter().enumerate() {
                        self.jacobian[(row, COUNT * j + i)] = v * (1.0 - a * a) * z;
                    }
                    self.jacobian[(row, COUNT * H + j)] = v * (1.0 - a * a);
                    self.jacobian[(row, 11 * H + k * H + j)] = a;
                }
                self.jacobian[(row, 15 * H + k)] = 1.0;
                self.residual[(row, 0)] = y - self.targets[s][k];
            }
        }
        (self.jacobian.transpose() * &self.residual).norm_l2()
    }

    fn step(&mut self, damping: f64) -> Option<Change> {
        let mut a = self.jacobian.transpose() * &self.jacobian;
        for i in 0..a.nrows() {
            a[(i, i)] += damping;
        }
        let gradient = self.jacobian.transpose() * &self.residual;
        // Not full pivoting: faer 0.24.4 returns a wrong answer here with AVX-512.
        let d = a.partial_piv_lu().solve(&gradient) * -1.0;
        let predicted = (0..d.nrows()).map(|i| 0.5 * d[(i, 0)] * (damping * d[(i, 0)] - gradient[(i, 0)])).sum();
        let d = d.col_as_slice(0);
        Some(Change {
            hidden_weights: d[..10 * H].to_vec(),
            hidden_biases: d[10 * H..11 * H].to_vec(),
            output_weights: d[11 * H..15 * H].to_vec(),
            output_biases: std::array::from_fn(|k| d[15 * H + k]),
            predicted,
        })
    }
}

fn weights(net: &Network) -> Vec<f64> {
    let all = [&net.hidden_weights[..], &net.hidden_biases, &net.output_weights];
    [all.concat(), net.output_biases.to_vec()].concat()
}

fn compare(bounds: Bounds, samples: usize, iterations: usize, tolerance: f64) {
    let mut start = random_network(H, 11);
    start.bounds = bounds;
    for j in 0..H {
        for i in (0..COUNT).filter(|&i| bounds.is_held(i)) {
            start.hidden_weights[COUNT * j + i] = 0.0;
        }
    }
    let truth = random_network(4, 12);
    let xs = random_points(samples, &bounds, 13);
    let targets: Vec<[f64; 4]> = xs.iter().map(|x| truth.predict(x)).collect();
    let zs: Vec<Point> = xs.iter().map(|x| scaled(&bounds, x)).collect();
    let free: Vec<usize> = (0..COUNT).filter(|&i| !bounds.is_held(i)).collect();
    let inputs = free.iter().map(|&i| zs.iter().map(|z| z[i]).collect()).collect();
    let mut squares = |net: &Network| -> f64 {
        let residuals = xs.iter().zip(&targets).flat_map(|(x, t)| {
            let y = net.predict(x);
            (0..4).map(move |k| (y[k] - t[k]).powi(2))
        });
        residuals.sum()
    };
    let first = squares(&start);
    let mut plain = Dense::new(zs, targets.clone());
    let mut structured = Normal::new(Data { free, inputs, targets: targets.clone() }, H);
    let mut a = Levenberg::new(start.clone(), first);
    let mut b = Levenberg::new(start, first);
    for _ in 0..iterations {
        assert_eq!(a.iterate(&mut plain, 0.0, &mut squares), Outcome::Moved);
        assert_eq!(b.iterate(&mut structured, 0.0, &mut squares), Outcome::Moved);
        for (p, s) in weights(&a.network).iter().zip(weights(&b.network)) {
            assert!((p - s).abs() < tolerance, "{p} {s}");
        }
        assert!((a.damping / b.damping - 1.0).abs() < 1e-6);
    }
    assert!(b.squares < 0.2 * first, "{} of {first}", b.squares);
}

#[test]
fn iterates_equal_those_of_a_dense_jacobian() {
    compare(Bounds::default(), 60, 5, 1e-8);
}

#[test]
fn iterates_agree_over_several_panels_and_with_held_inputs() {
    let mut bounds = Bounds::default();
    for i in [1, 3, 6] {
        bounds.upper[i] = bounds.lower[i];
    }
    compare(bounds, 1200, 4, 1e-8);
}
