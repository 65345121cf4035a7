//! A hovering stroke flown by the vortex lattice.

use crate::balance::{Body, Cycle, FinePower};
use crate::insect::Insect;
use crate::kinematics::{Attitude, Clock, Stroke};
use crate::simulation::{Infeasible, Means, Moment, Simulation, StrokeMean};
use crate::uvlm::first_row::first_row;
use crate::uvlm::geometry::{Flat, Lattice, Planform, Pose};
use crate::uvlm::limit::{Limit, Loads};
use crate::uvlm::{Air, Cores, Settings, Solver, Suction};

/// Flies all strokes and returns the mean of each; none when `watch`, shown every step, said not
/// to go on.
///
/// # Errors
/// When the lattice blows up.
pub fn fly(
    simulation: &Simulation,
    settings: &Settings,
    watch: &mut dyn FnMut(&Moment, Option<&Solver>) -> bool,
) -> Result<Option<Vec<StrokeMean>>, Infeasible> {
    let insect = &simulation.insect;
    let stroke = Stroke::new(&simulation.parameters, simulation.elevation_phase);
    let body = Body::new(simulation, &stroke);
    let mut solver = solver(insect, settings, &stroke, body.air());
    let clock = Clock::new(&stroke, &solver.lattice().trailing, settings.steps_per_stroke, settings.steps_by_speed);
    let mut power = FinePower::new(&body, &stroke, &clock);
    let limit = Limit::new(insect, &Planform::of_insect(insect, settings), &stroke, &body.air());
    let mut means = Vec::with_capacity(settings.strokes);
    while wants_more(&means, settings, insect) {
        let number = means.len() + 1;
        let (mut cycle, mut loads) = (Cycle::new(&body), Loads::default());
        for step in 0..settings.steps_per_stroke {
            let dt = (clock.phase(step as f64) - clock.phase(step as f64 - 1.0)) * stroke.period();
            let angles = stroke.angles(clock.phase(step as f64));
            let attitude = Attitude::new(&angles);
            let load = solver
                .step(&Pose::hinged(insect.hinge_offset_m, &attitude), dt)
                .ok_or(Infeasible::BlowUp { stroke: number })?;
            power.add(&attitude, &load.moment);
            let (phase, share) = (clock.phase(step as f64), clock.weight(step));
            loads.add(&load, share);
            let snapshot = cycle.add(&angles, &attitude, &load, share);
            if !watch(&Moment { stroke: number, step, phase, share, snapshot }, Some(&solver)) {
                return Ok(None);
            }
        }
        if let Some(times) = limit.exceeded(&loads).filter(|_| number > settings.strokes_dropped) {
            return Err(Infeasible::Beyond { stroke: number, times });
        }
        means.push(cycle.mean_with(power.take()));
    }
    Ok(Some(means))
}

/// Whether another stroke is to be flown: all strokes asked for, then pairs of
/// strokes until the standard errors are small enough or patience ends. Forces count
/// in stroke-plane axes, so that the tilt of the stroke plane decides nothing.
fn wants_more(flown: &[StrokeMean], settings: &Settings, insect: &Insect) -> bool {
    let extra = flown.len().saturating_sub(settings.strokes);
    if flown.len() < settings.strokes || extra % 2 == 1 {
        return true;
    }
    if flown.len() + 2 > settings.strokes_most {
        return false;
    }
    // The mean of one stroke has no standard error to be judged by.
    if flown.len() < settings.strokes_dropped + 2 {
        return true;
    }
    let means = Means::over(flown, settings.strokes_dropped, insect);
    let weight = insect.scales()[0];
    let [tangential, normal, _] = means.stroke_axes.map(|e| e.se / weight);
    let [_, _, moment, power] = means.scaled.map(|e| e.se);
    [tangential, normal, moment, power].iter().any(|se| *se > settings.standard_error)
}

fn solver(insect: &Insect, settings: &Settings, stroke: &Stroke, air: Air) -> Solver {
    let planform = Planform::of_insect(insect, settings);
    let speeds = edge_speeds(&planform, insect.hinge_offset_m, stroke, &air);
    solver_of(&planform, settings, insect.mean_chord_m, stroke.period(), &speeds, air)
}

/// A wing of any planform at these settings, whose lengths count in `chord` (m) and times in
/// `period` (s); `edge_speeds` is the mean speed of the trailing edge at each station, m/s.
pub fn solver_of(
    planform: &Planform,
    settings: &Settings,
    chord: f64,
    period: f64,
    edge_speeds: &[f64],
    air: Air,
) -> Solver {
    let steps = settings.steps_per_stroke as f64;
    let behind: Vec<f64> = edge_speeds
        .iter()
        .enumerate()
        .map(|(k, speed)| {
            let panel = (planform.leading[k] - planform.trailing[k]) / settings.chordwise_panels as f64;
            first_row(settings.first_row, panel, speed * period / steps)
        })
        .collect();
    let cores = Cores {
        bound: settings.bound_core * chord,
        bound_on_wake: settings.bound_core_on_wake * chord,
        wake_on_wake: settings.wake_core_on_wake * chord,
        fresh_on_wing: settings.fresh_core_on_wing * chord,
        developed_on_wing: settings.wake_core_on_wing * chord,
        over_wing: settings.core_over_wing * chord,
        growth_time: settings.core_growth_time * period,
        spreading: (settings.wake_spreading * chord).powi(2) / period,
    };
    let suction = Suction { to_lift: settings.suction_to_lift, in_plane: settings.suction_in_plane };
    let kept = (settings.wake_strokes * steps).round().max(1.0) as usize;
    let lattice = Lattice::new(planform, settings.chordwise_panels, &behind);
    let mut solver = Solver::new(lattice, air, cores, suction, kept);
    let joined = (settings.wake_joined_after * steps).round() as usize;
    if joined < kept {
        solver = solver.joining_after(joined, settings.steps_per_stroke);
    }
    if settings.wake_tail > 0.0 {
        solver = solver.with_tail(settings.steps_per_stroke, settings.wake_tail * chord);
    }
    if settings.single_precision_wake == 1 {
        solver = solver.single_precision_wake();
    }
    solver
}

/// Mean speed of the trailing edge through the air at each station over a stroke, m/s.
fn edge_speeds(planform: &Planform, hinge_offset: f64, stroke: &Stroke, air: &Air) -> Vec<f64> {
    const INSTANTS: usize = 200;
    let mut speeds = vec![0.0; planform.span.len()];
    for i in 0..INSTANTS {
        let pose = Pose::hinged(hinge_offset, &Attitude::new(&stroke.angles(i as f64 / INSTANTS as f64)));
        for (k, speed) in speeds.iter_mut().enumerate() {
            let edge = Flat::new(planform.span[k], planform.trailing[k]);
            let velocity = pose.velocity_of(&edge) + air.carried(&pose.place(&edge));
            *speed += velocity.norm() / INSTANTS as f64;
        }
    }
    speeds
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::ElevationPhase;
    use crate::simulation::{BodyVelocity, Model};

    fn coarse() -> Settings {
        Settings { chordwise_panels: 2, spanwise_panels: 3, strokes_dropped: 1, ..Settings::default() }
    }

    fn simulation(settings: Settings) -> Simulation {
        Simulation {
            model: Model::Uvlm(settings),
            insect: Insect::default(),
            parameters: crate::cases::CASES[0].parameters,
            elevation_phase: ElevationPhase::Plus,
            elastic_storage: 0.0,
            body_velocity: BodyVelocity::default(),
        }
    }

    #[test]
    fn one_stroke_is_not_enough_to_judge_its_error_by() {
        let insect = Insect::default();
        let settings = Settings { strokes: 2, strokes_most: 8, ..coarse() };
        assert!(wants_more(&[StrokeMean::default(); 2], &settings, &insect));
        assert!(!wants_more(&[StrokeMean::default(); 4], &settings, &insect));
        assert!(!wants_more(&[StrokeMean::default(); 2], &Settings { strokes_most: 2, ..settings }, &insect));
    }

    #[test]
    fn every_stroke_keeps_the_same_rows() {
        // Ten steps are no multiple of four.
        let steps = 10;
        let settings = Settings {
            steps_per_stroke: steps,
            strokes: 7,
            strokes_most: 7,
            wake_strokes: 3.0,
            wake_joined_after: 0.2,
            ..coarse()
        };
        let mut rows = Vec::new();
        let mut watch = |_: &Moment, solver: Option<&Solver>| {
            let rings = solver.map(Solver::rings);
            rows.extend(rings.map(|r| r.nodes[0].len() / r.columns));
            true
        };
        fly(&simulation(settings), &settings, &mut watch).unwrap();
        assert_eq!(rows[5 * steps..6 * steps], rows[6 * steps..]);
        assert!(rows[6 * steps] < 3 + 30, "rows were joined: {}", rows[6 * steps]);
    }

    #[test]
    fn the_shortest_wake_there_can_be_flies() {
        let settings = Settings { steps_per_stroke: 8, wake_strokes: 0.1, strokes: 3, strokes_most: 3, ..coarse() };
        let flown = fly(&simulation(settings), &settings, &mut |_, _| true).unwrap().unwrap();
        assert!(flown.iter().all(|stroke| stroke.normal_n.is_finite()));
    }
}
