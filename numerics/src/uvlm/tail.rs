//! The wake beyond the one remembered.
//!
//! What is forgotten does not end: stroke after stroke the same rings go down the
//! same way, a jet which reaches to infinity. Far from its rings a jet is a line of
//! dipoles, and a line of dipoles of even strength is, outside itself, a sink at its
//! beginning: air is drawn into the jet there. So each row of rings which is
//! forgotten leaves a sink of strength
//!
//! q = m · D / |D|²,  m = Σ Γ A
//!
//! (impulse of the row over density m; displacement D of the wake in a stroke) at
//! the place where its line of later copies begins, for one stroke, after which its
//! successor of the next stroke takes over. Known answer: all sinks of a stroke
//! together draw F / (ρ U) of air, the jet's flow, with mean force F and U = |D|/T.

use std::collections::VecDeque;

use crate::kinematics::Vector;
use crate::uvlm::kernel::Points;
use crate::uvlm::level::{Level, Real, Work, dispatch};
use crate::uvlm::wake::Vorticity;

/// A forgotten row.
#[derive(Debug, Clone, Copy)]
struct Lost {
    step: usize,
    /// Σ Γ A, m⁴/s.
    moment: Vector,
    place: Vector,
    /// Its displacement in the stroke before, m.
    drift: Vector,
}

/// Sinks for the rows forgotten in the last stroke.
#[derive(Debug, Clone)]
pub struct Tail {
    /// Steps in a stroke.
    period: usize,
    /// Radius over which a sink is spread, m.
    radius: f64,
    /// Where rows were one stroke before the end of their memory, by the step they were born in.
    marks: VecDeque<(usize, Vector)>,
    lost: VecDeque<Lost>,
    /// Place and strength / 4π of each sink.
    sinks: Vec<([f64; 3], f64)>,
}

impl Tail {
    /// A tail of strokes of `period` steps whose sinks are spread over `radius`, m.
    pub fn new(period: usize, radius: f64) -> Self {
        Self { period, radius, marks: VecDeque::new(), lost: VecDeque::new(), sinks: Vec::new() }
    }

    /// Looks at the wake at the end of step `now`, before rows `kept` steps old are forgotten.
    pub fn watch(&mut self, wake: &Vorticity, now: usize, kept: usize) {
        let marked = kept.saturating_sub(self.period).max(1);
        for row in wake.edge_row() + 1..wake.rows() {
            if now - wake.born(row) == marked {
                self.marks.push_back((wake.born(row), middle(wake, row)));
            }
        }
        if wake.outlives(now, kept) {
            self.lose(wake, now, kept - marked);
        }
        while self.lost.front().is_some_and(|l| now - l.step >= self.period) {
            self.lost.pop_front();
        }
        self.place_sinks(now);
    }

    fn lose(&mut self, wake: &Vorticity, now: usize, watched: usize) {
        let last = wake.rows() - 1;
        let born = wake.born(last);
        while self.marks.front().is_some_and(|m| m.0 < born) {
            self.marks.pop_front();
        }
        let Some((_, mark)) = self.marks.pop_front().filter(|m| m.0 == born) else { return };
        let (mut moment, mut place, mut weight) = (Vector::zeros(), Vector::zeros(), 0.0);
        for (strip, circulation) in wake.ring_row(last - 1).iter().enumerate() {
            let m = wake.ring_area(last - 1, strip) * *circulation;
            moment += m;
            place += wake.ring_middle(last - 1, strip) * m.norm();
            weight += m.norm();
        }
        if weight > 0.0 && watched > 0 {
            let drift = (middle(wake, last) - mark) * (self.period as f64 / watched as f64);
            self.lost.push_back(Lost { step: now, moment, place: place / weight, drift });
        }
    }

    fn place_sinks(&mut self, now: usize) {
        self.sinks.clear();
        let weight: f64 = self.lost.iter().map(|l| l.moment.norm()).sum();
        if weight <= 0.0 {
            return;
        }
        let mut drift = self.lost.iter().map(|l| l.drift * l.moment.norm()).sum::<Vector>() / weight;
        // The jet and its mirror image go down together.
        drift.y = 0.0;
        // A wake which stays where it is has no jet: its copies are no closer than half a radius.
        let length = drift.norm().max(0.5 * self.radius);
        for lost in &self.lost {
            // They act in the step to come.
            let since = (now + 1 - lost.step) as f64 / self.period as f64;
            let place = lost.place + drift * (since - 0.5);
            let strength = lost.moment.dot(&drift) / (length * length);
            self.sinks.push((place.into(), strength / (4.0 * std::f64::consts::PI)));
        }
    }

    /// Adds the sinks' velocity: -q/4π r / (r² + a²)^(3/2).
    pub fn induce(&self, targets: &Points, velocity: &mut Points) {
        if !self.sinks.is_empty() {
            dispatch(Induce { tail: self, targets, velocity });
        }
    }
}

/// Mean of a row's nodes.
fn middle(wake: &Vorticity, row: usize) -> Vector {
    let columns = wake.strips() + 1;
    (row * columns..(row + 1) * columns).map(|i| Vector::from(wake.node(i))).sum::<Vector>() / columns as f64
}

struct Induce<'a> {
    tail: &'a Tail,
    targets: &'a Points,
    velocity: &'a mut Points,
}

impl Work for Induce<'_> {
    #[inline(always)]
    fn run<S: Level>(self, simd: S) {
        let Self { tail, targets, velocity } = self;
        let spread = simd.splat_f64s(tail.radius * tail.radius);
        for start in (0..targets.len()).step_by(S::F64_LANES) {
            let target = targets.load(simd, start);
            let [mut u, mut v, mut w] = velocity.load(simd, start);
            for ([x, y, z], strength) in &tail.sinks {
                let x = simd.sub_f64s(simd.splat_f64s(*x), target[0]);
                let y = simd.sub_f64s(simd.splat_f64s(*y), target[1]);
                let z = simd.sub_f64s(simd.splat_f64s(*z), target[2]);
                let r2 = simd.mul_add_f64s(x, x, simd.mul_add_f64s(y, y, simd.mul_add_f64s(z, z, spread)));
                let r3 = simd.mul_f64s(r2, f64::root(simd, r2));
                let factor = simd.div_f64s(simd.splat_f64s(*strength), r3);
                u = simd.mul_add_f64s(factor, x, u);
                v = simd.mul_add_f64s(factor, y, v);
                w = simd.mul_add_f64s(factor, z, w);
            }
            velocity.store(simd, start, [u, v, w]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wing which sheds a level sheet, `dx` longer by every step, that sinks by `down` in each, looked at after so many
    /// steps as a solver which keeps `kept` of them would.
    fn flown(steps: usize, kept: usize, period: usize, dx: f64, down: f64) -> Tail {
        let mut tail = Tail::new(period, 1e-3);
        let mut wake = Vorticity::new(2, 2, kept + 1);
        for step in 0..steps {
            if let Some(now) = step.checked_sub(1) {
                tail.watch(&wake, now, kept);
                if wake.outlives(now, kept) {
                    wake.forget();
                }
                for i in wake.convected() {
                    let [x, y, z] = wake.node(i);
                    wake.set_node(i, [x, y, z - down]);
                }
                wake.shed(now, 0.0);
            }
            for (i, [ahead, y]) in [[1.0, 0.0], [1.0, 1.0], [0.0, 0.0], [0.0, 1.0]].into_iter().enumerate() {
                wake.set_node(i, [step as f64 * dx + ahead, y, 0.0]);
            }
            wake.set_bound(&[0.5]);
        }
        tail
    }

    #[test]
    fn sinks_draw_the_jet_of_what_is_forgotten() {
        let (kept, period, dx, down) = (12, 6, 0.1, 0.2);
        let tail = flown(40, kept, period, dx, down);
        assert_eq!(tail.sinks.len(), period);
        // F / (ρ U), the force that of a bound vortex, ρ Γ dx/dt over a span of one: Γ dx / down.
        let drawn: f64 = tail.sinks.iter().map(|(_, q)| 4.0 * std::f64::consts::PI * q).sum();
        assert!((drawn.abs() / (0.5 * dx / down) - 1.0).abs() < 1e-12, "{drawn}");
        // The ring just lost would be kept + 1/2 steps old in the step to come; copies follow a stroke apart.
        let (place, _) = tail.sinks[period - 1];
        let begins = (kept as f64 + 0.5 - 0.5 * period as f64) * down;
        assert!((place[2] + begins).abs() < 1e-12, "{place:?} {begins}");
    }

    #[test]
    fn a_wake_of_one_step_leaves_none() {
        assert!(flown(9, 1, 6, 0.1, 0.2).sinks.is_empty());
    }
}
