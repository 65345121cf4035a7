//! Axes of the wing.
//!
//! Vectors are in stroke-plane axes of one wing: x forward in the stroke plane,
//! y outboard, z normal to the stroke plane (up when it is level). The other wing
//! is the mirror image in y = 0.

use nalgebra::Vector3;

use crate::kinematics::Angle;
use crate::math::sin_cos;

/// A vector in stroke-plane axes (x forward, y outboard, z up).
pub type Vector = Vector3<f64>;

/// Where the wing points and how it turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attitude {
    /// Along the span, root to tip.
    pub e_r: Vector,
    /// Along the chord, trailing to leading edge.
    pub e_c: Vector,
    /// e_r x e_c; it points down in mid-downstroke.
    pub e_n: Vector,
    /// Axes about which sweep, elevation and rotation increase (right-handed).
    pub joints: [Vector; 3],
    /// Angular velocity, rad/s.
    pub omega: Vector,
    /// Angular acceleration, rad/s².
    pub omega_dot: Vector,
}

impl Attitude {
    /// From sweep, elevation and rotation: sweep about the stroke plane's normal,
    /// then elevation, then rotation about the span.
    pub fn new(angles: &[Angle; 3]) -> Self {
        let [(sp, cp), (st, ct), (sa, ca)] = angles.map(|a| sin_cos(a.value));
        let e_r = Vector::new(ct * sp, ct * cp, st);
        let e_phi = Vector::new(cp, -sp, 0.0);
        let e_theta = Vector::new(-st * sp, -st * cp, ct);
        let e_c = e_phi * ca + e_theta * sa;
        let joints = [Vector::new(0.0, 0.0, -1.0), e_phi, -e_r];
        let [phi, theta, alpha] = angles;
        let by_sweep = joints[0] * phi.rate;
        let by_elevation = by_sweep + joints[1] * theta.rate;
        let omega = by_elevation + joints[2] * alpha.rate;
        let omega_dot = joints[0] * phi.acceleration
            + joints[1] * theta.acceleration
            + joints[2] * alpha.acceleration
            + by_sweep.cross(&joints[1]) * theta.rate
            + by_elevation.cross(&joints[2]) * alpha.rate;
        Self { e_r, e_c, e_n: e_r.cross(&e_c), joints, omega, omega_dot }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::{ElevationPhase, Stroke};

    #[test]
    fn rates_are_the_derivatives_of_the_axes() {
        let x = [26.1, 15.0, -9.2, -0.5, 9.6, 57.2, 27.1, 58.0, 0.5, 2.5];
        let stroke = Stroke::new(&x, ElevationPhase::Plus);
        let h = 1e-6;
        for i in 0..50 {
            let phase = f64::from(i) / 50.0;
            let [a, b, c] = [phase - h, phase, phase + h].map(|p| Attitude::new(&stroke.angles(p)));
            let dt = 2.0 * h * stroke.period();
            for (axis, before, after) in [(b.e_r, a.e_r, c.e_r), (b.e_c, a.e_c, c.e_c), (b.e_n, a.e_n, c.e_n)] {
                assert!((b.omega.cross(&axis) - (after - before) / dt).norm() < 1e-5 * b.omega.norm().max(1.0));
            }
            let numeric = (c.omega - a.omega) / dt;
            assert!((b.omega_dot - numeric).norm() < 1e-5 * b.omega_dot.norm().max(1e4), "at {phase}");
        }
    }
}
