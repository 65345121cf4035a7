//! Prediction and its derivatives over many samples at once.
//!
//! ```text
//! tanh a = 1 - 2 q,   q = 1 / (1 + 2^t),   t = 2 a log2 e
//! y_k = b_k - 2 sum_j v_kj (q_j - 1/2)
//! dy_k/dz_i = sum_j v_kj (1 - tanh^2 a_j) w_ji
//! ```
//!
//! A lane is a sample, as in `kernel.rs`: the bits of a sample depend neither on
//! the width of the registers nor on its neighbours. The factor 2 log2 e is part
//! of the inputs and biases, so that the argument of 2^t is split exactly. A block
//! of neurons passes three loops which each keep their constants in registers: the
//! sums of the hidden layer, the sigmoid, the sums of the output layer. Two neurons
//! share one division, which would else bound the rate.

use super::Network;
use super::kernel::scaled;
use crate::parameters::{Bounds, COUNT, Point};
use pulp::{Simd, WithSimd};

/// Neurons of a block, an even number: its activations stay in the first-level cache.
const BLOCK: usize = 32;

/// Registers of samples predicted together.
const DEEP: usize = 2;

/// 2 log2 e, which makes e^2a of a hidden sum a a power of two.
const BASE: f64 = 2.0 * std::f64::consts::LOG2_E;

/// Largest |t|: the product of two 1 + 2^t must not overflow.
const LARGEST: f64 = 500.0;

/// Inputs up to this magnitude are promised; the box itself is `[-1, 1]`.
const REACH: f64 = 2.0;

/// 1.5 * 2^52 + 1023: adding it leaves the nearest whole number in the low bits,
/// biased as the exponent of a double is.
const ROUNDER: f64 = 6_755_399_441_056_767.0;

/// 2^f for |f| <= 1/2, interpolated at Chebyshev's points, highest power first;
/// relative error 2.9e-16.
const POWER: [f64; 11] = [
    7.072_585_949_269_223e-9,
    1.020_869_029_995_830_6e-7,
    1.321_544_258_792_169e-6,
    1.525_265_726_020_083_7e-5,
    1.540_353_044_173_605e-4,
    1.333_355_823_016_497_4e-3,
    9.618_129_107_606_888e-3,
    5.550_410_866_444_772e-2,
    2.402_265_069_591_009_7e-1,
    6.931_471_805_599_5e-1,
    1.0,
];

/// Outputs of the network at a point and their derivatives by the ten parameters,
/// one row per output, in table units.
pub type Jacobian = ([f64; 4], [[f64; COUNT]; 4]);

/// A network laid out for prediction: neuron by neuron, an even number of them.
pub(super) struct Packed {
    bounds: Bounds,
    weights: Vec<[f64; COUNT]>,
    /// Times [`BASE`].
    biases: Vec<f64>,
    /// Times -2.
    output_weights: Vec<[f64; 4]>,
    output_biases: [f64; 4],
    /// Whether some input within [`REACH`] could make |t| exceed [`LARGEST`].
    steep: bool,
}

impl Packed {
    pub(super) fn new(net: &Network) -> Self {
        let h = net.neurons();
        let even = h.next_multiple_of(2);
        let (rows, _) = net.hidden_weights.as_chunks::<COUNT>();
        let mut weights = rows.to_vec();
        weights.resize(even, [0.0; COUNT]);
        let mut biases: Vec<f64> = net.hidden_biases.iter().map(|b| BASE * b).collect();
        biases.resize(even, 0.0);
        let mut output_weights = vec![[0.0; 4]; even];
        for (k, row) in net.output_weights.chunks(h).take(4).enumerate() {
            for (place, v) in output_weights.iter_mut().zip(row) {
                place[k] = -2.0 * v;
            }
        }
        let most = |w: &[f64; COUNT]| BASE * REACH * w.iter().map(|w| w.abs()).sum::<f64>();
        // A sum which is not a number is steep, too.
        let steep = !weights.iter().zip(&biases).all(|(w, b)| most(w) + b.abs() < LARGEST);
        Self { bounds: net.bounds, weights, biases, output_weights, output_biases: net.output_biases, steep }
    }

    /// Scaled inputs of up to a register of points, times [`BASE`], and whether one
    /// of them makes it necessary to limit t.
    #[inline(always)]
    fn inputs<S: Simd>(&self, simd: S, xs: &[Point]) -> ([S::f64s; COUNT], bool) {
        let mut z = [simd.splat_f64s(0.0); COUNT];
        let mut within = !self.steep;
        for (l, x) in xs.iter().enumerate() {
            let scaled = scaled(&self.bounds, x);
            for i in 0..COUNT {
                within &= scaled[i].abs() <= REACH;
                pulp::bytemuck::cast_slice_mut::<_, f64>(&mut z[i..=i])[l] = BASE * scaled[i];
            }
        }
        (z, !within)
    }
}

/// 1 + 2^t; NaN stays NaN.
#[inline(always)]
fn one_and_power<S: Simd>(simd: S, t: S::f64s) -> S::f64s {
    let rounder = simd.splat_f64s(ROUNDER);
    let rounded = simd.add_f64s(t, rounder);
    let f = simd.sub_f64s(t, simd.sub_f64s(rounded, rounder));
    let mut p = simd.splat_f64s(POWER[0]);
    for c in &POWER[1..] {
        p = simd.mul_add_f64s(p, f, simd.splat_f64s(*c));
    }
    let mut power = rounded;
    let bits: &mut [u64] = pulp::bytemuck::cast_slice_mut(std::slice::from_mut(&mut power));
    for bits in bits {
        *bits <<= 52;
    }
    simd.mul_add_f64s(power, p, simd.splat_f64s(1.0))
}

/// t within [`LARGEST`]: beyond it tanh is 1 to the last bit.
#[inline(always)]
fn limited<S: Simd>(simd: S, t: S::f64s) -> S::f64s {
    let all = |v: f64| simd.splat_f64s(v);
    let inside = simd.min_f64s(simd.max_f64s(t, all(-LARGEST)), all(LARGEST));
    // Machines differ in which of two operands a minimum keeps beside a NaN.
    simd.select_f64s(simd.equal_f64s(t, t), inside, t)
}

/// One block of hidden neurons: q - 1/2 of each, for D registers of samples.
#[inline(always)]
fn activate<S: Simd, const D: usize>(
    simd: S,
    (weights, biases): (&[[f64; COUNT]], &[f64]),
    z: &[[S::f64s; COUNT]; D],
    limit: bool,
    active: &mut [[S::f64s; D]; BLOCK],
) {
    for ((t, w), b) in active.iter_mut().zip(weights).zip(biases) {
        let mut sums = [simd.splat_f64s(*b); D];
        for i in 0..COUNT {
            let w = simd.splat_f64s(w[i]);
            for d in 0..D {
                sums[d] = simd.mul_add_f64s(w, z[d][i], sums[d]);
            }
        }
        *t = sums;
    }
    if limit {
        for t in active.iter_mut().flatten() {
            *t = limited(simd, *t);
        }
    }
    let half = simd.splat_f64s(0.5);
    let (pairs, _) = active.as_chunks_mut::<2>();
    for [first, second] in &mut pairs[..weights.len() / 2] {
        for (a, b) in first.iter_mut().zip(second) {
            let (one, two) = (one_and_power(simd, *a), one_and_power(simd, *b));
            let inverse = simd.div_f64s(simd.splat_f64s(1.0), simd.mul_f64s(one, two));
            *a = simd.sub_f64s(simd.mul_f64s(inverse, two), half);
            *b = simd.sub_f64s(simd.mul_f64s(inverse, one), half);
        }
    }
}

/// Outputs for D registers of samples.
#[inline(always)]
fn outputs<S: Simd, const D: usize>(
    simd: S,
    net: &Packed,
    z: &[[S::f64s; COUNT]; D],
    limit: bool,
) -> [[S::f64s; D]; 4] {
    let mut sums = [[simd.splat_f64s(0.0); D]; 4];
    for (sums, bias) in sums.iter_mut().zip(net.output_biases) {
        *sums = [simd.splat_f64s(bias); D];
    }
    let mut active = [[simd.splat_f64s(0.0); D]; BLOCK];
    let blocks = net.weights.chunks(BLOCK).zip(net.biases.chunks(BLOCK));
    for (hidden, output) in blocks.zip(net.output_weights.chunks(BLOCK)) {
        activate(simd, hidden, z, limit, &mut active);
        for (q, v) in active.iter().zip(output) {
            for k in 0..4 {
                let v = simd.splat_f64s(v[k]);
                for d in 0..D {
                    sums[k][d] = simd.mul_add_f64s(v, q[d], sums[k][d]);
                }
            }
        }
    }
    sums
}

/// The network's answer to many samples, to be run by `lanes::dispatch`.
pub(super) struct Batch<'a> {
    /// The network.
    pub(super) net: &'a Packed,
    /// Points in table units.
    pub(super) xs: &'a [Point],
    /// One place per point.
    pub(super) out: &'a mut [[f64; 4]],
}

impl WithSimd for Batch<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let lanes = S::F64_LANES;
        for (xs, out) in self.xs.chunks(DEEP * lanes).zip(self.out.chunks_mut(DEEP * lanes)) {
            let mut z = [[simd.splat_f64s(0.0); COUNT]; DEEP];
            let mut limit = false;
            for (z, xs) in z.iter_mut().zip(xs.chunks(lanes)) {
                let (inputs, limited) = self.net.inputs(simd, xs);
                *z = inputs;
                limit |= limited;
            }
            let y = outputs(simd, self.net, &z, limit);
            for k in 0..4 {
                let y = pulp::bytemuck::cast_slice::<_, f64>(&y[k]);
                for (out, y) in out.iter_mut().zip(y) {
                    out[k] = *y;
                }
            }
        }
    }
}

/// Outputs and their derivatives by the scaled inputs, for one register of samples.
#[inline(always)]
fn slopes<S: Simd>(
    simd: S,
    net: &Packed,
    z: &[[S::f64s; COUNT]; 1],
    limit: bool,
) -> ([S::f64s; 4], [[S::f64s; COUNT]; 4]) {
    let mut y = [simd.splat_f64s(0.0); 4];
    for (y, bias) in y.iter_mut().zip(net.output_biases) {
        *y = simd.splat_f64s(bias);
    }
    let mut slopes = [[simd.splat_f64s(0.0); COUNT]; 4];
    let mut active = [[simd.splat_f64s(0.0); 1]; BLOCK];
    let blocks = net.weights.chunks(BLOCK).zip(net.biases.chunks(BLOCK));
    for (hidden, output) in blocks.zip(net.output_weights.chunks(BLOCK)) {
        activate(simd, hidden, z, limit, &mut active);
        for k in 0..4 {
            // Ten sums stay in registers, which forty would not.
            let mut row = slopes[k];
            for (([q], v), w) in active.iter().zip(output).zip(hidden.0) {
                let v = simd.splat_f64s(v[k]);
                y[k] = simd.mul_add_f64s(v, *q, y[k]);
                // v is -2 times the weight: -v (1/2 - 2 q^2) = weight (1 - tanh^2).
                let square = simd.mul_f64s(*q, *q);
                let steep = simd.mul_add_f64s(square, simd.splat_f64s(2.0), simd.splat_f64s(-0.5));
                let steep = simd.mul_f64s(v, steep);
                for i in 0..COUNT {
                    row[i] = simd.mul_add_f64s(steep, simd.splat_f64s(w[i]), row[i]);
                }
            }
            slopes[k] = row;
        }
    }
    (y, slopes)
}

/// Outputs and derivatives at many points, to be run by `lanes::dispatch`.
pub(super) struct Slopes<'a> {
    /// The network.
    pub(super) net: &'a Packed,
    /// Points in table units.
    pub(super) xs: &'a [Point],
    /// One place per point.
    pub(super) out: &'a mut [Jacobian],
}

impl WithSimd for Slopes<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let bounds = &self.net.bounds;
        for (xs, out) in self.xs.chunks(S::F64_LANES).zip(self.out.chunks_mut(S::F64_LANES)) {
            let (z, limit) = self.net.inputs(simd, xs);
            let (y, slopes) = slopes(simd, self.net, &[z], limit);
            for k in 0..4 {
                let y = pulp::bytemuck::cast_slice::<_, f64>(&y[k..=k]);
                for (out, y) in out.iter_mut().zip(y) {
                    out.0[k] = *y;
                }
                for i in 0..COUNT {
                    let span = bounds.upper[i] - bounds.lower[i];
                    let scale = if span > 0.0 { 2.0 / span } else { 0.0 };
                    let slope = pulp::bytemuck::cast_slice::<_, f64>(&slopes[k][i..=i]);
                    for (out, slope) in out.iter_mut().zip(slope) {
                        out.1[k][i] = scale * *slope;
                    }
                }
            }
        }
    }
}
