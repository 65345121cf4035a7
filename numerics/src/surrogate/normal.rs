//! The normal equations of one hidden layer, by their structure.
//!
//! With V the output weights, V_k its rows, e_k the residuals of output k,
//! D_k = diag(V_kj over all (q, j)), G = V'V (h x h), and H, Z as in
//! [`super::products`]:
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
use super::levenberg::{Change, Model};
use super::products::{Data, Products, packed};
use crate::parameters::COUNT;
use faer::linalg::matmul::matmul;
use faer::prelude::ReborrowMut;
use faer::{Accum, Mat, MatRef, Par};
use rayon::prelude::*;

/// The products of one linearisation and the memory for its steps.
pub(crate) struct Normal {
    pub(crate) products: Products,
    /// V'V, h x h.
    g: Mat<f64>,
    /// Factor of A.
    a: Mat<f64>,
    /// U, (h + 1) x p h.
    u: Mat<f64>,
    /// S, then its factor, in the upper triangle: the transpose of a lower one with contiguous rows.
    s: Mat<f64>,
}

impl Normal {
    /// Memory for networks of `h` neurons on these samples.
    pub(crate) fn new(data: Data, h: usize) -> Self {
        let products = Products::new(data, h);
        let n = products.p * h;
        Self {
            products,
            g: Mat::zeros(h, h),
            a: Mat::zeros(h + 1, h + 1),
            u: Mat::zeros(h + 1, n),
            s: Mat::zeros(n, n),
        }
    }

    /// Every product at a network, and G.
    pub(crate) fn prepare(&mut self, net: &Network) {
        let h = self.products.h;
        self.products.linearise(net);
        let v = &self.products.v;
        for c in 0..h {
            for (r, g) in self.g.col_as_slice_mut(c).iter_mut().enumerate() {
                *g = (0..4).map(|k| v[k * h + r] * v[k * h + c]).sum();
            }
        }
    }

    /// Factors A = H'H + `damping` I.
    pub(crate) fn factor_outputs(&mut self, damping: f64) -> Result<(), NotPositive> {
        let outputs = self.products.h + 1;
        self.a.copy_from(self.products.bb.get(..outputs, ..outputs));
        for i in 0..outputs {
            self.a[(i, i)] += damping;
        }
        factorise(self.a.as_mut())
    }

    /// S without its damping, G o (Z'Z - U'U), from the factored A.
    pub(crate) fn eliminate(&mut self) {
        let (h, outputs, n) = (self.products.h, self.products.h + 1, self.products.p * self.products.h);
        self.u.copy_from(MatRef::from_row_major_slice(&self.products.bz[..outputs * n], outputs, n));
        solve_lower(self.a.as_ref(), self.u.as_mut());
        let (u, g, zz) = (self.u.as_ref(), &self.g, &self.products.zz);
        let size = packed(self.products.p, 0) * h;
        self.s.par_col_chunks_mut(h).enumerate().for_each(|(i, column)| {
            let right = u.subcols(i * h, h);
            column.par_row_chunks_mut(h).enumerate().take(i + 1).for_each(|(q, mut tile)| {
                let left = u.subcols(q * h, h).transpose();
                matmul(tile.rb_mut(), Accum::Replace, left, right, -1.0, Par::Seq);
                let pair = packed(i, q) * h;
                for j in 0..h {
                    let Some(tile) = tile.rb_mut().col_mut(j).try_as_col_major_mut() else { continue };
                    let (tile, g) = (tile.as_slice_mut(), g.col_as_slice(j));
                    let (upper, lower) = tile.split_at_mut(j + 1);
                    let own = &zz[j * size + pair..];
                    for ((s, z), g) in upper.iter_mut().zip(own).zip(g) {
                        *s = g * (*s + z);
                    }
                    for (l, s) in lower.iter_mut().enumerate().map(|(l, s)| (j + 1 + l, s)) {
                        *s = g[l] * (*s + zz[l * size + pair + j]);
                    }
                }
            });
        });
    }

    /// Keeps S where Z'Z was: both triangles of its diagonal blocks and every other block fit exactly.
    pub(crate) fn keep(&mut self) {
        let (h, p) = (self.products.h, self.products.p);
        let s = &self.s;
        self.products.zz.par_chunks_mut(packed(p, 0) * h).enumerate().for_each(|(j, kept)| {
            for (i, q) in (0..p).flat_map(|i| (0..=i).map(move |q| (i, q))) {
                let row = &s.col_as_slice(i * h + j)[q * h..(q + 1) * h];
                kept[packed(i, q) * h..][..h].copy_from_slice(row);
            }
        });
    }

    /// S as it was kept.
    pub(crate) fn restore(&mut self) {
        let h = self.products.h;
        let (zz, size) = (&self.products.zz, packed(self.products.p, 0) * h);
        self.s.par_col_chunks_mut(h).enumerate().for_each(|(i, mut column)| {
            for j in 0..h {
                let Some(s) = column.rb_mut().col_mut(j).try_as_col_major_mut() else { continue };
                for (q, s) in s.as_slice_mut().chunks_exact_mut(h).take(i + 1).enumerate() {
                    s.copy_from_slice(&zz[j * size + packed(i, q) * h..][..h]);
                }
            }
        });
    }

    /// Damps S and factors it.
    pub(crate) fn factor_hidden(&mut self, damping: f64) -> Result<(), NotPositive> {
        for i in 0..self.s.ncols() {
            self.s[(i, i)] += damping;
        }
        factorise(self.s.as_mut().transpose_mut())
    }

    /// Solves with the factored S in place.
    pub(crate) fn solve_hidden(&self, x: &mut Mat<f64>) {
        let factor = self.s.transpose();
        solve_lower(factor, x.as_mut());
        solve_upper(factor, x.as_mut());
    }

    /// Solves with the factored A in place.
    pub(crate) fn solve_outputs(&self, x: &mut Mat<f64>) {
        solve_lower(self.a.as_ref(), x.as_mut());
        solve_upper(self.a.as_ref(), x.as_mut());
    }

    /// The change whose hidden part, in (q, j) order, is `hidden`; output weights stay.
    pub(crate) fn hidden_change(&self, hidden: &[f64]) -> Change {
        let Products { h, p, .. } = self.products;
        let mut change = Change {
            hidden_weights: vec![0.0; h * COUNT],
            hidden_biases: hidden[(p - 1) * h..].to_vec(),
            output_weights: vec![0.0; 4 * h],
            output_biases: [0.0; 4],
            predicted: 0.0,
        };
        for (q, &i) in self.products.data().free.iter().enumerate() {
            for j in 0..h {
                change.hidden_weights[j * COUNT + i] = hidden[q * h + j];
            }
        }
        change
    }

    /// U' L^-1 x, p h x 4.
    fn projected(&self, x: &Mat<f64>) -> Mat<f64> {
        let mut c = x.clone();
        solve_lower(self.a.as_ref(), c.as_mut());
        let mut uc = Mat::<f64>::zeros(self.u.ncols(), 4);
        matmul(uc.as_mut(), Accum::Replace, self.u.transpose(), c.as_ref(), 1.0, Par::Seq);
        uc
    }
}

/// Fall of half the sum of squares which a step d promises per entry, with gradient g:
/// d (mu d - g) / 2.
pub(crate) fn promise(damping: f64, d: f64, g: f64) -> f64 {
    0.5 * d * damping.mul_add(d, -g)
}

impl Model for Normal {
    fn objective(&mut self, net: &mut Network) -> Option<f64> {
        Some(self.products.data().squares(net))
    }

    fn linearise(&mut self, net: &Network) -> f64 {
        self.prepare(net);
        let output = self.products.output_gradient();
        let outputs: f64 = (0..4).flat_map(|k| output.col_as_slice(k)).map(|g| g * g).sum();
        let hidden: f64 = self.products.hidden_gradient().iter().map(|g| g * g).sum();
        (outputs + hidden).sqrt()
    }

    fn step(&mut self, damping: f64) -> Option<Change> {
        let Products { h, p, .. } = self.products;
        let n = p * h;
        self.factor_outputs(damping).ok()?;
        self.eliminate();
        self.factor_hidden(damping).ok()?;
        let gradient = self.products.output_gradient();
        let uc = self.projected(&gradient);
        let hidden_gradient = self.products.hidden_gradient();
        let v = |i: usize, k: usize| self.products.v[k * h + i % h];
        let mut hidden =
            Mat::from_fn(n, 1, |i, _| (0..4).map(|k| v(i, k) * uc[(i, k)]).sum::<f64>() - hidden_gradient[i]);
        self.solve_hidden(&mut hidden);

        let weighted = Mat::from_fn(n, 4, |i, k| v(i, k) * hidden[(i, 0)]);
        let mut output = gradient.clone();
        let hz = MatRef::from_row_major_slice(&self.products.bz[..(h + 1) * n], h + 1, n);
        matmul(output.as_mut(), Accum::Add, hz, weighted.as_ref(), 1.0, Par::Seq);
        self.solve_outputs(&mut output);

        let mut change = self.hidden_change(hidden.col_as_slice(0));
        change.predicted = (0..n).map(|i| promise(damping, hidden[(i, 0)], hidden_gradient[i])).sum();
        change.output_biases = std::array::from_fn(|k| -output[(h, k)]);
        for k in 0..4 {
            change.predicted += (0..=h).map(|j| promise(damping, -output[(j, k)], gradient[(j, k)])).sum::<f64>();
            for j in 0..h {
                change.output_weights[k * h + j] = -output[(j, k)];
            }
        }
        Some(change)
    }
}
