//! Where training starts: the split of the samples and the first weights.

use super::Network;
use super::random::{Streams, shuffle, uniform};
use super::settings::FEWEST;
use crate::math;
use crate::parameters::{Bounds, COUNT};

/// Streams of the seed, one per use.
const SPLIT_STREAM: u64 = 1;
const WEIGHT_STREAM: u64 = 2;

/// Which sample serves for what, as indices in increasing order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Split {
    /// Samples the weights are fitted to.
    pub train: Vec<usize>,
    /// Samples which say when to stop.
    pub validation: Vec<usize>,
    /// Samples which only judge the result.
    pub test: Vec<usize>,
}

impl Split {
    /// The split which a training of this seed makes of `count` samples.
    pub fn new(count: usize, train_share: f64, validation_share: f64, seed: u64) -> Self {
        split(count, train_share, validation_share, seed)
    }
}

/// How many of `count` samples are for training, for validation and for testing.
pub(crate) fn sizes(count: usize, train_share: f64, validation_share: f64) -> [usize; 3] {
    let part = |share: f64| ((count as f64) * share).round() as usize;
    let train = part(train_share).min(count);
    let validation = part(validation_share).min(count - train);
    [train, validation, count - train - validation]
}

/// [`sizes`], with samples moved from the largest part to those which have fewer than `fewest`, as far as there are
/// any: some strokes of a study may turn out not to fly.
pub(crate) fn filled(count: usize, train_share: f64, validation_share: f64, fewest: usize) -> [usize; 3] {
    let mut sizes = sizes(count, train_share, validation_share);
    if count < 3 * fewest {
        return sizes;
    }
    while let Some(short) = sizes.iter().position(|size| *size < fewest) {
        let largest = (0..3).max_by_key(|part| sizes[*part]).unwrap_or(0);
        sizes[largest] -= 1;
        sizes[short] += 1;
    }
    sizes
}

/// A random split of `count` samples by the given shares; the rest is for testing.
pub(crate) fn split(count: usize, train_share: f64, validation_share: f64, seed: u64) -> Split {
    let mut order: Vec<usize> = (0..count).collect();
    shuffle(&mut order, &mut Streams::new(seed).stream(SPLIT_STREAM));
    let [train, validation, _] = filled(count, train_share, validation_share, FEWEST);
    let sorted = |slice: &[usize]| {
        let mut indices = slice.to_vec();
        indices.sort_unstable();
        indices
    };
    Split {
        train: sorted(&order[..train]),
        validation: sorted(&order[train..train + validation]),
        test: sorted(&order[train + validation..]),
    }
}

/// Seed of the first weights of network `index` of an ensemble.
pub(crate) fn member_seed(seed: u64, index: usize) -> u64 {
    // 2^64 over the golden ratio: neighbouring seeds have no member in common.
    seed.wrapping_add((index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

/// The first weights by the rule of Nguyen & Widrow 1990.
///
/// Each neuron gets a random direction of length 1.4 h^(1/n), n the number of
/// free inputs, and the biases spread evenly over the same length, so that the
/// active slopes of the h sigmoids tile the box; 1.4 is the rule's 0.7 times the
/// half-width 2 of the active range of tanh, as in MATLAB's `initnw`. Held
/// inputs get no weight. Output weights start at zero, output biases at the
/// means, so iteration 0 is the best constant and the first step solves the
/// output layer.
pub(crate) fn nguyen_widrow(bounds: &Bounds, h: usize, means: [f64; 4], seed: u64) -> Network {
    let mut rng = Streams::new(seed).stream(WEIGHT_STREAM);
    let free = (0..COUNT).filter(|&i| !bounds.is_held(i)).count().max(1);
    let length = 1.4 * math::powf(h as f64, 1.0 / free as f64);
    let mut hidden_weights = Vec::with_capacity(h * COUNT);
    let mut hidden_biases = Vec::with_capacity(h);
    for j in 0..h {
        let mut row: [f64; COUNT] = std::array::from_fn(|i| {
            let w = 2.0 * uniform(&mut rng) - 1.0;
            if bounds.is_held(i) { 0.0 } else { w }
        });
        let norm = row.iter().map(|w| w * w).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
        for w in row.iter_mut().filter(|w| **w != 0.0) {
            *w *= length / norm;
        }
        let even = if h > 1 { 2.0 * j as f64 / (h - 1) as f64 - 1.0 } else { 0.0 };
        let first = row.iter().find(|w| **w != 0.0).copied().unwrap_or(1.0);
        hidden_weights.extend(row);
        hidden_biases.push(length * even * first.signum());
    }
    Network { bounds: *bounds, hidden_weights, hidden_biases, output_weights: vec![0.0; 4 * h], output_biases: means }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_split_is_a_partition_by_the_shares() {
        let s = split(101, 0.8, 0.1, 5);
        assert_eq!((s.train.len(), s.validation.len(), s.test.len()), (81, 10, 10));
        let mut all = [s.train.clone(), s.validation.clone(), s.test.clone()].concat();
        all.sort_unstable();
        assert_eq!(all, (0..101).collect::<Vec<_>>());
        assert_eq!(s, split(101, 0.8, 0.1, 5));
        assert_ne!(s, split(101, 0.8, 0.1, 6));
    }

    #[test]
    fn a_part_which_would_be_too_small_is_filled() {
        assert_eq!(filled(101, 0.8, 0.1, 2), sizes(101, 0.8, 0.1));
        assert_eq!((sizes(30, 0.9, 0.05), filled(30, 0.9, 0.05, 2)), ([27, 2, 1], [26, 2, 2]));
        assert_eq!(filled(6, 0.9, 0.05, 2), [2, 2, 2]);
        assert_eq!(filled(5, 0.8, 0.1, 2), sizes(5, 0.8, 0.1), "there are too few for three parts");
    }

    #[test]
    fn held_inputs_get_no_weight_and_rows_have_the_rules_length() {
        let mut bounds = Bounds::default();
        bounds.upper[3] = bounds.lower[3];
        let net = nguyen_widrow(&bounds, 20, [1.0; 4], 0);
        let length = 1.4 * math::powf(20.0, 1.0 / 9.0);
        for row in net.hidden_weights.chunks(COUNT) {
            assert_eq!(row[3], 0.0);
            let norm = row.iter().map(|w| w * w).sum::<f64>().sqrt();
            assert!((norm - length).abs() < 1e-12);
        }
        assert_eq!(net.predict(&bounds.lower), [1.0; 4]);
    }
}
