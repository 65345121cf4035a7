//! A gaussian process as the surrogate: for some hundred to two thousand samples it is
//! more exact than networks, and it needs no share of them to say when to stop.

mod ascent;
mod climbs;
mod fit;
mod kernel;
mod likelihood;
#[cfg(test)]
mod tests;

pub use ascent::AscentStop;
pub use climbs::{Climbed, FitProgress};
pub use fit::{Ascent, MOST_POINTS, ProcessFit, fit};

use self::kernel::{Packed, Slopes, Values};
use super::features::Frame;
use super::network::{NetworkError, bad_bounds};
use super::{Jacobian, kernel::dispatch};
use crate::parameters::{Bounds, COUNT, Point};
use rayon::prelude::*;

/// Points predicted by one parallel task.
const TASK: usize = 64;

/// What is known of four functions of the frame's parameters from their values at points.
///
/// ```text
/// y(z) = m + Σ_j w_j c(z, z_j),   c(z, v) = a² exp(-Σ_i (z_i - v_i)² / 2 l_i²)
/// (C + diag(s_j² + g²)) w = y - m
/// ```
///
/// z is the point with the box scaled to `[-1, 1]`; a, the lengths l_i and g, the part of
/// the labels which no smooth function explains, are the likeliest; s_j is the label's
/// standard error. Where the mirror law holds, the process is that of functions which
/// obey it, with the covariance `(c(z, v) ± c(z, v'))/2`, v' the mirror image of v:
/// a sample then counts twice without taking a second row. Source: Rasmussen & Williams
/// 2006, chapters 2, 4 and 5.
#[derive(Debug, Clone, PartialEq)]
pub struct Process {
    /// The box which is scaled to `[-1, 1]`, as the frame gives it; what is held is no input.
    pub bounds: Bounds,
    /// The points, as the frame gives them.
    pub points: Vec<Point>,
    /// One per output of the frame.
    pub outputs: [ProcessOutput; 4],
}

/// One output of a [`Process`].
#[derive(Debug, Clone, PartialEq)]
pub struct ProcessOutput {
    /// Lengths of correlation l, of a box from -1 to 1; any positive number where a parameter is held.
    pub lengths: Point,
    /// Standard deviation a of the functions about their mean.
    pub amplitude: f64,
    /// Standard deviation g of what the samples have beside them and their standard errors.
    pub noise: f64,
    /// Mean m.
    pub mean: f64,
    /// Weights w, one per point.
    pub weights: Vec<f64>,
}

impl ProcessOutput {
    /// One which is the same everywhere, whatever the points.
    fn constant(mean: f64, points: usize) -> Self {
        Self { lengths: [1.0; COUNT], amplitude: 1.0, noise: 0.0, mean, weights: vec![0.0; points] }
    }
}

impl Process {
    /// Refuses what is none.
    fn check(&self) -> Result<(), NetworkError> {
        if let Some(index) = bad_bounds(&self.bounds) {
            return Err(NetworkError::Bounds { index });
        }
        if self.points.is_empty() {
            return Err(NetworkError::NoPoints);
        }
        if !self.points.iter().flatten().all(|v| v.is_finite()) {
            return Err(NetworkError::NotFinite { array: "points" });
        }
        for output in &self.outputs {
            let (found, expected) = (output.weights.len(), self.points.len());
            if found != expected {
                return Err(NetworkError::Shape { array: "weights", found, expected });
            }
            if !output.weights.iter().chain([&output.mean, &output.noise]).all(|v| v.is_finite()) {
                return Err(NetworkError::NotFinite { array: "weights" });
            }
            let positive = |v: &f64| v.is_finite() && *v > 0.0;
            if !output.lengths.iter().chain([&output.amplitude]).all(positive) {
                return Err(NetworkError::NotFinite { array: "lengths" });
            }
        }
        Ok(())
    }
}

/// A process made ready to predict.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ready {
    pub(super) process: Process,
    packed: Packed,
}

impl Ready {
    /// Whether functions obey the mirror law is the frame's to say.
    pub(super) fn new(frame: &Frame, process: Process) -> Result<Self, NetworkError> {
        process.check()?;
        let packed = Packed::new(&process, frame.is_mirrored());
        Ok(Self { process, packed })
    }

    /// Outputs in the frame at many points, in parallel; the shorter slice counts.
    pub(super) fn predict_into(&self, xs: &[Point], out: &mut [[f64; 4]]) {
        let packed = &self.packed;
        xs.par_chunks(TASK).zip(out.par_chunks_mut(TASK)).for_each(|(xs, out)| {
            dispatch(Values { packed, xs, out });
        });
    }

    /// The same and their derivatives, on the calling thread.
    pub(super) fn jacobians_into(&self, xs: &[Point], out: &mut [Jacobian]) {
        dispatch(Slopes { packed: &self.packed, xs, out });
    }
}
