//! Sobol's sequence: points which fill a box evenly.

use crate::surrogate::random::Streams;
use rand::Rng;

/// Most dimensions.
pub const MOST_DIMENSIONS: usize = 21;

/// Degree, coefficients and first direction numbers of dimensions 2 to 21 (Joe & Kuo
/// 2008, SIAM J. Sci. Comput. 30, the file `new-joe-kuo-6.21201`).
#[rustfmt::skip]
const DIRECTIONS: [(u32, u32, &[u32]); MOST_DIMENSIONS - 1] = [
    (1, 0, &[1]),
    (2, 1, &[1, 3]),
    (3, 1, &[1, 3, 1]),
    (3, 2, &[1, 1, 1]),
    (4, 1, &[1, 1, 3, 3]),
    (4, 4, &[1, 3, 5, 13]),
    (5, 2, &[1, 1, 5, 5, 17]),
    (5, 4, &[1, 1, 5, 5, 5]),
    (5, 7, &[1, 1, 7, 11, 19]),
    (5, 11, &[1, 1, 5, 1, 1]),
    (5, 13, &[1, 1, 1, 3, 11]),
    (5, 14, &[1, 3, 5, 5, 31]),
    (6, 1, &[1, 3, 3, 9, 7, 49]),
    (6, 13, &[1, 1, 1, 15, 21, 21]),
    (6, 16, &[1, 3, 1, 13, 27, 49]),
    (6, 19, &[1, 1, 1, 15, 7, 5]),
    (6, 22, &[1, 3, 1, 15, 13, 25]),
    (6, 25, &[1, 1, 5, 5, 19, 61]),
    (7, 1, &[1, 3, 7, 11, 23, 15, 103]),
    (7, 4, &[1, 3, 7, 13, 13, 15, 69]),
];

/// Bits of a coordinate; the sequence repeats after 2^32 points.
const BITS: usize = 32;

/// The sequence, shifted digit by digit by a seed: each shift is as even as the other
/// and each point uniform over all seeds.
#[derive(Debug, Clone)]
pub struct Sobol {
    directions: Vec<[u32; BITS]>,
    shift: Vec<u32>,
}

impl Sobol {
    /// A sequence in up to [`MOST_DIMENSIONS`] dimensions; none in more.
    pub fn new(dimensions: usize, seed: u64) -> Option<Self> {
        if dimensions > MOST_DIMENSIONS {
            return None;
        }
        let mut rng = Streams::new(seed).stream(0);
        let shift = (0..dimensions).map(|_| rng.next_u32()).collect();
        Some(Self { directions: (0..dimensions).map(directions).collect(), shift })
    }

    /// Point `index`, each coordinate in `[0, 1)`, into the beginning of `into`.
    pub fn point(&self, index: u32, into: &mut [f64]) {
        for ((directions, shift), into) in self.directions.iter().zip(&self.shift).zip(into) {
            let mut bits = *shift;
            for (b, direction) in directions.iter().enumerate() {
                if index >> b & 1 == 1 {
                    bits ^= direction;
                }
            }
            // Half a step in keeps 0 out.
            *into = (f64::from(bits) + 0.5) / 2f64.powi(BITS as i32);
        }
    }
}

/// Direction numbers of one dimension, as fractions of 2^32.
fn directions(dimension: usize) -> [u32; BITS] {
    let Some(before) = dimension.checked_sub(1) else {
        return std::array::from_fn(|b| 1 << (BITS - 1 - b));
    };
    let (degree, coefficients, first) = DIRECTIONS[before];
    let s = degree as usize;
    let mut v = [0; BITS];
    for b in 0..BITS {
        v[b] = match first.get(b) {
            Some(m) => m << (BITS - 1 - b),
            None => {
                let mut sum = v[b - s] ^ (v[b - s] >> s);
                for k in 1..s {
                    if coefficients >> (s - 1 - k) & 1 == 1 {
                        sum ^= v[b - k];
                    }
                }
                sum
            }
        };
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every elementary interval of 2^-8 has one of 256 points, in every dimension and shift.
    #[test]
    fn every_projection_is_stratified() {
        let sequence = Sobol::new(MOST_DIMENSIONS, 3).unwrap();
        let mut seen = vec![[false; 256]; MOST_DIMENSIONS];
        let mut point = [0.0; MOST_DIMENSIONS];
        for i in 0..256 {
            sequence.point(i, &mut point);
            for (seen, x) in seen.iter_mut().zip(point) {
                let cell = (x * 256.0) as usize;
                assert!(!seen[cell]);
                seen[cell] = true;
            }
        }
        assert!(Sobol::new(MOST_DIMENSIONS + 1, 0).is_none());
    }

    /// A point as SciPy 1.17 gives it (`scipy.stats.qmc.Sobol(21, scramble=False)`, whose
    /// order is Gray's: its point 900 is this one).
    #[test]
    #[rustfmt::skip]
    fn unshifted_points_are_those_of_other_codes() {
        let mut sequence = Sobol::new(MOST_DIMENSIONS, 0).unwrap();
        sequence.shift.fill(0);
        let mut point = [0.0; MOST_DIMENSIONS];
        sequence.point(900 ^ 450, &mut point);
        let exact = [
            0.3837890625, 0.0419921875, 0.6982421875, 0.4033203125, 0.2099609375, 0.0244140625,
            0.4912109375, 0.4228515625, 0.8212890625, 0.9521484375, 0.8271484375, 0.9970703125,
            0.6376953125, 0.2822265625, 0.6513671875, 0.8154296875, 0.7744140625, 0.2119140625,
            0.8583984375, 0.7490234375, 0.4677734375,
        ];
        assert!(point.iter().zip(exact).all(|(a, b)| (a - b).abs() < 1e-9), "{point:?}");
    }
}
