//! Bound rings and free wake as one sheet, so that the edges they share are one segment.

use std::f64::consts::PI;

use crate::uvlm::kernel::Sheet;

/// Nodes, ring circulations and segments of the wing (first) and its wake.
///
/// Rows 0 to `bound_rows - 1` are ring corners of the wing, the last of them the
/// line from which the wake springs; further rows are older and older wake.
#[derive(Debug, Clone)]
pub struct Vorticity {
    columns: usize,
    bound_rows: usize,
    most_rows: usize,
    rows: usize,
    nodes: [Vec<f64>; 3],
    /// Ring circulations, row by row, bound rings first, m²/s.
    circulation: Vec<f64>,
    spanwise: Vec<f64>,
    chordwise: Vec<f64>,
    /// Squared lengths of the segments, m².
    spanwise_length2: Vec<f64>,
    chordwise_length2: Vec<f64>,
    spanwise_core: Vec<f64>,
    chordwise_core: Vec<f64>,
}

/// A grid of vortex rings, wing first, then wake from young to old; one wing's, the
/// other's is its mirror image in y = 0.
#[derive(Debug, Clone, Copy)]
pub struct Rings<'a> {
    /// Nodes in a row.
    pub columns: usize,
    /// Rows of nodes on the wing; the last is the line from which the wake springs.
    pub bound_rows: usize,
    /// Coordinates of the nodes row by row, stroke-plane axes (forward, outboard, up), m.
    pub nodes: [&'a [f64]; 3],
    /// Circulations row by row, `(rows - 1) x (columns - 1)`, m²/s.
    pub circulation: &'a [f64],
}

/// Strength / 4π of a segment. One without length (all chordwise edges meet in a
/// pointed tip) has no velocity, but its rounding errors would have one.
pub(super) fn strength(circulation: f64, length2: f64) -> f64 {
    if length2 > 0.0 { circulation / (4.0 * PI) } else { 0.0 }
}

impl Vorticity {
    /// A wing of `bound_rows` rows of nodes with room for `wake_rows` rings of wake.
    pub fn new(columns: usize, bound_rows: usize, wake_rows: usize) -> Self {
        let most_rows = bound_rows + wake_rows;
        let across = || vec![0.0; most_rows * (columns - 1)];
        let along = || vec![0.0; most_rows * columns];
        Self {
            columns,
            bound_rows,
            most_rows,
            rows: bound_rows,
            nodes: [along(), along(), along()],
            circulation: across(),
            spanwise: across(),
            chordwise: along(),
            spanwise_length2: across(),
            chordwise_length2: along(),
            spanwise_core: across(),
            chordwise_core: along(),
        }
    }

    /// Rings in a row.
    fn strips(&self) -> usize {
        self.columns - 1
    }

    /// Rows of wake rings.
    pub fn wake_rows(&self) -> usize {
        self.rows - self.bound_rows
    }

    /// First node of the line from which the wake springs.
    pub fn first_wake_node(&self) -> usize {
        (self.bound_rows - 1) * self.columns
    }

    /// Nodes that will still be wake after the next shedding.
    pub fn convected(&self) -> std::ops::Range<usize> {
        let kept = self.rows.min(self.most_rows - 1);
        self.first_wake_node()..kept * self.columns
    }

    /// A node.
    pub fn node(&self, i: usize) -> [f64; 3] {
        [self.nodes[0][i], self.nodes[1][i], self.nodes[2][i]]
    }

    /// Nodes and circulations.
    pub fn rings(&self) -> Rings<'_> {
        let [x, y, z] = [0, 1, 2].map(|i| &self.nodes[i][..self.rows * self.columns]);
        Rings {
            columns: self.columns,
            bound_rows: self.bound_rows,
            nodes: [x, y, z],
            circulation: &self.circulation[..(self.rows - 1) * self.strips()],
        }
    }

    /// Moves a node.
    pub fn set_node(&mut self, i: usize, p: [f64; 3]) {
        for (component, value) in self.nodes.iter_mut().zip(p) {
            component[i] = value;
        }
    }

    /// Sets the circulations of the bound rings.
    pub fn set_bound(&mut self, circulation: &[f64]) {
        self.circulation[..circulation.len()].copy_from_slice(circulation);
    }

    /// Sheds the last bound ring's circulation: the line at the edge becomes wake,
    /// every wake ring grows one step older, the oldest is forgotten.
    pub fn shed(&mut self) {
        let (columns, strips) = (self.columns, self.strips());
        self.rows = (self.rows + 1).min(self.most_rows);
        let (first, end) = (self.first_wake_node(), self.rows * columns);
        for component in &mut self.nodes {
            component.copy_within(first..end - columns, first + columns);
        }
        // The ring row before the wake is the wing's last: shifting from there sheds it.
        let (edge, end) = ((self.bound_rows - 2) * strips, (self.rows - 1) * strips);
        self.circulation.copy_within(edge..end - strips, edge + strips);
    }

    /// Recomputes strengths and lengths of all segments after nodes or circulations changed.
    pub fn assemble(&mut self) {
        let (columns, strips) = (self.columns, self.strips());
        for j in 0..self.rows {
            for k in 0..strips {
                let ahead = if j > 0 { self.circulation[(j - 1) * strips + k] } else { 0.0 };
                let behind = if j + 1 < self.rows { self.circulation[j * strips + k] } else { 0.0 };
                let length2 = self.length2(j * columns + k, j * columns + k + 1);
                self.spanwise[j * strips + k] = strength(ahead - behind, length2);
                self.spanwise_length2[j * strips + k] = length2;
            }
        }
        for j in 0..self.rows - 1 {
            for k in 0..columns {
                let inboard = if k > 0 { self.circulation[j * strips + k - 1] } else { 0.0 };
                let outboard = if k < strips { self.circulation[j * strips + k] } else { 0.0 };
                let length2 = self.length2(j * columns + k, (j + 1) * columns + k);
                self.chordwise[j * columns + k] = strength(outboard - inboard, length2);
                self.chordwise_length2[j * columns + k] = length2;
            }
        }
    }

    fn length2(&self, a: usize, b: usize) -> f64 {
        self.nodes.iter().map(|c| (c[a] - c[b]) * (c[a] - c[b])).sum()
    }

    /// Sets the cores: `spanwise(age)` and `chordwise(age)` give the core radius
    /// of a row's segments, m; age counts steps behind the edge, negative on the wing.
    pub fn set_cores(&mut self, spanwise: impl Fn(f64) -> f64, chordwise: impl Fn(f64) -> f64) {
        let edge = self.bound_rows as f64 - 1.0;
        for (row, (core, length2)) in self
            .spanwise_core
            .chunks_mut(self.columns - 1)
            .zip(self.spanwise_length2.chunks(self.columns - 1))
            .enumerate()
        {
            let radius = spanwise(row as f64 - edge);
            core.iter_mut().zip(length2).for_each(|(c, l)| *c = l * radius * radius);
        }
        for (row, (core, length2)) in
            self.chordwise_core.chunks_mut(self.columns).zip(self.chordwise_length2.chunks(self.columns)).enumerate()
        {
            let radius = chordwise(row as f64 + 0.5 - edge);
            core.iter_mut().zip(length2).for_each(|(c, l)| *c = l * radius * radius);
        }
    }

    fn sheet(&self, from: usize, to: usize) -> Sheet<'_> {
        let (columns, strips) = (self.columns, self.strips());
        let (nodes, across, along) =
            (from * columns..to * columns, from * strips..to * strips, from * columns..(to - 1) * columns);
        Sheet {
            columns,
            nodes: [&self.nodes[0][nodes.clone()], &self.nodes[1][nodes.clone()], &self.nodes[2][nodes]],
            spanwise: &self.spanwise[across.clone()],
            chordwise: &self.chordwise[along.clone()],
            spanwise_core: &self.spanwise_core[across],
            chordwise_core: &self.chordwise_core[along],
        }
    }

    /// Wing and wake.
    pub fn all(&self) -> Sheet<'_> {
        self.sheet(0, self.rows)
    }

    /// The wake from the edge on. With the bound circulations at zero the line at
    /// the edge carries the newest ring alone.
    pub fn wake(&self) -> Option<Sheet<'_>> {
        (self.wake_rows() > 0).then(|| self.sheet(self.bound_rows - 1, self.rows))
    }

    /// The wing alone; complete only while there is no wake or the wake's share of
    /// the edge line is wanted too.
    pub fn wing(&self) -> Sheet<'_> {
        self.sheet(0, self.bound_rows)
    }
}
