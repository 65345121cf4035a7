//! The network's outputs and their derivatives, over several samples at once.
//!
//! ```text
//! dy_k/dz_i = sum_j v_kj (1 - a_j^2) w_ji          (4 x 10)
//! ```
//!
//! A lane is a sample, as in `kernel.rs`, and for the same reason: the bits of a
//! sample depend neither on the width of the registers nor on its neighbours.

use super::kernel::{Layers, scaled, tanh};
use crate::parameters::{Bounds, COUNT, Point};
use pulp::{Simd, WithSimd};

/// Neurons whose activations are kept between the two halves of the work: in the
/// second half ten sums stay in registers, which forty would not.
const BLOCK: usize = 64;

/// Outputs of the network at a point and their derivatives by the ten parameters,
/// one row per output, in table units.
pub type Jacobian = ([f64; 4], [[f64; COUNT]; 4]);

/// Outputs and derivatives at many points, to be run by `kernel::dispatch`.
pub(crate) struct Slopes<'a> {
    /// The network.
    pub(crate) layers: Layers<'a>,
    /// The box of its inputs.
    pub(crate) bounds: &'a Bounds,
    /// Points in table units.
    pub(crate) xs: &'a [Point],
    /// One place per point.
    pub(crate) out: &'a mut [Jacobian],
}

impl WithSimd for Slopes<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (xs, out) in self.xs.chunks(S::F64_LANES).zip(self.out.chunks_mut(S::F64_LANES)) {
            let mut z = [simd.splat_f64s(0.0); COUNT];
            for (l, x) in xs.iter().enumerate() {
                let scaled = scaled(self.bounds, x);
                for i in 0..COUNT {
                    pulp::bytemuck::cast_slice_mut::<_, f64>(&mut z[i..=i])[l] = scaled[i];
                }
            }
            let (y, slopes) = slopes(simd, &self.layers, &z);
            for k in 0..4 {
                let y = pulp::bytemuck::cast_slice::<_, f64>(&y[k..=k]);
                for (out, y) in out.iter_mut().zip(y) {
                    out.0[k] = *y;
                }
                for i in 0..COUNT {
                    let span = self.bounds.upper[i] - self.bounds.lower[i];
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

/// Outputs and derivatives by the scaled inputs `z`.
#[inline(always)]
fn slopes<S: Simd>(simd: S, net: &Layers<'_>, z: &[S::f64s; COUNT]) -> ([S::f64s; 4], [[S::f64s; COUNT]; 4]) {
    let mut y = [simd.splat_f64s(0.0); 4];
    for (y, bias) in y.iter_mut().zip(net.output_biases) {
        *y = simd.splat_f64s(bias);
    }
    let mut slopes = [[simd.splat_f64s(0.0); COUNT]; 4];
    let (rows, _) = net.hidden_weights.as_chunks::<COUNT>();
    let mut active = [simd.splat_f64s(0.0); BLOCK];
    for (block, (rows, biases)) in rows.chunks(BLOCK).zip(net.hidden_biases.chunks(BLOCK)).enumerate() {
        for ((a, w), b) in active.iter_mut().zip(rows).zip(biases) {
            let mut sum = simd.splat_f64s(*b);
            for i in 0..COUNT {
                sum = simd.mul_add_f64s(simd.splat_f64s(w[i]), z[i], sum);
            }
            *a = tanh(simd, sum);
        }
        for k in 0..4 {
            let weights = &net.output_weights[k][block * BLOCK..];
            for ((a, w), v) in active.iter().zip(rows).zip(weights) {
                let v = simd.splat_f64s(*v);
                y[k] = simd.mul_add_f64s(v, *a, y[k]);
                let steep = simd.mul_f64s(v, simd.negate_mul_add_f64s(*a, *a, simd.splat_f64s(1.0)));
                for i in 0..COUNT {
                    slopes[k][i] = simd.mul_add_f64s(steep, simd.splat_f64s(w[i]), slopes[k][i]);
                }
            }
        }
    }
    (y, slopes)
}

#[cfg(test)]
mod tests {
    use super::super::network::tests::{random_network, random_points};
    use super::*;

    #[test]
    fn the_derivatives_are_those_of_the_outputs() {
        let net = random_network(70, 8);
        for x in random_points(12, &net.bounds, 9) {
            let (y, slopes) = net.jacobian(&x);
            assert!(y.iter().zip(net.predict(&x)).all(|(a, b)| (a - b).abs() < 1e-13));
            for i in 0..COUNT {
                let step = 1e-5 * (net.bounds.upper[i] - net.bounds.lower[i]);
                let at = |shift: f64| {
                    let mut x = x;
                    x[i] += shift;
                    net.predict(&x)
                };
                let (low, high) = (at(-step), at(step));
                for k in 0..4 {
                    let difference = (high[k] - low[k]) / (2.0 * step);
                    let error = (slopes[k][i] - difference).abs() * step * 1e5;
                    assert!(error < 1e-8, "{k} {i}: {} against {difference}", slopes[k][i]);
                }
            }
        }
    }

    #[test]
    fn batches_and_narrow_registers_have_the_same_bits() {
        let net = random_network(130, 5);
        let xs = random_points(29, &net.bounds, 6);
        let empty = ([0.0; 4], [[0.0; COUNT]; 4]);
        let (mut wide, mut narrow) = (vec![empty; 29], vec![empty; 29]);
        net.jacobians_into(&xs, &mut wide);
        net.slopes(&xs, &mut narrow).with_simd(pulp::Scalar);
        assert_eq!(wide, narrow);
        assert!(xs.iter().zip(&wide).all(|(x, j)| net.jacobian(x) == *j));
    }

    #[test]
    fn a_held_parameter_has_no_slope() {
        let mut net = random_network(5, 1);
        (net.bounds.lower[1], net.bounds.upper[1]) = (15.0, 15.0);
        let (_, slopes) = net.jacobian(&net.bounds.from_unit(&[0.3; COUNT]));
        assert!(slopes.iter().all(|row| row[1] == 0.0 && row[2] != 0.0));
    }
}
