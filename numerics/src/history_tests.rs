use super::*;
use crate::insect::Insect;
use crate::parameters::at;
use crate::quasi_steady;
use crate::simulation::{BodyVelocity, StrokeMean};

fn coarse() -> Settings {
    Settings {
        chordwise_panels: 3,
        spanwise_panels: 4,
        steps_per_stroke: 16,
        strokes: 3,
        strokes_most: 3,
        strokes_dropped: 1,
        wake_strokes: 1.0,
        wake_joined_after: 20.0,
        ..Settings::default()
    }
}

fn simulation(model: Model, stroke_plane_deg: f64) -> Simulation {
    let mut parameters = [26.0, 0.0, -6.0, 3.0, 8.0, 55.0, 7.0, 55.0, 0.3, 1.3];
    parameters[at::STROKE_PLANE] = stroke_plane_deg;
    Simulation {
        model,
        insect: Insect::default(),
        parameters,
        elevation_phase: ElevationPhase::Plus,
        elastic_storage: 0.3,
        body_velocity: BodyVelocity::default(),
    }
}

fn steps(text: &str) -> Steps {
    text.parse().unwrap()
}

/// The mean of one quantity over a stroke's steps is that of the stroke, within rounding
/// of its largest value.
fn assert_means(recorder: &Recorder, number: usize, stroke: &StrokeMean) {
    let of_stroke = recorder.history.iter().filter(|i| i.moment.stroke == number);
    let rows: Vec<_> = of_stroke.map(|i| (i.moment.share, i.moment.snapshot)).collect();
    let same = |what: &str, f: &dyn Fn(&crate::balance::Snapshot) -> f64, mean: f64| {
        let scale = rows.iter().fold(0.0_f64, |most, (_, row)| most.max(f(row).abs()));
        let averaged: f64 = rows.iter().map(|(share, row)| share * f(row)).sum();
        assert!((averaged - mean).abs() <= 1e-12 * scale, "stroke {number}, {what}: {averaged} against {mean}");
        assert!(scale > 0.0, "stroke {number}: no {what}");
    };
    same("lift", &|s| s.lift_n, stroke.outputs[0]);
    same("drag", &|s| s.drag_n, stroke.outputs[1]);
    same("moment", &|s| s.moment_nm, stroke.outputs[2]);
    // Power is integrated on a finer grid than that of the steps.
    let power = |s: &crate::balance::Snapshot| s.joints.iter().map(|j| j.required_w).sum::<f64>();
    let averaged: f64 = rows.iter().map(|(share, row)| share * power(row)).sum();
    assert!((0.75..1.33).contains(&(averaged / stroke.outputs[3])), "power: {averaged} against {}", stroke.outputs[3]);
}

#[test]
fn the_means_of_a_history_are_those_of_the_flight() {
    for model in [Model::Uvlm(coarse()), Model::QuasiSteady(quasi_steady::Settings::default())] {
        let (flown, recorder) = record(&simulation(model, 15.0), &Steps::none()).unwrap();
        let means = flown.unwrap();
        for (i, stroke) in means.strokes.iter().enumerate() {
            assert_means(&recorder, i + 1, stroke);
        }
        assert!(recorder.wakes.is_empty());
    }
}

#[test]
fn a_history_has_every_step_at_its_time() {
    let (_, recorder) =
        record(&simulation(Model::Uvlm(Settings { steps_by_speed: 0.0, ..coarse() }), 15.0), &Steps::none()).unwrap();
    assert_eq!(recorder.history.len(), 3 * 16);
    for (i, instant) in recorder.history.iter().enumerate() {
        assert_eq!((instant.moment.stroke, instant.moment.step), (i / 16 + 1, i % 16));
        assert!((instant.time_s - i as f64 / (16.0 * 26.0)).abs() < 1e-15, "{i}");
    }
}

#[test]
fn the_chosen_steps_have_their_rings() {
    let flight = simulation(Model::Uvlm(coarse()), 0.0);
    let (flown, recorder) = record(&flight, &steps("1:0,2:3,2:3,last")).unwrap();
    let at: Vec<_> = recorder.wakes.iter().map(|w| (w.stroke, w.step)).collect();
    assert_eq!(at, [(1, 0), (2, 3), (3, 15)]);
    // One more row of wake each step, until it is a stroke long.
    for (wake, rows) in recorder.wakes.iter().zip([4, 4 + 16, 4 + 16]) {
        assert_eq!((wake.columns, wake.wing_rows, wake.corners.len()), (5, 4, 5 * rows));
        assert_eq!(wake.circulation.len(), 4 * (rows - 1));
    }
    let (watched_not, all) = record(&flight, &steps("all")).unwrap();
    assert_eq!(all.wakes.len(), 16);
    assert_eq!(all.wakes.last(), recorder.wakes.last());
    assert_eq!(flown, watched_not, "looking changes nothing");
}

/// Joined from two steps on, again from eight: of 32 rows of wake one of two, three of the next six and six of the
/// last 24 are left.
#[test]
fn rows_of_wake_lie_apart_by_the_root_of_their_age() {
    let joined = Settings { wake_strokes: 2.0, wake_joined_after: 0.125, ..coarse() };
    let (_, recorder) = record(&simulation(Model::Uvlm(joined), 0.0), &steps("last")).unwrap();
    let wake = &recorder.wakes[0];
    let rows = wake.corners.len() / wake.columns - wake.wing_rows;
    assert!((10..=13).contains(&rows), "{rows}");
}

#[test]
fn the_last_stroke_can_be_thinned() {
    let at = |text: &str| {
        let (_, recorder) = record(&simulation(Model::Uvlm(coarse()), 0.0), &steps(text)).unwrap();
        recorder.wakes.iter().map(|w| (w.stroke, w.step)).collect::<Vec<_>>()
    };
    assert_eq!(at("all/6"), [(3, 0), (3, 6), (3, 12)]);
    assert_eq!(at("all/16,1:2"), [(1, 2), (3, 0)]);
    let thinned = |most, corners| Steps::thinned(&coarse(), most, corners).to_string();
    assert_eq!((thinned(16, 10_000), thinned(15, 10_000)), ("all".into(), "all/2".into()));
    // Two steps of at most 100 corners.
    assert_eq!((thinned(16, 200), thinned(16, 0)), ("all/8".into(), "all/16".into()));
}

#[test]
fn a_flight_told_to_stop_stops() {
    let flight = simulation(Model::Uvlm(coarse()), 0.0);
    let left = std::cell::Cell::new(20);
    let on = || {
        left.set(left.get() - 1);
        left.get() > 0
    };
    assert!(record_while(&flight, &Steps::last(), &on).unwrap().is_none());
    assert_eq!(left.get(), 0);
    let (flown, recorder) = record_while(&flight, &Steps::last(), &|| true).unwrap().unwrap();
    assert_eq!((flown, recorder.wakes), {
        let (flown, recorder) = record(&flight, &Steps::last()).unwrap();
        (flown, recorder.wakes)
    });
}

#[test]
fn a_tilted_stroke_plane_tilts_the_rings_forward_edge_down() {
    let wakes = |degrees| record(&simulation(Model::Uvlm(coarse()), degrees), &steps("last")).unwrap().1.wakes;
    let (level, tilted) = (wakes(0.0), wakes(90.0));
    for (a, b) in level[0].corners.iter().zip(&tilted[0].corners) {
        // Forward in a level stroke plane is down in an upright one, up is forward.
        let turned = [a[2], a[1], -a[0]];
        assert!(turned.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-15), "{a:?} {b:?}");
    }
    assert_eq!(level[0].circulation, tilted[0].circulation);
}

/// Strokes flown on until the standard errors are small are strokes: `last` is the last of them.
#[test]
fn the_last_stroke_is_the_last_one_flown() {
    let settings = Settings { standard_error: 0.0, strokes_most: 7, ..coarse() };
    let (flown, recorder) = record(&simulation(Model::Uvlm(settings), 0.0), &steps("2:3,3:1,last")).unwrap();
    assert_eq!(flown.unwrap().strokes.len(), 7);
    let at: Vec<_> = recorder.wakes.iter().map(|w| (w.stroke, w.step)).collect();
    assert_eq!(at, [(2, 3), (3, 1), (7, 15)]);
    let (_, all) = record(&simulation(Model::Uvlm(settings), 0.0), &steps("all")).unwrap();
    assert!(all.wakes.len() == 16 && all.wakes.iter().all(|w| w.stroke == 7));
}

/// In mid-downstroke the wing moves forward and lifts: the flow above it is faster, so
/// the bound circulation runs inboard along the leading edge's row (right-hand rule).
#[test]
fn circulation_has_the_sense_it_is_said_to_have() {
    let (_, recorder) = record(&simulation(Model::Uvlm(coarse()), 0.0), &steps("2:4")).unwrap();
    let wake = &recorder.wakes[0];
    assert!(recorder.history[16 + 4].moment.snapshot.lift_n > 0.0);
    let velocity_of_sweep = recorder.history[16 + 4].moment.snapshot.angles[0].rate;
    assert!(velocity_of_sweep > 0.0, "forward");
    // Lift per span is ρ (air past the wing) x Γ: with the air going to -x, up is along x's
    // cross product with -y, the direction from tip to root, so positive by this sense.
    assert!(wake.circulation[..4].iter().sum::<f64>() > 0.0);
    assert!(wake.corners[4][1] > wake.corners[0][1], "columns go outboard");
}

#[test]
fn what_is_no_step_is_refused() {
    for text in ["", "first", "7", "7:", ":0", "-1:0", "7:0.5", "last,,all", "7:0;7:1", "all/", "all/0", "all/-2"] {
        let error = text.parse::<Steps>().unwrap_err().to_string();
        assert!(error.contains("is no step: expected last, all, all/N, or STROKE:STEP"), "{text}: {error}");
    }
    let refused = |text: &str, model| Recorder::new(&simulation(model, 0.0), &steps(text)).unwrap_err().to_string();
    let lattice = Model::Uvlm(coarse());
    assert_eq!(refused("0:3", lattice), "0:3: there are strokes 1 to 3");
    assert_eq!(refused("last,4:0", lattice), "4:0: there are strokes 1 to 3");
    assert_eq!(refused("3:16", lattice), "3:16: a stroke has steps 0 to 15");
    assert!(refused("last", Model::QuasiSteady(quasi_steady::Settings::default())).contains("no wake"));
    let huge = Settings {
        spanwise_panels: 48,
        steps_per_stroke: 720,
        strokes: 20,
        strokes_most: 20,
        wake_strokes: 20.0,
        ..Settings::default()
    };
    assert!(refused("all", Model::Uvlm(huge)).contains("choose fewer steps"));
    assert!(Recorder::new(&simulation(Model::Uvlm(huge), 0.0), &steps("last")).is_ok());
}

#[test]
fn a_collision_leaves_an_empty_record() {
    let mut flight = simulation(Model::Uvlm(coarse()), 0.0);
    (flight.parameters[at::SWEEP_MEAN], flight.parameters[at::SWEEP_AMPLITUDE]) = (60.0, 90.0);
    let (flown, recorder) = record(&flight, &steps("last")).unwrap();
    assert!(matches!(flown, Err(Infeasible::Collision { .. })));
    assert!(recorder.history.is_empty() && recorder.wakes.is_empty());
}
