//! The Levenberg-Marquardt iteration, apart from how a step is computed.

use super::Network;

/// Damping of the first step and its limits (MATLAB's `trainlm`: mu, mu_max).
const FIRST_DAMPING: f64 = 1e-3;
const MOST_DAMPING: f64 = 1e10;
const LEAST_DAMPING: f64 = 1e-20;

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
    fn apply(&self, net: &Network) -> Option<Network> {
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
    /// Linearises; returns the norm of the gradient of half the sum of squares.
    fn linearise(&mut self, net: &Network) -> f64;
    /// Solves `(J'J + damping I) change = -J'e`; nothing if that is singular.
    fn step(&mut self, damping: f64) -> Option<Change>;
}

/// The state between iterations.
pub(crate) struct Levenberg {
    /// Where the iteration stands.
    pub(crate) network: Network,
    /// Sum of squared residuals there.
    pub(crate) squares: f64,
    /// Damping of the next step.
    pub(crate) damping: f64,
    growth: f64,
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
    /// Starts at a network with this sum of squares.
    pub(crate) fn new(network: Network, squares: f64) -> Self {
        Self { network, squares, damping: FIRST_DAMPING, growth: 2.0 }
    }

    /// One iteration: linearise, then try dampings until a step improves.
    ///
    /// Nielsen's rule (IMM-REP-1999-05) sets the damping: after a step which
    /// kept the share rho of its promise, mu *= max(1/3, 1 - (2 rho - 1)^3);
    /// after a refused one mu *= 2, then 4, 8... Against `trainlm`'s tenfold
    /// jumps it avoids the cycle of one refused factorisation per iteration.
    pub(crate) fn iterate(
        &mut self,
        model: &mut dyn Model,
        least_gradient: f64,
        squares: &mut dyn FnMut(&Network) -> f64,
    ) -> Outcome {
        if model.linearise(&self.network) < least_gradient {
            return Outcome::Flat;
        }
        while self.damping <= MOST_DAMPING {
            if let Some(change) = model.step(self.damping)
                && let Some(next) = change.apply(&self.network)
            {
                let found = squares(&next);
                let fall = 0.5 * (self.squares - found);
                // Written so that NaN refuses the step.
                if fall > 0.0 {
                    let kept = 2.0 * (fall / change.predicted).clamp(0.0, 1.0) - 1.0;
                    let factor = (1.0 - kept * kept * kept).max(1.0 / 3.0);
                    self.damping = (self.damping * factor).max(LEAST_DAMPING);
                    self.growth = 2.0;
                    (self.network, self.squares) = (next, found);
                    return Outcome::Moved;
                }
            }
            self.damping *= self.growth;
            self.growth *= 2.0;
        }
        Outcome::Stuck
    }
}
