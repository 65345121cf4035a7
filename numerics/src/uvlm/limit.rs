//! The most a wing can give: a lattice which says more has lost its numbers, though they are finite.

use crate::insect::Insect;
use crate::kinematics::{Attitude, Stroke};
use crate::uvlm::geometry::{Flat, Planform, Pose};
use crate::uvlm::{Air, WingLoad};

/// Instants of a stroke at which speeds are looked at.
const INSTANTS: usize = 400;
/// Coefficient of the greatest mean load. Strokes of all insects and of the whole range of parameters stay below 1
/// (the tests fly some): steady lift coefficients do not exceed 5, at the place and the instant of greatest speed.
const MOST: f64 = 10.0;

/// The greatest mean force and moment of a wing over a stroke.
///
/// ```text
/// F = 10 ρ R c V (V/2 + c f),   M = F R
/// ```
///
/// V is the greatest speed of a point of the wing's edges through the air. The first term is dynamic pressure times
/// area; the second is the momentum of the air which a wing carries along, ρ c² R V, given and taken with each stroke:
/// it is what small motions cost.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limit {
    force_n: f64,
    moment_nm: f64,
}

impl Limit {
    pub(super) fn new(insect: &Insect, planform: &Planform, stroke: &Stroke, air: &Air) -> Self {
        let speed = greatest_speed(planform, insect.hinge_offset_m, stroke, air);
        let (length, chord) = (insect.wing_length_m, insect.mean_chord_m);
        let scale = insect.air_density_kg_m3 * length * chord * speed * (0.5 * speed + chord / stroke.period());
        Self { force_n: MOST * scale, moment_nm: MOST * scale * length }
    }

    /// By how many times mean loads are beyond it, or `None` if they are not.
    pub(super) fn exceeded(&self, loads: &Loads) -> Option<f64> {
        let times = (loads.force / loads.weight / self.force_n).max(loads.moment / loads.weight / self.moment_nm);
        (times > 1.0).then_some(times)
    }
}

/// Sums of the sizes of a wing's loads over a stroke.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Loads {
    force: f64,
    moment: f64,
    weight: f64,
}

impl Loads {
    pub(super) fn add(&mut self, load: &WingLoad, weight: f64) {
        self.force += weight * load.force.norm();
        self.moment += weight * load.moment.norm();
        self.weight += weight;
    }
}

/// Greatest speed of a point of the wing's edges through the air, m/s.
fn greatest_speed(planform: &Planform, hinge_offset: f64, stroke: &Stroke, air: &Air) -> f64 {
    let mut most: f64 = 0.0;
    for i in 0..INSTANTS {
        let pose = Pose::hinged(hinge_offset, &Attitude::new(&stroke.angles(i as f64 / INSTANTS as f64)));
        for (k, span) in planform.span.iter().enumerate() {
            for edge in [planform.leading[k], planform.trailing[k]] {
                let edge = Flat::new(*span, edge);
                most = most.max((pose.velocity_of(&edge) + air.carried(&pose.place(&edge))).norm());
            }
        }
    }
    most
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::ElevationPhase;
    use crate::parameters::{Bounds, TABLE};
    use crate::simulation::{BodyVelocity, Infeasible, Model, Simulation, simulate};
    use crate::uvlm::Settings;

    fn coarse() -> Settings {
        Settings {
            chordwise_panels: 2,
            spanwise_panels: 4,
            steps_per_stroke: 24,
            strokes: 4,
            strokes_most: 4,
            strokes_dropped: 1,
            wake_strokes: 1.0,
            ..Settings::default()
        }
    }

    fn simulation(parameters: [f64; 10], settings: Settings) -> Simulation {
        Simulation {
            model: Model::Uvlm(settings),
            insect: Insect::default(),
            parameters,
            elevation_phase: ElevationPhase::Plus,
            elastic_storage: 0.0,
            body_velocity: BodyVelocity::default(),
        }
    }

    /// Over the limit, the greatest mean load of the strokes kept.
    fn share(parameters: [f64; 10], settings: Settings) -> Option<f64> {
        let simulation = simulation(parameters, settings);
        let insect = Insect::default();
        let stroke = Stroke::new(&parameters, ElevationPhase::Plus);
        let planform = Planform::of_insect(&insect, &settings);
        let body = crate::balance::Body::new(&simulation, &stroke);
        let limit = Limit::new(&insect, &planform, &stroke, &body.air());
        let means = simulate(&simulation).ok()?;
        let kept = &means.strokes[settings.strokes_dropped..];
        let force = |s: &crate::simulation::StrokeMean| s.tangential_n.hypot(s.normal_n) / 2.0 / limit.force_n;
        let power = |s: &crate::simulation::StrokeMean| s.joints.iter().map(|j| j.aerodynamic_w.abs()).sum::<f64>();
        let rate = 2.0 * limit.moment_nm / stroke.period();
        Some(kept.iter().map(|s| force(s).max(power(s) / rate / 20.0)).fold(0.0, f64::max))
    }

    #[test]
    fn no_stroke_of_the_literature_or_the_whole_range_comes_near_the_limit() {
        for case in &crate::cases::CASES {
            let share = share(case.parameters, coarse()).unwrap();
            assert!(share < 0.05, "{}: {share}", case.name);
        }
        let widest = Bounds { lower: TABLE.map(|p| p.least), upper: TABLE.map(|p| p.most) };
        let all = |_: &[f64; 10]| true;
        let drawn = [Bounds::default(), widest].into_iter().flat_map(|bounds| {
            (0..25).filter_map(move |i| crate::sampling::sample_with_faces(&bounds, 5, i, 0.5, &all))
        });
        let mut flown = 0;
        for x in drawn {
            // Nothing of these is refused as nonsense; some collide.
            let settings = Settings { strokes: 2, strokes_most: 2, strokes_dropped: 0, ..coarse() };
            match simulate(&simulation(x, settings)) {
                Err(Infeasible::Collision { .. }) => {}
                Err(why) => panic!("{x:?}: {why}"),
                Ok(_) => flown += 1,
            }
        }
        assert!(flown > 20, "{flown}");
    }

    #[test]
    fn finite_nonsense_is_a_lattice_which_blew_up() {
        let stroke = crate::cases::CASES[2].parameters;
        for (panels, core) in [(1, 0.4), (2, 0.35)] {
            let settings = Settings { chordwise_panels: panels, spanwise_panels: 6, steps_per_stroke: 40, ..coarse() };
            let simulation = simulation(stroke, Settings { bound_core: core, ..settings });
            let why = simulate(&simulation).unwrap_err();
            assert!(matches!(why, Infeasible::BlowUp { .. } | Infeasible::Beyond { .. }), "{why}");
            assert!(why.to_string().contains("blew up"), "{why}");
        }
    }
}
