//! Quasi-steady blade elements: the baseline a user would otherwise pick.

use crate::balance::{Body, Cycle};
use crate::kinematics::{Attitude, Stroke, Vector};
use crate::math::{atan2, sin, sin_cos};
use crate::simulation::{Moment, Simulation, StrokeMean};
use crate::table::table;
use crate::uvlm::{Air, WingLoad};
use crate::wing::Outline;

table! {
    /// Coefficients and resolution of the blade-element model; the defaults are the
    /// hawkmoth's (Berman & Wang 2007).
    pub struct Settings {
        blade_elements: usize = 60, 4..=2000, "", "blade elements along the wing";
        steps_per_stroke: usize = 200, 8..=5000, "", "instants per stroke";
        lift_coefficient: f64 = 1.678, 0.0..=10.0, "", "C_T in C_L = C_T sin 2a";
        drag_coefficient_0: f64 = 0.07, 0.0..=10.0, "", "drag coefficient at zero angle of attack";
        drag_coefficient_90: f64 = 3.06, 0.0..=10.0, "", "drag coefficient at 90 degrees";
    }
}

/// One blade element.
struct Blade {
    r: f64,
    width: f64,
    chord: f64,
}

/// Mean of one stroke; blade elements have no memory, so every stroke is the same.
///
/// dF = ½ρ|v|² c dr [C_L l - C_D v/|v|] + rotational + added-mass force, with
/// C_L = C_T sin 2a, C_D = C_D0 cos²a + C_D90 sin²a, centre of pressure at
/// (0.25 + 0.25·2|a|/π) c (Berman & Wang 2007, J. Fluid Mech. 582). At the
/// hawkmoth's reference kinematics: 0.90 W, 83 mW.
pub fn fly(simulation: &Simulation, settings: &Settings, watch: &mut dyn FnMut(&Moment)) -> StrokeMean {
    let insect = &simulation.insect;
    let stroke = Stroke::new(&simulation.parameters, simulation.elevation_phase);
    let body = Body::new(simulation, &stroke);
    let outline = Outline::new(insect);
    let blades: Vec<Blade> = (0..settings.blade_elements)
        .map(|i| {
            let width = 1.0 / settings.blade_elements as f64;
            let x = (i as f64 + 0.5) * width;
            Blade { r: x * insect.wing_length_m, width: width * insect.wing_length_m, chord: outline.chord(x) }
        })
        .collect();
    let hinge = Vector::new(0.0, insect.hinge_offset_m, 0.0);
    let mut cycle = Cycle::new(&body);
    for step in 0..settings.steps_per_stroke {
        let angles = stroke.angles(step as f64 / settings.steps_per_stroke as f64);
        let attitude = Attitude::new(&angles);
        let mut load = WingLoad::default();
        for blade in &blades {
            let (force, s) = blade_force(blade, &attitude, &body.air(), &hinge, insect.feathering_axis, settings);
            load.force += force;
            load.moment += (attitude.e_r * blade.r + attitude.e_c * s).cross(&force);
        }
        let snapshot = cycle.add(&angles, &attitude, &load, 1.0);
        let phase = step as f64 / settings.steps_per_stroke as f64;
        watch(&Moment { stroke: 1, step, phase, share: 1.0 / settings.steps_per_stroke as f64, snapshot });
    }
    cycle.mean()
}

/// Force on a blade element and its place along the chord ahead of the feathering axis.
fn blade_force(
    blade: &Blade,
    attitude: &Attitude,
    air: &Air,
    hinge: &Vector,
    axis: f64,
    settings: &Settings,
) -> (Vector, f64) {
    let (density, c, r) = (air.density, blade.chord, blade.r);
    let arm = attitude.e_r * r;
    let v = attitude.omega.cross(&arm) + air.carried(&(hinge + arm));
    let (along, normal) = (v.dot(&attitude.e_c), v.dot(&attitude.e_n));
    let speed = along.hypot(normal);
    let attack = atan2(-normal, along);
    let (sa, ca) = sin_cos(attack);
    let plane = |a: f64, b: f64| attitude.e_c * a + attitude.e_n * b;
    let mut force = Vector::zeros();
    if speed > 0.0 {
        let lift = settings.lift_coefficient * sin(2.0 * attack);
        let drag = settings.drag_coefficient_0 * ca * ca + settings.drag_coefficient_90 * sa * sa;
        let pressure = 0.5 * density * speed * c * blade.width;
        force += plane(-normal * lift - along * drag, along * lift - normal * drag) * pressure;
    }
    let turning = attitude.omega.dot(&attitude.e_r);
    let rotational = density * std::f64::consts::PI * (0.75 - axis) * c * c * turning * along * blade.width;
    // d(ω x e_r)/dt along the normal: the acceleration of the blade per unit radius.
    let per_radius =
        attitude.omega_dot.cross(&attitude.e_r) + attitude.omega.cross(&attitude.omega.cross(&attitude.e_r));
    let added_mass = -0.25 * std::f64::consts::PI * density * c * c * r * per_radius.dot(&attitude.e_n) * blade.width;
    force += attitude.e_n * (rotational + added_mass);
    let folded = attack.abs();
    let centre = (0.25 + 0.5 * folded / std::f64::consts::PI) * c;
    (force, axis * c - centre)
}
