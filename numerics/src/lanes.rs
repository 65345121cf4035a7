//! Elementary functions of each lane of a register.
//!
//! Every operation is one correctly rounded IEEE operation and lanes never mix, so
//! a value has the same bits whatever the width of the machine's registers. `pulp`
//! merely picks the widest instructions the processor has.

use std::f64::consts::FRAC_PI_2;

use pulp::{Simd, WithSimd};

/// Runs a kernel with the widest instructions the processor has.
///
/// Kernels are types, not closures: a closure is reached through a call which is
/// compiled without those instructions, where every `mul_add` is a function.
pub(crate) fn dispatch<K: WithSimd>(kernel: K) -> K::Output {
    pulp::Arch::new().dispatch(kernel)
}

/// Above this the hyperbolic tangent is 1 to the last bit of a double.
const SATURATION: f64 = 20.0;

/// 1.5 * 2^52: adding it leaves the nearest whole number in the low bits.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// ln 2 in two parts, the first with trailing zeros so that n * LN_2_HIGH is exact.
const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;

/// (exp(r) - 1 - r) / r^2 as its Taylor series, highest power first: 1/13! ... 1/2!.
/// For |r| <= ln(2)/2 the first term left out is 1.3e-17 of the sum.
const SERIES: [f64; 12] = [
    1.0 / 6_227_020_800.0,
    1.0 / 479_001_600.0,
    1.0 / 39_916_800.0,
    1.0 / 3_628_800.0,
    1.0 / 362_880.0,
    1.0 / 40_320.0,
    1.0 / 5_040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    1.0 / 2.0,
];

/// Hyperbolic tangent of each lane, relative error below 1e-15; NaN stays NaN.
///
/// tanh x = (e^2x - 1) / (e^2x + 1), with e^2x - 1 built from expm1 of the
/// reduced argument so that no digits cancel near zero.
#[inline(always)]
pub(crate) fn tanh<S: Simd>(simd: S, x: S::f64s) -> S::f64s {
    let all = |v: f64| simd.splat_f64s(v);
    let inside = simd.min_f64s(simd.max_f64s(x, all(-SATURATION)), all(SATURATION));
    let (power, p) = power_and_rest(simd, simd.add_f64s(inside, inside));
    let e = simd.mul_add_f64s(power, p, simd.sub_f64s(power, all(1.0)));
    let result = simd.div_f64s(e, simd.add_f64s(e, all(2.0)));
    // Machines differ in which of two operands a minimum keeps beside a NaN.
    simd.select_f64s(simd.equal_f64s(x, x), result, x)
}

/// Below this the exponential's power of two would leave the normal numbers.
const LEAST_EXPONENT: f64 = -700.0;

/// e^x of each lane for x <= 0, relative error below 1e-15; e^-700 below that; NaN stays NaN.
#[inline(always)]
pub(crate) fn exp<S: Simd>(simd: S, x: S::f64s) -> S::f64s {
    let inside = simd.max_f64s(x, simd.splat_f64s(LEAST_EXPONENT));
    let (power, p) = power_and_rest(simd, inside);
    simd.select_f64s(simd.equal_f64s(x, x), simd.mul_add_f64s(power, p, power), x)
}

/// e^y = 2^n (1 + p): the power of two and p, |ln(1 + p)| <= ln(2)/2.
#[inline(always)]
fn power_and_rest<S: Simd>(simd: S, y: S::f64s) -> (S::f64s, S::f64s) {
    let all = |v: f64| simd.splat_f64s(v);
    let rounded = simd.mul_add_f64s(y, all(std::f64::consts::LOG2_E), all(ROUNDER));
    let n = simd.sub_f64s(rounded, all(ROUNDER));
    let r = simd.mul_add_f64s(n, all(-LN_2_HIGH), y);
    let r = simd.mul_add_f64s(n, all(-LN_2_LOW), r);
    let mut q = all(SERIES[0]);
    for c in &SERIES[1..] {
        q = simd.mul_add_f64s(q, r, all(*c));
    }
    let p = simd.mul_add_f64s(simd.mul_f64s(r, r), q, r);
    // The low bits of `rounded` are n in two's complement; biased and shifted
    // they are the exponent field of 2^n.
    let mut power = rounded;
    let bits: &mut [u64] = pulp::bytemuck::cast_slice_mut(std::slice::from_mut(&mut power));
    for bits in bits {
        *bits = bits.wrapping_add(1023) << 52;
    }
    (power, p)
}

/// sin x = x + x^3 (...): Taylor's series in x^2, highest power first, 1/19! ... 1/3!.
const SINE: [f64; 9] = [
    -1.0 / 121_645_100_408_832_000.0,
    1.0 / 355_687_428_096_000.0,
    -1.0 / 1_307_674_368_000.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 39_916_800.0,
    1.0 / 362_880.0,
    -1.0 / 5_040.0,
    1.0 / 120.0,
    -1.0 / 6.0,
];

/// cos x = 1 + x^2 (...): Taylor's series in x^2, highest power first, 1/20! ... 1/2!.
const COSINE: [f64; 10] = [
    1.0 / 2_432_902_008_176_640_000.0,
    -1.0 / 6_402_373_705_728_000.0,
    1.0 / 20_922_789_888_000.0,
    -1.0 / 87_178_291_200.0,
    1.0 / 479_001_600.0,
    -1.0 / 3_628_800.0,
    1.0 / 40_320.0,
    -1.0 / 720.0,
    1.0 / 24.0,
    -1.0 / 2.0,
];

/// asin(v) / v as a polynomial in v^2, highest power first, interpolated at
/// Chebyshev's points of 0 <= v^2 <= 1/4; relative error 2.5e-16.
const ARCSINE: [f64; 12] = [
    0.031_504_776_751_624_31,
    -0.011_693_559_679_531_318,
    0.018_256_370_242_133_53,
    0.009_376_473_481_056_654,
    0.014_324_235_149_944_57,
    0.017_313_700_945_909_897,
    0.022_374_928_823_605_693,
    0.030_381_820_752_221_768,
    0.044_642_860_386_031_56,
    0.074_999_999_956_244_15,
    0.166_666_666_666_897_06,
    0.999_999_999_999_999_8,
];

/// A polynomial, highest power first.
#[inline(always)]
fn polynomial<S: Simd>(simd: S, x: S::f64s, coefficients: &[f64]) -> S::f64s {
    let mut sum = simd.splat_f64s(0.0);
    for c in coefficients {
        sum = simd.mul_add_f64s(sum, x, simd.splat_f64s(*c));
    }
    sum
}

/// Sine and cosine of each lane for |x| <= pi/2, absolute error below 1e-15.
#[inline(always)]
pub(crate) fn sin_cos<S: Simd>(simd: S, x: S::f64s) -> (S::f64s, S::f64s) {
    let square = simd.mul_f64s(x, x);
    let odd = simd.mul_f64s(simd.mul_f64s(x, square), polynomial(simd, square, &SINE));
    let even = polynomial(simd, square, &COSINE);
    (simd.add_f64s(x, odd), simd.mul_add_f64s(square, even, simd.splat_f64s(1.0)))
}

/// Inverse sine of each lane for 0 <= x <= 1, absolute error below 1e-15.
#[inline(always)]
pub(crate) fn asin<S: Simd>(simd: S, x: S::f64s) -> S::f64s {
    let all = |v: f64| simd.splat_f64s(v);
    let large = simd.greater_than_f64s(x, all(0.5));
    // asin x = pi/2 - 2 asin(sqrt((1 - x) / 2)).
    let mirrored = simd.mul_add_f64s(x, all(-0.5), all(0.5));
    let square = simd.select_f64s(large, mirrored, simd.mul_f64s(x, x));
    let v = simd.select_f64s(large, simd.sqrt_f64s(mirrored), x);
    let angle = simd.mul_f64s(v, polynomial(simd, square, &ARCSINE));
    simd.select_f64s(large, simd.mul_add_f64s(angle, all(-2.0), all(FRAC_PI_2)), angle)
}

/// 2 / (2 n + 1) from n = 8 to 0: ln m = s (...) in s^2 with s = (m - 1) / (m + 1).
const LOGARITHM: [f64; 9] =
    [2.0 / 17.0, 2.0 / 15.0, 2.0 / 13.0, 2.0 / 11.0, 2.0 / 9.0, 2.0 / 7.0, 2.0 / 5.0, 2.0 / 3.0, 2.0];

/// Two lanes of independent standard normal numbers (Box & Muller 1958) from three
/// of uniform ones: `radius` in (0, 1], `angle` in [-1/2, 1/2] and a `sign`, 1 or -1.
///
/// The logarithm's relative error is below 1e-12.
#[inline(always)]
pub(crate) fn normal_pair<S: Simd>(simd: S, radius: S::f64s, angle: S::f64s, sign: S::f64s) -> [S::f64s; 2] {
    let all = |v: f64| simd.splat_f64s(v);
    // x = m 2^e with sqrt(1/2) <= m < sqrt(2): the bits of sqrt(1/2) are taken off
    // before the exponent is.
    const HALF_ROOT: u64 = 0x3fe6_a09e_667f_3bcd;
    const MANTISSA: u64 = (1 << 52) - 1;
    // 2^52 as bits: a small whole number below it, read as a double, is itself plus 2^52.
    const WHOLE: u64 = 0x4330_0000_0000_0000;
    let (mut mantissa, mut exponent) = (radius, radius);
    let m: &mut [u64] = pulp::bytemuck::cast_slice_mut(std::slice::from_mut(&mut mantissa));
    let e: &mut [u64] = pulp::bytemuck::cast_slice_mut(std::slice::from_mut(&mut exponent));
    for (m, e) in m.iter_mut().zip(e) {
        let shifted = m.wrapping_sub(HALF_ROOT).wrapping_add(1 << 62);
        *m = (shifted & MANTISSA).wrapping_add(HALF_ROOT);
        *e = (shifted >> 52) | WHOLE;
    }
    let e = simd.sub_f64s(exponent, all(4_503_599_627_370_496.0 + 1024.0));
    let one = all(1.0);
    let s = simd.div_f64s(simd.sub_f64s(mantissa, one), simd.add_f64s(mantissa, one));
    let ln = simd.mul_f64s(s, polynomial(simd, simd.mul_f64s(s, s), &LOGARITHM));
    let ln = simd.mul_add_f64s(e, all(std::f64::consts::LN_2), ln);
    // The largest argument, 1, can give a rounding error below zero.
    let square = simd.max_f64s(simd.mul_f64s(ln, all(-2.0)), all(0.0));
    let length = simd.mul_f64s(simd.sqrt_f64s(square), sign);
    let (sin, cos) = sin_cos(simd, simd.mul_f64s(angle, all(std::f64::consts::PI)));
    [simd.mul_f64s(length, cos), simd.mul_f64s(length, sin)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math;

    #[derive(Clone, Copy)]
    enum Of {
        Tanh,
        Exponential,
        Sine,
        Cosine,
        Arcsine,
        Normals,
    }

    /// A function of each number, in place.
    struct Each<'a>(Of, &'a mut [f64]);

    impl WithSimd for Each<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            for x in self.1.chunks_mut(S::F64_LANES) {
                let v = simd.partial_load_f64s(x);
                let y = match self.0 {
                    Of::Tanh => tanh(simd, v),
                    Of::Exponential => exp(simd, v),
                    Of::Sine => sin_cos(simd, v).0,
                    Of::Cosine => sin_cos(simd, v).1,
                    Of::Arcsine => asin(simd, v),
                    Of::Normals => {
                        let fifth = simd.splat_f64s(0.2);
                        normal_pair(simd, v, fifth, simd.splat_f64s(-1.0))[1]
                    }
                };
                simd.partial_store_f64s(x, y);
            }
        }
    }

    /// Wide and single lanes give the same bits, within `tolerance` of the library.
    fn agrees(of: Of, xs: &[f64], exact: impl Fn(f64) -> f64, tolerance: f64) {
        let (mut wide, mut single) = (xs.to_vec(), xs.to_vec());
        dispatch(Each(of, &mut wide));
        Each(of, &mut single).with_simd(pulp::Scalar);
        for ((x, wide), single) in xs.iter().zip(&wide).zip(&single) {
            let error = (wide - exact(*x)).abs();
            assert!(error <= tolerance * exact(*x).abs().max(1e-300) || error < 1e-15, "{x}: {error:e}");
            assert_eq!(wide.to_bits(), single.to_bits());
        }
    }

    #[test]
    fn lanes_agree_with_the_library_and_with_one_lane() {
        let spread = |low: f64, high: f64| -> Vec<f64> {
            (0..=200_001).map(|i| low + (high - low) * f64::from(i) / 200_001.0).collect()
        };
        agrees(Of::Tanh, &spread(-24.4, 24.4), math::tanh, 1e-15);
        agrees(Of::Exponential, &spread(-699.9, 0.0), math::exp, 1e-15);
        agrees(Of::Sine, &spread(-FRAC_PI_2, FRAC_PI_2), math::sin, 1e-15);
        agrees(Of::Cosine, &spread(-FRAC_PI_2, FRAC_PI_2), math::cos, 1e-15);
        agrees(Of::Arcsine, &spread(0.0, 1.0), math::asin, 1e-15);
        let normal = |w: f64| -(-2.0 * math::ln(w)).sqrt() * math::sin(0.2 * std::f64::consts::PI);
        agrees(Of::Normals, &spread(1e-300, 0.999), normal, 1e-12);
        agrees(Of::Normals, &[1e-16, 1e-9, 1e-3, 0.5, 0.75], normal, 1e-12);
    }

    #[test]
    fn tanh_at_its_ends() {
        let mut x = [0.0, f64::INFINITY, f64::NEG_INFINITY, 1e300, -25.0, 1e-200, f64::NAN];
        dispatch(Each(Of::Tanh, &mut x));
        assert_eq!(x[..5], [0.0, 1.0, -1.0, 1.0, -1.0]);
        assert!((x[5] / 1e-200 - 1.0).abs() < 1e-15 && x[6].is_nan());
    }

    #[test]
    fn the_largest_radius_gives_zero() {
        let mut x = [1.0];
        dispatch(Each(Of::Normals, &mut x));
        assert_eq!(x[0].abs(), 0.0);
    }
}
