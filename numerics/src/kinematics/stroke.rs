//! The three Euler angles over a stroke (Nguyen et al. 2019, Eq. 1).

use std::f64::consts::{FRAC_PI_2, PI};

use crate::math::{asin, sin_cos, tanh};
use crate::parameters::{Point, at};

/// Sign of the elevation's second harmonic. It cannot be recovered from the
/// paper's text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ElevationPhase {
    /// `+cos(4πft)`: U-shaped tip path.
    #[default]
    Plus,
    /// `-cos(4πft)`: inverted U.
    Minus,
}

/// An angle with its time derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Angle {
    /// rad
    pub value: f64,
    /// rad/s
    pub rate: f64,
    /// rad/s²
    pub acceleration: f64,
}

/// One stroke's kinematics, angles in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stroke {
    /// Frequency f, Hz.
    pub frequency: f64,
    /// Stroke plane angle β, forward edge down.
    pub stroke_plane: f64,
    mean: [f64; 3],
    amplitude: [f64; 3],
    sweep_shape: f64,
    rotation_shape: f64,
}

/// Below this the shape functions are sinusoids to rounding.
pub(super) const SINUSOIDAL: f64 = 1e-6;
/// The sweep's acceleration is singular at K = 1.
pub(super) const SHARPEST_SWEEP: f64 = 0.999;

impl Stroke {
    /// From the ten design parameters (degrees).
    pub fn new(x: &Point, phase: ElevationPhase) -> Self {
        let sign = match phase {
            ElevationPhase::Plus => 1.0,
            ElevationPhase::Minus => -1.0,
        };
        Self {
            frequency: x[at::FREQUENCY],
            stroke_plane: x[at::STROKE_PLANE].to_radians(),
            mean: [x[at::SWEEP_MEAN], x[at::ELEVATION_MEAN], x[at::ROTATION_MEAN]].map(f64::to_radians),
            amplitude: [x[at::SWEEP_AMPLITUDE], sign * x[at::ELEVATION_AMPLITUDE], x[at::ROTATION_AMPLITUDE]]
                .map(f64::to_radians),
            sweep_shape: x[at::SWEEP_SHAPE].min(SHARPEST_SWEEP),
            rotation_shape: x[at::ROTATION_SHAPE],
        }
    }

    /// Period, s.
    pub fn period(&self) -> f64 {
        1.0 / self.frequency
    }

    /// Sweep φ, elevation θ and rotation α at a phase of the stroke (t f, so that
    /// one is a whole stroke).
    ///
    /// φ = φ0 + φa asin[K sin(2πft + 3π/2)] / asin K,
    /// θ = θ0 ± θa cos(4πft),
    /// α = π/2 + α0 - αa tanh[C sin(2πft)] / tanh C.
    pub fn angles(&self, phase: f64) -> [Angle; 3] {
        let omega = 2.0 * PI * self.frequency;
        let (s, c) = sin_cos(2.0 * PI * (phase - phase.floor()));
        let sweep = sweep_shape(self.sweep_shape, s, c);
        let rotation = rotation_shape(self.rotation_shape, s, c);
        let elevation = [c * c - s * s, -4.0 * s * c, -4.0 * (c * c - s * s)];
        let angle = |mean: f64, amplitude: f64, shape: [f64; 3]| Angle {
            value: mean + amplitude * shape[0],
            rate: amplitude * shape[1] * omega,
            acceleration: amplitude * shape[2] * omega * omega,
        };
        [
            angle(self.mean[0], self.amplitude[0], sweep),
            angle(self.mean[1], self.amplitude[1], elevation),
            angle(FRAC_PI_2 + self.mean[2], -self.amplitude[2], rotation),
        ]
    }
}

/// asin(K sin(x + 3π/2)) / asin K and its first two derivatives in x, from sin x and cos x.
fn sweep_shape(k: f64, s: f64, c: f64) -> [f64; 3] {
    if k < SINUSOIDAL {
        return [-c, s, c];
    }
    let u = k * c;
    let root = (1.0 - u * u).sqrt();
    let scale = 1.0 / asin(k);
    let second = k * c / root - k * k * s * s * u / (root * root * root);
    [-asin(u) * scale, k * s / root * scale, second * scale]
}

/// tanh(C sin x) / tanh C and its first two derivatives in x.
fn rotation_shape(steepness: f64, s: f64, c: f64) -> [f64; 3] {
    if steepness < SINUSOIDAL {
        return [s, c, -s];
    }
    let t = tanh(steepness * s);
    let scale = 1.0 / tanh(steepness);
    let sech2 = 1.0 - t * t;
    let first = steepness * c * sech2;
    let second = -steepness * s * sech2 - 2.0 * steepness * steepness * c * c * t * sech2;
    [t * scale, first * scale, second * scale]
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINT: Point = [26.1, 15.0, -9.2, -0.5, 9.6, 57.2, 7.1, 58.0, 0.8, 2.5];

    /// PHYSICS: t = 0 is dorsal stroke reversal, T/4 mid-downstroke, T/2 ventral reversal.
    #[test]
    fn key_instants() {
        let stroke = Stroke::new(&POINT, ElevationPhase::Plus);
        let degrees = |phase| stroke.angles(phase).map(|a| a.value.to_degrees());
        let close = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(close(degrees(0.0), [-9.2 - 57.2, 6.6, 99.6]));
        assert!(close(degrees(0.25), [-9.2, -7.6, 99.6 - 58.0]));
        assert!(close(degrees(0.5), [-9.2 + 57.2, 6.6, 99.6]));
        assert!(close(degrees(0.75), [-9.2, -7.6, 99.6 + 58.0]));
        assert!(stroke.angles(0.25)[0].rate > 0.0, "the first half is the downstroke: sweep increases");
    }

    #[test]
    fn derivatives_are_those_of_the_angles() {
        let stroke = Stroke::new(&POINT, ElevationPhase::Minus);
        let h = 1e-5;
        for i in 0..97 {
            let phase = f64::from(i) / 97.0 + 0.003;
            let [a, b, c] = [phase - h, phase, phase + h].map(|p| stroke.angles(p));
            for j in 0..3 {
                let dt = h * stroke.period();
                let rate = (c[j].value - a[j].value) / (2.0 * dt);
                let acceleration = (c[j].rate - a[j].rate) / (2.0 * dt);
                assert!((rate - b[j].rate).abs() < 1e-6 * 2e3, "rate {j} at {phase}");
                assert!((acceleration - b[j].acceleration).abs() < 1e-6 * 1e6, "acceleration {j} at {phase}");
            }
        }
    }

    #[test]
    fn shapes_have_their_limits() {
        for x in [0.1, 1.0, 2.5, 4.0, 6.0_f64] {
            let (s, c) = sin_cos(x);
            let (smooth, limit) = (sweep_shape(2e-6, s, c), sweep_shape(0.0, s, c));
            let (gentle, sine) = (rotation_shape(2e-6, s, c), rotation_shape(0.0, s, c));
            for i in 0..3 {
                assert!((smooth[i] - limit[i]).abs() < 1e-9 && (gentle[i] - sine[i]).abs() < 1e-9);
            }
        }
        // K near 1 is a triangle: constant rate away from the reversals.
        let (s, c) = sin_cos(1.2);
        assert!((sweep_shape(0.999, s, c)[1] - 2.0 / PI).abs() < 0.02);
    }
}
