//! Variable projection: the output weights are always the best for the hidden ones.
//!
//! For given hidden weights W, the output weights minimise the sum of squares plus
//! a small ridge, a linear problem:
//!
//! ```text
//! F(W) = min_V sum_nk (a_n e_nk)² + lambda |V|²        (H'H + lambda I) V_k = H'(a t_k)
//! ```
//!
//! so only W is searched (Golub & Pereyra 1973). Kaufman's approximation (1975)
//! of its Jacobian, P D_k Z with P what H cannot represent, makes the step's matrix
//! that of [`super::normal`] with lambda in the place of the damping of the output
//! weights:
//!
//! ```text
//! (mu I + G o (Z'Z - U'U)) dW = -sum_k D_k Z'e_k
//! ```
//!
//! The right-hand side is the exact gradient of F, because F is least in V. The
//! matrix does not depend on mu but for its diagonal: a refused mu costs one
//! factorisation.

use super::Network;
use super::levenberg::{Change, Model};
use super::normal::{Normal, promise};
use super::products::Data;
use faer::Mat;

/// The ridge lambda per sample: it keeps the output weights finite where neurons
/// resemble each other, and is far below what the labels' noise would ask for.
const RIDGE: f64 = 1e-7;

/// [`Normal`] with the output weights eliminated.
pub(crate) struct Projection {
    normal: Normal,
    ridge: f64,
}

impl Projection {
    /// Memory for networks of `h` neurons on these samples.
    pub(crate) fn new(data: Data, h: usize) -> Self {
        let ridge = RIDGE * data.targets.len() as f64;
        Self { normal: Normal::new(data, h), ridge }
    }
}

/// Sum of the squared output weights, biases included.
fn norm(net: &Network) -> f64 {
    net.output_weights.iter().chain(&net.output_biases).map(|v| v * v).sum()
}

impl Model for Projection {
    /// Sets the output weights to the best and returns F there.
    fn objective(&mut self, net: &mut Network) -> Option<f64> {
        let h = net.neurons();
        self.normal.products.outputs_of(net);
        self.normal.factor_outputs(self.ridge).ok()?;
        let weight = |net: &Network, j: usize, k: usize| {
            if j < h { net.output_weights[k * h + j] } else { net.output_biases[k] }
        };
        // From where the weights are: (H'H + lambda I) dV_k = -(H'e_k + lambda V_k).
        let gradient = self.normal.products.output_gradient();
        let mut fall = Mat::from_fn(h + 1, 4, |j, k| gradient[(j, k)] + self.ridge * weight(net, j, k));
        self.normal.solve_outputs(&mut fall);
        for k in 0..4 {
            for j in 0..h {
                net.output_weights[k * h + j] -= fall[(j, k)];
            }
            net.output_biases[k] -= fall[(h, k)];
        }
        Some(self.normal.products.data().squares(net) + self.ridge * norm(net))
    }

    fn linearise(&mut self, net: &Network) -> f64 {
        self.normal.prepare(net);
        let regular = self.normal.factor_outputs(self.ridge).is_ok();
        self.normal.eliminate();
        self.normal.keep();
        let hidden: f64 = self.normal.products.hidden_gradient().iter().map(|g| g * g).sum();
        // A singular A has no step either; the iteration must hear it from the step.
        if regular { hidden.sqrt() } else { f64::INFINITY }
    }

    fn step(&mut self, damping: f64) -> Option<Change> {
        self.normal.restore();
        self.normal.factor_hidden(damping).ok()?;
        let gradient = self.normal.products.hidden_gradient();
        let mut step = Mat::from_fn(gradient.len(), 1, |i, _| -gradient[i]);
        self.normal.solve_hidden(&mut step);
        let mut change = self.normal.hidden_change(step.col_as_slice(0));
        change.predicted = gradient.iter().zip(step.col_as_slice(0)).map(|(g, d)| promise(damping, *d, *g)).sum();
        Some(change)
    }
}
