//! Sums over the points of a process. A lane is a stroke asked for: sums run over the
//! points in their order, so their bits depend neither on the registers nor on the batch.

use super::{Process, ProcessOutput};
use crate::lanes::exp;
use crate::parameters::{Bounds, COUNT, Point, at};
use crate::surrogate::Jacobian;
use crate::surrogate::features::MIRROR_SIGNS;
use crate::surrogate::kernel::scaled;
use pulp::{Simd, WithSimd};

/// The inputs of a process: the free parameters, those which the mirror reverses last.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Inputs {
    /// Places in the parameter table.
    pub(super) order: Vec<usize>,
    /// How many of them the mirror leaves alone.
    pub(super) even: usize,
}

impl Inputs {
    pub(super) fn new(bounds: &Bounds, mirror: bool) -> Self {
        let reversed = |i: usize| mirror && (i == at::SWEEP_MEAN || i == at::ROTATION_MEAN);
        let free = || (0..COUNT).filter(|&i| !bounds.is_held(i));
        let order: Vec<usize> = free().filter(|&i| !reversed(i)).chain(free().filter(|&i| reversed(i))).collect();
        let even = order.iter().filter(|&&i| !reversed(i)).count();
        Self { order, even }
    }

    /// A point's inputs, the box from -1 to 1.
    pub(super) fn of(&self, bounds: &Bounds, x: &Point) -> impl Iterator<Item = f64> {
        let z = scaled(bounds, x);
        self.order.iter().map(move |&i| z[i])
    }
}

/// A process laid out for prediction.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Packed {
    bounds: Bounds,
    inputs: Inputs,
    outputs: [PackedOutput; 4],
}

#[derive(Debug, Clone, PartialEq)]
struct PackedOutput {
    /// One over the lengths.
    inverse: Vec<f64>,
    /// The points' inputs over the lengths, row by row.
    points: Vec<f64>,
    /// Times a², or half of it beside mirror images.
    weights: Vec<f64>,
    mean: f64,
    /// What the mirror image's covariance is multiplied by.
    sign: Option<f64>,
}

impl Packed {
    pub(super) fn new(process: &Process, mirror: bool) -> Self {
        let inputs = Inputs::new(&process.bounds, mirror);
        let output = |(k, o): (usize, &ProcessOutput)| {
            let inverse: Vec<f64> = inputs.order.iter().map(|&i| 1.0 / o.lengths[i]).collect();
            let row = |x| inputs.of(&process.bounds, x).zip(&inverse).map(|(z, l)| z * l).collect::<Vec<_>>();
            let factor = o.amplitude * o.amplitude * if mirror { 0.5 } else { 1.0 };
            PackedOutput {
                points: process.points.iter().flat_map(row).collect(),
                weights: o.weights.iter().map(|w| factor * w).collect(),
                mean: o.mean,
                sign: mirror.then_some(MIRROR_SIGNS[k]),
                inverse,
            }
        };
        let outputs = std::array::from_fn(|k| output((k, &process.outputs[k])));
        Self { bounds: process.bounds, inputs, outputs }
    }

    /// Inputs of up to a register of points, not yet over lengths.
    #[inline(always)]
    fn load<S: Simd>(&self, simd: S, xs: &[Point]) -> [S::f64s; COUNT] {
        let mut z = [simd.splat_f64s(0.0); COUNT];
        for (lane, x) in xs.iter().enumerate() {
            let scaled = scaled(&self.bounds, x);
            for (z, &i) in z.iter_mut().zip(&self.inputs.order) {
                pulp::bytemuck::cast_slice_mut::<_, f64>(std::slice::from_mut(z))[lane] = scaled[i];
            }
        }
        z
    }
}

/// Differences from a point and from its mirror image, and the two covariances over a²,
/// the second with its sign.
struct Near<V> {
    apart: [V; COUNT],
    across: [V; COUNT],
    here: V,
    there: V,
}

/// How near the strokes asked for are to one point, all over lengths.
#[inline(always)]
fn near<S: Simd>(simd: S, z: &[S::f64s; COUNT], point: &[f64], even: usize, sign: Option<f64>) -> Near<S::f64s> {
    let zero = simd.splat_f64s(0.0);
    let (mut apart, mut across) = ([zero; COUNT], [zero; COUNT]);
    let mut squares = zero;
    for i in 0..even {
        apart[i] = simd.sub_f64s(z[i], simd.splat_f64s(point[i]));
        squares = simd.mul_add_f64s(apart[i], apart[i], squares);
    }
    let (mut here, mut there) = (squares, squares);
    for i in even..point.len() {
        let v = simd.splat_f64s(point[i]);
        (apart[i], across[i]) = (simd.sub_f64s(z[i], v), simd.add_f64s(z[i], v));
        here = simd.mul_add_f64s(apart[i], apart[i], here);
        there = simd.mul_add_f64s(across[i], across[i], there);
    }
    let half = simd.splat_f64s(-0.5);
    let here = exp(simd, simd.mul_f64s(here, half));
    let there = match sign {
        Some(sign) => simd.mul_f64s(simd.splat_f64s(sign), exp(simd, simd.mul_f64s(there, half))),
        None => zero,
    };
    Near { apart, across, here, there }
}

/// Inputs over an output's lengths.
#[inline(always)]
fn over<S: Simd>(simd: S, z: &[S::f64s; COUNT], inverse: &[f64]) -> [S::f64s; COUNT] {
    let mut scaled = *z;
    for (z, l) in scaled.iter_mut().zip(inverse) {
        *z = simd.mul_f64s(*z, simd.splat_f64s(*l));
    }
    scaled
}

/// The process's answer to many strokes, to be run by `lanes::dispatch`.
pub(super) struct Values<'a> {
    pub(super) packed: &'a Packed,
    pub(super) xs: &'a [Point],
    pub(super) out: &'a mut [[f64; 4]],
}

impl WithSimd for Values<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (width, even) = (self.packed.inputs.order.len(), self.packed.inputs.even);
        for (xs, out) in self.xs.chunks(S::F64_LANES).zip(self.out.chunks_mut(S::F64_LANES)) {
            let all = self.packed.load(simd, xs);
            for (k, output) in self.packed.outputs.iter().enumerate() {
                let z = over(simd, &all, &output.inverse);
                let mut sum = simd.splat_f64s(output.mean);
                for (point, weight) in output.points.chunks_exact(width.max(1)).zip(&output.weights) {
                    let near = near(simd, &z, point, even, output.sign);
                    sum = simd.mul_add_f64s(simd.splat_f64s(*weight), simd.add_f64s(near.here, near.there), sum);
                }
                let values = pulp::bytemuck::cast_slice::<_, f64>(std::slice::from_ref(&sum));
                for (out, value) in out.iter_mut().zip(values) {
                    out[k] = *value;
                }
            }
        }
    }
}

/// The same with derivatives by the ten parameters, in table units.
pub(super) struct Slopes<'a> {
    pub(super) packed: &'a Packed,
    pub(super) xs: &'a [Point],
    pub(super) out: &'a mut [Jacobian],
}

impl WithSimd for Slopes<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Packed { bounds, inputs, outputs } = self.packed;
        for (xs, out) in self.xs.chunks(S::F64_LANES).zip(self.out.chunks_mut(S::F64_LANES)) {
            let all = self.packed.load(simd, xs);
            for (k, output) in outputs.iter().enumerate() {
                let z = over(simd, &all, &output.inverse);
                let (sum, slopes) = summed(simd, output, &z, inputs);
                let values = pulp::bytemuck::cast_slice::<_, f64>(std::slice::from_ref(&sum));
                for (out, value) in out.iter_mut().zip(values) {
                    (out.0[k], out.1[k]) = (*value, [0.0; COUNT]);
                }
                for (n, &i) in inputs.order.iter().enumerate() {
                    let scale = 2.0 * output.inverse[n] / (bounds.upper[i] - bounds.lower[i]);
                    let slope = pulp::bytemuck::cast_slice::<_, f64>(std::slice::from_ref(&slopes[n]));
                    for (out, slope) in out.iter_mut().zip(slope) {
                        out.1[k][i] = scale * *slope;
                    }
                }
            }
        }
    }
}

/// An output and its derivatives by the inputs over lengths.
#[inline(always)]
fn summed<S: Simd>(
    simd: S,
    output: &PackedOutput,
    z: &[S::f64s; COUNT],
    inputs: &Inputs,
) -> (S::f64s, [S::f64s; COUNT]) {
    let (width, even) = (inputs.order.len(), inputs.even);
    let mut sum = simd.splat_f64s(output.mean);
    let mut slopes = [simd.splat_f64s(0.0); COUNT];
    for (point, weight) in output.points.chunks_exact(width.max(1)).zip(&output.weights) {
        let near = near(simd, z, point, even, output.sign);
        let weight = simd.splat_f64s(*weight);
        let both = simd.add_f64s(near.here, near.there);
        sum = simd.mul_add_f64s(weight, both, sum);
        let fall = simd.neg_f64s(weight);
        let (both, here, there) =
            (simd.mul_f64s(fall, both), simd.mul_f64s(fall, near.here), simd.mul_f64s(fall, near.there));
        let differences = near.apart.iter().zip(&near.across);
        for (i, (slope, (apart, across))) in slopes.iter_mut().zip(differences).take(width).enumerate() {
            if i < even {
                *slope = simd.mul_add_f64s(both, *apart, *slope);
            } else {
                *slope = simd.mul_add_f64s(there, *across, simd.mul_add_f64s(here, *apart, *slope));
            }
        }
    }
    (sum, slopes)
}
