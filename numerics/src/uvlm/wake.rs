//! Bound rings and free wake as one sheet, so that the edges they share are one segment.

use crate::uvlm::kernel::{Edge, Node, Sheet};

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

/// Nodes, ring circulations and segments of the wing (first) and its wake.
///
/// Rows 0 to `bound_rows - 1` are ring corners of the wing, the last of them the
/// line from which the wake springs; further rows are older and older wake.
#[derive(Debug, Clone)]
pub struct Vorticity {
    columns: usize,
    bound_rows: usize,
    rows: usize,
    /// Number of the step in which each row of nodes left the edge; the wing's rows have none.
    born: Vec<usize>,
    /// When that was, s.
    left: Vec<f64>,
    nodes: [Vec<f64>; 3],
    /// Ring circulations, row by row, bound rings first, m²/s.
    circulation: Vec<f64>,
    /// Core radius at each node, m.
    cores: Vec<f64>,
    /// Nodes with their segments, as the kernel wants them.
    sheet: Vec<Node>,
}

impl Vorticity {
    /// A wing of `bound_rows` rows of nodes with room for `wake_rows` rings of wake.
    pub fn new(columns: usize, bound_rows: usize, wake_rows: usize) -> Self {
        let most_rows = bound_rows + wake_rows + 1;
        let along = || vec![0.0; most_rows * columns];
        Self {
            columns,
            bound_rows,
            rows: bound_rows,
            born: vec![0; most_rows],
            left: vec![0.0; most_rows],
            nodes: [along(), along(), along()],
            circulation: vec![0.0; most_rows * (columns - 1)],
            cores: vec![0.0; most_rows * columns],
            sheet: vec![Node::default(); most_rows * columns],
        }
    }

    /// Rings in a row.
    pub fn strips(&self) -> usize {
        self.columns - 1
    }

    /// Rows of nodes, the wing's included.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The row of nodes from which the wake springs.
    pub fn edge_row(&self) -> usize {
        self.bound_rows - 1
    }

    /// Step in which a row of wake nodes left the edge.
    pub fn born(&self, row: usize) -> usize {
        self.born[row]
    }

    /// Nodes which move with the air: the edge's, about to leave, and the wake's.
    pub fn convected(&self) -> std::ops::Range<usize> {
        self.edge_row() * self.columns..self.rows * self.columns
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

    /// Circulations of the rings behind a row of nodes.
    pub fn ring_row(&self, row: usize) -> &[f64] {
        &self.circulation[row * self.strips()..(row + 1) * self.strips()]
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

    /// Sets the circulations of the bound rings to zero.
    pub fn clear_bound(&mut self) {
        let bound = self.edge_row() * self.strips();
        self.circulation[..bound].fill(0.0);
    }

    /// Sheds the last bound ring's circulation: the line at the edge, which left in
    /// step `step` at `time` (s), becomes wake.
    pub fn shed(&mut self, step: usize, time: f64) {
        let (columns, strips) = (self.columns, self.strips());
        let (edge, rows) = (self.edge_row(), self.rows);
        for component in &mut self.nodes {
            component.copy_within(edge * columns..rows * columns, (edge + 1) * columns);
        }
        self.born.copy_within(edge..rows, edge + 1);
        self.left.copy_within(edge..rows, edge + 1);
        (self.born[edge + 1], self.left[edge + 1]) = (step, time);
        // The ring row before the wake is the wing's last: shifting from there sheds it.
        self.circulation.copy_within((edge - 1) * strips..(rows - 1) * strips, edge * strips);
        self.rows += 1;
    }

    /// Whether the oldest row of wake is `kept` steps old at the end of step `now`, and is to be forgotten.
    pub fn outlives(&self, now: usize, kept: usize) -> bool {
        let last = self.rows - 1;
        last > self.edge_row() && now - self.born[last] >= kept
    }

    /// Forgets the oldest row of rings.
    pub fn forget(&mut self) {
        self.rows -= 1;
    }

    /// In step `now`, joins the rings on either side of every row of wake which has come of age: every other row of a
    /// stroke of `period` steps when it is `age` steps old, every other of those left at four times that age, and so on.
    pub fn join_old(&mut self, now: usize, age: usize, period: usize) {
        let joined_at = |born: usize| age.saturating_mul(4_usize.saturating_pow((born % period).trailing_zeros()));
        for row in (self.edge_row() + 2..self.rows - 1).rev() {
            if now - self.born[row] >= joined_at(self.born[row]) {
                self.join(row);
            }
        }
    }

    /// Joins the rings before and behind a row of wake nodes, which goes. The joint
    /// ring's circulation is the mean by area, which keeps the impulse ΓA where they are parallel:
    /// Γ |A| = Γ1 |A1| + Γ2 |A2|, |A| = |A1| + |A2|.
    fn join(&mut self, row: usize) {
        let (columns, strips) = (self.columns, self.strips());
        for k in 0..strips {
            let (before, behind) = ((row - 1) * strips + k, row * strips + k);
            let (a1, a2) = (self.ring_area(row - 1, k).norm(), self.ring_area(row, k).norm());
            let (g1, g2) = (self.circulation[before], self.circulation[behind]);
            self.circulation[before] = if a1 + a2 > 0.0 { (g1 * a1 + g2 * a2) / (a1 + a2) } else { 0.5 * (g1 + g2) };
        }
        let rows = self.rows;
        for component in &mut self.nodes {
            component.copy_within((row + 1) * columns..rows * columns, row * columns);
        }
        self.born.copy_within(row + 1..rows, row);
        self.left.copy_within(row + 1..rows, row);
        self.circulation.copy_within((row + 1) * strips..(rows - 1) * strips, row * strips);
        self.rows -= 1;
    }

    /// Area vector of a ring, m²: half the cross product of its diagonals, along the
    /// velocity in its middle when its circulation is positive.
    pub fn ring_area(&self, row: usize, strip: usize) -> crate::kinematics::Vector {
        let first = row * self.columns + strip;
        let node = |i: usize| crate::kinematics::Vector::from(self.node(i));
        let (a, b) = (node(first + self.columns + 1) - node(first), node(first + self.columns) - node(first + 1));
        b.cross(&a) * 0.5
    }

    /// Middle of a ring, m.
    pub fn ring_middle(&self, row: usize, strip: usize) -> crate::kinematics::Vector {
        let first = row * self.columns + strip;
        let corners = [first, first + 1, first + self.columns, first + self.columns + 1];
        corners.iter().map(|i| crate::kinematics::Vector::from(self.node(*i))).sum::<crate::kinematics::Vector>() * 0.25
    }

    /// Recomputes all segments: `radius(age)` gives the core radius at a row of nodes, m; age is the
    /// time `now` since the edge was left, s, negative on the wing; `more(place)` what its square
    /// gains at a node of the wake, m².
    pub fn assemble(&mut self, now: f64, radius: impl Fn(f64) -> f64, more: impl Fn([f64; 3]) -> f64) {
        let edge = self.edge_row();
        for row in 0..self.rows {
            let age = if row > edge { now - self.left[row] } else { row as f64 - edge as f64 };
            let core = radius(age);
            for i in row * self.columns..(row + 1) * self.columns {
                let more = if row > edge { more(self.node(i)) } else { 0.0 };
                self.cores[i] = if more > 0.0 { (core * core + more).sqrt() } else { core };
            }
        }
        self.assemble_rows(0..self.rows);
    }

    /// Recomputes the segments of the wing and the edge after the bound circulations changed. Cores
    /// are kept.
    pub fn assemble_bound(&mut self) {
        self.assemble_rows(0..self.bound_rows);
    }

    fn assemble_rows(&mut self, rows: std::ops::Range<usize>) {
        let (columns, strips) = (self.columns, self.strips());
        // Circulation of a ring, which may be beyond the sheet.
        let ring = |row: Option<usize>, strip: Option<usize>| match (row, strip) {
            (Some(row), Some(strip)) if row + 1 < self.rows && strip < strips => self.circulation[row * strips + strip],
            _ => 0.0,
        };
        for j in rows {
            for k in 0..columns {
                let i = j * columns + k;
                let (ahead, inboard) = (j.checked_sub(1), k.checked_sub(1));
                let core = self.cores[i];
                let spanwise = inboard.map_or(Edge::NONE, |_| {
                    let circulation = ring(ahead, inboard) - ring(Some(j), inboard);
                    Edge::between(self.node(i - 1), self.node(i), [self.cores[i - 1], core], circulation)
                });
                let chordwise = ahead.map_or(Edge::NONE, |ahead| {
                    let circulation = ring(Some(ahead), Some(k)) - ring(Some(ahead), inboard);
                    let cores = [self.cores[i - columns], core];
                    Edge::between(self.node(i - columns), self.node(i), cores, circulation)
                });
                self.sheet[i] = Node { place: self.node(i), core2: core * core, spanwise, chordwise };
            }
        }
    }

    fn sheet(&self, from: usize, to: usize) -> Sheet<'_> {
        Sheet { columns: self.columns, nodes: &self.sheet[from * self.columns..to * self.columns] }
    }

    /// Wing and wake.
    pub fn all(&self) -> Sheet<'_> {
        self.sheet(0, self.rows)
    }

    /// The wake from the edge on. With the bound circulations at zero the line at
    /// the edge carries the newest ring alone.
    pub fn wake(&self) -> Option<Sheet<'_>> {
        (self.rows > self.bound_rows).then(|| self.sheet(self.bound_rows - 1, self.rows))
    }

    /// The wing's nodes by component.
    pub fn wing_nodes(&self) -> [&[f64]; 3] {
        let count = self.bound_rows * self.columns;
        [&self.nodes[0][..count], &self.nodes[1][..count], &self.nodes[2][..count]]
    }
}
