//! The one Biot-Savart kernel: the velocity a vortex sheet induces at points.
//!
//! Wake and wing act on the wing and on the wake by a call of [`induce`]; rings of the wing one by one, for the influence
//! matrices, by `influence.rs`, with the same formula. A sheet is a grid of nodes joined by straight vortex
//! segments; coincident edges of neighbouring rings are merged into one segment
//! with their net circulation.
//!
//! Lanes are targets, so no sum crosses lanes and the order of every sum is that
//! of the sheet's segments: the result has the same bits on every instruction
//! level, whether a register holds one target or sixteen. What differs between
//! levels is only when each operation of a segment is done (`ahead.rs`, `staged.rs`).

mod ahead;
mod staged;

use crate::uvlm::level::{Level, Real, Work, dispatch};
pub use crate::uvlm::sheet::{Edge, Node, Points, Sheet, segments};

/// Largest number of nodes in a row.
pub const MAX_COLUMNS: usize = 64;

/// A node as seen from a register of targets: offsets, and the distance with the core. Aligned, so
/// that no load of a register crosses a cache line.
#[repr(align(64))]
pub(super) struct Seen<S: Level, T: Real> {
    x: T::Lanes<S>,
    y: T::Lanes<S>,
    z: T::Lanes<S>,
    pub(super) r: T::Lanes<S>,
}

impl<S: Level, T: Real> Clone for Seen<S, T> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<S: Level, T: Real> Copy for Seen<S, T> {}

impl<S: Level, T: Real> Seen<S, T> {
    #[inline(always)]
    pub(super) fn nowhere(simd: S) -> Self {
        let zero = T::splat(simd, T::default());
        Self { x: zero, y: zero, z: zero, r: zero }
    }

    /// The offset along a vector.
    #[inline(always)]
    pub(super) fn dot(&self, simd: S, [x, y, z]: [T::Lanes<S>; 3]) -> T::Lanes<S> {
        T::mul_add(simd, self.z, z, T::mul_add(simd, self.y, y, T::mul(simd, self.x, x)))
    }
}

#[inline(always)]
pub(super) fn see<S: Level, T: Real>(simd: S, node: [T; 3], core2: T, target: &[T::Lanes<S>; 3]) -> Seen<S, T> {
    let seen = look(simd, node, core2, target);
    Seen { r: T::root(simd, seen.r), ..seen }
}

/// The node with the square of its distance in `r`.
#[inline(always)]
fn look<S: Level, T: Real>(simd: S, node: [T; 3], core2: T, target: &[T::Lanes<S>; 3]) -> Seen<S, T> {
    let x = T::sub(simd, target[0], T::splat(simd, node[0]));
    let y = T::sub(simd, target[1], T::splat(simd, node[1]));
    let z = T::sub(simd, target[2], T::splat(simd, node[2]));
    let zz = T::mul_add(simd, z, z, T::splat(simd, core2));
    let r = T::mul_add(simd, x, x, T::mul_add(simd, y, y, zz));
    Seen { x, y, z, r }
}

/// A segment's factor before its division: velocity = `num / den` (vector x offset from an end).
pub(super) struct Factor<S: Level, T: Real> {
    pub(super) num: T::Lanes<S>,
    pub(super) den: T::Lanes<S>,
}

/// The factor of a segment from `a` to `b`, given as their distances R1 and R2:
///
/// V = Γ/4π ∫ dl x r / (r² + c²)^(3/2) = Γ/2π (R1 + R2) / [R1 R2 ((R1 + R2)² - r0² - (c1 - c2)²)] (r0 x r2)
///
/// with R² = r² + c² at either end: the velocity of vorticity spread evenly in all directions
/// over the core c (Rosenhead 1930, Moore 1972), which goes linearly from one end to the other.
/// It is exact, for with the core as a fourth coordinate the segment stays straight. A core
/// which counts the distance from the segment's line instead would take as much from the air far
/// ahead of a trailing vortex as from the air beside it. r1 x r2 = r0 x r2, which far away is no
/// difference of large numbers. On the segment's extension the velocity is zero.
#[inline(always)]
pub(super) fn factor<S: Level, T: Real>(simd: S, a: T::Lanes<S>, b: T::Lanes<S>, edge: &Edge<T>) -> Factor<S, T> {
    let product = T::mul(simd, a, b);
    let sum = T::add(simd, a, b);
    let rest = T::mul_add(simd, sum, sum, T::splat(simd, edge.minus_length2));
    Factor { num: sum, den: T::mul_add(simd, product, rest, T::splat(simd, T::SMALLEST)) }
}

/// factor x vector
#[inline(always)]
fn scaled<S: Level, T: Real>(simd: S, factor: T::Lanes<S>, vector: &[T; 3]) -> [T::Lanes<S>; 3] {
    let [x, y, z] = [T::splat(simd, vector[0]), T::splat(simd, vector[1]), T::splat(simd, vector[2])];
    [T::mul(simd, factor, x), T::mul(simd, factor, y), T::mul(simd, factor, z)]
}

/// sum + factor x vector
#[inline(always)]
fn scaled_added<S: Level, T: Real>(
    simd: S,
    factor: T::Lanes<S>,
    vector: &[T; 3],
    sum: [T::Lanes<S>; 3],
) -> [T::Lanes<S>; 3] {
    let [x, y, z] = [T::splat(simd, vector[0]), T::splat(simd, vector[1]), T::splat(simd, vector[2])];
    [T::mul_add(simd, factor, x, sum[0]), T::mul_add(simd, factor, y, sum[1]), T::mul_add(simd, factor, z, sum[2])]
}

/// sum + u x offset
#[inline(always)]
fn cross_added<S: Level, T: Real>(
    simd: S,
    u: [T::Lanes<S>; 3],
    offset: &Seen<S, T>,
    sum: [T::Lanes<S>; 3],
) -> [T::Lanes<S>; 3] {
    [
        T::sub_mul(simd, T::mul_add(simd, u[1], offset.z, sum[0]), u[2], offset.y),
        T::sub_mul(simd, T::mul_add(simd, u[2], offset.x, sum[1]), u[0], offset.z),
        T::sub_mul(simd, T::mul_add(simd, u[0], offset.y, sum[2]), u[1], offset.x),
    ]
}

/// The two segments which end at a node, with one division between them.
#[derive(Clone, Copy)]
struct Pair<S: Level, T: Real> {
    /// Numerators over the common denominator.
    spanwise: T::Lanes<S>,
    chordwise: T::Lanes<S>,
    /// 1 / common denominator.
    inverse: T::Lanes<S>,
}

impl<S: Level, T: Real> Pair<S, T> {
    #[inline(always)]
    fn none(simd: S) -> Self {
        let zero = T::splat(simd, T::default());
        Self { spanwise: zero, chordwise: zero, inverse: T::splat(simd, T::of(1.0)) }
    }

    /// `inverse` is yet the denominator. From the distances of the node inboard, the node above
    /// and the node itself.
    #[inline(always)]
    fn undivided(simd: S, node: &Node<T>, [inboard, above, here]: [T::Lanes<S>; 3]) -> Self {
        let s = factor::<S, T>(simd, inboard, here, &node.spanwise);
        let t = factor::<S, T>(simd, above, here, &node.chordwise);
        let spanwise = T::mul(simd, s.num, t.den);
        let chordwise = T::mul(simd, t.num, s.den);
        Self { spanwise, chordwise, inverse: T::mul(simd, s.den, t.den) }
    }

    #[inline(always)]
    fn divide(&mut self, simd: S) {
        self.inverse = T::div(simd, T::splat(simd, T::of(1.0)), self.inverse);
    }

    /// Divides two, in the way which is faster.
    #[inline(always)]
    fn divide_both(&mut self, other: &mut Self, simd: S) {
        if T::DIVIDES_TOGETHER {
            let both = T::div(simd, T::splat(simd, T::of(1.0)), T::mul(simd, self.inverse, other.inverse));
            (self.inverse, other.inverse) = (T::mul(simd, both, other.inverse), T::mul(simd, both, self.inverse));
        } else {
            self.divide(simd);
            other.divide(simd);
        }
    }

    /// Both segments end at the node, so that their vectors are added before they are crossed.
    #[inline(always)]
    fn added(&self, simd: S, node: &Node<T>, here: &Seen<S, T>, velocity: [T::Lanes<S>; 3]) -> [T::Lanes<S>; 3] {
        let u = scaled::<S, T>(simd, T::mul(simd, self.spanwise, self.inverse), &node.spanwise.vector);
        let factor = T::mul(simd, self.chordwise, self.inverse);
        let u = scaled_added::<S, T>(simd, factor, &node.chordwise.vector, u);
        cross_added(simd, u, here, velocity)
    }
}

/// Adds the segment between two nodes of the first row, which has none from a row before.
#[inline(always)]
fn first_row_added<S: Level, T: Real>(
    simd: S,
    node: &Node<T>,
    inboard: &Seen<S, T>,
    here: &Seen<S, T>,
    velocity: [T::Lanes<S>; 3],
) -> [T::Lanes<S>; 3] {
    let f = factor::<S, T>(simd, inboard.r, here.r, &node.spanwise);
    let u = scaled::<S, T>(simd, T::div(simd, f.num, f.den), &node.spanwise.vector);
    cross_added(simd, u, here, velocity)
}

/// The arguments of [`induce`] as work for a level.
struct Induce<'a, 'b, T> {
    sheet: &'a Sheet<'b, T>,
    targets: &'a Points<T>,
    velocity: &'a mut Points<T>,
}

impl<T: Real> Work for Induce<'_, '_, T> {
    #[inline(always)]
    fn run<S: Level>(self, simd: S) {
        let Self { sheet, targets, velocity } = self;
        let blocks = (0..targets.len()).step_by(T::lanes::<S>());
        if S::ROOTS_IN_STAGES {
            let mut line = staged::Line::new(simd, sheet.columns);
            for start in blocks {
                let target = targets.load(simd, start);
                let v = staged::induce(simd, sheet, &target, velocity.load(simd, start), &mut line);
                velocity.store(simd, start, v);
            }
        } else {
            let mut ring = ahead::Ring::new(simd, sheet.columns);
            for start in blocks {
                let target = targets.load(simd, start);
                let v = ahead::induce(simd, sheet, &target, velocity.load(simd, start), &mut ring);
                velocity.store(simd, start, v);
            }
        }
    }
}

/// Adds the velocity the sheet induces at the targets, m/s.
///
/// Known answer: the middle of a square ring of side a and strength Γ sees
/// 2√2 Γ/(π a) along the ring's axis.
///
/// # Panics
/// When the sheet's arrays do not fit its number of columns, or `velocity` is
/// shorter than `targets`; both are the solver's own.
pub fn induce<T: Real>(sheet: &Sheet<'_, T>, targets: &Points<T>, velocity: &mut Points<T>) {
    assert!((2..=MAX_COLUMNS).contains(&sheet.columns) && velocity.len() >= targets.len());
    assert!(sheet.nodes.len() >= sheet.columns && sheet.nodes.len().is_multiple_of(sheet.columns));
    dispatch(Induce { sheet, targets, velocity });
}

/// How many segment-target pairs a call of [`induce`] evaluates.
pub fn interactions<T: Real>(sheet: &Sheet<'_, T>, targets: &Points<T>) -> u64 {
    (segments(sheet) * targets.len()) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn same_bits_everywhere<T: Real + PartialEq + std::fmt::Debug>(rows: usize, columns: usize) {
        let number = |i: usize, step: f64| T::of((i as f64 * step).fract());
        let three = |i: usize, steps: [f64; 3]| steps.map(|step| number(i, step));
        let edge = |i| Edge { vector: three(i, [0.3, 0.8, 0.9]), minus_length2: number(i, -0.577) };
        let node = |i| Node {
            place: three(i, [0.618, 0.414, 0.732]),
            core2: T::of(0.01 + (i as f64 * 0.161).fract()),
            spanwise: edge(i + 3),
            chordwise: edge(i),
        };
        let nodes: Vec<Node<T>> = (0..rows * columns).map(node).collect();
        let sheet = Sheet { columns, nodes: &nodes };
        let mut targets = Points::<T>::zeros(21);
        (0..21).for_each(|i| targets.set(i, [0.1, 0.7, 0.3].map(|s| (f64::from(i as u32) * s).fract())));
        let found: Vec<Points<T>> = crate::uvlm::level::available()
            .into_iter()
            .map(|level| {
                let mut velocity = Points::zeros(21);
                crate::uvlm::level::run_at(level, Induce { sheet: &sheet, targets: &targets, velocity: &mut velocity });
                velocity
            })
            .collect();
        assert!(found[0].get(3).iter().any(|v| *v != 0.0));
        for other in &found[1..] {
            // Beyond the points is padding.
            for (a, b) in [(&found[0].x, &other.x), (&found[0].y, &other.y), (&found[0].z, &other.z)] {
                assert_eq!(a[..21], b[..21]);
            }
        }
    }

    #[test]
    fn every_level_gives_the_same_bits() {
        for (rows, columns) in [(1, 2), (2, 2), (2, 3), (7, 2), (7, 5), (6, 7), (7, 6), (9, 18), (4, MAX_COLUMNS)] {
            same_bits_everywhere::<f64>(rows, columns);
            same_bits_everywhere::<f32>(rows, columns);
        }
    }

    /// Registers of targets follow one another through the same memory.
    #[test]
    fn a_target_which_is_lost_leaves_the_others_alone() {
        for columns in [2, 3, 4, 7] {
            let mut work = crate::uvlm::probe::Workload::new(40, columns);
            let count = work.targets.len();
            for level in crate::uvlm::level::available() {
                let mut induced = |target: [f64; 3]| {
                    work.targets.set(1, target);
                    let mut velocity = Points::zeros(count);
                    let sheet = work.sheet();
                    let induce = Induce { sheet: &sheet, targets: &work.targets, velocity: &mut velocity };
                    crate::uvlm::level::run_at(level, induce);
                    velocity
                };
                let (sound, lost) = (induced([0.5; 3]), induced([f64::NAN; 3]));
                assert!(lost.get(1)[0].is_nan() && sound.get(1)[0].is_finite());
                assert!((2..count).all(|i| sound.get(i) == lost.get(i)), "{columns} columns, {level}");
            }
        }
    }

    #[test]
    fn the_middle_of_a_square_ring() {
        let a = 0.3;
        let corners = [[0.0, 0.0, 0.0], [0.0, a, 0.0], [a, 0.0, 0.0], [a, a, 0.0]];
        let core = 1e-8;
        let edge =
            |from: usize, to: usize, circulation| Edge::between(corners[from], corners[to], [core; 2], circulation);
        // Counter-clockwise seen from above: down the left side, ...
        let edges = [
            (Edge::NONE, Edge::NONE),
            (edge(0, 1, -1.0), Edge::NONE),
            (Edge::NONE, edge(0, 2, 1.0)),
            (edge(2, 3, 1.0), edge(1, 3, -1.0)),
        ];
        let node =
            |i: usize| Node { place: corners[i], core2: core * core, spanwise: edges[i].0, chordwise: edges[i].1 };
        let nodes = [0, 1, 2, 3].map(node);
        let sheet = Sheet { columns: 2, nodes: &nodes };
        let mut targets = Points::zeros(3);
        targets.set(0, [a / 2.0, a / 2.0, 0.0]);
        targets.set(1, [0.0, 0.0, 0.0]);
        targets.set(2, [-a, 0.0, 0.0]);
        let mut velocity = Points::zeros(3);
        induce(&sheet, &targets, &mut velocity);
        let expected = 2.0 * 2.0_f64.sqrt() / (std::f64::consts::PI * a);
        assert!((velocity.get(0)[2] - expected).abs() < 1e-12 * expected, "{:?}", velocity.get(0));
        assert!(velocity.get(1).iter().chain(&velocity.get(2)).all(|v| v.is_finite()));
    }
}
