//! The hidden layer as training needs it, over several samples at once.
//!
//! A lane is a sample. Every operation on a lane is one correctly rounded IEEE
//! operation (`mul_add` included), and lanes never mix, so the result of a
//! sample has the same bits whatever the width of the machine's registers and
//! wherever in a batch the sample stands.

pub(crate) use crate::lanes::dispatch;
use crate::lanes::tanh;
use crate::parameters::{Bounds, COUNT, Point};
use pulp::{Simd, WithSimd};

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

/// One neuron's answer to many samples, to be run by `lanes::dispatch`.
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
