//! Sums over samples of products of three columns, the bulk of a linearisation.
//!
//! With slopes s_nl (samples n, neurons l), a column w and monomials m_c of the
//! inputs (x_i x_q, or x_q), every sum needed is one of
//!
//! ```text
//! C[c, l] = sum_n w_n m_nc s_nl
//! ```
//!
//! For w a column of the slopes and m the pairs x_i x_q this is a column of all
//! blocks of Z'Z at once, and only neurons up to the column's own are needed; for
//! w an activation and m the inputs it is a row of H'Z. Z itself is never formed.
//!
//! A lane is a neuron and sums run over the samples in their order, one fused
//! multiply-add each, so neither threads nor the width of registers change a bit.

use super::kernel::dispatch;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

/// Neurons in a tile of slopes: four of the widest registers.
const TILE: usize = 32;
/// Monomials summed together: with four registers of neurons they fill 24 of 32 registers,
/// with two of them 12 of 16.
const GROUP: usize = 6;
/// Samples between two looks at the sums: their slopes fit the second cache.
const SPAN: usize = 256;
/// Columns which share one pass over the slopes.
const COLUMNS: usize = 4;

/// Slopes of some samples, neuron tile by neuron tile.
pub(crate) struct Slopes {
    rows: usize,
    /// For each tile, sample by sample, [`TILE`] slopes.
    tiles: Vec<f64>,
}

impl Slopes {
    /// Slopes of `h` columns over `rows` samples, `column(j, out)` filling one column.
    pub(crate) fn fill(&mut self, h: usize, rows: usize, column: impl Fn(usize, &mut [f64]) + Sync) {
        self.rows = rows;
        self.tiles.clear();
        self.tiles.resize(h.div_ceil(TILE) * rows * TILE, 0.0);
        self.tiles.par_chunks_mut(rows * TILE).enumerate().for_each(|(b, tile)| {
            let mut one = vec![0.0; rows];
            for l in 0..TILE.min(h - b * TILE) {
                column(b * TILE + l, &mut one);
                for (row, s) in tile.chunks_exact_mut(TILE).zip(&one) {
                    row[l] = *s;
                }
            }
        });
    }

    /// No slopes yet.
    pub(crate) fn new() -> Self {
        Self { rows: 0, tiles: Vec::new() }
    }

    /// Slopes of neuron `j` from sample `start` on, into `out`.
    fn column(&self, j: usize, start: usize, out: &mut [f64]) {
        let tile = &self.tiles[(j / TILE) * self.rows * TILE..];
        for (out, row) in out.iter_mut().zip(tile.chunks_exact(TILE).skip(start)) {
            *out = row[j % TILE];
        }
    }
}

/// Monomials of the inputs of some samples, in groups of [`GROUP`].
pub(crate) struct Monomials {
    count: usize,
    rows: usize,
    /// For each group, sample by sample, [`GROUP`] values; zeros fill the last group.
    groups: Vec<f64>,
}

impl Monomials {
    /// `count` monomials over `rows` samples.
    pub(crate) fn new(count: usize, rows: usize, value: impl Fn(usize, usize) -> f64) -> Self {
        let mut groups = vec![0.0; count.div_ceil(GROUP) * rows * GROUP];
        for c in 0..count {
            let group = &mut groups[(c / GROUP) * rows * GROUP..];
            for (n, row) in group.chunks_exact_mut(GROUP).take(rows).enumerate() {
                row[c % GROUP] = value(c, n);
            }
        }
        Self { count, rows, groups }
    }
}

/// Adds the sums of column `j` for each chunk `out[j]`, which holds `count` rows of `h` neurons.
///
/// Neurons from `needed(j)` on are left alone; `weight(j, start, w)` gives the
/// column's weights from sample `start` on.
pub(crate) fn add_sums(
    slopes: &Slopes,
    monomials: &Monomials,
    h: usize,
    out: &mut [f64],
    needed: impl Fn(usize) -> usize + Sync,
    weight: impl Fn(usize, usize, &mut [f64]) + Sync,
) {
    let tiles = h.div_ceil(TILE);
    let size = monomials.count * h;
    let sums = monomials.count.div_ceil(GROUP) * tiles * GROUP * TILE;
    // The last columns of a triangle are the longest: they begin first.
    out.par_chunks_mut(COLUMNS * size).enumerate().rev().for_each_init(
        || (vec![0.0; COLUMNS * sums], vec![0.0; SPAN], vec![0.0; SPAN * GROUP]),
        |(buffer, weights, factors), (block, out)| {
            buffer.fill(0.0);
            let columns = out.len() / size;
            for start in (0..slopes.rows).step_by(SPAN) {
                let rows = SPAN.min(slopes.rows - start);
                for c in 0..columns {
                    let j = block * COLUMNS + c;
                    weight(j, start, &mut weights[..rows]);
                    let (weights, factors) = (&weights[..rows], &mut factors[..rows * GROUP]);
                    let (sums, used) = (&mut buffer[c * sums..(c + 1) * sums], needed(j).div_ceil(TILE));
                    dispatch(Column { slopes, monomials, start, weights, factors, sums, tiles, used });
                }
            }
            for (c, out) in out.chunks_exact_mut(size).enumerate() {
                let most = needed(block * COLUMNS + c);
                for (m, row) in out.chunks_exact_mut(h).enumerate() {
                    for (t, row) in row[..most].chunks_mut(TILE).enumerate() {
                        let at = c * sums + (((m / GROUP) * tiles + t) * GROUP + m % GROUP) * TILE;
                        for (to, by) in row.iter_mut().zip(&buffer[at..]) {
                            *to += by;
                        }
                    }
                }
            }
        },
    );
}

/// Adds column `j` of every block of Z'Z; neurons after the j-th are left out by symmetry.
pub(crate) fn add_pairs(slopes: &Slopes, pairs: &Monomials, h: usize, out: &mut [f64]) {
    add_sums(slopes, pairs, h, out, |j| j + 1, |j, start, w| slopes.column(j, start, w));
}

/// One column's sums over some samples, to be run by [`dispatch`].
struct Column<'a> {
    slopes: &'a Slopes,
    monomials: &'a Monomials,
    start: usize,
    weights: &'a [f64],
    factors: &'a mut [f64],
    /// For each group and tile, [`GROUP`] rows of [`TILE`] sums.
    sums: &'a mut [f64],
    tiles: usize,
    /// Tiles which are needed.
    used: usize,
}

impl WithSimd for Column<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let rows = self.weights.len();
        let slopes = self.slopes.tiles.chunks_exact(self.slopes.rows * TILE);
        let groups = self.monomials.groups.chunks_exact(self.monomials.rows * GROUP);
        for (group, sums) in groups.zip(self.sums.chunks_exact_mut(self.tiles * GROUP * TILE)) {
            let group = &group[self.start * GROUP..];
            for ((to, m), w) in self.factors.chunks_exact_mut(GROUP).zip(group.chunks_exact(GROUP)).zip(self.weights) {
                for c in 0..GROUP {
                    to[c] = w * m[c];
                }
            }
            let tiles = slopes.clone().take(self.used).zip(sums.chunks_exact_mut(GROUP * TILE));
            for (slopes, sums) in tiles {
                let slopes = &slopes[self.start * TILE..(self.start + rows) * TILE];
                if S::REGISTER_COUNT >= 32 {
                    tile::<S, 4>(simd, slopes, self.factors, sums);
                } else {
                    tile::<S, 2>(simd, slopes, self.factors, sums);
                }
            }
        }
    }
}

/// `sums[c][l] += sum_n factors[n][c] slopes[n][l]`, REGISTERS registers of neurons at a time.
#[inline(always)]
fn tile<S: Simd, const REGISTERS: usize>(simd: S, slopes: &[f64], factors: &[f64], sums: &mut [f64]) {
    let width = REGISTERS * S::F64_LANES;
    for first in (0..TILE).step_by(width) {
        let mut total = [[simd.splat_f64s(0.0); REGISTERS]; GROUP];
        for c in 0..GROUP {
            let (row, _) = S::as_simd_f64s(&sums[c * TILE + first..c * TILE + first + width]);
            total[c].copy_from_slice(row);
        }
        let (factors, _) = factors.as_chunks::<GROUP>();
        for (slopes, factors) in slopes.chunks_exact(TILE).zip(factors) {
            let (s, _) = S::as_simd_f64s(&slopes[first..first + width]);
            for c in 0..GROUP {
                let factor = simd.splat_f64s(factors[c]);
                for r in 0..REGISTERS {
                    total[c][r] = simd.mul_add_f64s(s[r], factor, total[c][r]);
                }
            }
        }
        for c in 0..GROUP {
            let (row, _) = S::as_mut_simd_f64s(&mut sums[c * TILE + first..c * TILE + first + width]);
            row.copy_from_slice(&total[c]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surrogate::random::{Streams, uniform};

    #[test]
    fn sums_are_those_of_the_definition_on_any_threads_and_registers() {
        let (h, rows, count) = (2 * TILE + 5, SPAN + 3, GROUP + 1);
        let mut rng = Streams::new(4).stream(0);
        let mut draw = |n: usize| -> Vec<f64> { (0..n).map(|_| 2.0 * uniform(&mut rng) - 1.0).collect() };
        let (s, m) = (draw(h * rows), draw(count * rows));
        let mut slopes = Slopes::new();
        slopes.fill(h, rows, |j, out| out.copy_from_slice(&s[j * rows..(j + 1) * rows]));
        let monomials = Monomials::new(count, rows, |c, n| m[c * rows + n]);
        let runs = [1, 3].map(|threads| {
            let mut out = vec![1.0; h * count * h];
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| add_pairs(&slopes, &monomials, h, &mut out));
            out
        });
        assert_eq!(runs[0], runs[1]);
        for (j, c, l) in [(0, 0, 0), (40, 3, 17), (h - 1, count - 1, h - 1), (33, 6, 32)] {
            let exact: f64 = (0..rows).map(|n| s[j * rows + n] * m[c * rows + n] * s[l * rows + n]).sum();
            assert!((runs[0][(j * count + c) * h + l] - 1.0 - exact).abs() < 1e-12, "{j} {c} {l}");
        }
        assert_eq!(runs[0][4], 1.0, "a neuron after the column's own is left alone");
        let factors: Vec<f64> = m[..SPAN * GROUP].to_vec();
        let (mut wide, mut single) = (vec![0.0; GROUP * TILE], vec![0.0; GROUP * TILE]);
        dispatch(Tile(&slopes.tiles[..SPAN * TILE], &factors, &mut wide));
        Tile(&slopes.tiles[..SPAN * TILE], &factors, &mut single).with_simd(pulp::Scalar);
        assert_eq!(wide, single);
    }

    struct Tile<'a>(&'a [f64], &'a [f64], &'a mut [f64]);

    impl WithSimd for Tile<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            if S::REGISTER_COUNT >= 32 {
                tile::<S, 4>(simd, self.0, self.1, self.2);
            } else {
                tile::<S, 2>(simd, self.0, self.1, self.2);
            }
        }
    }
}
