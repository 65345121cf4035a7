//! The normal equations of one hidden layer, by their structure.
//!
//! With N samples, h neurons, p free inputs counting the constant 1 of the bias:
//! H = [tanh 1] (N x (h+1)), Z (N x p h) with column (q, j) = tanh'_j x_q,
//! V the output weights, V_k its rows, e_k the residuals of output k,
//! D_k = diag(V_kj over all (q, j)) and G = V'V (h x h):
//!
//! ```text
//! J'J = [ G o Z'Z        D_k Z'H     ]      gradient = [ sum_k D_k Z'e_k ]
//!       [ H'Z D_k        I4 (x) H'H  ]                 [ H'e_k           ]
//! ```
//!
//! where `o` multiplies entry by neuron pair. Writing A = H'H + mu I = L L' and
//! U = L^-1 H'Z, the output weights drop out exactly, damping included:
//!
//! ```text
//! S = mu I + G o (Z'Z - U'U)
//! S dW   = -(sum_k D_k (Z'e_k - U' L^-1 H'e_k))
//! A dV_k = -(H'e_k + H'Z D_k dW)
//! ```
//!
//! All four outputs share one U, which is what makes a step cheap. The blocks
//! (i, q) of Z'Z are symmetric, so p (p+1) / 2 half products of h x h suffice.

use super::Network;
use super::cholesky::{NotPositive, factorise, solve_lower, solve_upper};
use super::kernel::{self, Neuron};
use super::levenberg::{Change, Model};
use crate::parameters::COUNT;
use faer::linalg::matmul::{matmul, triangular};
use faer::prelude::{MatMut, ReborrowMut};
use faer::{Accum, Mat, Par};
use rayon::prelude::*;
use triangular::BlockStructure::{Rectangular, TriangularLower};

/// Samples whose part of Z is held in memory at one time.
const PANEL: usize = 512;

/// The samples to fit, column by column.
#[derive(Debug, Clone)]
pub(crate) struct Data {
    /// Which inputs are free, as places in the parameter table.
    pub(crate) free: Vec<usize>,
    /// Scaled free inputs, each a column over the samples.
    pub(crate) inputs: Vec<Vec<f64>>,
    /// Targets, one per sample.
    pub(crate) targets: Vec<[f64; 4]>,
}

/// The products of one linearisation and the memory for its steps.
pub(crate) struct Normal {
    data: Data,
    h: usize,
    /// Free inputs and the constant.
    p: usize,
    /// Panel of [H 1 E], PANEL x (h + 5).
    b: Mat<f64>,
    /// Panel of Z, PANEL x p h.
    z: Mat<f64>,
    /// Blocks (i, q), i >= q, of Z'Z, each h x h.
    zz: Vec<Mat<f64>>,
    /// [H 1 E]'Z, (h + 5) x p h.
    bz: Mat<f64>,
    /// [H 1 E]'[H 1 E], lower triangle.
    bb: Mat<f64>,
    /// V'V, h x h.
    g: Mat<f64>,
    /// Output weights of the linearised network, 4 rows of h.
    v: Vec<f64>,
    /// Factor of A, U, and S or its factor.
    a: Mat<f64>,
    u: Mat<f64>,
    s: Mat<f64>,
}

/// Place of block (i, q), i >= q, in a packed lower triangle.
fn packed(i: usize, q: usize) -> usize {
    i * (i + 1) / 2 + q
}

impl Normal {
    /// Memory for networks of `h` neurons on these samples.
    pub(crate) fn new(data: Data, h: usize) -> Self {
        let p = data.free.len() + 1;
        let rows = PANEL.min(data.targets.len());
        Self {
            h,
            p,
            b: Mat::zeros(rows, h + 5),
            z: Mat::zeros(rows, p * h),
            zz: (0..packed(p, 0)).map(|_| Mat::zeros(h, h)).collect(),
            bz: Mat::zeros(h + 5, p * h),
            bb: Mat::zeros(h + 5, h + 5),
            g: Mat::zeros(h, h),
            v: vec![0.0; 4 * h],
            a: Mat::zeros(h + 1, h + 1),
            u: Mat::zeros(h + 1, p * h),
            s: Mat::zeros(p * h, p * h),
            data,
        }
    }

    /// Weights of neuron `j` on the free inputs, its bias last.
    fn row(&self, net: &Network, j: usize) -> Vec<f64> {
        let weight = |&i: &usize| net.hidden_weights[j * COUNT + i];
        self.data.free.iter().map(weight).chain([net.hidden_biases[j]]).collect()
    }

    /// Fills the panels with the samples from `start` on.
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
                    *e = v.mul_add(*a, *e);
                }
            }
            b.col_as_slice_mut(h + 1 + k)[..rows].copy_from_slice(&e);
        }
        let inputs = &self.data.inputs;
        self.z.par_col_chunks_mut(h).enumerate().for_each(|(q, mut block)| {
            let x = inputs.get(q).map(|x| &x[start..start + rows]);
            for j in 0..h {
                let column = block.rb_mut().col_mut(j).subrows_mut(0, rows);
                let Some(column) = column.try_as_col_major_mut() else {
                    continue;
                };
                let slopes = b.col_as_slice(j).iter().map(|a| (-a).mul_add(*a, 1.0));
                let column = column.as_slice_mut().iter_mut().zip(slopes);
                match x {
                    Some(x) => column.zip(x).for_each(|((z, slope), x)| *z = slope * x),
                    None => column.for_each(|(z, slope)| *z = slope),
                }
            }
        });
        self.b = b;
    }

    /// Adds the panel's share of every product.
    fn add(&mut self, rows: usize, first: bool) {
        let (h, p) = (self.h, self.p);
        let beta = if first { Accum::Replace } else { Accum::Add };
        let b = self.b.as_ref().subrows(0, rows);
        let z = self.z.as_ref().subrows(0, rows);
        let block = |q: usize| z.subcols(q * h, h);
        let (zz, bz, bb) = (&mut self.zz, &mut self.bz, &mut self.bb);
        let pairs: Vec<(usize, usize)> = (0..p).flat_map(|i| (0..=i).map(move |q| (i, q))).collect();
        let half = |dst: MatMut<'_, f64>, l: faer::MatRef<'_, f64>, r: faer::MatRef<'_, f64>| {
            let l = l.transpose();
            triangular::matmul(dst, TriangularLower, beta, l, Rectangular, r, Rectangular, 1.0, Par::Seq);
        };
        rayon::join(
            || {
                zz.par_iter_mut().zip(&pairs).with_max_len(1).for_each(|(dst, &(i, q))| {
                    half(dst.as_mut(), block(i), block(q));
                });
            },
            || {
                bz.par_col_chunks_mut(h).enumerate().for_each(|(q, dst)| {
                    matmul(dst, beta, b.transpose(), block(q), 1.0, Par::Seq);
                });
                half(bb.as_mut(), b, b);
            },
        );
    }

    /// Factors A and S for a damping.
    fn factor(&mut self, damping: f64) -> Result<(), NotPositive> {
        let (h, outputs) = (self.h, self.h + 1);
        self.a.copy_from(self.bb.get(..outputs, ..outputs));
        for i in 0..outputs {
            self.a[(i, i)] += damping;
        }
        factorise(self.a.as_mut())?;
        self.u.copy_from(self.bz.get(..outputs, ..));
        solve_lower(self.a.as_ref(), self.u.as_mut());
        let (u, g, zz) = (self.u.as_ref(), self.g.as_ref(), &self.zz);
        self.s.par_col_chunks_mut(h).enumerate().for_each(|(q, column)| {
            let right = u.subcols(q * h, h);
            column.par_row_chunks_mut(h).enumerate().skip(q).for_each(|(i, mut tile)| {
                let left = u.subcols(i * h, h).transpose();
                matmul(tile.rb_mut(), Accum::Replace, left, right, -1.0, Par::Seq);
                let zz = zz[packed(i, q)].as_ref();
                for c in 0..h {
                    for r in 0..h {
                        let (r1, c1) = if r >= c { (r, c) } else { (c, r) };
                        tile[(r, c)] = g[(r, c)] * (tile[(r, c)] + zz[(r1, c1)]);
                    }
                    if i == q {
                        tile[(c, c)] += damping;
                    }
                }
            });
        });
        factorise(self.s.as_mut())
    }

    /// Residual products: H'e_k as (h + 1) x 4.
    fn output_gradient(&self) -> Mat<f64> {
        Mat::from_fn(self.h + 1, 4, |j, k| self.bb[(self.h + 1 + k, j)])
    }

    /// Gradient with respect to the hidden weights, (q, j) order.
    fn hidden_gradient(&self) -> Vec<f64> {
        let h = self.h;
        (0..self.p * h).map(|c| (0..4).map(|k| self.v[k * h + c % h] * self.bz[(h + 1 + k, c)]).sum()).collect()
    }
}

impl Model for Normal {
    fn linearise(&mut self, net: &Network) -> f64 {
        let h = self.h;
        self.v.copy_from_slice(&net.output_weights);
        let v = &self.v;
        for c in 0..h {
            for r in 0..h {
                self.g[(r, c)] = (0..4).map(|k| v[k * h + r] * v[k * h + c]).sum();
            }
        }
        let count = self.data.targets.len();
        for start in (0..count).step_by(PANEL) {
            let rows = PANEL.min(count - start);
            self.fill(net, start, rows);
            self.add(rows, start == 0);
        }
        let output = self.output_gradient();
        let outputs: f64 = (0..4).flat_map(|k| output.col_as_slice(k)).map(|g| g * g).sum();
        let hidden: f64 = self.hidden_gradient().iter().map(|g| g * g).sum();
        (outputs + hidden).sqrt()
    }

    fn step(&mut self, damping: f64) -> Option<Change> {
        let (h, n) = (self.h, self.p * self.h);
        self.factor(damping).ok()?;
        let gradient = self.output_gradient();
        let mut c = gradient.clone();
        solve_lower(self.a.as_ref(), c.as_mut());
        let mut uc = Mat::<f64>::zeros(n, 4);
        matmul(uc.as_mut(), Accum::Replace, self.u.transpose(), c.as_ref(), 1.0, Par::Seq);
        let hidden_gradient = self.hidden_gradient();
        let v = |i: usize, k: usize| self.v[k * h + i % h];
        let mut hidden =
            Mat::from_fn(n, 1, |i, _| (0..4).map(|k| v(i, k) * uc[(i, k)]).sum::<f64>() - hidden_gradient[i]);
        solve_lower(self.s.as_ref(), hidden.as_mut());
        solve_upper(self.s.as_ref(), hidden.as_mut());

        let weighted = Mat::from_fn(n, 4, |i, k| v(i, k) * hidden[(i, 0)]);
        let mut output = gradient.clone();
        let hz = self.bz.as_ref().subrows(0, h + 1);
        matmul(output.as_mut(), Accum::Add, hz, weighted.as_ref(), 1.0, Par::Seq);
        solve_lower(self.a.as_ref(), output.as_mut());
        solve_upper(self.a.as_ref(), output.as_mut());

        let fall = |d: f64, g: f64| 0.5 * d * damping.mul_add(d, -g);
        let mut predicted: f64 = (0..n).map(|i| fall(hidden[(i, 0)], hidden_gradient[i])).sum();
        let mut change = Change {
            hidden_weights: vec![0.0; h * COUNT],
            hidden_biases: hidden.col_as_slice(0)[(self.p - 1) * h..].to_vec(),
            output_weights: vec![0.0; 4 * h],
            output_biases: std::array::from_fn(|k| -output[(h, k)]),
            predicted: 0.0,
        };
        for k in 0..4 {
            predicted += (0..=h).map(|j| fall(-output[(j, k)], gradient[(j, k)])).sum::<f64>();
            for j in 0..h {
                change.output_weights[k * h + j] = -output[(j, k)];
            }
        }
        for (q, &i) in self.data.free.iter().enumerate() {
            for j in 0..h {
                change.hidden_weights[j * COUNT + i] = hidden[(q * h + j, 0)];
            }
        }
        change.predicted = predicted;
        Some(change)
    }
}
