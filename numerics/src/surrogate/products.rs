//! Sums over the samples from which both methods take their steps.
//!
//! With N samples of weight a_n, h neurons, p free inputs counting the constant 1
//! of the bias: H = [a tanh, a] (N x (h+1)), E = a (y - target) (N x 4), and Z
//! (N x p h) with column (q, j) = a tanh'_j x_q.

use super::Network;
use super::gram::{Monomials, Slopes, add_pairs, add_sums};
use super::kernel::{self, Neuron};
use crate::parameters::{COUNT, Point};
use faer::linalg::matmul::matmul;
use faer::prelude::ReborrowMut;
use faer::{Accum, Mat, Par};
use rayon::prelude::*;

/// Samples whose columns are held in memory at one time.
const PANEL: usize = 4096;
/// Columns of one task of H'H.
const STRIPE: usize = 64;

/// The samples to fit.
#[derive(Debug, Clone)]
pub(crate) struct Data {
    /// Which inputs are free, as places in the parameter table.
    pub(crate) free: Vec<usize>,
    /// Scaled free inputs, each a column over the samples.
    pub(crate) inputs: Vec<Vec<f64>>,
    /// The same samples as the network is asked.
    pub(crate) points: Vec<Point>,
    /// Targets, one per sample.
    pub(crate) targets: Vec<[f64; 4]>,
    /// Factor of each sample's residuals, a_n.
    pub(crate) weights: Vec<f64>,
}

impl Data {
    /// Sum over samples and outputs of (a_n (y - target))², in sample order.
    pub(crate) fn squares(&self, net: &Network) -> f64 {
        let mut found = vec![[0.0; 4]; self.points.len()];
        net.predict_into(&self.points, &mut found);
        let of = |((f, t), a): ((&[f64; 4], &[f64; 4]), &f64)| {
            (0..4).map(|k| (a * (f[k] - t[k])) * (a * (f[k] - t[k]))).sum::<f64>()
        };
        found.iter().zip(&self.targets).zip(&self.weights).map(of).sum()
    }
}

/// The products of one linearisation.
pub(crate) struct Products {
    data: Data,
    pub(crate) h: usize,
    /// Free inputs and the constant.
    pub(crate) p: usize,
    /// Panel of [H E], samples x (h + 5).
    b: Mat<f64>,
    slopes: Slopes,
    /// Z'Z: for each neuron j, pair (i, q) with i >= q and neuron l <= j, the entry
    /// ((i, l), (q, j)), which is also that of ((i, j), (q, l)).
    pub(crate) zz: Vec<f64>,
    /// [H E]'Z row by row, (h + 5) x p h.
    pub(crate) bz: Vec<f64>,
    /// [H E]'[H E], lower triangle.
    pub(crate) bb: Mat<f64>,
    /// Output weights of the linearised network, 4 rows of h.
    pub(crate) v: Vec<f64>,
}

/// Place of pair (i, q), i >= q, in a packed lower triangle.
pub(crate) fn packed(i: usize, q: usize) -> usize {
    i * (i + 1) / 2 + q
}

impl Products {
    /// Memory for networks of `h` neurons on these samples.
    pub(crate) fn new(data: Data, h: usize) -> Self {
        let p = data.free.len() + 1;
        Self {
            h,
            p,
            b: Mat::zeros(PANEL.min(data.targets.len()), h + 5),
            slopes: Slopes::new(),
            zz: vec![0.0; packed(p, 0) * h * h],
            bz: vec![0.0; (h + 5) * p * h],
            bb: Mat::zeros(h + 5, h + 5),
            v: vec![0.0; 4 * h],
            data,
        }
    }

    /// The samples.
    pub(crate) fn data(&self) -> &Data {
        &self.data
    }

    /// Weights of neuron `j` on the free inputs, its bias last.
    fn row(&self, net: &Network, j: usize) -> Vec<f64> {
        let weight = |&i: &usize| net.hidden_weights[j * COUNT + i];
        self.data.free.iter().map(weight).chain([net.hidden_biases[j]]).collect()
    }

    /// Fills the panel with the samples from `start` on, residuals included, not yet weighted.
    fn fill(&mut self, net: &Network, start: usize, rows: usize) {
        let h = self.h;
        let mut b = std::mem::replace(&mut self.b, Mat::new());
        b.par_col_chunks_mut(1).take(h).enumerate().for_each(|(j, mut column)| {
            let out = column.rb_mut().col_mut(0).subrows_mut(0, rows);
            if let Some(out) = out.try_as_col_major_mut() {
                let (weights, out) = (&self.row(net, j), out.as_slice_mut());
                kernel::dispatch(Neuron { weights, inputs: &self.data.inputs, start, out });
            }
        });
        let targets = &self.data.targets[start..start + rows];
        b.col_as_slice_mut(h).fill(1.0);
        for k in 0..4 {
            // Column by column in the order of the neurons: the sum of a sample
            // always has the same order.
            let mut e: Vec<f64> = targets.iter().map(|t| net.output_biases[k] - t[k]).collect();
            for j in 0..h {
                let v = net.output_weights[k * h + j];
                for (e, a) in e.iter_mut().zip(b.col_as_slice(j)) {
                    *e += v * a;
                }
            }
            b.col_as_slice_mut(h + 1 + k)[..rows].copy_from_slice(&e);
        }
        self.b = b;
    }

    /// Multiplies the panel by the samples' weights.
    fn weigh(&mut self, start: usize, rows: usize) {
        let weights = &self.data.weights[start..start + rows];
        if weights.iter().all(|a| *a == 1.0) {
            return;
        }
        for j in 0..self.b.ncols() {
            for (b, a) in self.b.col_as_slice_mut(j).iter_mut().zip(weights) {
                *b *= a;
            }
        }
    }

    /// Adds the panel's share of [H E]'[H E].
    fn add_outputs(&mut self, rows: usize, first: bool) {
        let beta = if first { Accum::Replace } else { Accum::Add };
        let b = self.b.as_ref().subrows(0, rows);
        self.bb.par_col_chunks_mut(STRIPE).enumerate().for_each(|(c, stripe)| {
            let (from, width) = (c * STRIPE, stripe.ncols());
            let below = stripe.subrows_mut(from, b.ncols() - from);
            let left = b.subcols(from, b.ncols() - from).transpose();
            matmul(below, beta, left, b.subcols(from, width), 1.0, Par::Seq);
        });
    }

    /// Adds the panel's share of Z'Z and [H E]'Z.
    fn add_hidden(&mut self, start: usize, rows: usize) {
        let (h, p) = (self.h, self.p);
        let (b, inputs) = (&self.b, &self.data.inputs);
        let value = |q: usize, n: usize| inputs.get(q).map_or(1.0, |x| x[start + n]);
        let pairs: Vec<(usize, usize)> = (0..p).flat_map(|i| (0..=i).map(move |q| (i, q))).collect();
        let singles = Monomials::new(p, rows, value);
        let pairs = Monomials::new(pairs.len(), rows, |c, n| value(pairs[c].0, n) * value(pairs[c].1, n));
        add_pairs(&self.slopes, &pairs, h, &mut self.zz);
        let column = |j: usize, from: usize, w: &mut [f64]| {
            w.copy_from_slice(&b.col_as_slice(j)[from..from + w.len()]);
        };
        add_sums(&self.slopes, &singles, h, &mut self.bz, |_| h, column);
    }

    /// [H E]'[H E] alone, without what only a step needs.
    pub(crate) fn outputs_of(&mut self, net: &Network) {
        self.sum(net, false);
    }

    /// Every product at a network.
    pub(crate) fn linearise(&mut self, net: &Network) {
        self.v.copy_from_slice(&net.output_weights);
        self.zz.fill(0.0);
        self.bz.fill(0.0);
        self.sum(net, true);
    }

    fn sum(&mut self, net: &Network, hidden: bool) {
        let count = self.data.targets.len();
        for start in (0..count).step_by(PANEL) {
            let rows = PANEL.min(count - start);
            self.fill(net, start, rows);
            if hidden {
                let (b, weights) = (&self.b, &self.data.weights[start..start + rows]);
                self.slopes.fill(self.h, rows, |j, out| {
                    for ((out, t), a) in out.iter_mut().zip(b.col_as_slice(j)).zip(weights) {
                        *out = a * (1.0 - t * t);
                    }
                });
            }
            self.weigh(start, rows);
            self.add_outputs(rows, start == 0);
            if hidden {
                self.add_hidden(start, rows);
            }
        }
    }

    /// H'e_k as (h + 1) x 4.
    pub(crate) fn output_gradient(&self) -> Mat<f64> {
        Mat::from_fn(self.h + 1, 4, |j, k| self.bb[(self.h + 1 + k, j)])
    }

    /// sum_k D_k Z'e_k, (q, j) order.
    pub(crate) fn hidden_gradient(&self) -> Vec<f64> {
        let (h, n) = (self.h, self.p * self.h);
        let entry = |c: usize| (0..4).map(|k| self.v[k * h + c % h] * self.bz[(h + 1 + k) * n + c]).sum();
        (0..n).map(entry).collect()
    }
}
