//! One simulation: an insect, a stroke and a model in, the means out.

use crate::balance::Snapshot;
use crate::insect::Insect;
use crate::kinematics::ElevationPhase;
use crate::parameters::Point;
use crate::{quasi_steady, uvlm};

/// Version of the numbers: it changes whenever any result may change.
pub const SOLVER_VERSION: &str = "9";

/// Which aerodynamics, with its settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Model {
    /// Extended unsteady vortex lattice.
    Uvlm(uvlm::Settings),
    /// Blade elements (Berman & Wang 2007).
    QuasiSteady(quasi_steady::Settings),
}

/// Velocity of the body through still air, earth axes; zero in hover.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BodyVelocity {
    /// Forward, m/s.
    pub forward_m_s: f64,
    /// Down, m/s.
    pub down_m_s: f64,
    /// Pitch rate, nose up, rad/s.
    pub pitch_rad_s: f64,
}

/// What is simulated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Simulation {
    /// The aerodynamic model.
    pub model: Model,
    /// The insect.
    pub insect: Insect,
    /// The ten design parameters.
    pub parameters: Point,
    /// Sign of the elevation's second harmonic.
    pub elevation_phase: ElevationPhase,
    /// Share of a joint's negative power that a spring returns, 0 to 1.
    pub elastic_storage: f64,
    /// Velocity of the body.
    pub body_velocity: BodyVelocity,
}

/// A mean and its standard error.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// Mean over the strokes kept.
    pub mean: f64,
    /// Standard error of that mean.
    pub se: f64,
}

/// Power of one joint, both wings, stroke means, W.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointPower {
    /// Against the air.
    pub aerodynamic_w: f64,
    /// Against the wing's own inertia (zero over a stroke when summed over joints).
    pub inertial_w: f64,
    /// Mean of the positive part of their sum, less what a spring returns: what the muscles must deliver.
    pub required_w: f64,
}

/// Means of one stroke, both wings.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StrokeMean {
    /// Lift, drag, pitching moment, power in SI units, order of [`crate::parameters::OUTPUTS`].
    pub outputs: [f64; 4],
    /// Force along the stroke plane, forward, N.
    pub tangential_n: f64,
    /// Force normal to the stroke plane, N.
    pub normal_n: f64,
    /// Pitching moment about the hinge line, nose up, N m.
    pub hinge_moment_nm: f64,
    /// Sweep, elevation, rotation.
    pub joints: [JointPower; 3],
}

/// What a finished simulation says.
#[derive(Debug, Clone, PartialEq)]
pub struct Means {
    /// Lift N, drag N, pitching moment N m, power W.
    pub outputs: [Estimate; 4],
    /// L+, D+, M+, P+ (paper Eq. 4).
    pub scaled: [Estimate; 4],
    /// Power per joint (sweep, elevation, rotation), mean over the strokes kept.
    pub joints: [JointPower; 3],
    /// Tangential and normal force in stroke-plane axes N, hinge moment N m.
    pub stroke_axes: [Estimate; 3],
    /// Strokes in the means.
    pub strokes_averaged: usize,
    /// Every stroke flown, also those dropped.
    pub strokes: Vec<StrokeMean>,
}

impl Means {
    /// Power per lift, W/N; of no meaning where nothing is lifted.
    pub fn power_per_lift(&self) -> f64 {
        self.outputs[3].mean / self.outputs[0].mean
    }
}

/// Why a stroke has no means. An answer like any other, not an error.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Infeasible {
    /// A wing would cross the plane of symmetry.
    #[error("the wings cross the plane of symmetry by {depth_mm:.2} mm")]
    Collision {
        /// How far, mm.
        depth_mm: f64,
    },
    /// The lattice lost its numbers.
    #[error("the vortex lattice blew up in stroke {stroke}")]
    BlowUp {
        /// In which stroke, counted from 1.
        stroke: usize,
    },
    /// The lattice gave finite nonsense.
    #[error("the vortex lattice blew up in stroke {stroke}: its loads are {times:.1} times the most a wing can give")]
    Beyond {
        /// In which stroke, counted from 1.
        stroke: usize,
        /// Mean load over the greatest possible one.
        times: f64,
    },
}

/// A step of a flight, shown to who watches it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Number of the stroke, from 1.
    pub stroke: usize,
    /// Number of the step in its stroke, from 0.
    pub step: usize,
    /// Time since the stroke began, in strokes.
    pub phase: f64,
    /// Its weight in means over the stroke.
    pub share: f64,
    /// Angles, loads and power.
    pub snapshot: Snapshot,
}

/// Flies a simulation.
///
/// # Errors
/// [`Infeasible`] when the wings would collide or the lattice blows up: an answer,
/// with its reason.
pub fn simulate(simulation: &Simulation) -> Result<Means, Infeasible> {
    simulate_watched(simulation, &mut |_, _| {})
}

/// Flies a simulation and shows every step with the vortex lattice as it then is
/// (none for blade elements, whose strokes are all the same and flown once).
///
/// # Errors
/// As [`simulate`].
pub fn simulate_watched(
    simulation: &Simulation,
    watch: &mut dyn FnMut(&Moment, Option<&uvlm::Solver>),
) -> Result<Means, Infeasible> {
    let mut on = |moment: &Moment, solver: Option<&uvlm::Solver>| {
        watch(moment, solver);
        true
    };
    Ok(simulate_while(simulation, &mut on)?.expect("a flight told to go on at every step"))
}

/// Flies as [`simulate_watched`] for as long as `watch` says to go on; none where it did not.
///
/// # Errors
/// As [`simulate`].
pub fn simulate_while(
    simulation: &Simulation,
    watch: &mut dyn FnMut(&Moment, Option<&uvlm::Solver>) -> bool,
) -> Result<Option<Means>, Infeasible> {
    let clearance =
        crate::kinematics::clearance(&simulation.insect, simulation.elevation_phase, &simulation.parameters);
    if clearance < 0.0 {
        return Err(Infeasible::Collision { depth_mm: -1e3 * clearance });
    }
    match &simulation.model {
        Model::Uvlm(settings) => {
            let strokes = uvlm::fly(simulation, settings, watch)?;
            Ok(strokes.map(|strokes| Means::over(&strokes, settings.strokes_dropped, &simulation.insect)))
        }
        // Blade elements have no memory: one stroke is every stroke.
        Model::QuasiSteady(settings) => {
            let mut on = true;
            let stroke = quasi_steady::fly(simulation, settings, &mut |moment| on = on && watch(moment, None));
            Ok(on.then(|| Means::over(&[stroke], 0, &simulation.insect)))
        }
    }
}

/// Instruction level the solver's kernel runs at here. Results have the same bits
/// on every level.
pub fn level() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f") {
            return "avx512";
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return "avx2";
        }
    }
    if cfg!(target_arch = "aarch64") { "neon" } else { "portable" }
}

impl Means {
    /// Means over all strokes but the first `dropped`.
    pub(crate) fn over(strokes: &[StrokeMean], dropped: usize, insect: &Insect) -> Self {
        let kept = &strokes[dropped.min(strokes.len() - 1)..];
        let estimate = |f: &dyn Fn(&StrokeMean) -> f64| estimate(&kept.iter().map(f).collect::<Vec<_>>());
        let outputs: [Estimate; 4] = std::array::from_fn(|i| estimate(&|s| s.outputs[i]));
        let scales = insect.scales();
        let n = kept.len() as f64;
        let joint = |i: usize, f: &dyn Fn(&JointPower) -> f64| kept.iter().map(|s| f(&s.joints[i])).sum::<f64>() / n;
        Self {
            scaled: std::array::from_fn(|i| Estimate {
                mean: outputs[i].mean / scales[i],
                se: outputs[i].se / scales[i],
            }),
            joints: std::array::from_fn(|i| JointPower {
                aerodynamic_w: joint(i, &|j| j.aerodynamic_w),
                inertial_w: joint(i, &|j| j.inertial_w),
                required_w: joint(i, &|j| j.required_w),
            }),
            stroke_axes: [estimate(&|s| s.tangential_n), estimate(&|s| s.normal_n), estimate(&|s| s.hinge_moment_nm)],
            strokes_averaged: kept.len(),
            outputs,
            strokes: strokes.to_vec(),
        }
    }
}

/// Mean of stroke means and its standard error.
///
/// Successive strokes alternate (the wake of one disturbs the next), so strokes
/// are paired and the spread of the pairs' means is used; an odd first stroke is
/// in the mean but in no pair. With fewer than two pairs the strokes themselves
/// are used, and a single stroke has no standard error: 0 stands for it. Few values give a
/// poor idea of their own spread: the error is widened by Student's factor, so that
/// the mean lies within two of it nineteen times in twenty.
pub fn estimate(strokes: &[f64]) -> Estimate {
    let mean = strokes.iter().sum::<f64>() / strokes.len() as f64;
    let pairs: Vec<f64> = strokes.rchunks_exact(2).map(|p| 0.5 * (p[0] + p[1])).collect();
    let sample = if pairs.len() >= 2 { &pairs[..] } else { strokes };
    let n = sample.len() as f64;
    if sample.len() < 2 {
        return Estimate { mean, se: 0.0 };
    }
    let centre = sample.iter().sum::<f64>() / n;
    let variance = sample.iter().map(|x| (x - centre).powi(2)).sum::<f64>() / (n - 1.0);
    Estimate { mean, se: (variance / n).sqrt() * student(sample.len() - 1) }
}

/// Student's two-sided 5 % point over the normal distribution's (1.96), by degrees of freedom.
fn student(freedom: usize) -> f64 {
    const POINTS: [f64; 10] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228];
    let point = POINTS.get(freedom - 1).copied().unwrap_or(1.96 + 2.5 / freedom as f64);
    point / 1.96
}
