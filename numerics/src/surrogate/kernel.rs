//! The arithmetic of the network over several samples at once.
//!
//! A lane is a sample. Every operation on a lane is one correctly rounded IEEE
//! operation (`mul_add` included), and lanes never mix, so the result of a
//! sample has the same bits whatever the width of the machine's registers and
//! wherever in a batch the sample stands. `pulp` merely picks the widest
//! instructions the processor has.

use crate::parameters::{Bounds, COUNT, Point};
use pulp::{Simd, WithSimd};

/// Registers of samples evaluated together: one alone would wait for each
/// multiplication to finish before it can start the next.
const DEEP: usize = 2;

/// Above this the hyperbolic tangent is 1 to the last bit of a double.
const SATURATION: f64 = 20.0;

/// 1.5 * 2^52: adding it leaves the nearest whole number in the low bits.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// ln 2 in two parts, the first with trailing zeros so that n * LN_2_HIGH is exact.
const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;

/// (exp(r) - 1 - r) / r^2 as its Taylor series, highest power first: 1/13! ... 1/2!.
/// For |r| <= ln(2)/2 the first term left out is 1.3e-17 of the sum.
const SERIES: [f64; 12] = [
    1.0 / 6_227_020_800.0,
    1.0 / 479_001_600.0,
    1.0 / 39_916_800.0,
    1.0 / 3_628_800.0,
    1.0 / 362_880.0,
    1.0 / 40_320.0,
    1.0 / 5_040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    1.0 / 2.0,
];

/// Hyperbolic tangent of each lane, relative error below 1e-15; NaN stays NaN.
///
/// tanh x = (e^2x - 1) / (e^2x + 1), with e^2x - 1 built from expm1 of the
/// reduced argument so that no digits cancel near zero.
#[inline(always)]
pub(super) fn tanh<S: Simd>(simd: S, x: S::f64s) -> S::f64s {
    let all = |v: f64| simd.splat_f64s(v);
    let inside = simd.min_f64s(simd.max_f64s(x, all(-SATURATION)), all(SATURATION));
    let y = simd.add_f64s(inside, inside);
    let rounded = simd.mul_add_f64s(y, all(std::f64::consts::LOG2_E), all(ROUNDER));
    let n = simd.sub_f64s(rounded, all(ROUNDER));
    let r = simd.mul_add_f64s(n, all(-LN_2_HIGH), y);
    let r = simd.mul_add_f64s(n, all(-LN_2_LOW), r);
    let mut q = all(SERIES[0]);
    for c in &SERIES[1..] {
        q = simd.mul_add_f64s(q, r, all(*c));
    }
    let p = simd.mul_add_f64s(simd.mul_f64s(r, r), q, r);
    // The low bits of `rounded` are n in two's complement; biased and shifted
    // they are the exponent field of 2^n.
    let mut power = rounded;
    let bits: &mut [u64] = pulp::bytemuck::cast_slice_mut(std::slice::from_mut(&mut power));
    for bits in bits {
        *bits = bits.wrapping_add(1023) << 52;
    }
    let e = simd.mul_add_f64s(power, p, simd.sub_f64s(power, all(1.0)));
    let result = simd.div_f64s(e, simd.add_f64s(e, all(2.0)));
    // Machines differ in which of two operands a minimum keeps beside a NaN.
    simd.select_f64s(simd.equal_f64s(x, x), result, x)
}

/// The layers of a network as slices, neuron by neuron.
#[derive(Clone, Copy)]
pub(crate) struct Layers<'a> {
    /// h x 10, row-major.
    pub(crate) hidden_weights: &'a [f64],
    /// h.
    pub(crate) hidden_biases: &'a [f64],
    /// Four rows of h.
    pub(crate) output_weights: [&'a [f64]; 4],
    /// One per output.
    pub(crate) output_biases: [f64; 4],
}

/// Outputs for DEEP registers of samples, `z[input]` their scaled inputs.
#[inline(always)]
fn outputs<S: Simd>(simd: S, net: &Layers<'_>, z: &[[S::f64s; DEEP]; COUNT]) -> [[S::f64s; DEEP]; 4] {
    let mut sums = net.output_biases.map(|b| [simd.splat_f64s(b); DEEP]);
    let [v0, v1, v2, v3] = net.output_weights;
    let (rows, _) = net.hidden_weights.as_chunks::<COUNT>();
    let neurons = rows.iter().zip(net.hidden_biases).zip(v0).zip(v1).zip(v2).zip(v3);
    for (((((w, b), v0), v1), v2), v3) in neurons {
        let mut a = [simd.splat_f64s(*b); DEEP];
        for i in 0..COUNT {
            let w = simd.splat_f64s(w[i]);
            for d in 0..DEEP {
                a[d] = simd.mul_add_f64s(w, z[i][d], a[d]);
            }
        }
        let v = [*v0, *v1, *v2, *v3];
        for d in 0..DEEP {
            let a = tanh(simd, a[d]);
            for k in 0..4 {
                sums[k][d] = simd.mul_add_f64s(simd.splat_f64s(v[k]), a, sums[k][d]);
            }
        }
    }
    sums
}

/// The network's answer to many samples, to be run by [`dispatch`].
pub(crate) struct Batch<'a> {
    /// The network.
    pub(crate) layers: Layers<'a>,
    /// The box of its inputs.
    pub(crate) bounds: &'a Bounds,
    /// Points in table units.
    pub(crate) xs: &'a [Point],
    /// One place per point.
    pub(crate) out: &'a mut [[f64; 4]],
}

impl WithSimd for Batch<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let lanes = DEEP * S::F64_LANES;
        for (xs, out) in self.xs.chunks(lanes).zip(self.out.chunks_mut(lanes)) {
            let mut z = [[simd.splat_f64s(0.0); DEEP]; COUNT];
            for (l, x) in xs.iter().enumerate() {
                let scaled = scaled(self.bounds, x);
                for i in 0..COUNT {
                    pulp::bytemuck::cast_slice_mut::<_, f64>(&mut z[i])[l] = scaled[i];
                }
            }
            let y = outputs(simd, &self.layers, &z);
            for k in 0..4 {
                let y = pulp::bytemuck::cast_slice::<_, f64>(&y[k]);
                for (out, y) in out.iter_mut().zip(y) {
                    out[k] = *y;
                }
            }
        }
    }
}

/// Inputs of the hidden layer: the box onto `[-1, 1]`, held parameters onto 0.
#[inline(always)]
pub(crate) fn scaled(bounds: &Bounds, x: &Point) -> Point {
    let mut z = [0.0; COUNT];
    for i in 0..COUNT {
        let span = bounds.upper[i] - bounds.lower[i];
        // Not `mul_add`: outside the kernels that is a function call.
        z[i] = if span > 0.0 { 2.0 * ((x[i] - bounds.lower[i]) / span) - 1.0 } else { 0.0 };
    }
    z
}

/// One neuron's answer to many samples, to be run by [`dispatch`].
pub(crate) struct Neuron<'a> {
    /// One weight per input, the bias last.
    pub(crate) weights: &'a [f64],
    /// Scaled inputs, each a column over the samples.
    pub(crate) inputs: &'a [Vec<f64>],
    /// The first sample wanted.
    pub(crate) start: usize,
    /// One place per sample wanted.
    pub(crate) out: &'a mut [f64],
}

impl WithSimd for Neuron<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Some((bias, weights)) = self.weights.split_last() else {
            return;
        };
        for (c, out) in self.out.chunks_mut(S::F64_LANES).enumerate() {
            let at = self.start + c * S::F64_LANES;
            let mut a = simd.splat_f64s(*bias);
            for (w, z) in weights.iter().zip(self.inputs) {
                let z = simd.partial_load_f64s(&z[at..at + out.len()]);
                a = simd.mul_add_f64s(simd.splat_f64s(*w), z, a);
            }
            simd.partial_store_f64s(out, tanh(simd, a));
        }
    }
}

/// Runs a kernel with the widest instructions the processor has.
///
/// Kernels are types, not closures: a closure is reached through a call which is
/// compiled without those instructions, where every `mul_add` is a function.
pub(crate) fn dispatch<K: WithSimd>(kernel: K) -> K::Output {
    pulp::Arch::new().dispatch(kernel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math;

    struct Tanh<'a>(&'a mut [f64]);

    impl WithSimd for Tanh<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            for x in self.0.chunks_mut(S::F64_LANES) {
                let y = tanh(simd, simd.partial_load_f64s(x));
                simd.partial_store_f64s(x, y);
            }
        }
    }

    #[test]
    fn tanh_agrees_with_the_library_and_with_one_lane() {
        let xs: Vec<f64> = (-400_000..=400_000).map(|i| f64::from(i) * 6.1e-5).collect();
        let (mut wide, mut single) = (xs.clone(), xs.clone());
        dispatch(Tanh(&mut wide));
        Tanh(&mut single).with_simd(pulp::Scalar);
        for ((x, wide), single) in xs.iter().zip(&wide).zip(&single) {
            let exact = math::tanh(*x);
            let error = (wide - exact).abs() / exact.abs().max(1e-300);
            assert!(error < 1e-15, "{x}: {error:e}");
            assert_eq!(wide.to_bits(), single.to_bits());
        }
    }

    #[test]
    fn tanh_at_its_ends() {
        let mut x = [0.0, f64::INFINITY, f64::NEG_INFINITY, 1e300, -25.0, 1e-200, f64::NAN];
        dispatch(Tanh(&mut x));
        assert_eq!(x[..5], [0.0, 1.0, -1.0, 1.0, -1.0]);
        assert!((x[5] / 1e-200 - 1.0).abs() < 1e-15 && x[6].is_nan());
    }
}
