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
//! level, whether eight lanes are one register, two, four or eight.

/// Targets computed at once.
const LANES: usize = 8;

/// Eight numbers which LLVM keeps in vector registers.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Lane([f64; LANES]);

macro_rules! lanewise {
    ($($name:ident($($arg:ident),*) = $body:expr;)*) => {
        impl Lane {
            $(#[inline(always)]
            fn $name($($arg: Lane),*) -> Lane {
                let mut out = [0.0; LANES];
                for i in 0..LANES {
                    $(let $arg = $arg.0[i];)*
                    out[i] = $body;
                }
                Lane(out)
            })*
        }
    };
}

lanewise! {
    add(a, b) = a + b;
    sub(a, b) = a - b;
    mul(a, b) = a * b;
    div(a, b) = a / b;
    sqrt(a) = a.sqrt();
    mul_add(a, b, c) = a.mul_add(b, c);
    mul_sub(a, b, c) = a.mul_add(b, -c);
}

impl Lane {
    const ZERO: Lane = Lane([0.0; LANES]);

    #[inline(always)]
    fn splat(x: f64) -> Lane {
        Lane([x; LANES])
    }

    #[inline(always)]
    fn load(from: &[f64]) -> Lane {
        let mut out = [0.0; LANES];
        out.copy_from_slice(&from[..LANES]);
        Lane(out)
    }
}

/// Points or vectors, one array per component, padded to whole vectors.
#[derive(Debug, Clone, Default)]
pub struct Points {
    len: usize,
    /// Forward components.
    pub x: Vec<f64>,
    /// Outboard components.
    pub y: Vec<f64>,
    /// Upward components.
    pub z: Vec<f64>,
}

impl Points {
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
        let padded = len.next_multiple_of(LANES);
        for component in [&mut self.x, &mut self.y, &mut self.z] {
            component.resize(padded, 0.0);
        }
    }

    /// Point `i`.
    #[inline]
    pub fn get(&self, i: usize) -> [f64; 3] {
        [self.x[i], self.y[i], self.z[i]]
    }

    /// Sets point `i`.
    #[inline]
    pub fn set(&mut self, i: usize, [x, y, z]: [f64; 3]) {
        (self.x[i], self.y[i], self.z[i]) = (x, y, z);
    }

    /// Sets every component to zero.
    pub fn clear(&mut self) {
        for component in [&mut self.x, &mut self.y, &mut self.z] {
            component.fill(0.0);
        }
    }
}

/// A grid of vortex segments: `rows x columns` nodes, row by row.
#[derive(Debug, Clone, Copy)]
pub struct Sheet<'a> {
    /// Nodes in a row.
    pub columns: usize,
    /// Node coordinates, `rows * columns` each.
    pub nodes: [&'a [f64]; 3],
    /// Strength / 4π of the segment from node (j, k) to (j, k+1), `rows * (columns - 1)`, m²/s.
    pub spanwise: &'a [f64],
    /// Strength / 4π of the segment from node (j, k) to (j+1, k), `(rows - 1) * columns`, m²/s.
    pub chordwise: &'a [f64],
    /// (segment length x core radius)² of the spanwise segments, m⁴.
    pub spanwise_core: &'a [f64],
    /// (segment length x core radius)² of the chordwise segments, m⁴.
    pub chordwise_core: &'a [f64],
}

/// Largest number of nodes in a row.
pub const MAX_COLUMNS: usize = 64;

/// A node as seen from eight targets: offsets and distances.
#[derive(Clone, Copy)]
struct Seen {
    x: Lane,
    y: Lane,
    z: Lane,
    r: Lane,
}

/// One segment before its division: velocity = `cross * strength * num / den`.
struct Segment {
    cross: [Lane; 3],
    num: Lane,
    den: Lane,
}

/// Segment from `a` to `b`, strength Γ/4π, `core` = (r0 rc)²:
///
/// V = Γ/4π (r1 + r2)(r1 r2 - r1·r2) / [r1 r2 (|r1 x r2|² + r0² rc²)] (r1 x r2)
///
/// (Katz & Plotkin, Low-Speed Aerodynamics, Eq. 10.115 with a core.) On the
/// segment itself and on its extension the velocity is zero.
#[inline(always)]
fn segment(a: &Seen, b: &Seen, strength: f64, core: f64) -> Segment {
    let cx = Lane::mul_sub(a.y, b.z, Lane::mul(a.z, b.y));
    let cy = Lane::mul_sub(a.z, b.x, Lane::mul(a.x, b.z));
    let cz = Lane::mul_sub(a.x, b.y, Lane::mul(a.y, b.x));
    let cross2 = Lane::mul_add(cx, cx, Lane::mul_add(cy, cy, Lane::mul_add(cz, cz, Lane::splat(core))));
    let dot = Lane::mul_add(a.x, b.x, Lane::mul_add(a.y, b.y, Lane::mul(a.z, b.z)));
    let product = Lane::mul(a.r, b.r);
    let sum = Lane::mul(Lane::add(a.r, b.r), Lane::splat(strength));
    // The smallest of numbers keeps a node's own velocity 0 instead of 0/0.
    let den = Lane::mul_add(product, cross2, Lane::splat(1e-60));
    Segment { cross: [cx, cy, cz], num: Lane::mul(sum, Lane::sub(product, dot)), den }
}

#[inline(always)]
fn accumulate(velocity: &mut [Lane; 3], segment: &Segment, factor: Lane) {
    for (v, c) in velocity.iter_mut().zip(&segment.cross) {
        *v = Lane::mul_add(factor, *c, *v);
    }
}

/// Adds one segment.
#[inline(always)]
fn add_one(velocity: &mut [Lane; 3], s: &Segment) {
    accumulate(velocity, s, Lane::div(s.num, s.den));
}

/// Adds two segments with one division between them, which costs as much as
/// all the multiplications of a segment together.
#[inline(always)]
fn add_two(velocity: &mut [Lane; 3], s: &Segment, t: &Segment) {
    let inverse = Lane::div(Lane::splat(1.0), Lane::mul(s.den, t.den));
    accumulate(velocity, s, Lane::mul(Lane::mul(s.num, t.den), inverse));
    accumulate(velocity, t, Lane::mul(Lane::mul(t.num, s.den), inverse));
}

/// One row of nodes with the segments along it and those from the row above.
struct Row<'a> {
    x: &'a [f64],
    y: &'a [f64],
    z: &'a [f64],
    /// Strengths and cores of the segments along the row.
    along: (&'a [f64], &'a [f64]),
    /// Strengths and cores of the segments from the row above; none above the first.
    above: (&'a [f64], &'a [f64]),
}

impl<'a> Row<'a> {
    #[inline(always)]
    fn of(sheet: &Sheet<'a>, j: usize) -> Self {
        let (columns, strips) = (sheet.columns, sheet.columns - 1);
        let (nodes, along) = (j * columns..(j + 1) * columns, j * strips..(j + 1) * strips);
        let above = if j > 0 { (j - 1) * columns..j * columns } else { 0..0 };
        Self {
            x: &sheet.nodes[0][nodes.clone()],
            y: &sheet.nodes[1][nodes.clone()],
            z: &sheet.nodes[2][nodes],
            along: (&sheet.spanwise[along.clone()], &sheet.spanwise_core[along]),
            above: (&sheet.chordwise[above.clone()], &sheet.chordwise_core[above]),
        }
    }

    #[inline(always)]
    fn see(&self, k: usize, target: &[Lane; 3]) -> Seen {
        let x = Lane::sub(target[0], Lane::splat(self.x[k]));
        let y = Lane::sub(target[1], Lane::splat(self.y[k]));
        let z = Lane::sub(target[2], Lane::splat(self.z[k]));
        let r = Lane::sqrt(Lane::mul_add(x, x, Lane::mul_add(y, y, Lane::mul(z, z))));
        Seen { x, y, z, r }
    }
}

/// Velocity at eight targets. `seen` carries a row's nodes to the next row.
#[inline(always)]
fn induce_block(sheet: &Sheet<'_>, target: &[Lane; 3], seen: &mut [Seen; MAX_COLUMNS]) -> [Lane; 3] {
    let columns = sheet.columns;
    let seen = &mut seen[..columns];
    let mut velocity = [Lane::ZERO; 3];
    let first = Row::of(sheet, 0);
    let mut inboard = first.see(0, target);
    seen[0] = inboard;
    for (k, place) in seen.iter_mut().enumerate().skip(1) {
        let node = first.see(k, target);
        add_one(&mut velocity, &segment(&inboard, &node, first.along.0[k - 1], first.along.1[k - 1]));
        *place = node;
        inboard = node;
    }
    for j in 1..sheet.nodes[0].len() / columns {
        let row = Row::of(sheet, j);
        let mut inboard = row.see(0, target);
        add_one(&mut velocity, &segment(&seen[0], &inboard, row.above.0[0], row.above.1[0]));
        seen[0] = inboard;
        for (k, place) in seen.iter_mut().enumerate().skip(1) {
            let node = row.see(k, target);
            let along = segment(&inboard, &node, row.along.0[k - 1], row.along.1[k - 1]);
            let above = segment(place, &node, row.above.0[k], row.above.1[k]);
            add_two(&mut velocity, &along, &above);
            *place = node;
            inboard = node;
        }
    }
    velocity
}

#[inline(always)]
fn induce_all(sheet: &Sheet<'_>, targets: &Points, velocity: &mut Points) {
    let nothing = Seen { x: Lane::ZERO, y: Lane::ZERO, z: Lane::ZERO, r: Lane::ZERO };
    let mut seen = [nothing; MAX_COLUMNS];
    for start in (0..targets.len()).step_by(LANES) {
        let target =
            [Lane::load(&targets.x[start..]), Lane::load(&targets.y[start..]), Lane::load(&targets.z[start..])];
        let v = induce_block(sheet, &target, &mut seen);
        for (component, v) in [&mut velocity.x, &mut velocity.y, &mut velocity.z].into_iter().zip(v) {
            for (sum, v) in component[start..start + LANES].iter_mut().zip(v.0) {
                *sum += v;
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
pub fn induce(sheet: &Sheet<'_>, targets: &Points, velocity: &mut Points) {
    assert!((2..=MAX_COLUMNS).contains(&sheet.columns) && velocity.len() >= targets.len());
    pulp::Arch::new().dispatch(Induce { sheet, targets, velocity });
}

/// The call of [`induce_all`] as a type, so that it is inlined into the function
/// compiled for the instruction level found at run time.
struct Induce<'a, 'b> {
    sheet: &'a Sheet<'b>,
    targets: &'a Points,
    velocity: &'a mut Points,
}

impl pulp::NullaryFnOnce for Induce<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        induce_all(self.sheet, self.targets, self.velocity);
    }
}

/// How many segment-target pairs a call of [`induce`] evaluates.
pub fn interactions(sheet: &Sheet<'_>, targets: &Points) -> u64 {
    ((sheet.spanwise.len() + sheet.chordwise.len()) * targets.len()) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn square_ring_and_its_mirror() {
        let a = 0.3;
        let (x, y, z) = ([0.0, 0.0, a, a], [0.0, a, 0.0, a], [0.0; 4]);
        let g = 1.0 / (4.0 * std::f64::consts::PI);
        // Counter-clockwise seen from above: down the left side, ...
        let sheet = Sheet {
            columns: 2,
            nodes: [&x, &y, &z],
            spanwise: &[-g, g],
            chordwise: &[g, -g],
            spanwise_core: &[0.0; 2],
            chordwise_core: &[0.0; 2],
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
