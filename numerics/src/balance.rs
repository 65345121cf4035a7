//! From loads on one wing to lift, drag, pitching moment and power of the insect.

use crate::kinematics::{Angle, Attitude, Clock, Stroke, Vector};
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

    /// Lift, drag and pitching moment about the centre of mass.
    ///
    /// F_fwd = T cos β + N sin β, L = N cos β - T sin β, D = -F_fwd; the moment
    /// about the centre of mass is that about the hinge less r_cm x F.
    fn to_earth(&self, tangential: f64, normal: f64, hinge_moment: f64) -> (f64, f64, f64) {
        let (s, c) = self.tilt;
        let (forward, lift) = (tangential * c + normal * s, normal * c - tangential * s);
        let (x, z) = self.centre;
        (lift, -forward, hinge_moment - (x * lift - z * forward))
    }

    /// Power at each joint, both wings, from the air's moment on one wing about its hinge.
    ///
    /// Torque of the muscles at joint j: τ_j = a_j·(dH/dt - M_air); power of a
    /// joint max(0, τ_j q_j'), less what a spring returns of the negative part.
    fn joint_power(&self, angles: &[Angle; 3], attitude: &Attitude, moment: &Vector) -> [JointPower; 3] {
        let momentum_rate = self.mass.momentum_rate(attitude);
        std::array::from_fn(|j| {
            let (axis, rate) = (&attitude.joints[j], angles[j].rate);
            let aerodynamic_w = -2.0 * moment.dot(axis) * rate;
            let inertial_w = 2.0 * momentum_rate.dot(axis) * rate;
            let total = aerodynamic_w + inertial_w;
            let required_w = total.max(0.0) + self.elastic_storage * total.min(0.0);
            JointPower { aerodynamic_w, inertial_w, required_w }
        })
    }

    /// The air as the stroke plane's axes move through it.
    pub fn air(&self) -> Air {
        self.air
    }
}

/// One instant of a stroke, both wings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Snapshot {
    /// Sweep, elevation, rotation.
    pub angles: [Angle; 3],
    /// Lift, up, N.
    pub lift_n: f64,
    /// Drag, rearward, N.
    pub drag_n: f64,
    /// Pitching moment about the centre of mass, nose up, N m.
    pub moment_nm: f64,
    /// Power at each joint; `required_w` is its positive part, less what a spring returns.
    pub joints: [JointPower; 3],
}

/// Sums over the instants of one stroke.
#[derive(Debug, Clone)]
pub struct Cycle<'a> {
    body: &'a Body,
    weight: f64,
    tangential: f64,
    normal: f64,
    hinge_moment: f64,
    joints: [JointPower; 3],
}

impl<'a> Cycle<'a> {
    /// An empty stroke.
    pub fn new(body: &'a Body) -> Self {
        Self { body, weight: 0.0, tangential: 0.0, normal: 0.0, hinge_moment: 0.0, joints: [JointPower::default(); 3] }
    }

    /// One instant: angles, attitude, the load on one wing about its hinge, and its weight
    /// in the means.
    pub fn add(&mut self, angles: &[Angle; 3], attitude: &Attitude, load: &WingLoad, weight: f64) -> Snapshot {
        let (tangential, normal) = (2.0 * load.force.x, 2.0 * load.force.z);
        // Nose up turns x towards z: about -y.
        let hinge_moment = -2.0 * load.moment.y;
        self.weight += weight;
        self.tangential += weight * tangential;
        self.normal += weight * normal;
        self.hinge_moment += weight * hinge_moment;
        let joints = self.body.joint_power(angles, attitude, &load.moment);
        for (sum, joint) in self.joints.iter_mut().zip(&joints) {
            sum.add(joint, weight);
        }
        let (lift, drag, moment) = self.body.to_earth(tangential, normal, hinge_moment);
        Snapshot { angles: *angles, lift_n: lift, drag_n: drag, moment_nm: moment, joints }
    }

    /// The stroke's means, with the power of its instants.
    pub fn mean(&self) -> StrokeMean {
        self.mean_with(self.joints.map(|joint| joint.over(self.weight)))
    }

    /// The stroke's means, with power integrated elsewhere.
    pub fn mean_with(&self, joints: [JointPower; 3]) -> StrokeMean {
        let n = self.weight;
        let (tangential, normal, hinge_moment) = (self.tangential / n, self.normal / n, self.hinge_moment / n);
        let (lift, drag, moment) = self.body.to_earth(tangential, normal, hinge_moment);
        let power = joints.iter().map(|j| j.required_w).sum();
        StrokeMean {
            outputs: [lift, drag, moment, power],
            tangential_n: tangential,
            normal_n: normal,
            hinge_moment_nm: hinge_moment,
            joints,
        }
    }
}

impl JointPower {
    fn add(&mut self, other: &JointPower, weight: f64) {
        self.aerodynamic_w += weight * other.aerodynamic_w;
        self.inertial_w += weight * other.inertial_w;
        self.required_w += weight * other.required_w;
    }

    fn over(&self, weight: f64) -> Self {
        let n = if weight > 0.0 { weight } else { 1.0 };
        Self { aerodynamic_w: self.aerodynamic_w / n, inertial_w: self.inertial_w / n, required_w: self.required_w / n }
    }
}

/// Instants between two steps at which power is taken.
const BETWEEN: usize = 4;

/// Power integrated on a finer grid than the loads.
///
/// The wing's inertia is known at every instant and may turn within a step or two,
/// where power changes its sign and is cut off at zero; the air's moment in the
/// wing's own axes is smooth enough for a cubic through four steps.
#[derive(Debug, Clone)]
pub struct FinePower<'a> {
    body: &'a Body,
    stroke: &'a Stroke,
    clock: &'a Clock,
    /// The air's moment in the wing's axes at the last four steps, oldest first.
    moments: [Vector; 4],
    steps: usize,
    weight: f64,
    joints: [JointPower; 3],
}

impl<'a> FinePower<'a> {
    /// Nothing yet.
    pub fn new(body: &'a Body, stroke: &'a Stroke, clock: &'a Clock) -> Self {
        let moments = [Vector::zeros(); 4];
        Self { body, stroke, clock, moments, steps: 0, weight: 0.0, joints: Default::default() }
    }

    /// The next step: its attitude and the air's moment on one wing about the hinge.
    pub fn add(&mut self, attitude: &Attitude, moment: &Vector) {
        let axes = [attitude.e_r, attitude.e_c, attitude.e_n];
        self.moments.rotate_left(1);
        self.moments[3] = Vector::from_fn(|i, _| moment.dot(&axes[i]));
        self.steps += 1;
        if self.steps < self.moments.len() {
            return;
        }
        for i in 0..BETWEEN {
            let share = (i as f64 + 0.5) / BETWEEN as f64;
            // Between the second and third of the four.
            let step = (self.steps - 3) as f64 + share;
            let weight = self.clock.pace(step);
            self.weight += weight;
            let angles = self.stroke.angles(self.clock.phase(step));
            let attitude = Attitude::new(&angles);
            let m = cubic(&self.moments, share);
            let moment = attitude.e_r * m.x + attitude.e_c * m.y + attitude.e_n * m.z;
            for (sum, joint) in self.joints.iter_mut().zip(self.body.joint_power(&angles, &attitude, &moment)) {
                sum.add(&joint, weight);
            }
        }
    }

    /// Mean power since it was last taken.
    pub fn take(&mut self) -> [JointPower; 3] {
        let mean = self.joints.map(|joint| joint.over(self.weight));
        self.weight = 0.0;
        self.joints = Default::default();
        mean
    }
}

/// Cubic through four values at -1, 0, 1 and 2.
fn cubic([a, b, c, d]: &[Vector; 4], x: f64) -> Vector {
    let (p, q, r) = (x + 1.0, x - 1.0, x - 2.0);
    a * (-x * q * r / 6.0) + b * (p * q * r / 2.0) + c * (-p * x * r / 2.0) + d * (p * x * q / 6.0)
}
