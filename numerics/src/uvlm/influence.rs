//! What each ring of unit circulation does to each collocation point.

use nalgebra::{DMatrix, DVector};

use crate::uvlm::kernel::{Edge, MAX_COLUMNS, Points, Seen, factor, see};
use crate::uvlm::level::{Level, MOST_LANES, Real, Work, dispatch};

/// A matrix by columns, its rows padded to whole registers.
#[derive(Debug, Clone, Default)]
pub struct Matrix {
    rows: usize,
    stride: usize,
    columns: usize,
    values: Vec<f64>,
}

impl Matrix {
    /// Zeros.
    pub fn zeros(rows: usize, columns: usize) -> Self {
        let stride = rows.next_multiple_of(MOST_LANES);
        Self { rows, stride, columns, values: vec![0.0; stride * columns] }
    }

    /// Adds to the rows from `start` of a column.
    #[inline(always)]
    fn add<S: Level>(&mut self, simd: S, start: usize, column: usize, value: S::f64s) {
        let place = &mut self.values[column * self.stride + start..];
        f64::store(simd, place, simd.add_f64s(f64::load(simd, place), value));
    }

    fn from_dense(dense: &DMatrix<f64>) -> Self {
        let mut matrix = Self::zeros(dense.nrows(), dense.ncols());
        for (j, column) in dense.column_iter().enumerate() {
            matrix.values[j * matrix.stride..][..matrix.rows].copy_from_slice(column.as_slice());
        }
        matrix
    }

    fn dense(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.rows, self.columns, |i, j| self.values[j * self.stride + i])
    }

    /// y = M x; `y` is padded like a column.
    fn times(&self, x: &[f64], y: &mut [f64]) {
        dispatch(Product { matrix: self, x, y });
    }
}

struct Product<'a> {
    matrix: &'a Matrix,
    x: &'a [f64],
    y: &'a mut [f64],
}

impl Work for Product<'_> {
    #[inline(always)]
    fn run<S: Level>(self, simd: S) {
        let Self { matrix, x, y } = self;
        for start in (0..matrix.stride).step_by(S::F64_LANES) {
            let mut sum = simd.splat_f64s(0.0);
            for (x, column) in x.iter().zip(matrix.values.chunks_exact(matrix.stride)) {
                sum = simd.mul_add_f64s(f64::load(simd, &column[start..]), simd.splat_f64s(*x), sum);
            }
            f64::store(simd, &mut y[start..], sum);
        }
    }
}

/// Unit rings of a wing lattice on targets, along one direction. Every segment is
/// evaluated once for the two rings which share it.
pub struct RingInfluence<'a> {
    /// Ring corners by component, row by row.
    pub nodes: [&'a [f64]; 3],
    /// Nodes in a row.
    pub columns: usize,
    /// Core radius of every segment, m.
    pub core: f64,
    /// Where the velocity is wanted.
    pub targets: &'a Points,
    /// Along which it is measured.
    pub direction: [f64; 3],
}

impl RingInfluence<'_> {
    /// `matrix[(i, j)]` becomes the velocity of ring j at target i along the direction.
    pub fn fill(self, matrix: &mut Matrix) {
        dispatch(Fill { rings: self, matrix });
    }

    #[inline(always)]
    fn node(&self, i: usize) -> [f64; 3] {
        let [x, y, z] = self.nodes;
        [x[i], y[i], z[i]]
    }

    /// A segment of unit circulation.
    #[inline(always)]
    fn edge(&self, from: usize, to: usize) -> Edge {
        Edge::between(self.node(from), self.node(to), [self.core; 2], 1.0)
    }

    /// Velocity of a segment along the direction: d · (v x r) = (d x v) · r.
    #[inline(always)]
    fn along<S: Level>(&self, simd: S, a: &Seen<S, f64>, b: &Seen<S, f64>, edge: &Edge) -> S::f64s {
        let ([dx, dy, dz], [vx, vy, vz]) = (self.direction, edge.vector);
        let [x, y, z] = [dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx];
        let across = [simd.splat_f64s(x), simd.splat_f64s(y), simd.splat_f64s(z)];
        let f = factor::<S, f64>(simd, a.r, b.r, edge);
        simd.mul_f64s(b.dot(simd, across), simd.div_f64s(f.num, f.den))
    }
}

struct Fill<'a, 'b> {
    rings: RingInfluence<'a>,
    matrix: &'b mut Matrix,
}

impl Work for Fill<'_, '_> {
    #[inline(always)]
    fn run<S: Level>(self, simd: S) {
        let Self { rings, matrix } = self;
        let (columns, strips) = (rings.columns, rings.columns - 1);
        let (zero, core2) = (simd.splat_f64s(0.0), rings.core * rings.core);
        let nothing = Seen::<S, f64>::nowhere(simd);
        let mut seen = [[nothing; MAX_COLUMNS]; 2];
        for start in (0..rings.targets.len()).step_by(S::F64_LANES) {
            let target = rings.targets.load(simd, start);
            let [above, row] = &mut seen;
            let (mut above, mut row) = (&mut above[..columns], &mut row[..columns]);
            for j in 0..rings.nodes[0].len() / columns {
                for (k, place) in row.iter_mut().enumerate() {
                    *place = see(simd, rings.node(j * columns + k), core2, &target);
                }
                for k in 0..strips {
                    // The rear of the ring ahead, the front of the ring behind.
                    let edge = rings.edge(j * columns + k, j * columns + k + 1);
                    let v = rings.along(simd, &row[k], &row[k + 1], &edge);
                    if j > 0 {
                        matrix.add(simd, start, (j - 1) * strips + k, v);
                    }
                    if (j + 1) * columns < rings.nodes[0].len() {
                        let place = (j * strips + k) * matrix.stride + start;
                        f64::store(simd, &mut matrix.values[place..], simd.sub_f64s(zero, v));
                    }
                }
                for k in 0..if j > 0 { columns } else { 0 } {
                    let edge = rings.edge((j - 1) * columns + k, j * columns + k);
                    let v = rings.along(simd, &above[k], &row[k], &edge);
                    if k > 0 {
                        matrix.add(simd, start, (j - 1) * strips + k - 1, simd.sub_f64s(zero, v));
                    }
                    if k < strips {
                        matrix.add(simd, start, (j - 1) * strips + k, v);
                    }
                }
                std::mem::swap(&mut above, &mut row);
            }
        }
    }
}

/// Solves (own + image) Γ = b, where `own` never changes.
///
/// A rigid wing's influence on itself is inverted once; the image's is small next
/// to it, so that Γ ← own⁻¹ (b - image Γ) converges in a few products. Where it
/// does not (a wing which touches its image), the sum is factorised.
#[derive(Debug, Clone)]
pub struct Circulations {
    own: Matrix,
    inverse: Matrix,
    /// The image's influence, to be filled before each solution.
    pub image: Matrix,
    rest: Vec<f64>,
    next: Vec<f64>,
}

/// Largest change of a circulation, of the largest circulation, at which the iteration ends.
const CONVERGED: f64 = 1e-13;
/// Products after which the sum is factorised instead.
const PATIENCE: usize = 40;

impl Circulations {
    /// From the wing's influence on itself. `None` when that is singular.
    pub fn new(own: Matrix) -> Option<Self> {
        let inverse = Matrix::from_dense(&own.dense().try_inverse()?);
        let padded = vec![0.0; own.stride];
        let image = Matrix::zeros(own.rows, own.columns);
        Some(Self { own, inverse, image, rest: padded.clone(), next: padded })
    }

    /// Replaces a guess of Γ by the solution. `None` when there is none.
    pub fn solve(&mut self, rhs: &[f64], guess: &mut [f64]) -> Option<()> {
        for _ in 0..PATIENCE {
            self.image.times(guess, &mut self.rest);
            for (rest, b) in self.rest.iter_mut().zip(rhs) {
                *rest = b - *rest;
            }
            self.inverse.times(&self.rest[..rhs.len()], &mut self.next);
            let (mut change, mut size) = (0.0_f64, 0.0_f64);
            for (old, new) in guess.iter_mut().zip(&self.next) {
                change = change.max((*old - new).abs());
                size = size.max(new.abs());
                *old = *new;
            }
            if !size.is_finite() {
                return None;
            }
            if change <= CONVERGED * size {
                // Neither of the two counts what is not a number.
                return guess.iter().all(|g| g.is_finite()).then_some(());
            }
        }
        let solution = (self.own.dense() + self.image.dense()).lu().solve(&DVector::from_column_slice(rhs))?;
        guess.copy_from_slice(solution.as_slice());
        guess.iter().all(|g| g.is_finite()).then_some(())
    }
}
