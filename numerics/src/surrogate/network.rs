//! The network itself: shape, checks and prediction.

use super::infer::{Batch, Jacobian, Packed, Slopes};
use crate::lanes;
use crate::parameters::{Bounds, COUNT, Point};
use rayon::prelude::*;

/// How many samples one parallel task predicts.
const TASK: usize = 512;

/// A network 10 -> h -> 4 with sigmoid hidden units and linear outputs.
///
/// ```text
/// z_i = 2 (x_i - lower_i) / (upper_i - lower_i) - 1     (paper Eq. 3 onto [-1, 1]; 0 if held)
/// a_j = tanh(sum_i hidden_weights[j, i] z_i + hidden_biases[j])
/// y_k = sum_j output_weights[k, j] a_j + output_biases[k]
/// ```
///
/// The hyperbolic tangent is the sigmoid symmetric about 0; weights and outputs
/// are dimensionless.
#[derive(Clone, PartialEq, Debug)]
pub struct Network {
    /// The box which is scaled to `[-1, 1]`, in table units.
    pub bounds: Bounds,
    /// Hidden weights, h x 10 row-major.
    pub hidden_weights: Vec<f64>,
    /// Hidden biases, h.
    pub hidden_biases: Vec<f64>,
    /// Output weights, 4 x h row-major.
    pub output_weights: Vec<f64>,
    /// Output biases.
    pub output_biases: [f64; 4],
}

/// Why numbers are not a network.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NetworkError {
    /// There are no neurons.
    #[error("a network needs at least one neuron")]
    Empty,
    /// There are no points.
    #[error("a gaussian process needs at least one point")]
    NoPoints,
    /// An array has the wrong length.
    #[error("{array} has {found} numbers; {expected} are needed")]
    Shape {
        /// Which array.
        array: &'static str,
        /// How many numbers it has.
        found: usize,
        /// How many it should have.
        expected: usize,
    },
    /// An array holds NaN or infinity.
    #[error("{array} holds a number which is not finite")]
    NotFinite {
        /// Which array.
        array: &'static str,
    },
    /// The bounds are not finite, or a lower one exceeds its upper one.
    #[error("bounds of parameter {index} are not finite and in order")]
    Bounds {
        /// Place in the parameter table.
        index: usize,
    },
}

/// The first parameter whose bounds are not finite and in order.
pub(crate) fn bad_bounds(bounds: &Bounds) -> Option<usize> {
    (0..COUNT).find(|&i| {
        let (lower, upper) = (bounds.lower[i], bounds.upper[i]);
        !(lower.is_finite() && upper.is_finite() && (upper - lower).is_finite() && lower <= upper)
    })
}

impl Network {
    /// A network from its numbers.
    ///
    /// # Errors
    /// When a length is wrong or a number is not finite.
    pub fn new_checked(
        bounds: Bounds,
        hidden_weights: Vec<f64>,
        hidden_biases: Vec<f64>,
        output_weights: Vec<f64>,
        output_biases: [f64; 4],
    ) -> Result<Self, NetworkError> {
        if let Some(index) = bad_bounds(&bounds) {
            return Err(NetworkError::Bounds { index });
        }
        let h = hidden_biases.len();
        if h == 0 {
            return Err(NetworkError::Empty);
        }
        let arrays: [(&'static str, &[f64], usize); 4] = [
            ("hidden_weights", &hidden_weights, h * COUNT),
            ("hidden_biases", &hidden_biases, h),
            ("output_weights", &output_weights, h * 4),
            ("output_biases", &output_biases, 4),
        ];
        for (array, numbers, expected) in arrays {
            if numbers.len() != expected {
                return Err(NetworkError::Shape { array, found: numbers.len(), expected });
            }
            if !numbers.iter().all(|v| v.is_finite()) {
                return Err(NetworkError::NotFinite { array });
            }
        }
        Ok(Self { bounds, hidden_weights, hidden_biases, output_weights, output_biases })
    }

    /// How many hidden neurons there are, h.
    pub fn neurons(&self) -> usize {
        self.hidden_biases.len()
    }

    /// The scaled means `[L+, D+, M+, P+]` at one point in table units.
    pub fn predict(&self, x: &Point) -> [f64; 4] {
        let mut out = [[0.0; 4]];
        let xs = std::slice::from_ref(x);
        lanes::dispatch(Batch { net: &Packed::new(self), xs, out: &mut out });
        out[0]
    }

    /// Predicts a batch in parallel; each result has the bits of [`Network::predict`].
    ///
    /// Where the two slices differ in length, the shorter one counts.
    pub fn predict_into(&self, xs: &[Point], out: &mut [[f64; 4]]) {
        let net = &Packed::new(self);
        xs.par_chunks(TASK).zip(out.par_chunks_mut(TASK)).for_each(|(xs, out)| {
            lanes::dispatch(Batch { net, xs, out });
        });
    }

    /// Outputs `[L+, D+, M+, P+]` at one point in table units, with the bits of
    /// [`Network::predict`], and their derivatives by the ten parameters, one row
    /// per output; those by held parameters are 0.
    pub fn jacobian(&self, x: &Point) -> Jacobian {
        let mut out = [([0.0; 4], [[0.0; COUNT]; 4])];
        self.jacobians_into(std::slice::from_ref(x), &mut out);
        out[0]
    }

    /// Jacobians of a batch, on the calling thread: a register full of points costs
    /// little more than one. Each result has the bits of [`Network::jacobian`].
    ///
    /// Where the two slices differ in length, the shorter one counts.
    pub fn jacobians_into(&self, xs: &[Point], out: &mut [Jacobian]) {
        lanes::dispatch(Slopes { net: &Packed::new(self), xs, out });
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::super::random::{Streams, uniform};
    use super::*;
    use crate::math;

    /// A network with random weights.
    pub(crate) fn random_network(h: usize, seed: u64) -> Network {
        let mut rng = Streams::new(seed).stream(0);
        let mut draw = |n: usize| -> Vec<f64> { (0..n).map(|_| 2.0 * uniform(&mut rng) - 1.0).collect() };
        let (w, b, v) = (draw(10 * h), draw(h), draw(4 * h));
        Network::new_checked(Bounds::default(), w, b, v, [0.1, 0.2, 0.3, 0.4]).unwrap()
    }

    /// Points spread over the box.
    pub(crate) fn random_points(n: usize, bounds: &Bounds, seed: u64) -> Vec<Point> {
        let mut rng = Streams::new(seed).stream(1);
        (0..n).map(|_| bounds.from_unit(&std::array::from_fn(|_| uniform(&mut rng)))).collect()
    }

    #[test]
    fn prediction_is_the_formula() {
        let net = random_network(7, 3);
        for x in random_points(20, &net.bounds, 4) {
            let z = net.bounds.to_unit(&x).map(|u| 2.0 * u - 1.0);
            for k in 0..4 {
                let mut y = net.output_biases[k];
                for j in 0..7 {
                    let a: f64 = (0..10).map(|i| net.hidden_weights[10 * j + i] * z[i]).sum();
                    y += net.output_weights[7 * k + j] * math::tanh(a + net.hidden_biases[j]);
                }
                assert!((net.predict(&x)[k] - y).abs() < 1e-13);
            }
        }
    }

    #[test]
    fn a_batch_has_the_bits_of_single_predictions() {
        let net = random_network(33, 5);
        let xs = random_points(1237, &net.bounds, 6);
        let mut out = vec![[0.0; 4]; xs.len()];
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| net.predict_into(&xs, &mut out));
            for (x, y) in xs.iter().zip(&out) {
                assert_eq!(net.predict(x), *y);
            }
        }
    }

    #[test]
    fn a_held_parameter_does_not_matter() {
        let mut net = random_network(5, 1);
        (net.bounds.lower[1], net.bounds.upper[1]) = (15.0, 15.0);
        let mut x = net.bounds.from_unit(&[0.3; COUNT]);
        let y = net.predict(&x);
        x[1] = 40.0;
        assert_eq!(net.predict(&x), y);
    }

    #[test]
    fn bad_numbers_are_refused() {
        let good = random_network(3, 1);
        let make =
            |w: Vec<f64>, b: Vec<f64>| Network::new_checked(good.bounds, w, b, good.output_weights.clone(), [0.0; 4]);
        assert!(matches!(make(vec![], vec![]), Err(NetworkError::Empty)));
        assert!(matches!(make(vec![0.0; 29], vec![0.0; 3]), Err(NetworkError::Shape { found: 29, expected: 30, .. })));
        assert!(matches!(
            make(vec![0.0; 30], vec![0.0, f64::NAN, 0.0]),
            Err(NetworkError::NotFinite { array: "hidden_biases" })
        ));
        let mut bounds = good.bounds;
        bounds.lower[2] = 99.0;
        let bad = Network::new_checked(bounds, vec![0.0; 10], vec![0.0], vec![0.0; 4], [0.0; 4]);
        assert_eq!(bad, Err(NetworkError::Bounds { index: 2 }));
    }
}
