//! The Levenberg-Marquardt iteration, apart from how a step is computed.

use super::Network;

/// Damping of the first step and its limits (MATLAB's `trainlm`: mu, mu_max).
const FIRST_DAMPING: f64 = 1e-3;
const MOST_DAMPING: f64 = 1e10;
const LEAST_DAMPING: f64 = 1e-20;
/// What the first refused step multiplies the damping by.
const FIRST_GROWTH: f64 = 2.0;

/// A change of every weight, in the layout of [`Network`].
#[derive(Debug, Clone)]
pub(crate) struct Change {
    pub(crate) hidden_weights: Vec<f64>,
    pub(crate) hidden_biases: Vec<f64>,
    pub(crate) output_weights: Vec<f64>,
    pub(crate) output_biases: [f64; 4],
    /// Fall of half the sum of squares which the linear model promises.
    pub(crate) predicted: f64,
}

impl Change {
    /// The network after the change, or nothing where a weight is not finite.
    pub(crate) fn apply(&self, net: &Network) -> Option<Network> {
        let mut next = net.clone();
        let add = |to: &mut [f64], by: &[f64]| {
            for (to, by) in to.iter_mut().zip(by) {
                *to += by;
            }
            to.iter().all(|w| w.is_finite())
        };
        let finite = [
            add(&mut next.hidden_weights, &self.hidden_weights),
            add(&mut next.hidden_biases, &self.hidden_biases),
            add(&mut next.output_weights, &self.output_weights),
            add(&mut next.output_biases, &self.output_biases),
        ];
        finite.iter().all(|f| *f).then_some(next)
    }
}

/// A least-squares problem linearised about a network.
pub(crate) trait Model {
    /// Completes a network which has moved, and returns twice what is to be made small
    /// there: the weighted sum of squares, and what a method adds to it. Nothing where
    /// it cannot be completed.
    fn objective(&mut self, net: &mut Network) -> Option<f64>;
    /// Linearises; returns the norm of the gradient of half the objective.
    fn linearise(&mut self, net: &Network) -> f64;
    /// The step for a damping; nothing if its equations are singular.
    fn step(&mut self, damping: f64) -> Option<Change>;
}

/// The state between iterations.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Levenberg {
    /// Where the iteration stands.
    pub(crate) network: Network,
    /// The objective there.
    pub(crate) objective: f64,
    /// Damping of the next step.
    pub(crate) damping: f64,
    /// What the damping is multiplied by when the next step is refused.
    pub(crate) growth: f64,
}

/// What one iteration did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Outcome {
    /// It moved to a smaller sum of squares.
    Moved,
    /// The gradient is smaller than asked.
    Flat,
    /// No damping up to the limit gave a smaller sum of squares.
    Stuck,
}

impl Levenberg {
    /// Starts at a network, completed by the model.
    pub(crate) fn new(mut network: Network, model: &mut dyn Model) -> Self {
        let objective = model.objective(&mut network).unwrap_or(f64::INFINITY);
        Self { network, objective, damping: FIRST_DAMPING, growth: FIRST_GROWTH }
    }

    /// One iteration: linearise, then try dampings until a step improves.
    ///
    /// Nielsen's rule (IMM-REP-1999-05) sets the damping: after a step which
    /// kept the share rho of its promise, mu *= max(1/3, 1 - (2 rho - 1)^3);
    /// after a refused one mu *= 2, then 4, 8... Against `trainlm`'s tenfold
    /// jumps it avoids the cycle of one refused factorisation per iteration.
    pub(crate) fn iterate(&mut self, model: &mut dyn Model, least_gradient: f64) -> Outcome {
        if model.linearise(&self.network) < least_gradient {
            return Outcome::Flat;
        }
        while self.damping <= MOST_DAMPING {
            if let Some(change) = model.step(self.damping)
                && let Some(mut next) = change.apply(&self.network)
                && let Some(found) = model.objective(&mut next)
            {
                let fall = 0.5 * (self.objective - found);
                // Written so that NaN refuses the step.
                if fall > 0.0 {
                    let kept = 2.0 * (fall / change.predicted).clamp(0.0, 1.0) - 1.0;
                    let factor = (1.0 - kept * kept * kept).max(1.0 / 3.0);
                    self.damping = (self.damping * factor).max(LEAST_DAMPING);
                    self.growth = FIRST_GROWTH;
                    (self.network, self.objective) = (next, found);
                    return Outcome::Moved;
                }
            }
            self.damping *= self.growth;
            self.growth *= 2.0;
        }
        Outcome::Stuck
    }
}
