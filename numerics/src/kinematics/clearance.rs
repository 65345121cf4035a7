//! Whether the wings collide is pure kinematics.

use std::f64::consts::FRAC_PI_2;

use crate::insect::Insect;
use crate::kinematics::{ElevationPhase, Stroke};
use crate::math::sin_cos;
use crate::parameters::{Point, at};
use crate::wing::Outline;

/// Instants per half stroke. The closest approach is a smooth minimum: at this
/// spacing it is missed by less than 0.1 mm at hawkmoth size.
const INSTANTS: usize = 32;
/// Stations along the span.
const STATIONS: usize = 16;

/// The least distance of the wings from the plane of symmetry, prepared for one insect.
#[derive(Debug, Clone)]
pub struct Clearance {
    hinge_offset: f64,
    phase: ElevationPhase,
    /// Distance of each station from the hinge, m.
    span: [f64; STATIONS],
    /// Leading and trailing edge there, m.
    edges: [[f64; STATIONS]; 2],
}

impl Clearance {
    /// Prepares the outline of the wing.
    pub fn new(insect: &Insect, phase: ElevationPhase) -> Self {
        let outline = Outline::new(insect);
        let stations: [f64; STATIONS] = std::array::from_fn(|k| {
            let share = k as f64 / (STATIONS - 1) as f64;
            // Closer towards the tip, which comes closest and where the chord changes fastest.
            insect.root_cutout + (1.0 - insect.root_cutout) * crate::math::sin(share * FRAC_PI_2)
        });
        Self {
            hinge_offset: insect.hinge_offset_m,
            phase,
            span: stations.map(|x| x * insect.wing_length_m),
            edges: [stations.map(|x| outline.edges(x).0), stations.map(|x| outline.edges(x).1)],
        }
    }

    /// Least distance of any wing point from the plane of symmetry over the
    /// stroke, m; negative where the wings would cross.
    pub fn of(&self, x: &Point) -> f64 {
        let stroke = Stroke::new(x, self.phase);
        // One minimum per station, so that stations are computed side by side.
        let mut least = [f64::INFINITY; STATIONS];
        let mean = FRAC_PI_2 + x[at::ROTATION_MEAN].to_radians();
        for i in 0..=INSTANTS {
            let phase = i as f64 / (2 * INSTANTS) as f64;
            let [sweep, elevation, rotation] = stroke.angles(phase).map(|a| a.value);
            let (sp, cp) = sin_cos(sweep);
            let (st, ct) = sin_cos(elevation);
            // The second half stroke has the same sweep and elevation as the first,
            // run backwards, and the rotation mirrored about its mean.
            for alpha in [rotation, 2.0 * mean - rotation] {
                let (sa, ca) = sin_cos(alpha);
                let (span, chord) = (ct * cp, -ca * sp - sa * st * cp);
                let edge = &self.edges[usize::from(chord > 0.0)];
                for k in 0..STATIONS {
                    let y = span * self.span[k] + chord * edge[k];
                    least[k] = if y < least[k] { y } else { least[k] };
                }
            }
        }
        self.hinge_offset + least.into_iter().fold(f64::INFINITY, f64::min)
    }
}

/// Least distance of the wings from the plane of symmetry over a stroke, m.
pub fn clearance(insect: &Insect, phase: ElevationPhase, x: &Point) -> f64 {
    Clearance::new(insect, phase).of(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::Attitude;

    /// The shortcut of the second half stroke and the coarse instants agree with
    /// brute force over the whole stroke.
    #[test]
    fn agrees_with_brute_force() {
        let insect = Insect::default();
        let outline = Outline::new(&insect);
        let prepared = Clearance::new(&insect, ElevationPhase::Plus);
        let bounds = crate::parameters::Bounds::default();
        for i in 0..40 {
            let Some(x) = crate::sampling::sample(&bounds, 11, i, &|_| true) else { panic!("no sample") };
            let stroke = Stroke::new(&x, ElevationPhase::Plus);
            let mut least = f64::INFINITY;
            for step in 0..720 {
                let a = Attitude::new(&stroke.angles(f64::from(step) / 720.0));
                for station in 0..=100 {
                    let r = 0.08 + 0.92 * f64::from(station) / 100.0;
                    let (leading, trailing) = outline.edges(r);
                    for s in [leading, trailing] {
                        least = least.min((a.e_r * r * insect.wing_length_m + a.e_c * s).y);
                    }
                }
            }
            let brute = least + insect.hinge_offset_m;
            assert!((prepared.of(&x) - brute).abs() < 1.5e-4, "{} against {brute}", prepared.of(&x));
        }
    }

    /// The reason for the hinges' 8 mm: at 5 mm, 42 % of the paper's box would
    /// make the wings collide, at 8 mm 9 %.
    #[test]
    fn the_hinge_offset_decides_how_much_of_the_box_collides() {
        for (hinge_offset_m, share) in [(0.005, 0.42), (0.008, 0.09)] {
            let prepared = Clearance::new(&Insect { hinge_offset_m, ..Insect::default() }, ElevationPhase::Plus);
            let bounds = crate::parameters::Bounds::default();
            let draws = 4000;
            let collide =
                |i: &u64| crate::sampling::sample(&bounds, 3, *i, &|_| true).is_some_and(|x| prepared.of(&x) < 0.0);
            let colliding = (0..draws).filter(collide).count() as f64 / draws as f64;
            assert!((colliding - share).abs() < 0.025, "{hinge_offset_m}: {colliding}");
        }
    }
}
