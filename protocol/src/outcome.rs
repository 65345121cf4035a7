//! What a simulation says, as it is said on the wire.

use manduca_numerics::simulation::{self, Infeasible, Means};

use crate::task::{Estimate, JointPower, JointPowers, MeansMessage, ScaledEstimates, SimulateOutcome};

impl SimulateOutcome {
    /// Of a flight; none where a mean is not finite, which JSON has no word for.
    pub fn of(flown: Result<Means, Infeasible>) -> Option<Self> {
        let means = match flown {
            Ok(means) => means,
            Err(why) => return Some(Self::Infeasible { reason: why.to_string() }),
        };
        let estimates = means.outputs.iter().chain(&means.scaled).flat_map(|e| [e.mean, e.se]);
        let joints = means.joints.iter().flat_map(|j| [j.aerodynamic_w, j.inertial_w, j.required_w]);
        if !estimates.chain(joints).all(f64::is_finite) {
            return None;
        }
        let [lift_n, drag_n, pitch_moment_nm, power_w] = means.outputs.map(estimate);
        let [lift, drag, pitch_moment, power] = means.scaled.map(estimate);
        let [sweep, elevation, rotation] = means.joints.map(joint);
        let per_lift = Some(means.power_per_lift()).filter(|p| p.is_finite() && lift_n.mean > 0.0);
        Some(Self::Ok {
            means: MeansMessage { lift_n, drag_n, pitch_moment_nm, power_w },
            scaled: ScaledEstimates { lift, drag, pitch_moment, power },
            joints: JointPowers { sweep, elevation, rotation },
            power_per_lift_w_per_n: per_lift,
            strokes_averaged: u32::try_from(means.strokes_averaged).unwrap_or(u32::MAX),
        })
    }
}

fn estimate(e: simulation::Estimate) -> Estimate {
    Estimate { mean: e.mean, se: e.se }
}

fn joint(j: simulation::JointPower) -> JointPower {
    JointPower { aerodynamic_w: j.aerodynamic_w, inertial_w: j.inertial_w, required_w: j.required_w }
}

#[cfg(test)]
mod tests {
    use manduca_numerics::simulation::{Estimate, JointPower};

    use super::{Infeasible, Means, SimulateOutcome};

    fn means(lift: f64) -> Means {
        let at = |mean| Estimate { mean, se: 0.25 };
        Means {
            outputs: [at(lift), at(2.0), at(3.0), at(4.0)],
            scaled: [at(5.0), at(6.0), at(7.0), at(8.0)],
            joints: [JointPower { aerodynamic_w: 9.0, inertial_w: 10.0, required_w: 11.0 }; 3],
            stroke_axes: [Estimate::default(); 3],
            strokes_averaged: 6,
            strokes: Vec::new(),
        }
    }

    #[test]
    fn every_mean_lands_under_its_name() {
        let SimulateOutcome::Ok { means: si, scaled, joints, power_per_lift_w_per_n, strokes_averaged } =
            SimulateOutcome::of(Ok(means(0.5))).unwrap()
        else {
            panic!("flown")
        };
        assert_eq!((si.lift_n.mean, si.drag_n.mean, si.pitch_moment_nm.mean, si.power_w.mean), (0.5, 2.0, 3.0, 4.0));
        assert_eq!((scaled.lift.mean, scaled.drag.mean, scaled.pitch_moment.mean), (5.0, 6.0, 7.0));
        assert_eq!((scaled.power.mean, scaled.power.se, joints.rotation.inertial_w), (8.0, 0.25, 10.0));
        assert_eq!((power_per_lift_w_per_n, strokes_averaged), (Some(8.0), 6));
    }

    #[test]
    fn numbers_which_are_none_are_no_result() {
        assert_eq!(SimulateOutcome::of(Ok(means(f64::NAN))), None);
        assert_eq!(SimulateOutcome::of(Ok(means(f64::INFINITY))), None);
    }

    #[test]
    fn an_infeasible_stroke_is_an_answer() {
        let answer = SimulateOutcome::of(Err(Infeasible::BlowUp { stroke: 3 })).unwrap();
        assert!(matches!(answer, SimulateOutcome::Infeasible { reason } if reason.contains("stroke 3")));
        let SimulateOutcome::Ok { power_per_lift_w_per_n, .. } = SimulateOutcome::of(Ok(means(-0.1))).unwrap() else {
            panic!("flown")
        };
        assert_eq!(power_per_lift_w_per_n, None);
    }
}
