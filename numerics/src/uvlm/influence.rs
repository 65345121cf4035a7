//! What each ring of unit circulation does to each collocation point.

use nalgebra::DMatrix;

use crate::uvlm::kernel::{Points, Sheet, induce};
use crate::uvlm::wake::strength;

/// Scratch of one ring, kept between steps.
#[derive(Debug, Clone, Default)]
pub struct RingInfluence {
    velocity: Points,
}

impl RingInfluence {
    /// Adds to `matrix[(i, j)]` the velocity that ring j of a wing lattice (unit
    /// circulation) induces at target i, along `direction(i)`.
    ///
    /// `nodes` are the ring corners by component, `columns` to a row.
    pub fn add(
        &mut self,
        matrix: &mut DMatrix<f64>,
        nodes: [&[f64]; 3],
        columns: usize,
        core: f64,
        targets: &Points,
        direction: impl Fn(usize) -> [f64; 3],
    ) {
        self.velocity.resize(targets.len());
        for ring in 0..matrix.ncols() {
            let first = ring / (columns - 1) * columns + ring % (columns - 1);
            let corners = [first, first + 1, first + columns, first + columns + 1];
            let of = |c: &[f64]| corners.map(|i| c[i]);
            let (x, y, z) = (of(nodes[0]), of(nodes[1]), of(nodes[2]));
            let length2 = |a: usize, b: usize| (x[a] - x[b]).powi(2) + (y[a] - y[b]).powi(2) + (z[a] - z[b]).powi(2);
            let (front, rear, inboard, outboard) = (length2(0, 1), length2(2, 3), length2(0, 2), length2(1, 3));
            let core2 = core * core;
            let sheet = Sheet {
                columns: 2,
                nodes: [&x, &y, &z],
                spanwise: &[strength(-1.0, front), strength(1.0, rear)],
                chordwise: &[strength(1.0, inboard), strength(-1.0, outboard)],
                spanwise_core: &[front * core2, rear * core2],
                chordwise_core: &[inboard * core2, outboard * core2],
            };
            self.velocity.clear();
            induce(&sheet, targets, &mut self.velocity);
            for i in 0..targets.len() {
                let (v, d) = (self.velocity.get(i), direction(i));
                matrix[(i, ring)] += v[0] * d[0] + v[1] * d[1] + v[2] * d[2];
            }
        }
    }
}
