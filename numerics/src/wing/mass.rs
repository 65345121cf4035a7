//! Inertia of the wing as a lamina whose mass thins towards the tip.

use nalgebra::{Matrix3, Vector3};

use crate::insect::Insect;
use crate::kinematics::{Attitude, Vector};
use crate::math::exp;
use crate::wing::Outline;

/// Moments of inertia of one wing about the hinge, kg m².
///
/// Mass per area m'/c ~ exp(-κ r/R) with κ chosen to give the insect's radius of
/// gyration, uniform along the chord.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WingMass {
    /// ∫ s² dm: about the span (rotation).
    pub about_span: f64,
    /// ∫ r² dm: about the chord (sweep and elevation).
    pub about_chord: f64,
    /// ∫ r s dm; negative because the mass lies behind the feathering axis.
    pub product: f64,
}

impl WingMass {
    /// For an insect's wing.
    pub fn new(insect: &Insect) -> Self {
        let outline = Outline::new(insect);
        let chords: Vec<(f64, f64)> = outline.samples().collect();
        let gyration = |kappa: f64| {
            let (mut mass, mut second) = (0.0, 0.0);
            for (x, weight) in &chords {
                let m = weight * exp(-kappa * x);
                mass += m;
                second += x * x * m;
            }
            (second / mass).sqrt()
        };
        // The radius of gyration falls as κ grows: bisection over a range wider than any wing's.
        let (mut low, mut high) = (-60.0, 60.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if gyration(middle) > insect.wing_gyration_radius {
                low = middle;
            } else {
                high = middle;
            }
        }
        let kappa = 0.5 * (low + high);
        let (length, axis) = (insect.wing_length_m, insect.feathering_axis);
        let density = insect.wing_mass_kg / outline.integrate(|x, _| exp(-kappa * x));
        // Mean of s and s² over a chord from axis - 1 to axis, in chords.
        let (first, second) = (axis - 0.5, (axis.powi(3) + (1.0 - axis).powi(3)) / 3.0);
        let moment = |f: &dyn Fn(f64, f64) -> f64| density * outline.integrate(|x, c| f(x, c) * exp(-kappa * x));
        Self {
            about_span: moment(&|_, c| second * c * c),
            about_chord: moment(&|x, _| (x * length).powi(2)),
            product: moment(&|x, c| x * length * first * c),
        }
    }

    /// Rate of change of the wing's angular momentum about the hinge, N m:
    /// I·ω' + ω x (I·ω), stroke-plane axes.
    pub fn momentum_rate(&self, attitude: &Attitude) -> Vector {
        let axes = Matrix3::from_columns(&[attitude.e_r, attitude.e_c, attitude.e_n]);
        #[rustfmt::skip]
        let inertia = Matrix3::new(
            self.about_span, -self.product, 0.0,
            -self.product, self.about_chord, 0.0,
            0.0, 0.0, self.about_span + self.about_chord,
        );
        let omega: Vector3<f64> = axes.transpose() * attitude.omega;
        let omega_dot = axes.transpose() * attitude.omega_dot;
        axes * (inertia * omega_dot + omega.cross(&(inertia * omega)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::{ElevationPhase, Stroke};

    /// Values from published F1 data by the same lamina model: I_cc 1.54e-8,
    /// I_rr 2.5e-9, product -3.1e-9 kg m².
    #[test]
    fn hawkmoth_wing_has_the_published_inertia() {
        let mass = WingMass::new(&Insect::default());
        assert!((mass.about_chord / 1.54e-8 - 1.0).abs() < 0.01, "{mass:?}");
        assert!((mass.about_span / 2.5e-9 - 1.0).abs() < 0.05, "{mass:?}");
        assert!((mass.product / -3.1e-9 - 1.0).abs() < 0.05, "{mass:?}");
    }

    /// Unrectified inertial power summed over the joints is a total derivative.
    #[test]
    fn inertial_power_averages_to_zero() {
        let x = [26.1, 15.0, -9.2, -0.5, 9.6, 57.2, 7.1, 58.0, 0.4, 2.0];
        let stroke = Stroke::new(&x, ElevationPhase::Plus);
        let mass = WingMass::new(&Insect::default());
        let steps = 400;
        let powers: Vec<f64> = (0..steps)
            .map(|i| {
                let angles = stroke.angles(f64::from(i) / f64::from(steps));
                let attitude = Attitude::new(&angles);
                let torque = mass.momentum_rate(&attitude);
                (0..3).map(|j| torque.dot(&attitude.joints[j]) * angles[j].rate).sum()
            })
            .collect();
        let amplitude = powers.iter().fold(0.0_f64, |a, p| a.max(p.abs()));
        let mean = powers.iter().sum::<f64>() / f64::from(steps);
        assert!(mean.abs() < 1e-3 * amplitude, "{mean} of {amplitude}");
        // The torque's power is that of the kinetic energy, joint by joint: ω = Σ a_j q_j'.
        let angles = stroke.angles(0.13);
        let attitude = Attitude::new(&angles);
        let by_joints: f64 =
            (0..3).map(|j| mass.momentum_rate(&attitude).dot(&attitude.joints[j]) * angles[j].rate).sum();
        assert!((by_joints - mass.momentum_rate(&attitude).dot(&attitude.omega)).abs() < 1e-12);
    }
}
