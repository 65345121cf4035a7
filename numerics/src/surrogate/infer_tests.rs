//! Prediction against plain arithmetic, and its bits.

use super::infer::{Batch, Packed, Slopes};
use super::network::tests::{random_network, random_points};
use crate::math;
use crate::parameters::COUNT;
use pulp::WithSimd;

/// Hidden sums from gentle to far beyond where 1 + 2^t would overflow: nothing but
/// rounding separates the prediction from the formula.
#[test]
fn steep_networks_are_predicted_too() {
    for factor in [1.0, 8.0, 40.0, 3e3] {
        let mut net = random_network(61, 12);
        net.hidden_weights.iter_mut().for_each(|w| *w *= factor);
        let mut xs = random_points(40, &net.bounds, 13);
        // Far outside the box.
        xs[7][0] += 600.0;
        let mut found = vec![[0.0; 4]; xs.len()];
        net.predict_into(&xs, &mut found);
        for (x, found) in xs.iter().zip(&found) {
            let z = net.bounds.to_unit(x).map(|u| 2.0 * u - 1.0);
            let mut expected = net.output_biases;
            for j in 0..61 {
                let sum: f64 = (0..COUNT).map(|i| net.hidden_weights[COUNT * j + i] * z[i]).sum();
                let active = math::tanh(sum + net.hidden_biases[j]);
                for (k, expected) in expected.iter_mut().enumerate() {
                    *expected += net.output_weights[61 * k + j] * active;
                }
            }
            for k in 0..4 {
                let error = (found[k] - expected[k]).abs();
                assert!(error < 2e-14 * factor.max(1.0), "{factor}: {error:e}");
            }
        }
    }
}

#[test]
fn what_is_not_a_number_stays_so() {
    let net = random_network(9, 2);
    assert!(net.predict(&[f64::NAN; COUNT]).iter().all(|y| y.is_nan()));
    let mut xs = random_points(3, &net.bounds, 1);
    let alone = net.predict(&xs[0]);
    (xs[1][4], xs[2][5]) = (f64::NAN, f64::INFINITY);
    let mut out = [[0.0; 4]; 3];
    net.predict_into(&xs, &mut out);
    assert_eq!(out[0], alone);
    assert!(out[1].iter().all(|y| y.is_nan()));
}

#[test]
fn narrow_registers_have_the_same_bits() {
    for factor in [1.0, 300.0] {
        let mut net = random_network(133, 5);
        net.hidden_weights.iter_mut().for_each(|w| *w *= factor);
        let xs = random_points(101, &net.bounds, 6);
        let (mut wide, mut narrow) = (vec![[0.0; 4]; 101], vec![[0.0; 4]; 101]);
        net.predict_into(&xs, &mut wide);
        Batch { net: &Packed::new(&net), xs: &xs, out: &mut narrow }.with_simd(pulp::Scalar);
        assert_eq!(wide, narrow);
    }
}

#[test]
fn the_derivatives_are_those_of_the_outputs() {
    let net = random_network(70, 8);
    for x in random_points(12, &net.bounds, 9) {
        let (y, slopes) = net.jacobian(&x);
        assert_eq!(y, net.predict(&x));
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
    Slopes { net: &Packed::new(&net), xs: &xs, out: &mut narrow }.with_simd(pulp::Scalar);
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
