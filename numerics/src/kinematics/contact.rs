//! Where the wings come nearest to each other, with derivatives.

use super::Clearance;
use super::clearance::{INSTANTS, STATIONS};
use super::stroke::Stroke;
use crate::math::sin_cos;
use crate::parameters::{COUNT, Point, at};
use std::f64::consts::FRAC_PI_2;

/// Most contacts told of one stroke.
pub const MOST_CONTACTS: usize = 10;

/// Step of K and C for the derivatives of the shape functions.
const STEP: f64 = 1e-5;

/// A point of the wing at an instant, near to the plane of symmetry.
///
/// The clearance is the least of finitely many smooth distances and so not smooth
/// itself; an optimiser takes those near the least one as constraints of their own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Which instant, half stroke, station and edge: equal where these are.
    pub id: usize,
    /// Distance from the plane of symmetry, m.
    pub distance_m: f64,
    /// Its derivatives by the ten parameters in table units.
    pub slope: Point,
}

/// Sines and cosines at one instant of one half stroke.
#[derive(Clone, Copy)]
struct Pose {
    /// Sine and cosine of sweep, elevation and rotation.
    angles: [(f64, f64); 3],
    /// -1 in the second half stroke, where the rotation is mirrored about its mean.
    side: f64,
}

impl Pose {
    /// Distance from the plane per distance from the hinge along span and chord.
    fn directions(&self) -> (f64, f64) {
        let [(sp, cp), (st, ct), (sa, ca)] = self.angles;
        (ct * cp, -ca * sp - sa * st * cp)
    }

    /// Derivatives of both directions by sweep, elevation and rotation.
    fn slopes(&self) -> [(f64, f64); 3] {
        let [(sp, cp), (st, ct), (sa, ca)] = self.angles;
        [(-ct * sp, -ca * cp + sa * st * sp), (-st * cp, -sa * ct * cp), (0.0, sa * sp - ca * st * cp)]
    }
}

impl Clearance {
    /// Fills `into` with the nearest contacts of a stroke closer than `within_m`, the
    /// nearest first; the distance of that one is the clearance.
    ///
    /// Per instant and half stroke the nearest station takes part and its nearer
    /// neighbour, so that neither the nearest instant nor the nearest station can
    /// jump between two steps of an optimiser without both being known.
    pub fn contacts(&self, x: &Point, within_m: f64, into: &mut Vec<Contact>) {
        into.clear();
        let within = within_m - self.hinge_offset;
        let stroke = Stroke::new(x, self.phase);
        let mut near: Vec<(f64, usize)> = Vec::with_capacity(4 * (INSTANTS + 1));
        let mut poses = [[None; 2]; INSTANTS + 1];
        for (i, poses) in poses.iter_mut().enumerate() {
            for (half, place) in poses.iter_mut().enumerate() {
                let pose = pose(&stroke, x, i, half);
                self.nearest(pose, 2 * i + half, within, &mut near);
                *place = Some(pose);
            }
        }
        // No ties are left to the sort: places differ.
        near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for &(distance, id) in near.iter().take(MOST_CONTACTS) {
            let (k, rest) = (id % STATIONS, id / STATIONS);
            let (edge, instant) = (rest % 2, rest / 2);
            let Some(pose) = poses[instant / 2][instant % 2] else { continue };
            let slope = self.slope(&pose, x, instant / 2, (self.span[k], self.edges[edge][k]));
            into.push(Contact { id, distance_m: self.hinge_offset + distance, slope });
        }
    }

    /// The nearest station of a pose and its nearer neighbour.
    fn nearest(&self, pose: Pose, instant: usize, within: f64, near: &mut Vec<(f64, usize)>) {
        let (span, chord) = pose.directions();
        let edge = usize::from(chord > 0.0);
        let distance = |k: usize| span * self.span[k] + chord * self.edges[edge][k];
        let distances: [f64; STATIONS] = std::array::from_fn(distance);
        let mut least = 0;
        for k in 1..STATIONS {
            if distances[k] < distances[least] {
                least = k;
            }
        }
        let (below, above) = (least.saturating_sub(1), (least + 1).min(STATIONS - 1));
        let second =
            if below == least || (above != least && distances[above] < distances[below]) { above } else { below };
        for k in [least, second] {
            if distances[k] < within {
                near.push((distances[k], (2 * instant + edge) * STATIONS + k));
            }
        }
    }

    /// Derivatives of the distance of one point of the wing by the parameters.
    fn slope(&self, pose: &Pose, x: &Point, i: usize, (along, across): (f64, f64)) -> Point {
        let [sweep, elevation, rotation] = pose.slopes().map(|(s, c)| s * along + c * across);
        let shapes = |x: &Point| shapes(x, self.phase, i);
        let [s, e, r] = shapes(x);
        let mut slope = [0.0; COUNT];
        slope[at::SWEEP_MEAN] = sweep;
        slope[at::SWEEP_AMPLITUDE] = sweep * s;
        slope[at::ELEVATION_MEAN] = elevation;
        slope[at::ELEVATION_AMPLITUDE] = elevation * e;
        slope[at::ROTATION_MEAN] = rotation;
        slope[at::ROTATION_AMPLITUDE] = rotation * pose.side * r;
        let mut slope = slope.map(f64::to_radians);
        let difference = |which: usize, shape: usize| {
            let (mut low, mut high) = (*x, *x);
            low[which] = (x[which] - STEP).max(0.0);
            high[which] = x[which] + STEP;
            (shapes(&high)[shape] - shapes(&low)[shape]) / (high[which] - low[which])
        };
        slope[at::SWEEP_SHAPE] = sweep * x[at::SWEEP_AMPLITUDE].to_radians() * difference(at::SWEEP_SHAPE, 0);
        slope[at::ROTATION_SHAPE] =
            rotation * pose.side * x[at::ROTATION_AMPLITUDE].to_radians() * difference(at::ROTATION_SHAPE, 2);
        slope
    }
}

fn pose(stroke: &Stroke, x: &Point, i: usize, half: usize) -> Pose {
    let [sweep, elevation, rotation] = stroke.angles(instant(i)).map(|a| a.value);
    let mean = FRAC_PI_2 + x[at::ROTATION_MEAN].to_radians();
    let (rotation, side) = if half == 0 { (rotation, 1.0) } else { (2.0 * mean - rotation, -1.0) };
    Pose { angles: [sweep, elevation, rotation].map(sin_cos), side }
}

fn instant(i: usize) -> f64 {
    i as f64 / (2 * INSTANTS) as f64
}

/// Deviation of each angle from its mean for an amplitude of 1.
fn shapes(x: &Point, phase: super::ElevationPhase, i: usize) -> [f64; 3] {
    let mut unit = *x;
    for (mean, amplitude) in [
        (at::SWEEP_MEAN, at::SWEEP_AMPLITUDE),
        (at::ELEVATION_MEAN, at::ELEVATION_AMPLITUDE),
        (at::ROTATION_MEAN, at::ROTATION_AMPLITUDE),
    ] {
        (unit[mean], unit[amplitude]) = (0.0, 1f64.to_degrees());
    }
    let [s, e, r] = Stroke::new(&unit, phase).angles(instant(i)).map(|a| a.value);
    [s, e, r - FRAC_PI_2]
}

#[cfg(test)]
mod tests {
    use super::super::ElevationPhase;
    use super::*;
    use crate::insect::Insect;
    use crate::parameters::Bounds;

    #[test]
    fn contacts_begin_with_the_clearance_and_have_its_slopes() {
        let bounds = Bounds::default();
        for phase in [ElevationPhase::Plus, ElevationPhase::Minus] {
            let wing = Clearance::new(&Insect::default(), phase);
            let (mut contacts, mut moved) = (Vec::new(), Vec::new());
            for seed in 0..40 {
                let Some(x) = crate::sampling::sample(&bounds, 8, seed, &|_| true) else { panic!("no sample") };
                wing.contacts(&x, 1.0, &mut contacts);
                assert_eq!(contacts.len(), MOST_CONTACTS);
                assert!((contacts[0].distance_m - wing.of(&x)).abs() < 1e-13);
                assert!(contacts.windows(2).all(|w| w[0].distance_m <= w[1].distance_m));
                for i in 0..COUNT {
                    let step = 1e-4 * (bounds.upper[i] - bounds.lower[i]);
                    let mut at = |shift: f64, id: usize| {
                        let mut x = x;
                        x[i] += shift;
                        wing.contacts(&x, 1.0, &mut moved);
                        moved.iter().find(|c| c.id == id).map(|c| c.distance_m)
                    };
                    let nearest = contacts[0];
                    let (Some(low), Some(high)) = (at(-step, nearest.id), at(step, nearest.id)) else { continue };
                    let difference = (high - low) / (2.0 * step);
                    let scale = bounds.upper[i] - bounds.lower[i];
                    let error = (nearest.slope[i] - difference).abs() * scale;
                    assert!(error < 1e-6, "{seed} {i}: {} against {difference}", nearest.slope[i]);
                }
            }
        }
    }
}
