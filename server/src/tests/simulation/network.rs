//! What becomes of a message on its way.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// When the copies of one message arrive, ms from now; none where it is lost.
pub(super) fn arrivals(rng: &mut ChaCha8Rng, faulty: bool) -> Vec<i64> {
    if !faulty {
        return vec![rng.random_range(1..50)];
    }
    if rng.random_bool(0.1) {
        return Vec::new();
    }
    let copies = if rng.random_bool(0.05) { 2 } else { 1 };
    let delay = |rng: &mut ChaCha8Rng| {
        if rng.random_bool(0.05) { rng.random_range(200..30_000) } else { rng.random_range(1..200) }
    };
    (0..copies).map(|_| delay(rng)).collect()
}
