//! Cholesky factorisation whose bits do not depend on the number of threads.
//!
//! Left-looking by panels of [`WIDTH`] columns. Each tile is updated by one
//! sequential product over all columns to its left, so its sum has one order;
//! rayon only decides which thread forms it. Products run along rows: a matrix
//! whose rows are contiguous is factored half as fast again as one whose columns are.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor;
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve as triangular;
use faer::prelude::{MatMut, MatRef, Reborrow, ReborrowMut};
use faer::{Accum, Par, Spec};
use rayon::prelude::*;

/// Columns of a panel.
const WIDTH: usize = 128;
/// Rows of a tile.
const TILE: usize = 512;

/// The matrix is not positive definite to working precision.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NotPositive;

/// Replaces the lower triangle of `a` by its factor L, `a = L L'`.
///
/// The strict upper triangle is not read; parts of it are overwritten.
pub(crate) fn factorise(a: MatMut<'_, f64>) -> Result<(), NotPositive> {
    let n = a.nrows();
    let params = Spec::default();
    let need = factor::cholesky_in_place_scratch::<f64>(WIDTH, Par::Seq, params);
    let mut memory = MemBuffer::new(need);
    let mut a = a;
    for k in (0..n).step_by(WIDTH) {
        let width = WIDTH.min(n - k);
        let (left, right) = a.rb_mut().split_at_col_mut(k);
        let left = left.rb().subrows(k, n - k);
        let mut panel = right.subcols_mut(0, width).subrows_mut(k, n - k);
        let across = left.subrows(0, width);
        panel.rb_mut().par_row_chunks_mut(TILE).enumerate().for_each(|(r, tile)| {
            let below = left.subrows(r * TILE, tile.nrows());
            matmul(tile, Accum::Add, below, across.transpose(), -1.0, Par::Seq);
        });
        let (mut top, bottom) = panel.split_at_row_mut(width);
        let stack = MemStack::new(&mut memory);
        let regular = Default::default();
        factor::cholesky_in_place(top.rb_mut(), regular, Par::Seq, stack, params).map_err(|_| NotPositive)?;
        let top = top.rb();
        bottom.par_row_chunks_mut(TILE).for_each(|tile| {
            triangular::solve_lower_triangular_in_place(top, tile.transpose_mut(), Par::Seq);
        });
    }
    Ok(())
}

/// Solves `L X = B` in place, parallel over groups of columns of B.
pub(crate) fn solve_lower(l: MatRef<'_, f64>, b: MatMut<'_, f64>) {
    b.par_col_chunks_mut(TILE).for_each(|b| {
        triangular::solve_lower_triangular_in_place(l, b, Par::Seq);
    });
}

/// Solves `L' X = B` in place.
pub(crate) fn solve_upper(l: MatRef<'_, f64>, b: MatMut<'_, f64>) {
    triangular::solve_upper_triangular_in_place(l.transpose(), b, Par::Seq);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surrogate::random::{Streams, uniform};
    use faer::Mat;

    fn positive(n: usize) -> Mat<f64> {
        let mut rng = Streams::new(2).stream(9);
        let b = Mat::from_fn(n, n, |_, _| uniform(&mut rng) - 0.5);
        let mut a = &b * b.transpose();
        for i in 0..n {
            a[(i, i)] += 0.1;
        }
        a
    }

    #[test]
    fn factors_and_solves_with_the_same_bits_on_any_threads() {
        let n = 2 * TILE + 37;
        let a = positive(n);
        let factors: Vec<Mat<f64>> = [1, 4]
            .map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let mut l = a.clone();
                pool.install(|| factorise(l.as_mut())).unwrap();
                l
            })
            .into();
        let mut worst: f64 = 0.0;
        for j in 0..n {
            for i in j..n {
                assert_eq!(factors[0][(i, j)].to_bits(), factors[1][(i, j)].to_bits());
            }
        }
        let mut x = Mat::from_fn(n, 2, |i, j| (i + j) as f64 / n as f64);
        let b = x.clone();
        solve_lower(factors[0].as_ref(), x.as_mut());
        solve_upper(factors[0].as_ref(), x.as_mut());
        let residual = &a * &x - &b;
        for j in 0..2 {
            for i in 0..n {
                worst = worst.max(residual[(i, j)].abs());
            }
        }
        assert!(worst < 1e-9, "{worst:e}");
    }

    #[test]
    fn an_indefinite_matrix_or_nan_is_refused() {
        let mut a = positive(300);
        a[(280, 280)] = -1.0;
        assert_eq!(factorise(a.as_mut()), Err(NotPositive));
        a[(0, 0)] = f64::NAN;
        assert_eq!(factorise(a.as_mut()), Err(NotPositive));
    }
}
