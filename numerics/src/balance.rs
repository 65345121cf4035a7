//! From loads on one wing to lift, drag, pitching moment and power of the insect.

use crate::kinematics::{Angle, Attitude, Stroke, Vector};
use crate::math::sin_cos;
use crate::simulation::{JointPower, Simulation, StrokeMean};
use crate::uvlm::{Air, WingLoad};
use crate::wing::WingMass;

/// What does not change over the strokes, in stroke-plane axes.
#[derive(Debug, Clone)]
pub struct Body {
    mass: WingMass,
    /// Sine and cosine of the stroke plane angle.
    tilt: (f64, f64),
    /// Centre of mass from the hinge line: forward and up in earth axes, m.
    centre: (f64, f64),
    elastic_storage: f64,
    air: Air,
}

impl Body {
    /// The insect holding its stroke plane at the stroke's angle.
    ///
    /// The body axis keeps its angle to the stroke plane: χ = (π - that angle) - β,
    /// r_cm = l1 (-cos χ, -sin χ) + h (sin χ, -cos χ).
    pub fn new(simulation: &Simulation, stroke: &Stroke) -> Self {
        let insect = &simulation.insect;
        let chi = (180.0 - insect.stroke_plane_to_body_deg).to_radians() - stroke.stroke_plane;
        let (sx, cx) = sin_cos(chi);
        let (l, h) = (insect.hinge_to_cm_along_m, insect.hinge_to_cm_below_m);
        let centre = (-l * cx + h * sx, -l * sx - h * cx);
        let (s, c) = sin_cos(stroke.stroke_plane);
        let velocity = &simulation.body_velocity;
        let (forward, up) = (velocity.forward_m_s, -velocity.down_m_s);
        let air = Air {
            density: insect.air_density_kg_m3,
            velocity: Vector::new(forward * c - up * s, 0.0, forward * s + up * c),
            omega: Vector::new(0.0, -velocity.pitch_rad_s, 0.0),
            reference: Vector::new(centre.0 * c - centre.1 * s, 0.0, centre.0 * s + centre.1 * c),
        };
        Self { mass: WingMass::new(insect), tilt: (s, c), centre, elastic_storage: simulation.elastic_storage, air }
    }

    /// The air as the stroke plane's axes move through it.
    pub fn air(&self) -> Air {
        self.air
    }
}

/// Sums over the instants of one stroke, equally spaced.
#[derive(Debug, Clone)]
pub struct Cycle<'a> {
    body: &'a Body,
    instants: usize,
    tangential: f64,
    normal: f64,
    hinge_moment: f64,
    joints: [JointPower; 3],
}

impl<'a> Cycle<'a> {
    /// An empty stroke.
    pub fn new(body: &'a Body) -> Self {
        Self { body, instants: 0, tangential: 0.0, normal: 0.0, hinge_moment: 0.0, joints: [JointPower::default(); 3] }
    }

    /// One instant: angles, attitude and the load on one wing about its hinge.
    ///
    /// Torque of the muscles at joint j: τ_j = a_j·(dH/dt - M_air); power of a
    /// joint max(0, τ_j q_j'), less what a spring returns of the negative part.
    pub fn add(&mut self, angles: &[Angle; 3], attitude: &Attitude, load: &WingLoad) {
        self.instants += 1;
        self.tangential += 2.0 * load.force.x;
        self.normal += 2.0 * load.force.z;
        // Nose up turns x towards z: about -y.
        self.hinge_moment -= 2.0 * load.moment.y;
        let momentum_rate = self.body.mass.momentum_rate(attitude);
        for ((joint, axis), angle) in self.joints.iter_mut().zip(&attitude.joints).zip(angles) {
            let aerodynamic = -2.0 * load.moment.dot(axis) * angle.rate;
            let inertial = 2.0 * momentum_rate.dot(axis) * angle.rate;
            let total = aerodynamic + inertial;
            joint.aerodynamic_w += aerodynamic;
            joint.inertial_w += inertial;
            joint.required_w += total.max(0.0) + self.body.elastic_storage * total.min(0.0);
        }
    }

    /// The stroke's means.
    ///
    /// F_fwd = T cos β + N sin β, L = N cos β - T sin β, D = -F_fwd; the moment
    /// about the centre of mass is that about the hinge less r_cm x F.
    pub fn mean(&self) -> StrokeMean {
        let n = self.instants as f64;
        let (tangential, normal, hinge_moment) = (self.tangential / n, self.normal / n, self.hinge_moment / n);
        let (s, c) = self.body.tilt;
        let (forward, lift) = (tangential * c + normal * s, normal * c - tangential * s);
        let (x, z) = self.body.centre;
        let joints = self.joints.map(|j| JointPower {
            aerodynamic_w: j.aerodynamic_w / n,
            inertial_w: j.inertial_w / n,
            required_w: j.required_w / n,
        });
        let power = joints.iter().map(|j| j.required_w).sum();
        let moment = hinge_moment - (x * lift - z * forward);
        StrokeMean {
            outputs: [lift, -forward, moment, power],
            tangential_n: tangential,
            normal_n: normal,
            hinge_moment_nm: hinge_moment,
            joints,
        }
    }
}
