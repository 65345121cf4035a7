//! When a stroke is looked at.

use nalgebra::Vector2;

use crate::kinematics::{Attitude, Stroke};

/// The time steps of a stroke, closer together where the wing's trailing edge is fast.
///
/// A wing which flips within a tenth of a stroke moves its trailing edge several times as
/// far in a step then as in between; the row of wake it sheds is as much longer. With a share
/// s of the steps dealt out by speed and the rest evenly, their density is
///
/// dn/dφ = N [1 - s + s v(φ) / v̄]
///
/// (phase φ in strokes, N steps, v root mean square over the span of the edge's speed, v̄ its
/// mean over the stroke). Known answer: s = 0 gives φ = n / N.
#[derive(Debug, Clone)]
pub struct Clock {
    steps: f64,
    /// Phase at equal shares of the steps, `PARTS` of them and the end.
    phases: Vec<f64>,
    weights: Vec<f64>,
}

/// Parts over which the derivative of phase is taken.
const WIDTH: f64 = 2.0;

/// Parts of a stroke in which the density of steps is constant.
const PARTS: usize = 2048;

impl Clock {
    /// A clock of `steps` a stroke, `share` of them by the speed of the points `edge` of the
    /// wing's plane (m from the hinge along span and chord).
    pub fn new(stroke: &Stroke, edge: &[Vector2<f64>], steps: usize, share: f64) -> Self {
        let speed = |part: usize| {
            let attitude = Attitude::new(&stroke.angles((part as f64 + 0.5) / PARTS as f64));
            let squared =
                |p: &Vector2<f64>| attitude.omega.cross(&(attitude.e_r * p.x + attitude.e_c * p.y)).norm_squared();
            (edge.iter().map(squared).sum::<f64>() / edge.len().max(1) as f64).sqrt()
        };
        let speeds: Vec<f64> = (0..PARTS).map(speed).collect();
        let mean = speeds.iter().sum::<f64>() / PARTS as f64;
        let share = if mean > 0.0 { share } else { 0.0 };
        let densities = speeds.iter().map(|v| if share > 0.0 { 1.0 - share + share * v / mean } else { 1.0 });
        let mut clock = Self { steps: steps as f64, phases: inverted(densities), weights: Vec::new() };
        let paces: Vec<f64> = (0..steps).map(|step| clock.pace(step as f64)).collect();
        let total: f64 = paces.iter().sum();
        clock.weights = paces.iter().map(|pace| pace / total).collect();
        clock
    }

    /// Phase, in strokes since the first, at a number of steps (and parts of one) since then.
    pub fn phase(&self, steps: f64) -> f64 {
        let strokes = steps / self.steps;
        let whole = strokes.floor();
        let parts = (strokes - whole) * PARTS as f64;
        let part = (parts as usize).min(PARTS - 1);
        let (a, b) = (self.phases[part], self.phases[part + 1]);
        whole + a + (b - a) * (parts - part as f64)
    }

    /// Share dφ/dn of a stroke that a step takes where `step` is: the weight of what is there
    /// in a mean over the stroke. Equal weights in n make the mean of something periodic
    /// converge fastest.
    pub fn pace(&self, step: f64) -> f64 {
        let width = WIDTH * self.steps / PARTS as f64;
        (self.phase(step + 0.5 * width) - self.phase(step - 0.5 * width)) / width
    }

    /// Weight of each step of a stroke in a mean over it. They sum to one.
    pub fn weight(&self, step: usize) -> f64 {
        self.weights[step]
    }
}

/// Where the integral of densities over equal parts of 0..1 reaches each of as many equal shares.
fn inverted(densities: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut reached = vec![0.0];
    let mut total = 0.0;
    for density in densities {
        total += density;
        reached.push(total);
    }
    let parts = reached.len() - 1;
    let mut part = 0;
    let mut phases: Vec<f64> = (0..parts)
        .map(|i| {
            let wanted = total * i as f64 / parts as f64;
            while part + 1 < parts && reached[part + 1] <= wanted {
                part += 1;
            }
            (part as f64 + (wanted - reached[part]) / (reached[part + 1] - reached[part])) / parts as f64
        })
        .collect();
    phases.push(1.0);
    phases
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases::CASES;
    use crate::kinematics::ElevationPhase;

    fn clock(share: f64) -> Clock {
        let mut x = CASES[0].parameters;
        x[crate::parameters::at::ROTATION_SHAPE] = 5.0;
        let edge = [Vector2::new(0.02, -0.014), Vector2::new(0.04, -0.012)];
        Clock::new(&Stroke::new(&x, ElevationPhase::Plus), &edge, 64, share)
    }

    #[test]
    fn without_a_share_steps_are_even() {
        let even = clock(0.0);
        for step in 0..200 {
            assert!((even.phase(f64::from(step)) - f64::from(step) / 64.0).abs() < 1e-12);
        }
    }

    #[test]
    fn steps_crowd_where_the_wing_flips_and_fill_the_stroke() {
        let clock = clock(0.7);
        let shares: Vec<f64> = (0..64).map(|i| clock.weight(i)).collect();
        assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        for i in 0..64 {
            let step = clock.phase(f64::from(i) + 0.5) - clock.phase(f64::from(i) - 0.5);
            assert!((shares[i as usize] / step - 1.0).abs() < 0.05, "{i}");
        }
        // It flips at the beginning and in the middle of the stroke.
        assert!(shares[0] < 0.6 / 64.0 && shares[32] < 0.6 / 64.0, "{} {}", shares[0], shares[32]);
        assert!(shares.iter().all(|s| *s > 0.0 && *s < 2.5 / 64.0), "{shares:?}");
        assert!((clock.phase(64.0 + 5.0) - 1.0 - clock.phase(5.0)).abs() < 1e-12);
    }
}
