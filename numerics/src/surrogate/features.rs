//! What the networks learn: the paper's four outputs, or what is left of them once
//! the exact laws of hovering are taken out.
//!
//! In still air the flow knows neither gravity nor the tilt of the stroke plane nor,
//! with lengths in chords and times in strokes, the frequency. In stroke-plane axes
//! (T along, N normal, M_h about the hinge line):
//!
//! ```text
//! N = (f/f_r)² N_r    T = (f/f_r)² T_r    M_h = (f/f_r)² M_r    P = (f/f_r)³ P_r
//! L = N cos b - T sin b        D = -(T cos b + N sin b)
//! M = M_h - (x N - z T)        (x, z): the centre of mass from the hinge, fixed in these axes
//! (phi0, alpha0) -> (-phi0, -alpha0):   N, P unchanged,  T, M_h change sign
//! ```
//!
//! (f² and f³ without viscosity, PHYSICS of `docs/model.md`; the laws are tests of the
//! solver in `numerics/tests/symmetries.rs`.) The network is asked for N_r, T_r, M_r,
//! P_r, in units of W, W, W c, P0, so beta and f are no inputs of it, and every sample
//! is two, its mirror image included.
//!
//! The shapes K and C enter by how sharp they make the reversals (`sharpness.rs`).

use super::{Network, Sample, sharpness};
use crate::insect::Insect;
use crate::math::sin_cos;
use crate::parameters::{Bounds, COUNT, Point, at};

/// What the networks learn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Features {
    /// Tilt, frequency and fore-aft mirror image by their exact laws, shapes by their sharpness.
    #[default]
    Physical,
    /// Ten inputs to L+, D+, M+, P+ (paper Eq. 3 and 4).
    Paper,
}

/// A label's standard error at which a sample counts half: a typical error of the network
/// itself, in scaled units at the reference frequency.
const MODEL_ERROR: f64 = 0.015;
/// Spread over the largest label below which labels differ by rounding only.
const ROUNDING: f64 = 1e-12;
/// Labels below this, in scaled units, are rounding of others: then their spread is compared with this.
const SMALL: f64 = 1e-2;
/// Least factor of a sample's residuals.
const LEAST_WEIGHT: f64 = 0.1;

/// The map between a stroke with its means and what the network sees of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Frame {
    /// The means as they are.
    Paper,
    /// Stroke-plane axes at a reference frequency.
    Physical {
        /// f_r, Hz.
        reference_hz: f64,
        /// Centre of mass from the hinge line, x along the stroke plane and z normal to it,
        /// over the c in the scale W c of M+.
        arm: [f64; 2],
        /// Whether mirror images count as samples, and predictions obey the mirror law.
        mirror: bool,
        /// Whether K and C are given as the sharpness of their reversals.
        sharpness: bool,
    },
}

/// Samples as a network sees them.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    pub(crate) xs: Vec<Point>,
    pub(crate) ys: Vec<[f64; 4]>,
    pub(crate) weights: Vec<f64>,
}

/// The mirror image of a stroke.
pub(crate) fn mirrored(x: &Point) -> Point {
    let mut x = *x;
    x[at::SWEEP_MEAN] = -x[at::SWEEP_MEAN];
    x[at::ROTATION_MEAN] = -x[at::ROTATION_MEAN];
    x
}

/// What the mirror image multiplies N, T, M_h, P by.
pub(crate) const MIRROR_SIGNS: [f64; 4] = [1.0, -1.0, -1.0, 1.0];

impl Frame {
    /// The frame of an insect for strokes of a box.
    ///
    /// Mirror images are used where the box meets its own: a box on one side of
    /// phi0 = 0 or alpha0 = 0 learns nothing from the other side.
    pub fn new(features: Features, insect: &Insect, bounds: &Bounds) -> Self {
        if features == Features::Paper {
            return Self::Paper;
        }
        let (x, z) = insect.centre_in_stroke_plane();
        let across = |i: usize| bounds.lower[i] <= 0.0 && bounds.upper[i] >= 0.0;
        Self::Physical {
            reference_hz: 0.5 * (bounds.lower[at::FREQUENCY] + bounds.upper[at::FREQUENCY]),
            arm: [x / insect.moment_scale_m, z / insect.moment_scale_m],
            mirror: across(at::SWEEP_MEAN) && across(at::ROTATION_MEAN),
            sharpness: true,
        }
    }

    /// Whether K and C are given as the sharpness of their reversals.
    pub fn is_sharp(&self) -> bool {
        matches!(self, Self::Physical { sharpness: true, .. })
    }

    /// What of a stroke the network is given.
    pub fn inputs(&self, x: &Point) -> Point {
        match self {
            Self::Physical { sharpness: true, .. } => sharpness::of(x),
            _ => *x,
        }
    }

    /// Derivatives of [`Frame::inputs`], each by its own parameter.
    pub(crate) fn input_slopes(&self, x: &Point) -> Point {
        match self {
            Self::Physical { sharpness: true, .. } => sharpness::slopes(x),
            _ => [1.0; COUNT],
        }
    }

    /// Whether predictions obey the mirror law.
    pub fn is_mirrored(&self) -> bool {
        matches!(self, Self::Physical { mirror: true, .. })
    }

    /// Squares of a sample's standard errors, as if independent of each other, in the frame.
    pub(crate) fn variances(&self, sample: &Sample) -> [f64; 4] {
        let mut variances = [0.0; 4];
        for (k, se) in sample.se.iter().enumerate() {
            let mut error = [0.0; 4];
            error[k] = *se;
            // What the frame does to means is linear.
            for (variance, part) in variances.iter_mut().zip(self.inward(&sample.x, &error)) {
                *variance += part * part;
            }
        }
        variances
    }

    /// The box of the network's inputs: what the laws know is held, what is mirrored is symmetric.
    pub fn bounds(&self, given: &Bounds) -> Bounds {
        let mut bounds = *given;
        let Self::Physical { mirror, .. } = self else { return bounds };
        for i in [at::FREQUENCY, at::STROKE_PLANE] {
            bounds.upper[i] = bounds.lower[i];
        }
        for i in [at::SWEEP_MEAN, at::ROTATION_MEAN].into_iter().filter(|_| *mirror) {
            let most = bounds.upper[i].max(-bounds.lower[i]);
            (bounds.lower[i], bounds.upper[i]) = (-most, most);
        }
        Bounds { lower: self.inputs(&bounds.lower), upper: self.inputs(&bounds.upper) }
    }

    /// From L+, D+, M+, P+ at a stroke to what the network learns.
    pub fn inward(&self, x: &Point, y: &[f64; 4]) -> [f64; 4] {
        let Self::Physical { reference_hz, arm, .. } = self else { return *y };
        let (s, c) = sin_cos(x[at::STROKE_PLANE].to_radians());
        let (lift, forward) = (y[0], -y[1]);
        let (normal, tangential) = (lift * c + forward * s, forward * c - lift * s);
        let hinge = y[2] + (arm[0] * normal - arm[1] * tangential);
        let r = reference_hz / x[at::FREQUENCY];
        let square = r * r;
        [normal * square, tangential * square, hinge * square, y[3] * square * r]
    }

    /// The inverse of [`Frame::inward`].
    pub fn outward(&self, x: &Point, y: &[f64; 4]) -> [f64; 4] {
        let Self::Physical { reference_hz, arm, .. } = self else { return *y };
        let (s, c) = sin_cos(x[at::STROKE_PLANE].to_radians());
        let r = x[at::FREQUENCY] / reference_hz;
        let square = r * r;
        let (normal, tangential, hinge) = (y[0] * square, y[1] * square, y[2] * square);
        let moment = hinge - (arm[0] * normal - arm[1] * tangential);
        [normal * c - tangential * s, -(tangential * c + normal * s), moment, y[3] * square * r]
    }

    /// Derivatives of [`Frame::outward`]: by y, 4 x 4, and by f and beta (per Hz, per degree).
    pub(crate) fn slopes(&self, x: &Point, y: &[f64; 4]) -> ([[f64; 4]; 4], [[f64; 2]; 4]) {
        let unit = |k: usize| std::array::from_fn(|i| f64::from(u8::from(i == k)));
        let columns: [[f64; 4]; 4] = std::array::from_fn(|k| self.outward(x, &unit(k)));
        let by_y = std::array::from_fn(|o| std::array::from_fn(|k| columns[k][o]));
        if matches!(self, Self::Paper) {
            return (by_y, [[0.0; 2]; 4]);
        }
        let [lift, drag, moment, power] = self.outward(x, y);
        let (per_hz, per_degree) = (1.0 / x[at::FREQUENCY], 1_f64.to_radians());
        let by_f = [2.0 * lift, 2.0 * drag, 2.0 * moment, 3.0 * power].map(|d| d * per_hz);
        // dL/db = -(N sin b + T cos b) = D, dD/db = T sin b - N cos b = -L.
        let by_beta = [drag, -lift, 0.0, 0.0].map(|d| d * per_degree);
        (by_y, std::array::from_fn(|o| [by_f[o], by_beta[o]]))
    }

    /// Samples of these indices as the network sees them, mirror images beside them.
    pub(crate) fn part(&self, samples: &[Sample], indices: &[usize]) -> Part {
        let mut part = Part { xs: Vec::new(), ys: Vec::new(), weights: Vec::new() };
        for sample in indices.iter().map(|&i| &samples[i]) {
            let (x, y, weight) = (self.inputs(&sample.x), self.inward(&sample.x, &sample.y), self.weight(sample));
            part.push(x, y, weight);
            if let Self::Physical { mirror: true, .. } = self {
                part.push(mirrored(&x), std::array::from_fn(|k| MIRROR_SIGNS[k] * y[k]), weight);
            }
        }
        part
    }

    /// Factor a_n of a sample's residuals: with s_n the root mean square of its four
    /// standard errors (at the reference frequency) and m the network's own error,
    /// a_n = 1/sqrt(1 + (s_n/m)²), at least 0.1; 1 where no error is known.
    fn weight(&self, sample: &Sample) -> f64 {
        let r = match self {
            Self::Paper => 1.0,
            Self::Physical { reference_hz, .. } => reference_hz / sample.x[at::FREQUENCY],
        };
        let factors = [r * r, r * r, r * r, if r == 1.0 { 1.0 } else { r * r * r }];
        let squares: f64 = sample.se.iter().zip(factors).map(|(se, f)| (se * f) * (se * f)).sum();
        let ratio = squares / 4.0 / (MODEL_ERROR * MODEL_ERROR);
        (1.0 / (1.0 + ratio).sqrt()).max(LEAST_WEIGHT)
    }
}

/// The value of labels which differ by rounding only: such as a moment which does not depend on the one parameter
/// that is free.
pub(crate) fn constant(labels: impl Iterator<Item = f64> + Clone) -> Option<f64> {
    let (low, high) = labels.clone().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), y| (l.min(y), h.max(y)));
    let largest = low.abs().max(high.abs());
    (high - low <= ROUNDING * largest.max(SMALL)).then(|| labels.clone().next()).flatten()
}

impl Part {
    fn push(&mut self, x: Point, y: [f64; 4], weight: f64) {
        self.xs.push(x);
        self.ys.push(y);
        self.weights.push(weight);
    }

    /// Mean squared residual over samples and outputs, in sample order.
    pub(crate) fn mse(&self, net: &Network) -> f64 {
        let mut found = vec![[0.0; 4]; self.xs.len()];
        net.predict_into(&self.xs, &mut found);
        let residuals = found.iter().flatten().zip(self.ys.iter().flatten());
        residuals.map(|(f, y)| (f - y) * (f - y)).sum::<f64>() / (4 * self.ys.len()) as f64
    }

    /// Mean of each output.
    pub(crate) fn means(&self) -> [f64; 4] {
        std::array::from_fn(|k| self.ys.iter().map(|y| y[k]).sum::<f64>() / self.ys.len() as f64)
    }

    /// The outputs which are the same in every sample but for rounding, with their value.
    pub(crate) fn constants(&self) -> [Option<f64>; 4] {
        std::array::from_fn(|k| constant(self.ys.iter().map(|y| y[k])))
    }

    /// Takes known constants away: what is left of a constant output is 0.
    pub(crate) fn without(mut self, constants: &[Option<f64>; 4]) -> Self {
        for (k, constant) in constants.iter().enumerate() {
            let Some(constant) = constant else { continue };
            self.ys.iter_mut().for_each(|y| y[k] -= constant);
        }
        self
    }
}
