//! Flights of strokes with changed settings, spread over the cores.

use manduca_numerics::cases::Case;
use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::ElevationPhase;
use manduca_numerics::parameters::Point;
use manduca_numerics::simulation::{BodyVelocity, Infeasible, Means, Model, Moment, Simulation, simulate_watched};
use manduca_numerics::uvlm::Settings;
use rayon::prelude::*;

/// A stroke flown by the vortex lattice, with everything that may be changed about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flight {
    /// The ten parameters.
    pub parameters: Point,
    /// The solver's settings.
    pub settings: Settings,
    /// The insect.
    pub insect: Insect,
    /// Sign of the elevation's second harmonic.
    pub elevation_phase: ElevationPhase,
}

impl Flight {
    /// A stroke at the default settings.
    pub fn of(parameters: Point) -> Self {
        Self {
            parameters,
            settings: Settings::default(),
            insect: Insect::default(),
            elevation_phase: ElevationPhase::default(),
        }
    }

    /// A published stroke at the default settings.
    pub fn of_case(case: &Case) -> Self {
        Self::of(case.parameters)
    }

    /// As the solver takes it.
    pub fn simulation(&self) -> Simulation {
        Simulation {
            model: Model::Uvlm(self.settings),
            insect: self.insect,
            parameters: self.parameters,
            elevation_phase: self.elevation_phase,
            elastic_storage: 0.0,
            body_velocity: BodyVelocity::default(),
        }
    }

    /// Flies it.
    ///
    /// # Errors
    /// When the wings would collide or the lattice blows up.
    pub fn fly(&self) -> Result<Means, Infeasible> {
        manduca_numerics::simulation::simulate(&self.simulation())
    }

    /// Flies it and keeps every step of the last stroke.
    ///
    /// # Errors
    /// As [`Self::fly`].
    pub fn fly_with_history(&self) -> Result<(Means, Vec<Moment>), Infeasible> {
        fly_with_history(&self.simulation())
    }
}

/// Flies any simulation and keeps every step of the last stroke.
///
/// # Errors
/// When the wings would collide or the lattice blows up.
pub fn fly_with_history(simulation: &Simulation) -> Result<(Means, Vec<Moment>), Infeasible> {
    let mut history = Vec::new();
    let means = simulate_watched(simulation, &mut |moment, _| {
        if moment.step == 0 {
            history.clear();
        }
        history.push(*moment);
    })?;
    Ok((means, history))
}

/// Flies all of them on all cores; answers are in the order of the flights.
pub fn fly_all(flights: &[Flight]) -> Vec<Result<Means, Infeasible>> {
    flights.par_iter().map(Flight::fly).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use manduca_numerics::cases::CASES;

    fn small() -> Settings {
        Settings {
            chordwise_panels: 2,
            spanwise_panels: 4,
            steps_per_stroke: 16,
            strokes: 2,
            strokes_most: 2,
            strokes_dropped: 1,
            ..Settings::default()
        }
    }

    #[test]
    fn answers_are_in_the_order_of_the_flights() {
        let flights: Vec<_> = CASES.iter().map(|case| Flight { settings: small(), ..Flight::of_case(case) }).collect();
        let together = fly_all(&flights);
        let alone: Vec<_> = flights.iter().map(Flight::fly).collect();
        assert_eq!(together, alone);
        assert!(together[0] != together[1]);
    }

    #[test]
    fn the_history_is_the_last_stroke_and_has_its_means() {
        let flight = Flight { settings: small(), ..Flight::of_case(&CASES[2]) };
        let (means, history) = flight.fly_with_history().unwrap();
        assert_eq!(history.len(), flight.settings.steps_per_stroke);
        assert!(history.iter().all(|m| m.stroke == 2));
        let lift = history.iter().map(|m| m.share * m.snapshot.lift_n).sum::<f64>();
        assert!((lift / means.outputs[0].mean - 1.0).abs() < 1e-9);
    }
}
