//! Counter-based random streams: one per (seed, stream id).
//!
//! A stream belongs to what is drawn, not to the thread which draws it, so the
//! number of threads cannot change a result.

use crate::math;
use rand::{RngExt, SeedableRng};
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

/// Two independent standard normal numbers (Box & Muller 1958).
///
/// The sine and the cosine come from the portable library, so the numbers are
/// the same on every machine, and a fixed count of words is drawn.
pub(crate) fn normal_pair(rng: &mut ChaCha8Rng) -> [f64; 2] {
    // 1 - u lies in (0, 1], where the logarithm is finite.
    let radius = (-2.0 * math::ln(1.0 - uniform(rng))).sqrt();
    let (sin, cos) = math::sin_cos(std::f64::consts::TAU * uniform(rng));
    [radius * cos, radius * sin]
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
        let draws: Vec<f64> = (0..50_000).flat_map(|_| normal_pair(&mut rng)).collect();
        let n = draws.len() as f64;
        let mean = draws.iter().sum::<f64>() / n;
        let variance = draws.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / n;
        assert!(mean.abs() < 0.01 && (variance - 1.0).abs() < 0.02, "{mean} {variance}");
    }
}
