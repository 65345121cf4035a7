//! Theodorsen: lift of an oscillating plate; Garrick: its thrust.

use std::f64::consts::PI;

use manduca_numerics::kinematics::Vector;
use manduca_numerics::math::{atan2, sin_cos};
use manduca_numerics::uvlm::Pose;
use rayon::prelude::*;

use super::scheme::Scheme;
use super::wing::{Wing, level};
use crate::check::{Expected, Group, Row, Setup};
use crate::markdown::percent;
use crate::plot::{Figure, Mark, Panel, Series};

/// Title of the checks.
pub const TITLE: &str = "Theodorsen and Garrick: oscillating plate";
const THEODORSEN: &str = "Theodorsen, NACA TR 496";
const GARRICK: &str = "Garrick, NACA TR 567";

/// Reduced frequency ω b / U and Theodorsen's function.
pub const FUNCTION: [(f64, f64, f64); 7] = [
    (0.05, 0.9090, -0.1306),
    (0.1, 0.8319, -0.1723),
    (0.2, 0.7276, -0.1886),
    (0.3, 0.6650, -0.1793),
    (0.5, 0.5979, -0.1507),
    (1.0, 0.5394, -0.1003),
    (2.0, 0.5130, -0.0577),
];

/// What the plate does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// Up and down, level.
    Plunge,
    /// Nose up and down about the quarter-chord line.
    Pitch,
}

impl Motion {
    fn name(self) -> &'static str {
        match self {
            Self::Plunge => "plunge",
            Self::Pitch => "pitch about c/4",
        }
    }
}

/// Amplitude of the plunging velocity over U, or of the pitch angle, rad.
const AMPLITUDE: f64 = 0.01;

/// First harmonic of the lift over span, and the mean thrust.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    /// Real part over the amplitude.
    pub real: f64,
    /// Imaginary part over the amplitude.
    pub imaginary: f64,
    /// Mean thrust coefficient.
    pub thrust: f64,
}

impl Response {
    fn size(&self) -> f64 {
        self.real.hypot(self.imaginary)
    }

    fn phase(&self) -> f64 {
        atan2(self.imaginary, self.real).to_degrees()
    }
}

fn pose(motion: Motion, omega: f64, time: f64) -> Pose {
    let (s, c) = sin_cos(omega * time);
    match motion {
        // Downward velocity h' = amplitude cos ωt.
        Motion::Plunge => {
            level(0.0, Vector::new(time, 0.0, -AMPLITUDE / omega * s), Vector::new(1.0, 0.0, -AMPLITUDE * c))
        }
        Motion::Pitch => Pose {
            omega: Vector::new(0.0, AMPLITUDE * omega * s, 0.0),
            ..level(AMPLITUDE * c, Vector::new(time, 0.0, 0.0), Vector::x())
        },
    }
}

/// The lattice's answer in the last of some periods.
pub fn response(motion: Motion, k: f64, scheme: Scheme) -> Response {
    let omega = 2.0 * k;
    let period = 2.0 * PI / omega;
    let steps = (period / scheme.step()).round().max(8.0) as usize;
    let (dt, cycles) = (period / steps as f64, if k < 0.2 { 2 } else { 4 });
    let wing = Wing { in_plane: 1.0, ..Wing::two_dimensional(scheme.with_step(dt)) };
    let mut solver = wing.solver(period * f64::from(cycles));
    let mut sums = [0.0; 3];
    for i in 0..steps * cycles as usize {
        let time = i as f64 * dt;
        let Some(load) = solver.step(&pose(motion, omega, time), dt) else {
            return Response { real: f64::NAN, imaginary: f64::NAN, thrust: f64::NAN };
        };
        if i >= steps * (cycles as usize - 1) {
            let (s, c) = sin_cos(omega * time);
            let lift = load.force.z / wing.area();
            sums[0] += 2.0 / steps as f64 * lift * c;
            sums[1] -= 2.0 / steps as f64 * lift * s;
            sums[2] += load.force.x / (0.5 * wing.area()) / steps as f64;
        }
    }
    Response { real: sums[0] / AMPLITUDE, imaginary: sums[1] / AMPLITUDE, thrust: sums[2] }
}

/// Theory, with b = 1/2 and the motion's amplitude as unit:
/// π ρ b² (h'' + U α' - b a α'') + 2π ρ U b C(k) [h' + U α + b (1/2 - a) α'], a = -1/2.
pub fn theory(motion: Motion, (k, re, im): (f64, f64, f64)) -> Response {
    let omega = 2.0 * k;
    let height = AMPLITUDE / omega;
    match motion {
        Motion::Plunge => Response {
            real: PI * re,
            imaginary: PI * im + 0.25 * PI * omega,
            thrust: 4.0 * PI * (k * height).powi(2) * (re * re + im * im),
        },
        Motion::Pitch => Response {
            real: -PI / 16.0 * omega * omega + PI * (re - 0.5 * omega * im),
            imaginary: 0.25 * PI * omega + PI * (im + 0.5 * omega * re),
            thrust: f64::NAN,
        },
    }
}

/// Settings of a check: fine enough for the frequency, with small or the default cores, or as flown.
pub fn scheme(setup: Setup, k: f64) -> Scheme {
    let (step, panels) = match k {
        k if k < 0.1 => (0.25, 8),
        k if k < 1.0 => (0.125, 16),
        _ => (0.0625, 32),
    };
    match setup {
        Setup::Fine => Scheme::fine(1e-6, step, panels),
        Setup::Production => Scheme::production().with_panels(panels).with_step(step),
        Setup::Flown => Scheme::production(),
    }
}

fn rows(motion: Motion, setup: Setup, point: (f64, f64, f64)) -> Vec<Row> {
    let (got, want) = (response(motion, point.0, scheme(setup, point.0)), theory(motion, point));
    let name = format!("{}, k = {}", motion.name(), point.0);
    let row = |what, source, expected, got| Row { what, source, setup, expected, got };
    let size = Expected::Within { value: want.size(), share: 0.03 };
    let phase = Expected::Near { value: want.phase(), distance: 3.0 };
    let mut rows = vec![
        row(format!("{name}: lift"), THEODORSEN, size, got.size()),
        row(format!("{name}: phase, °"), THEODORSEN, phase, got.phase()),
    ];
    if motion == Motion::Plunge {
        let thrust = Expected::Within { value: want.thrust, share: 0.05 };
        rows.push(row(format!("{name}: thrust"), GARRICK, thrust, got.thrust));
    }
    rows
}

/// Relative error of the plunging plate's lift as flown but with small cores.
fn lattice_error(k: f64) -> f64 {
    let Some(point) = FUNCTION.iter().find(|p| p.0 == k) else { return f64::NAN };
    let got = response(Motion::Plunge, k, Scheme::production_without_cores());
    got.size() / theory(Motion::Plunge, *point).size() - 1.0
}

/// The checks.
pub fn group() -> Group {
    let stroke = Scheme::production().reduced_frequency();
    let steps = |k: f64| stroke / k * Scheme::production().settings.steps_per_stroke as f64;
    let mut work = Vec::new();
    for motion in [Motion::Plunge, Motion::Pitch] {
        for setup in Setup::ALL {
            work.extend(FUNCTION.map(|point| (motion, setup, point)));
        }
    }
    let lattice = |k: f64| percent(lattice_error(k), 1);
    Group {
        title: TITLE,
        about: format!(
            "Lift per span of a plunging and of a pitching plate, amplitude over ρ U² c times the motion's amplitude \
             (h'/U or α), and the thrust of the plunging one, all of it leading-edge suction: \
             C_T = 4π k² (h0/c)² |C(k)|². A hawkmoth's stroke as a whole is an oscillation at k = {stroke:.2}, its \
             rotation has twice that. 8 panels and steps of 0.25 chords, from k = 0.1 on 16 and 0.125, from k = 1 on 32 and \
             0.0625. As flown, a period has {:.0} steps at k = 1 and {:.0} at k = 2, and dΓ/dt is of second order in them: \
             with small cores the plunging plate's lift is then off by {} at k = 0.5, {} at k = 1 and {} at k = 2; the rest is the cores'.",
            steps(1.0),
            steps(2.0),
            lattice(0.5),
            lattice(1.0),
            lattice(2.0),
        ),
        rows: work.into_par_iter().flat_map_iter(|(motion, setup, point)| rows(motion, setup, point)).collect(),
    }
}

/// Amplitude and phase of the plunging plate's lift against reduced frequency.
pub fn figure() -> Figure {
    let curves = [
        ("fine", Mark::Line, scheme as fn(Setup, f64) -> Scheme, Setup::Fine),
        ("default", Mark::Dashed, scheme, Setup::Production),
        ("as flown", Mark::Dashed, scheme, Setup::Flown),
    ];
    let responses = curves.map(|(_, _, scheme, setup)| {
        let at = |p: &(f64, f64, f64)| (p.0, response(Motion::Plunge, p.0, scheme(setup, p.0)));
        FUNCTION[1..].par_iter().map(at).collect::<Vec<_>>()
    });
    let panel = |y: &str, part: fn(&Response) -> f64| {
        let exact = FUNCTION[1..].iter().map(|p| (p.0, part(&theory(Motion::Plunge, *p))));
        let mut series = vec![Series::new("theory", Mark::Points, exact)];
        for ((label, mark, ..), points) in curves.iter().zip(&responses) {
            series.push(Series::new(*label, *mark, points.iter().map(|(k, r)| (*k, part(r)))));
        }
        Panel { x: "reduced frequency k".into(), y: y.into(), series }
    };
    let panels = vec![panel("lift / (ρ U c h')", Response::size), panel("phase before h', °", Response::phase)];
    Figure { panels, columns: 2 }
}
