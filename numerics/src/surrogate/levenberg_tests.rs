//! The structured step against the plain one with a dense Jacobian.

use super::kernel::scaled;
use super::levenberg::{Change, Levenberg, Model, Outcome};
use super::network::Network;
use super::network::tests::{random_network, random_points};
use super::normal::Normal;
use super::products::Data;
use super::projection::Projection;
use crate::parameters::{Bounds, COUNT, Point};
use faer::Mat;
use faer::prelude::Solve;

const H: usize = 6;

/// The textbook way: every derivative of every residual in one matrix.
struct Dense {
    xs: Vec<Point>,
    zs: Vec<Point>,
    targets: Vec<[f64; 4]>,
    weights: Vec<f64>,
    jacobian: Mat<f64>,
    residual: Mat<f64>,
}

impl Dense {
    fn new(xs: Vec<Point>, bounds: &Bounds, targets: Vec<[f64; 4]>, weights: Vec<f64>) -> Self {
        let zs = xs.iter().map(|x| scaled(bounds, x)).collect();
        Self { xs, zs, targets, weights, jacobian: Mat::new(), residual: Mat::new() }
    }
}

impl Model for Dense {
    fn objective(&mut self, net: &mut Network) -> Option<f64> {
        let residuals = self.xs.iter().zip(&self.targets).zip(&self.weights).flat_map(|((x, t), a)| {
            let y = net.predict(x);
            (0..4).map(move |k| (a * (y[k] - t[k])).powi(2))
        });
        Some(residuals.sum())
    }

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
                let a = self.weights[s];
                self.residual[(row, 0)] = a * (y - self.targets[s][k]);
                for c in 0..weights {
                    self.jacobian[(row, c)] *= a;
                }
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

/// Samples of a small network, and where to start.
fn task(bounds: &Bounds, samples: usize) -> (Network, Data) {
    let mut start = random_network(H, 11);
    start.bounds = *bounds;
    for j in 0..H {
        for i in (0..COUNT).filter(|&i| bounds.is_held(i)) {
            start.hidden_weights[COUNT * j + i] = 0.0;
        }
    }
    let truth = random_network(4, 12);
    let points = random_points(samples, bounds, 13);
    let targets: Vec<[f64; 4]> = points.iter().map(|x| truth.predict(x)).collect();
    let zs: Vec<Point> = points.iter().map(|x| scaled(bounds, x)).collect();
    let free: Vec<usize> = (0..COUNT).filter(|&i| !bounds.is_held(i)).collect();
    let inputs = free.iter().map(|&i| zs.iter().map(|z| z[i]).collect()).collect();
    let weights = (0..samples).map(|n| if n % 3 == 0 { 0.4 } else { 1.0 }).collect();
    (start, Data { free, inputs, points, targets, weights })
}

fn compare(bounds: Bounds, samples: usize, iterations: usize, tolerance: f64) {
    let (start, data) = task(&bounds, samples);
    let mut plain = Dense::new(data.points.clone(), &bounds, data.targets.clone(), data.weights.clone());
    let mut structured = Normal::new(data, H);
    let mut a = Levenberg::new(start.clone(), &mut plain);
    let mut b = Levenberg::new(start, &mut structured);
    let first = b.objective;
    for _ in 0..iterations {
        assert_eq!(a.iterate(&mut plain, 0.0), Outcome::Moved);
        assert_eq!(b.iterate(&mut structured, 0.0), Outcome::Moved);
        for (p, s) in weights(&a.network).iter().zip(weights(&b.network)) {
            assert!((p - s).abs() < tolerance, "{p} {s}");
        }
        assert!((a.damping / b.damping - 1.0).abs() < 1e-6);
    }
    assert!(b.objective < 0.2 * first, "{} of {first}", b.objective);
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
    compare(bounds, 4500, 4, 1e-8);
}

/// Where the output weights are the best ones the objective's gradient in them is zero,
/// and its fall along a small step is what the hidden gradient says.
#[test]
fn projection_steps_go_down_the_true_gradient() {
    let (start, data) = task(&Bounds::default(), 300);
    let mut model = Projection::new(data, H);
    let mut state = Levenberg::new(start, &mut model);
    let norm = model.linearise(&state.network);
    // With this much damping the step is -gradient / mu.
    let damping = 1e8;
    let change = model.step(damping).unwrap();
    let mut next = change.apply(&state.network).unwrap();
    let fall = 0.5 * (state.objective - model.objective(&mut next).unwrap());
    assert!((fall * damping / (norm * norm) - 1.0).abs() < 1e-3, "{fall:e} {norm:e}");
    assert!((change.predicted * damping / (norm * norm) - 1.0).abs() < 1e-3);

    let first = state.objective;
    for _ in 0..12 {
        assert_eq!(state.iterate(&mut model, 0.0), Outcome::Moved);
    }
    assert!(state.objective < 0.05 * first, "{} of {first}", state.objective);
}

/// A refused damping is tried again on the kept matrix: the step is that of a fresh linearisation.
#[test]
fn a_second_damping_gives_the_step_of_a_fresh_start() {
    let (mut start, data) = task(&Bounds::default(), 300);
    let mut model = Projection::new(data, H);
    model.objective(&mut start).unwrap();
    model.linearise(&start);
    let fresh = model.step(0.5).unwrap();
    model.linearise(&start);
    model.step(1e-3).unwrap();
    assert_eq!(model.step(0.5).unwrap().hidden_weights, fresh.hidden_weights);
}
