//! Random points of the design box.

use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::parameters::{Bounds, COUNT, Point};

/// Draws per sample before the box is taken to hold nothing feasible.
const MOST_DRAWS: usize = 10_000;

/// Sample `index` of a study: the first draw of its own random stream which
/// `accept` takes, uniform over the accepted part of the box. A pure function of
/// bounds, seed and index; `None` when nothing acceptable is found.
pub fn sample(bounds: &Bounds, seed: u64, index: u64, accept: &dyn Fn(&Point) -> bool) -> Option<Point> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(index);
    (0..MOST_DRAWS).find_map(|_| {
        let unit: [f64; COUNT] = std::array::from_fn(|_| rng.random());
        let x = bounds.from_unit(&unit);
        accept(&x).then_some(x)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_depends_on_seed_and_index_alone() {
        let bounds = Bounds::default();
        let all = |_: &Point| true;
        let a = sample(&bounds, 7, 41, &all);
        assert_eq!(a, sample(&bounds, 7, 41, &all));
        assert_ne!(a, sample(&bounds, 7, 42, &all));
        assert_ne!(a, sample(&bounds, 8, 41, &all));
        assert_eq!(sample(&bounds, 7, 0, &|_| false), None);
    }
}
