//! Whether the wings collide is pure kinematics.

use std::f64::consts::FRAC_PI_2;

use pulp::{Simd, WithSimd};

use super::stroke::{SHARPEST_SWEEP, SINUSOIDAL};
use crate::insect::Insect;
use crate::kinematics::ElevationPhase;
use crate::lanes::{self, asin, sin_cos, tanh};
use crate::parameters::{COUNT, Point, at};
use crate::wing::Outline;

/// Instants per half stroke. The closest approach is a smooth minimum: at this
/// spacing it is missed by less than 0.1 mm at hawkmoth size.
pub(super) const INSTANTS: usize = 32;
/// Stations along the span.
pub(super) const STATIONS: usize = 16;

/// The least distance of the wings from the plane of symmetry, prepared for one insect.
#[derive(Debug, Clone)]
pub struct Clearance {
    pub(super) hinge_offset: f64,
    pub(super) phase: ElevationPhase,
    /// Distance of each station from the hinge, m.
    pub(super) span: [f64; STATIONS],
    /// Leading and trailing edge there, m.
    pub(super) edges: [[f64; STATIONS]; 2],
    /// Cosine and sine of the instants of the first quarter stroke.
    instants: [(f64, f64); INSTANTS / 2 + 1],
}

impl Clearance {
    /// Prepares the outline of the wing.
    pub fn new(insect: &Insect, phase: ElevationPhase) -> Self {
        let outline = Outline::new(insect);
        let stations: [f64; STATIONS] = std::array::from_fn(|k| {
            let share = k as f64 / (STATIONS - 1) as f64;
            // Closer towards the tip, which comes closest and where the chord changes fastest.
            insect.root_cutout + (1.0 - insect.root_cutout) * crate::math::sin(share * FRAC_PI_2)
        });
        Self {
            hinge_offset: insect.hinge_offset_m,
            phase,
            span: stations.map(|x| x * insect.wing_length_m),
            edges: [stations.map(|x| outline.edges(x).0), stations.map(|x| outline.edges(x).1)],
            instants: std::array::from_fn(|i| {
                let (s, c) = crate::math::sin_cos(std::f64::consts::PI * i as f64 / INSTANTS as f64);
                (c, s)
            }),
        }
    }

    /// Least distance of any wing point from the plane of symmetry over the
    /// stroke, m; negative where the wings would cross.
    pub fn of(&self, x: &Point) -> f64 {
        let mut least = [0.0];
        self.of_each(std::slice::from_ref(x), &mut least);
        least[0]
    }

    /// [`Clearance::of`] many points, with the same bits, on the calling thread; a
    /// register full of points costs little more than one.
    ///
    /// Where the two slices differ in length, the shorter one counts.
    pub fn of_each(&self, xs: &[Point], out: &mut [f64]) {
        lanes::dispatch(Many { wing: self, xs, out });
    }
}

/// The sine and cosine of a sum of two angles.
#[inline(always)]
fn sum<S: Simd>(simd: S, (s, c): (S::f64s, S::f64s), (t, d): (S::f64s, S::f64s)) -> (S::f64s, S::f64s) {
    let sine = simd.mul_add_f64s(s, d, simd.mul_f64s(c, t));
    (sine, simd.negate_mul_add_f64s(s, t, simd.mul_f64s(c, d)))
}

/// The clearances of many points. A lane is a point.
struct Many<'a> {
    wing: &'a Clearance,
    xs: &'a [Point],
    out: &'a mut [f64],
}

impl WithSimd for Many<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (xs, out) in self.xs.chunks(S::F64_LANES).zip(self.out.chunks_mut(S::F64_LANES)) {
            let mut columns = [simd.splat_f64s(0.0); COUNT];
            for (l, x) in xs.iter().enumerate() {
                for i in 0..COUNT {
                    pulp::bytemuck::cast_slice_mut::<_, f64>(&mut columns[i..=i])[l] = x[i];
                }
            }
            let least = [least(simd, self.wing, &columns)];
            let least = pulp::bytemuck::cast_slice::<_, f64>(&least);
            for ((out, least), x) in out.iter_mut().zip(least).zip(xs) {
                // Machines differ in which of two operands a minimum keeps beside a NaN.
                let sound = x.iter().all(|v| v.is_finite());
                *out = if sound { self.wing.hinge_offset + *least } else { f64::NAN };
            }
        }
    }
}

/// What a stroke is made of, as lanes.
struct Lanes<S: Simd> {
    /// Sine and cosine of the mean sweep, elevation and rotation.
    means: [(S::f64s, S::f64s); 3],
    /// Amplitudes of the same, rad.
    amplitudes: [S::f64s; 3],
    /// K and 1 / asin K; C and 1 / tanh C.
    shapes: [(S::f64s, S::f64s); 2],
    /// Where K and C leave sinusoids.
    sinusoidal: [S::m64s; 2],
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    fn new(simd: S, phase: ElevationPhase, x: &[S::f64s; COUNT]) -> Self {
        let radians = simd.splat_f64s(std::f64::consts::PI / 180.0);
        let sign = match phase {
            ElevationPhase::Plus => radians,
            ElevationPhase::Minus => simd.splat_f64s(-std::f64::consts::PI / 180.0),
        };
        let [small, one] = [simd.splat_f64s(SINUSOIDAL), simd.splat_f64s(1.0)];
        let k = simd.min_f64s(x[at::SWEEP_SHAPE], simd.splat_f64s(SHARPEST_SWEEP));
        let c = x[at::ROTATION_SHAPE];
        Self {
            means: [
                sin_cos(simd, simd.mul_f64s(radians, x[at::SWEEP_MEAN])),
                sin_cos(simd, simd.mul_f64s(radians, x[at::ELEVATION_MEAN])),
                sin_cos(simd, simd.mul_f64s(radians, x[at::ROTATION_MEAN])),
            ],
            amplitudes: [
                simd.mul_f64s(radians, x[at::SWEEP_AMPLITUDE]),
                simd.mul_f64s(sign, x[at::ELEVATION_AMPLITUDE]),
                simd.mul_f64s(radians, x[at::ROTATION_AMPLITUDE]),
            ],
            shapes: [(k, simd.div_f64s(one, asin(simd, k))), (c, simd.div_f64s(one, tanh(simd, c)))],
            sinusoidal: [simd.less_than_f64s(k, small), simd.less_than_f64s(c, small)],
        }
    }

    /// Sine and cosine of the deviations of sweep, elevation and rotation from their
    /// means, from the cosine and sine of the instant.
    #[inline(always)]
    fn deviations(&self, simd: S, (cos, sin): (f64, f64)) -> [(S::f64s, S::f64s); 3] {
        let (c, s) = (simd.splat_f64s(cos), simd.splat_f64s(sin));
        let [(k, k_scale), (steepness, scale)] = self.shapes;
        let sweep = simd.mul_f64s(asin(simd, simd.mul_f64s(k, c)), k_scale);
        let sweep = simd.select_f64s(self.sinusoidal[0], c, sweep);
        let rotation = simd.mul_f64s(tanh(simd, simd.mul_f64s(steepness, s)), scale);
        let rotation = simd.select_f64s(self.sinusoidal[1], s, rotation);
        let elevation = simd.splat_f64s(cos * cos - sin * sin);
        let [a, b, d] = self.amplitudes;
        [
            sin_cos(simd, simd.mul_f64s(a, sweep)),
            sin_cos(simd, simd.mul_f64s(b, elevation)),
            sin_cos(simd, simd.mul_f64s(d, rotation)),
        ]
    }
}

/// Least distance of the wing from the plane through the hinge over the stroke, m.
///
/// The instants of the second quarter mirror the sweep of the first and share its
/// elevation and rotation; the second half stroke has the sweep and elevation of
/// the first, run backwards, and the rotation mirrored about its mean. So sixteen
/// instants and one give all of them.
#[inline(always)]
fn least<S: Simd>(simd: S, wing: &Clearance, x: &[S::f64s; COUNT]) -> S::f64s {
    let stroke = Lanes::new(simd, wing.phase, x);
    // One minimum per station, so that stations are computed side by side.
    let mut least = [simd.splat_f64s(f64::INFINITY); STATIONS];
    for instant in wing.instants {
        let [sweep, elevation, rotation] = stroke.deviations(simd, instant);
        let (st, ct) = sum(simd, stroke.means[1], elevation);
        // The wing is upright, alpha = 90 deg, where beta = alpha - 90 deg is 0.
        let minus = (simd.neg_f64s(rotation.0), rotation.1);
        let turns = [sum(simd, stroke.means[2], minus), sum(simd, stroke.means[2], rotation)];
        let back = (simd.neg_f64s(sweep.0), sweep.1);
        for deviation in [back, sweep] {
            let (sp, cp) = sum(simd, stroke.means[0], deviation);
            let lift = simd.mul_f64s(st, cp);
            let span = simd.mul_f64s(ct, cp);
            // chord = -cos(alpha) sin(phi) - sin(alpha) sin(theta) cos(phi)
            let [(s0, c0), (s1, c1)] = turns;
            let one = simd.negate_mul_add_f64s(c0, lift, simd.mul_f64s(s0, sp));
            let two = simd.negate_mul_add_f64s(c1, lift, simd.mul_f64s(s1, sp));
            // The trailing edge is nearest where the chord points away most, the
            // leading edge where it points to the plane most.
            let (high, low) = (simd.max_f64s(one, two), simd.min_f64s(one, two));
            for (k, least) in least.iter_mut().enumerate() {
                let base = simd.mul_f64s(span, simd.splat_f64s(wing.span[k]));
                let leading = simd.mul_add_f64s(low, simd.splat_f64s(wing.edges[0][k]), base);
                let trailing = simd.mul_add_f64s(high, simd.splat_f64s(wing.edges[1][k]), base);
                *least = simd.min_f64s(*least, simd.min_f64s(leading, trailing));
            }
        }
    }
    let mut all = least[0];
    for least in &least[1..] {
        all = simd.min_f64s(all, *least);
    }
    all
}

/// Least distance of the wings from the plane of symmetry over a stroke, m.
pub fn clearance(insect: &Insect, phase: ElevationPhase, x: &Point) -> f64 {
    Clearance::new(insect, phase).of(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::{Attitude, Stroke};

    /// The shortcut of the second half stroke and the coarse instants agree with
    /// brute force over the whole stroke.
    #[test]
    fn agrees_with_brute_force() {
        let insect = Insect::default();
        let outline = Outline::new(&insect);
        let prepared = Clearance::new(&insect, ElevationPhase::Plus);
        let bounds = crate::parameters::Bounds::default();
        for i in 0..40 {
            let Some(x) = crate::sampling::sample(&bounds, 11, i, &|_| true) else { panic!("no sample") };
            let stroke = Stroke::new(&x, ElevationPhase::Plus);
            let mut least = f64::INFINITY;
            for step in 0..720 {
                let a = Attitude::new(&stroke.angles(f64::from(step) / 720.0));
                for station in 0..=100 {
                    let r = 0.08 + 0.92 * f64::from(station) / 100.0;
                    let (leading, trailing) = outline.edges(r);
                    for s in [leading, trailing] {
                        least = least.min((a.e_r * r * insect.wing_length_m + a.e_c * s).y);
                    }
                }
            }
            let brute = least + insect.hinge_offset_m;
            assert!((prepared.of(&x) - brute).abs() < 1.5e-4, "{} against {brute}", prepared.of(&x));
        }
    }

    /// The reason for the hinges' 8 mm: at 5 mm, 42 % of the paper's box would
    /// make the wings collide, at 8 mm 9 %.
    #[test]
    fn the_hinge_offset_decides_how_much_of_the_box_collides() {
        for (hinge_offset_m, share) in [(0.005, 0.42), (0.008, 0.09)] {
            let prepared = Clearance::new(&Insect { hinge_offset_m, ..Insect::default() }, ElevationPhase::Plus);
            let bounds = crate::parameters::Bounds::default();
            let draws = 4000;
            let collide =
                |i: &u64| crate::sampling::sample(&bounds, 3, *i, &|_| true).is_some_and(|x| prepared.of(&x) < 0.0);
            let colliding = (0..draws).filter(collide).count() as f64 / draws as f64;
            assert!((colliding - share).abs() < 0.025, "{hinge_offset_m}: {colliding}");
        }
    }

    #[test]
    fn many_points_have_the_bits_of_one_at_every_width() {
        let wing = Clearance::new(&Insect::default(), ElevationPhase::Minus);
        let bounds = crate::parameters::Bounds::default();
        let mut xs: Vec<Point> = (0..53).filter_map(|i| crate::sampling::sample(&bounds, 4, i, &|_| true)).collect();
        (xs[3][at::SWEEP_SHAPE], xs[3][at::ROTATION_SHAPE]) = (0.0, 0.0);
        xs[9][at::SWEEP_SHAPE] = 1.0;
        xs[11][0] = f64::NAN;
        let (mut wide, mut narrow) = (vec![0.0; 53], vec![0.0; 53]);
        wing.of_each(&xs, &mut wide);
        Many { wing: &wing, xs: &xs, out: &mut narrow }.with_simd(pulp::Scalar);
        for ((x, a), b) in xs.iter().zip(&wide).zip(&narrow) {
            assert_eq!((a.to_bits(), a.to_bits()), (b.to_bits(), wing.of(x).to_bits()));
        }
        assert!(wide[11].is_nan() && wide.iter().filter(|c| c.is_nan()).count() == 1);
    }
}
