//! The one Biot-Savart kernel: the velocity a vortex sheet induces at points.
//!
//! Everything the solver needs is a call of [`induce`]: the influence matrix
//! (sheets of one ring), its image (mirrored targets), the wake on the wing and
//! the wake on itself. A sheet is a grid of nodes joined by straight vortex
//! segments; coincident edges of neighbouring rings are merged into one segment
//! with their net circulation.
//!
//! Lanes are targets, so no sum crosses lanes and the order of every sum is that
//! of the sheet's segments: the result has the same bits on every instruction
//! level, whether a register holds one target or sixteen.

use crate::uvlm::level::{Level, MOST_LANES, Real, Work, dispatch};

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

/// Numbers of a sheet's segments of one direction.
#[derive(Debug, Clone, Copy)]
pub struct Segments<'a, T = f64> {
    /// Circulation / 8π, m²/s.
    pub strength: &'a [T],
    /// Squared length r0², m².
    pub length2: &'a [T],
    /// (length x core radius)², m⁴.
    pub core: &'a [T],
}

impl<'a, T> Segments<'a, T> {
    #[inline(always)]
    fn range(&self, range: std::ops::Range<usize>) -> Self {
        Self { strength: &self.strength[range.clone()], length2: &self.length2[range.clone()], core: &self.core[range] }
    }
}

/// A grid of vortex segments: `rows x columns` nodes, row by row.
#[derive(Debug, Clone, Copy)]
pub struct Sheet<'a, T = f64> {
    /// Nodes in a row.
    pub columns: usize,
    /// Node coordinates, `rows * columns` each.
    pub nodes: [&'a [T]; 3],
    /// From node (j, k) to (j, k+1), `rows * (columns - 1)`.
    pub spanwise: Segments<'a, T>,
    /// From node (j, k) to (j+1, k), `(rows - 1) * columns`.
    pub chordwise: Segments<'a, T>,
}

/// Largest number of nodes in a row.
pub const MAX_COLUMNS: usize = 64;

/// A node as seen from a register of targets: offsets and distance. Aligned, so
/// that no load of a register crosses a cache line.
#[repr(align(64))]
pub(super) struct Seen<S: Level, T: Real> {
    x: T::Lanes<S>,
    y: T::Lanes<S>,
    z: T::Lanes<S>,
    r: T::Lanes<S>,
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
}

#[inline(always)]
fn see<S: Level, T: Real>(simd: S, node: [T; 3], target: &[T::Lanes<S>; 3]) -> Seen<S, T> {
    let x = T::sub(simd, target[0], T::splat(simd, node[0]));
    let y = T::sub(simd, target[1], T::splat(simd, node[1]));
    let z = T::sub(simd, target[2], T::splat(simd, node[2]));
    let zz = T::mul_add(simd, z, z, T::splat(simd, T::CLOSEST2));
    let r = T::root(simd, T::mul_add(simd, x, x, T::mul_add(simd, y, y, zz)));
    Seen { x, y, z, r }
}

/// One segment before its division: velocity = `cross * num / den`.
pub(super) struct Segment<S: Level, T: Real> {
    pub(super) cross: [T::Lanes<S>; 3],
    pub(super) num: T::Lanes<S>,
    pub(super) den: T::Lanes<S>,
}

/// Segment from `a` to `b`:
///
/// V = Γ/4π (r1 + r2)(r1 r2 - r1·r2) / [r1 r2 (|r1 x r2|² + r0² rc²)] (r1 x r2)
///
/// (Katz & Plotkin, Low-Speed Aerodynamics, Eq. 10.115 with a core), with
/// q = r0² - (r1 - r2)² for 2(r1 r2 - r1·r2), so that |r1 x r2|² = q (r1 r2 - q/4).
/// On the segment's extension the velocity is zero.
#[inline(always)]
pub(super) fn segment<S: Level, T: Real>(
    simd: S,
    a: &Seen<S, T>,
    b: &Seen<S, T>,
    (strength, length2, core): (T, T, T),
) -> Segment<S, T> {
    let cx = T::sub_mul(simd, T::mul(simd, a.y, b.z), a.z, b.y);
    let cy = T::sub_mul(simd, T::mul(simd, a.z, b.x), a.x, b.z);
    let cz = T::sub_mul(simd, T::mul(simd, a.x, b.y), a.y, b.x);
    let product = T::mul(simd, a.r, b.r);
    let difference = T::sub(simd, a.r, b.r);
    let q = T::sub_mul(simd, T::splat(simd, length2), difference, difference);
    let share = T::sub_mul(simd, product, q, T::splat(simd, T::of(0.25)));
    let cross2 = T::mul_add(simd, q, share, T::splat(simd, core));
    let den = T::mul_add(simd, product, cross2, T::splat(simd, T::SMALLEST));
    let sum = T::mul(simd, T::add(simd, a.r, b.r), T::splat(simd, strength));
    Segment { cross: [cx, cy, cz], num: T::mul(simd, sum, q), den }
}

#[inline(always)]
fn accumulate<S: Level, T: Real>(
    simd: S,
    velocity: &mut [T::Lanes<S>; 3],
    segment: &Segment<S, T>,
    factor: T::Lanes<S>,
) {
    for (v, c) in velocity.iter_mut().zip(segment.cross) {
        *v = T::mul_add(simd, factor, c, *v);
    }
}

/// Adds one segment.
#[inline(always)]
fn add_one<S: Level, T: Real>(simd: S, velocity: &mut [T::Lanes<S>; 3], s: &Segment<S, T>) {
    accumulate(simd, velocity, s, T::div(simd, s.num, s.den));
}

/// Adds two segments with one division between them.
#[inline(always)]
fn add_two<S: Level, T: Real>(simd: S, velocity: &mut [T::Lanes<S>; 3], s: &Segment<S, T>, t: &Segment<S, T>) {
    let inverse = T::div(simd, T::splat(simd, T::of(1.0)), T::mul(simd, s.den, t.den));
    accumulate(simd, velocity, s, T::mul(simd, T::mul(simd, s.num, t.den), inverse));
    accumulate(simd, velocity, t, T::mul(simd, T::mul(simd, t.num, s.den), inverse));
}

#[inline(always)]
fn numbers<T: Real>(segments: &Segments<'_, T>) -> impl Iterator<Item = (T, T, T)> {
    segments.strength.iter().zip(segments.length2).zip(segments.core).map(|((s, l), c)| (*s, *l, *c))
}

/// All distances of a row first, then its segments: two short chains of
/// operations keep the processor busier than one long one.
#[inline(always)]
pub(super) fn see_row<S: Level, T: Real>(
    simd: S,
    nodes: [&[T]; 3],
    first: usize,
    target: &[T::Lanes<S>; 3],
    seen: &mut [Seen<S, T>],
) {
    let [x, y, z] = nodes.map(|c| &c[first..first + seen.len()]);
    for (((x, y), z), place) in x.iter().zip(y).zip(z).zip(seen) {
        *place = see(simd, [*x, *y, *z], target);
    }
}

/// Adds the velocity at a register of targets. `seen` holds two rows of nodes.
#[inline(always)]
fn induce_block<S: Level, T: Real>(
    simd: S,
    sheet: &Sheet<'_, T>,
    target: &[T::Lanes<S>; 3],
    mut velocity: [T::Lanes<S>; 3],
    seen: &mut [[Seen<S, T>; MAX_COLUMNS]; 2],
) -> [T::Lanes<S>; 3] {
    let (columns, strips) = (sheet.columns, sheet.columns - 1);
    let [above, row] = seen;
    let (mut above, mut row) = (&mut above[..columns], &mut row[..columns]);
    see_row(simd, sheet.nodes, 0, target, above);
    let first = sheet.spanwise.range(0..strips);
    for ((a, b), along) in above.iter().zip(&above[1..]).zip(numbers(&first)) {
        add_one(simd, &mut velocity, &segment(simd, a, b, along));
    }
    for j in 1..sheet.nodes[0].len() / columns {
        see_row(simd, sheet.nodes, j * columns, target, row);
        let along = sheet.spanwise.range(j * strips..(j + 1) * strips);
        let down = sheet.chordwise.range((j - 1) * columns..j * columns);
        let root = (down.strength[0], down.length2[0], down.core[0]);
        add_one(simd, &mut velocity, &segment(simd, &above[0], &row[0], root));
        let down = down.range(1..columns);
        let mut inboard = row[0];
        for (((node, over), along), down) in row[1..].iter().zip(&above[1..]).zip(numbers(&along)).zip(numbers(&down)) {
            let s = segment(simd, &inboard, node, along);
            let t = segment(simd, over, node, down);
            add_two(simd, &mut velocity, &s, &t);
            inboard = *node;
        }
        std::mem::swap(&mut above, &mut row);
    }
    velocity
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
        let mut seen = [[Seen::<S, T>::nowhere(simd); MAX_COLUMNS]; 2];
        for start in (0..targets.len()).step_by(T::lanes::<S>()) {
            let target = targets.load(simd, start);
            let v = induce_block(simd, sheet, &target, velocity.load(simd, start), &mut seen);
            velocity.store(simd, start, v);
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
    dispatch(Induce { sheet, targets, velocity });
}

/// How many segment-target pairs a call of [`induce`] evaluates.
pub fn interactions<T: Real>(sheet: &Sheet<'_, T>, targets: &Points<T>) -> u64 {
    ((sheet.spanwise.strength.len() + sheet.chordwise.strength.len()) * targets.len()) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn same_bits_everywhere<T: Real + PartialEq + std::fmt::Debug>() {
        let columns = 5;
        let fold = |step: f64, count: usize| (0..count).map(|i| T::of((i as f64 * step).fract())).collect::<Vec<_>>();
        let nodes = [fold(0.618, 35), fold(0.414, 35), fold(0.732, 35)];
        let numbers = |count| (fold(0.271, count), fold(0.577, count), fold(0.161, count));
        let (spanwise, chordwise) = (numbers(28), numbers(30));
        let segments = |n: &'static (Vec<T>, Vec<T>, Vec<T>)| Segments { strength: &n.0, length2: &n.1, core: &n.2 };
        let (spanwise, chordwise) = (Box::leak(Box::new(spanwise)), Box::leak(Box::new(chordwise)));
        let [x, y, z] = &nodes;
        let sheet = Sheet { columns, nodes: [x, y, z], spanwise: segments(spanwise), chordwise: segments(chordwise) };
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
        same_bits_everywhere::<f64>();
        same_bits_everywhere::<f32>();
    }

    #[test]
    fn square_ring_and_its_mirror() {
        let a = 0.3;
        let (x, y, z) = ([0.0, 0.0, a, a], [0.0, a, 0.0, a], [0.0; 4]);
        let g = 1.0 / (8.0 * std::f64::consts::PI);
        // Counter-clockwise seen from above: down the left side, ...
        let sheet = Sheet {
            columns: 2,
            nodes: [&x, &y, &z],
            spanwise: Segments { strength: &[-g, g], length2: &[a * a; 2], core: &[1e-30; 2] },
            chordwise: Segments { strength: &[g, -g], length2: &[a * a; 2], core: &[1e-30; 2] },
        };
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
