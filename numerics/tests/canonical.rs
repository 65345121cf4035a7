//! Canonical checks any vortex lattice must pass, against published numbers.
//! Wings have unit chord and unit speed; lengths below are in chords.

mod support;

use std::f64::consts::PI;

use manduca_numerics::kinematics::{Attitude, ElevationPhase, Stroke, Vector};
use manduca_numerics::math::{atan2, cos, sin};
use manduca_numerics::uvlm::{Air, Cores, Lattice, Planform, Pose, Solver, Suction};
use support::Wing;

/// Steady lift slope of rectangular wings: 3.63 (AR 4) and 4.55 (AR 8) per rad,
/// lifting-surface values (Jones & Cohen, High Speed Wing Theory; the 6 x 12
/// lattice is published as 3.72). Uniform spacing converges as 1/N, so two
/// lattices extrapolate.
#[test]
fn rectangular_wings_have_the_lifting_surface_slope() {
    for (aspect, expected) in [(4.0, 3.63), (8.0, 4.55)] {
        let slope = |chordwise, strips| Wing { aspect, chordwise, strips, ..Wing::default() }.lift_slope();
        let extrapolated = 2.0 * slope(8, 24) - slope(4, 12);
        assert!((extrapolated / expected - 1.0).abs() < 0.01, "AR {aspect}: {extrapolated} against {expected}");
    }
    let coarse = Wing { chordwise: 6, strips: 12, ..Wing::default() }.lift_slope();
    assert!((coarse / 3.72 - 1.0).abs() < 0.005, "6 x 12: {coarse}");
}

/// Bertin & Smith, Aerodynamics for Engineers, example 7.2: AR 5, 45° sweep, one
/// panel by four per half: CL = 3.443 α; a 4 x 12 lattice gives 3.27.
#[test]
fn swept_wing_of_bertin_and_smith() {
    let wing = Wing { aspect: 5.0, sweep: PI / 4.0, chordwise: 1, strips: 4, ..Wing::default() };
    let slope = wing.lift_slope();
    assert!((slope / 3.443 - 1.0).abs() < 0.005, "{slope}");
    let finer = Wing { chordwise: 4, strips: 12, ..wing }.lift_slope();
    assert!((finer / 3.27 - 1.0).abs() < 0.01, "{finer}");
}

/// Sudden start at 5°, dt U/c = 1/16, 4 x 13 panels per half (Katz & Plotkin,
/// Low-Speed Aerodynamics, Fig. 13.34). The published lattice has its first wake
/// row a quarter panel behind the edge, which is one step here.
#[test]
fn sudden_start_builds_up_as_published() {
    let cases = [(4.0, [0.297, 0.298, 0.306, 0.314, 0.317]), (8.0, [0.346, 0.353, 0.370, 0.388, 0.398])];
    for (aspect, published) in cases {
        let wing = Wing { aspect, chordwise: 4, strips: 13, first_row: 1.0, ..Wing::default() };
        let lift = wing.sudden_start(5.0_f64.to_radians(), 1.0 / 16.0, 8.0);
        for (time, expected) in [0.5, 1.0, 2.0, 4.0, 8.0].into_iter().zip(published) {
            let got = lift[(time * 16.0) as usize];
            let tolerance = if time <= 1.0 { 0.05 } else { 0.03 };
            assert!((got / expected - 1.0).abs() < tolerance, "AR {aspect} at {time}: {got} against {expected}");
        }
    }
}

/// Wagner's indicial lift (R. T. Jones, NACA TR 681), s in semichords, at the
/// production settings' first wake row and chordwise panels.
#[test]
fn wagner() {
    let published = [(2.0, 0.669), (4.0, 0.758), (6.0, 0.813), (10.0, 0.875), (20.0, 0.937)];
    for (chordwise, step) in [(8, 0.125), (8, 0.25), (16, 0.0625), (16, 0.125)] {
        let wing = Wing { aspect: 2000.0, chordwise, strips: 2, core: 1e-6, ..Wing::default() };
        let lift = wing.sudden_start(0.02, step, 10.0);
        for (s, expected) in published {
            let got = lift[(s / 2.0 / step) as usize] / (2.0 * PI * 0.02);
            assert!(
                (got / expected - 1.0).abs() < 0.03,
                "{chordwise} panels, step {step}, s {s}: {got} against {expected}"
            );
        }
    }
}

/// Theodorsen (NACA TR 496), plunging plate: lift per span
/// π ρ b² h'' + 2π ρ U b C(k) h', amplitude and phase of the first harmonic.
#[test]
fn theodorsen_plunge() {
    for (k, re, im) in [(0.1, 0.8319, -0.1723), (0.3, 0.6650, -0.1793), (0.5, 0.5979, -0.1507), (1.0, 0.5394, -0.1003)]
    {
        let omega = 2.0 * k;
        let period = 2.0 * PI / omega;
        let steps = (period / 0.125).round() as usize;
        let (dt, cycles) = (period / steps as f64, if k < 0.2 { 2 } else { 4 });
        let wing = Wing { aspect: 2000.0, chordwise: 16, strips: 2, core: 1e-6, ..Wing::default() };
        let mut solver = wing.solver(dt, steps * cycles);
        let amplitude = 0.01;
        let (mut cosine, mut sine) = (0.0, 0.0);
        for i in 0..steps * cycles {
            // Downward plunge velocity h' = amplitude cos(ωt); the plate stays level.
            let phase = omega * i as f64 * dt;
            let height = -amplitude / omega * sin(phase);
            let mut pose = Wing::pose(0.0, i as f64 * dt, Vector::new(1.0, 0.0, -amplitude * cos(phase)), 0.0);
            pose.origin.z = height;
            let lift = solver.step(&pose, dt).expect("holds").force.z / wing.area();
            if i >= steps * (cycles - 1) {
                cosine += 2.0 / steps as f64 * lift * cos(phase);
                sine += 2.0 / steps as f64 * lift * sin(phase);
            }
        }
        // As real and imaginary part of the lift over h' = amplitude e^{iωt}, b = 1/2.
        let (got_re, got_im) = (cosine / amplitude, -sine / amplitude);
        let (want_re, want_im) = (PI * re, PI * im + PI * 0.25 * omega);
        let (size, want) = (got_re.hypot(got_im), want_re.hypot(want_im));
        let turn = (atan2(got_im, got_re) - atan2(want_im, want_re)).to_degrees();
        assert!((size / want - 1.0).abs() < 0.03 && turn.abs() < 3.0, "k {k}: {size} against {want}, {turn}° off");
    }
}

/// Added mass of a rectangular plate moving along its normal, in π ρ c² b / 4:
/// AR 1 0.579, 2 0.757, 4 0.872 (Meyerhoff 1970, J. Ship Research 14).
#[test]
fn added_mass_of_plates() {
    for (aspect, expected) in [(1.0, 0.579), (2.0, 0.757), (4.0, 0.872)] {
        let coefficient = |chordwise: usize, strips: usize| {
            // A closed plate: the last ring ends a quarter panel behind the edge, where the lattice has its edge.
            let planform = Planform::straight(0.0, 0.5 * aspect, 1.0, 0.0, strips, 0.0);
            let behind = vec![0.25 / chordwise as f64; strips + 1];
            let lattice = Lattice::new(&planform, chordwise, &behind);
            let panel_area = 0.5 * aspect / (chordwise * strips) as f64;
            let mut solver =
                Solver::new(lattice, Air::still(1.0), Cores::uniform(1e-6), Suction { to_lift: 0.0, in_plane: 0.0 }, 1);
            solver.step(&Wing::pose(0.0, 0.0, Vector::new(0.0, 0.0, -1.0), 0.0), 1.0).expect("holds");
            // Momentum of the air: ρ ∫ Γ dA over both halves.
            let impulse: f64 = solver.circulation().iter().map(|g| 2.0 * g * panel_area).sum();
            impulse / (PI / 4.0 * aspect)
        };
        // Uniform lattices of square panels converge as 1/N with a 1/N² remainder.
        let base = 6;
        let half = |scale: usize| ((base * scale) as f64 * 0.5 * aspect).round() as usize;
        let [a, b, c] = [1, 2, 3].map(|scale| coefficient(base * scale, half(scale)));
        let extrapolated = 0.5 * a - 4.0 * b + 4.5 * c;
        assert!((extrapolated / expected - 1.0).abs() < 0.005, "AR {aspect}: {extrapolated} against {expected}");
    }
}

/// Induced drag: with the suction kept in the plane, drag is what the wake takes,
/// close to CL²/(π AR) for a rectangular wing of moderate aspect ratio (efficiency
/// 0.97 to 1, Katz & Plotkin, Table 12.1 family).
#[test]
fn suction_in_the_plane_leaves_the_induced_drag() {
    let wing = Wing { aspect: 4.0, chordwise: 8, strips: 16, in_plane: 1.0, cosine: 0.5, ..Wing::default() };
    let incidence = 0.1;
    let load = *wing.history(incidence, 0.25, 20.0).last().expect("steps");
    let (lift, drag) = (load.force.z / (0.5 * wing.area()), -load.force.x / (0.5 * wing.area()));
    let ideal = lift * lift / (PI * wing.aspect);
    assert!((0.95..1.08).contains(&(drag / ideal)), "{drag} against {ideal}");
}

/// Two flapping rectangular wings of 48.5 x 18 mm, hinges 5 mm off the plane of
/// symmetry, axis at c/4, f 26.8 Hz, φa = αa = 60°, 6 x 12 panels, 40 steps: mean
/// lift over the second half of stroke 1 is 19.3 to 22.5 mN in four public codes
/// whose loads contain the full suction in the wing's plane.
#[test]
fn agrees_with_other_codes_in_the_first_stroke() {
    let x = [26.8, 0.0, 0.0, 0.0, 0.0, 60.0, 0.0, 60.0, 0.0, 0.0];
    let stroke = Stroke::new(&x, ElevationPhase::Plus);
    let (chord, steps) = (0.018, 40);
    let dt = stroke.period() / f64::from(steps);
    let planform = Planform::straight(0.0, 0.0485, chord, 0.0, 12, 0.0);
    let speed = |r: f64| r * 4.0 * 60.0_f64.to_radians() * stroke.frequency;
    let behind: Vec<f64> = planform.span.iter().map(|r| (0.25 * speed(*r) * dt).max(1e-4 * chord)).collect();
    let lattice = Lattice::new(&planform, 6, &behind);
    let mut solver = Solver::new(
        lattice,
        Air::still(1.225),
        Cores::uniform(0.05 * chord),
        Suction { to_lift: 0.0, in_plane: 1.0 },
        3 * steps as usize,
    );
    let mut lift = 0.0;
    for step in 0..steps {
        let attitude = Attitude::new(&stroke.angles(f64::from(step) / f64::from(steps)));
        let pose = Pose {
            origin: Vector::new(0.0, 0.005, 0.0),
            e_r: attitude.e_r,
            e_c: attitude.e_c,
            velocity: Vector::zeros(),
            omega: attitude.omega,
        };
        let load = solver.step(&pose, dt).expect("holds");
        if step >= steps / 2 {
            lift += 2.0 * load.force.z / f64::from(steps / 2);
        }
    }
    assert!((19.3e-3..22.5e-3).contains(&lift), "{} mN", 1e3 * lift);
}
