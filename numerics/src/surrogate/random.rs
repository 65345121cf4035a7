//! Counter-based random streams: one per (seed, stream id).
//!
//! A stream belongs to what is drawn, not to the thread which draws it, so the
//! number of threads cannot change a result.

use crate::lanes::{self, normal_pair};
use pulp::{Simd, WithSimd};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The source from which [`stream`] derives its streams; cheap to copy.
#[derive(Debug, Clone)]
pub(crate) struct Streams {
    root: ChaCha8Rng,
}

impl Streams {
    /// All streams of one seed.
    pub(crate) fn new(seed: u64) -> Self {
        Self { root: ChaCha8Rng::seed_from_u64(seed) }
    }

    /// Stream number `id` from its beginning.
    pub(crate) fn stream(&self, id: u64) -> ChaCha8Rng {
        let mut rng = self.root.clone();
        rng.set_stream(id);
        rng
    }
}

/// Uniform number in `[0, 1)`.
pub(crate) fn uniform(rng: &mut ChaCha8Rng) -> f64 {
    rng.random::<f64>()
}

/// Fills `out`, of even length, with independent standard normal numbers.
///
/// Two words are drawn for each two numbers; the first half of `out` has the cosines
/// of Box & Muller 1958, the second the sines, so that the width of the registers
/// does not matter.
pub(crate) fn normals(rng: &mut ChaCha8Rng, out: &mut [f64]) {
    const UNIT: f64 = 1.0 / (1u64 << 53) as f64;
    let (first, second) = out.split_at_mut(out.len() / 2);
    const PAIRS: usize = 64;
    for (first, second) in first.chunks_mut(PAIRS).zip(second.chunks_mut(PAIRS)) {
        let (mut angle, mut sign) = ([0.0; PAIRS], [1.0; PAIRS]);
        for (i, radius) in first.iter_mut().enumerate() {
            // 1 - u lies in (0, 1], where the logarithm is finite.
            *radius = 1.0 - (rng.next_u64() >> 11) as f64 * UNIT;
            let word = rng.next_u64();
            angle[i] = (word >> 11) as f64 * UNIT - 0.5;
            sign[i] = if word & 1 == 0 { 1.0 } else { -1.0 };
        }
        let count = first.len();
        lanes::dispatch(Normals { angle: &angle[..count], sign: &sign[..count], first, second });
    }
}

/// Box & Muller's numbers in place of `first`, the radii, and `second`.
struct Normals<'a> {
    angle: &'a [f64],
    sign: &'a [f64],
    first: &'a mut [f64],
    second: &'a mut [f64],
}

impl WithSimd for Normals<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let wide = S::F64_LANES;
        let uniform = self.angle.chunks(wide).zip(self.sign.chunks(wide));
        let out = self.first.chunks_mut(wide).zip(self.second.chunks_mut(wide));
        for ((angle, sign), (first, second)) in uniform.zip(out) {
            // Lanes without a number hold 0; what becomes of them is not stored.
            let radius = simd.partial_load_f64s(first);
            let [a, b] = normal_pair(simd, radius, simd.partial_load_f64s(angle), simd.partial_load_f64s(sign));
            simd.partial_store_f64s(first, a);
            simd.partial_store_f64s(second, b);
        }
    }
}

/// Shuffles in place (Fisher & Yates).
pub(crate) fn shuffle<T>(items: &mut [T], rng: &mut ChaCha8Rng) {
    for i in (1..items.len()).rev() {
        let j = rng.random_range(0..=i as u64) as usize;
        items.swap(i, j);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_from_each_other_and_repeat() {
        let streams = Streams::new(7);
        let draw = |id| uniform(&mut streams.stream(id));
        assert_eq!(draw(3), draw(3));
        assert_ne!(draw(3), draw(4));
        assert_ne!(draw(3), uniform(&mut Streams::new(8).stream(3)));
    }

    #[test]
    fn normal_numbers_have_mean_zero_and_variance_one() {
        let mut rng = Streams::new(1).stream(0);
        let mut draws = vec![0.0; 100_000];
        normals(&mut rng, &mut draws);
        let n = draws.len() as f64;
        let mean = draws.iter().sum::<f64>() / n;
        let variance = draws.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / n;
        assert!(mean.abs() < 0.01 && (variance - 1.0).abs() < 0.02, "{mean} {variance}");
        let kurtosis = draws.iter().map(|d| (d - mean).powi(4)).sum::<f64>() / n;
        let (first, second) = draws.split_at(50_000);
        let product = first.iter().zip(second).map(|(a, b)| a * b).sum::<f64>() / 50_000.0;
        assert!((kurtosis - 3.0).abs() < 0.1 && product.abs() < 0.02, "{kurtosis} {product}");
    }
}
