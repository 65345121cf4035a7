//! The ascents of a fit, and where it can be taken up again.

use super::ascent::{AscentStop, Top, climb};
use super::likelihood::Labels;
use std::ops::ControlFlow;

/// Most iterations of an ascent.
const MOST_ITERATIONS: usize = 60;

/// An ascent which has ended: enough to go on after it without making it again.
#[derive(Debug, Clone, PartialEq)]
pub struct Climbed {
    /// Which of the fit's ascents, from 0.
    pub ascent: usize,
    /// Logarithms of lengths, amplitude and noise at its end.
    pub at: Vec<f64>,
    /// Iterations made.
    pub iterations: usize,
    /// Why it ended.
    pub stop: AscentStop,
}

/// Where a fit stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitProgress<'a> {
    /// The ascent being made, from 0.
    pub ascent: usize,
    /// Ascents of the whole fit.
    pub ascents: usize,
    /// Iterations of the present one.
    pub iteration: usize,
    /// Logarithm of the likelihood it has reached, but for a constant.
    pub likelihood: f64,
    /// Those which have ended: a fit which starts from them ends where this one will.
    pub ended: &'a [Climbed],
}

/// The ascents of a fit as they are made.
pub(super) struct Climbs<'a> {
    pub(super) ascents: usize,
    pub(super) ended: Vec<Climbed>,
    pub(super) observe: &'a mut dyn FnMut(&FitProgress<'_>) -> ControlFlow<()>,
}

impl Climbs<'_> {
    /// Makes an ascent, or finds its end where it was made before. None where its first
    /// point has no likelihood.
    pub(super) fn climb(
        &mut self,
        ascent: usize,
        labels: &Labels,
        start: Vec<f64>,
        bounds: &[(f64, f64)],
    ) -> Option<Top> {
        if let Some(top) = self.made(ascent, labels, bounds) {
            return Some(top);
        }
        let Self { ascents, ended, observe } = self;
        let mut hear =
            |iteration, likelihood| observe(&FitProgress { ascent, ascents: *ascents, iteration, likelihood, ended });
        let top = climb(labels, start, bounds, MOST_ITERATIONS, &mut hear)?;
        if top.stop != AscentStop::Interrupted {
            let at = top.at.clone();
            ended.push(Climbed { ascent, at, iterations: top.iterations, stop: top.stop });
        }
        Some(top)
    }

    /// The end of an ascent which was made before, unless it cannot be one of these labels.
    fn made(&self, ascent: usize, labels: &Labels, bounds: &[(f64, f64)]) -> Option<Top> {
        let found = self.ended.iter().find(|c| c.ascent == ascent)?;
        let within = |(v, (low, high)): (&f64, &(f64, f64))| (*low..=*high).contains(v);
        if found.at.len() != bounds.len() || !found.at.iter().zip(bounds).all(within) {
            return None;
        }
        let solved = labels.solve(&found.at)?;
        Some(Top { at: found.at.clone(), solved, iterations: found.iterations, stop: found.stop })
    }
}
