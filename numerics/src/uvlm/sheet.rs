//! What the kernel reads: targets by component, and a sheet's nodes with the segments
//! which end there side by side, so that one pass over the sheet is one stream of memory.

use crate::uvlm::level::{Level, MOST_LANES, Real};

/// Points or vectors, one array per component, padded to whole registers.
#[derive(Debug, Clone, Default)]
pub struct Points<T = f64> {
    len: usize,
    /// Forward components.
    pub x: Vec<T>,
    /// Outboard components.
    pub y: Vec<T>,
    /// Upward components.
    pub z: Vec<T>,
}

impl<T: Real> Points<T> {
    /// `len` points at the origin.
    pub fn zeros(len: usize) -> Self {
        let mut points = Self::default();
        points.resize(len);
        points
    }

    /// How many points.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Changes the number of points; new ones are at the origin.
    pub fn resize(&mut self, len: usize) {
        self.len = len;
        let padded = len.next_multiple_of(MOST_LANES);
        for component in [&mut self.x, &mut self.y, &mut self.z] {
            component.resize(padded, T::default());
        }
    }

    /// Point `i`.
    #[inline]
    pub fn get(&self, i: usize) -> [f64; 3] {
        [self.x[i].double(), self.y[i].double(), self.z[i].double()]
    }

    /// Sets point `i`.
    #[inline]
    pub fn set(&mut self, i: usize, [x, y, z]: [f64; 3]) {
        (self.x[i], self.y[i], self.z[i]) = (T::of(x), T::of(y), T::of(z));
    }

    /// A register of points from point `start` on.
    #[inline(always)]
    pub(super) fn load<S: Level>(&self, simd: S, start: usize) -> [T::Lanes<S>; 3] {
        [T::load(simd, &self.x[start..]), T::load(simd, &self.y[start..]), T::load(simd, &self.z[start..])]
    }

    /// Sets a register of points from point `start` on.
    #[inline(always)]
    pub(super) fn store<S: Level>(&mut self, simd: S, start: usize, [x, y, z]: [T::Lanes<S>; 3]) {
        T::store(simd, &mut self.x[start..], x);
        T::store(simd, &mut self.y[start..], y);
        T::store(simd, &mut self.z[start..], z);
    }

    /// Sets every component to zero.
    pub fn clear(&mut self) {
        for component in [&mut self.x, &mut self.y, &mut self.z] {
            component.fill(T::default());
        }
    }
}

/// A vortex segment, which belongs to the node where it ends.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Edge<T = f64> {
    /// Circulation / 2π times the way from the first node to the second, m³/s.
    pub vector: [T; 3],
    /// -(r0² + (c1 - c2)²): its length and the difference of the cores at its ends, m².
    pub minus_length2: T,
}

impl Edge {
    /// No segment.
    pub const NONE: Self = Self { vector: [0.0; 3], minus_length2: 0.0 };

    /// From one place to another, where the cores' radii are `cores` (m), with a circulation in m²/s. One
    /// without length (all chordwise edges meet in a pointed tip) has no vector, hence no velocity.
    #[inline(always)]
    pub fn between(from: [f64; 3], to: [f64; 3], cores: [f64; 2], circulation: f64) -> Self {
        let way = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
        let strength = circulation / std::f64::consts::TAU;
        let vector = [strength * way[0], strength * way[1], strength * way[2]];
        let wider = cores[1] - cores[0];
        Self { vector, minus_length2: -(way[0] * way[0] + way[1] * way[1] + way[2] * way[2] + wider * wider) }
    }
}

/// A node and the segments which end there: what the kernel reads of a sheet, in the
/// order in which it does.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(align(64))]
pub struct Node<T = f64> {
    /// Where it is, m.
    pub place: [T; 3],
    /// Squared radius of the core which its segments have here, m².
    pub core2: T,
    /// From the node before in its row; [`Edge::NONE`] in the first column.
    pub spanwise: Edge<T>,
    /// From the node of the row before; not looked at in the first row.
    pub chordwise: Edge<T>,
}

/// A grid of vortex segments: `rows x columns` nodes, row by row.
#[derive(Debug, Clone, Copy)]
pub struct Sheet<'a, T = f64> {
    /// Nodes in a row.
    pub columns: usize,
    /// Its nodes, `rows * columns`.
    pub nodes: &'a [Node<T>],
}

/// How many segments a sheet has.
pub fn segments<T>(sheet: &Sheet<'_, T>) -> usize {
    let rows = sheet.nodes.len() / sheet.columns;
    rows * (sheet.columns - 1) + (rows - 1) * sheet.columns
}
