//! The lattice in the wing's own plane, and where the wing is.

use nalgebra::Vector2;

use crate::insect::Insect;
use crate::kinematics::{Attitude, Vector};
use crate::math::{cos, sin};
use crate::uvlm::Settings;
use crate::wing::Outline;

/// A point of the wing's plane: distance r along the span and s along the chord
/// (positive towards the leading edge), m.
pub type Flat = Vector2<f64>;

/// Outline of a wing by stations.
#[derive(Debug, Clone, PartialEq)]
pub struct Planform {
    /// Distance of each station from the wing's origin, m, increasing.
    pub span: Vec<f64>,
    /// Leading edge at each station, m.
    pub leading: Vec<f64>,
    /// Trailing edge at each station, m.
    pub trailing: Vec<f64>,
}

impl Planform {
    /// A straight-edged wing: `panels` strips from `root` to `tip` with constant
    /// chord, its quarter-chord line swept back by `sweep` rad and on s = 0 at the root.
    pub fn straight(root: f64, tip: f64, chord: f64, sweep: f64, panels: usize, cosine: f64) -> Self {
        let span = stations(root, tip, panels, cosine);
        let slope = sin(sweep) / cos(sweep);
        let quarter: Vec<f64> = span.iter().map(|r| -slope * (r - root)).collect();
        Self {
            leading: quarter.iter().map(|s| s + 0.25 * chord).collect(),
            trailing: quarter.iter().map(|s| s - 0.75 * chord).collect(),
            span,
        }
    }

    /// The same with its tip drawn in by a share of the last strip (see [`crate::uvlm::Settings`],
    /// `edge_inset`); straight edges stay where they are.
    pub fn drawn_in(mut self, share: f64) -> Self {
        let (root, last) = (self.span[0], self.span.len() - 1);
        let strip = (self.span[last] - self.span[last - 1]) / (self.span[last] - root);
        let factor = 1.0 / (1.0 + share * strip);
        for values in [&mut self.span, &mut self.leading, &mut self.trailing] {
            let first = values[0];
            values.iter_mut().for_each(|v| *v = first + (*v - first) * factor);
        }
        self
    }

    /// An insect's wing from the root cut-out to the tip; r from the hinge, s from the feathering axis.
    pub fn of_insect(insect: &Insect, settings: &Settings) -> Self {
        let outline = Outline::new(insect);
        let unit = inset_stations(insect.root_cutout, 1.0, settings);
        let edges: Vec<_> = unit.iter().map(|&x| outline.edges(x)).collect();
        Self {
            span: unit.iter().map(|x| x * insect.wing_length_m).collect(),
            leading: edges.iter().map(|e| e.0).collect(),
            trailing: edges.iter().map(|e| e.1).collect(),
        }
    }

    /// Strips along the span.
    pub fn strips(&self) -> usize {
        self.span.len() - 1
    }
}

/// Stations of a wing both of whose ends are free. A lattice of horseshoes or rings
/// behaves as a wing which reaches a quarter of its end strips beyond it, so its ends
/// are drawn in by `edge_inset` of a strip (Hough 1973, J. Aircraft 10, 618).
fn inset_stations(root: f64, tip: f64, settings: &Settings) -> Vec<f64> {
    let (panels, cosine) = (settings.spanwise_panels, settings.spanwise_cosine);
    let unit = stations(0.0, 1.0, panels, cosine);
    // End strips count from the lattice's own ends: inset = share x strip x (length - 2 inset).
    let share = settings.edge_inset * unit[1];
    let inset = share * (tip - root) / (1.0 + 2.0 * share);
    stations(root + inset, tip - inset, panels, cosine)
}

/// Stations from `root` to `tip`, spacing between uniform (0) and cosine (1).
fn stations(root: f64, tip: f64, panels: usize, cosine: f64) -> Vec<f64> {
    (0..=panels)
        .map(|k| {
            let uniform = k as f64 / panels as f64;
            let clustered = 0.5 * (1.0 - cos(std::f64::consts::PI * uniform));
            root + (tip - root) * (cosine * clustered + (1.0 - cosine) * uniform)
        })
        .collect()
}

/// One panel's numbers, wing plane.
#[derive(Debug, Clone, Copy)]
pub struct Panel {
    /// Collocation point: three quarters of the panel.
    pub collocation: Flat,
    /// Middle of the bound segment: one quarter of the panel.
    pub bound: Flat,
    /// The bound segment from inboard to outboard.
    pub segment: Flat,
    /// Centre of the part of the wing its ring covers.
    pub centre: Flat,
    /// That part's area, m².
    pub area: f64,
}

/// Rings and points of a planar wing. Ring i of a strip reaches from one quarter
/// of panel i to one quarter of panel i+1; the last one a little behind the
/// trailing edge.
#[derive(Debug, Clone)]
pub struct Lattice {
    /// Panels along the chord.
    pub chordwise: usize,
    /// Strips along the span.
    pub strips: usize,
    /// Ring corners, `(chordwise + 1) x (strips + 1)`.
    pub nodes: Vec<Flat>,
    /// Trailing edge at each station.
    pub trailing: Vec<Flat>,
    /// Panels, `chordwise x strips`.
    pub panels: Vec<Panel>,
    /// Width of each strip, m.
    pub width: Vec<f64>,
    /// Mean chord of each strip, m.
    pub chord: Vec<f64>,
    /// Length of each strip's leading edge, m.
    pub edge_length: Vec<f64>,
    /// Middle of each strip's leading edge.
    pub edge: Vec<Flat>,
}

impl Lattice {
    /// Builds the lattice; `behind` is how far the last ring reaches behind the
    /// trailing edge at each station, m.
    ///
    /// # Panics
    /// When `behind` has not one value per station.
    pub fn new(planform: &Planform, chordwise: usize, behind: &[f64]) -> Self {
        let strips = planform.strips();
        assert_eq!(behind.len(), strips + 1);
        let m = chordwise as f64;
        let at = |station: usize, share: f64| {
            let (leading, trailing) = (planform.leading[station], planform.trailing[station]);
            Flat::new(planform.span[station], leading + (trailing - leading) * share)
        };
        let mut nodes = Vec::with_capacity((chordwise + 1) * (strips + 1));
        for i in 0..=chordwise {
            for (k, distance) in behind.iter().enumerate() {
                nodes.push(if i < chordwise {
                    at(k, (i as f64 + 0.25) / m)
                } else {
                    at(k, 1.0) - Flat::new(0.0, *distance)
                });
            }
        }
        let mut panels = Vec::with_capacity(chordwise * strips);
        for i in 0..chordwise {
            for k in 0..strips {
                let middle = |share: f64| (at(k, share) + at(k + 1, share)) * 0.5;
                let (front, rear) = ((i as f64 + 0.25) / m, ((i as f64 + 1.25) / m).min(1.0));
                let quad = [at(k, front), at(k + 1, front), at(k + 1, rear), at(k, rear)];
                panels.push(Panel {
                    collocation: middle((i as f64 + 0.75) / m),
                    bound: middle(front),
                    segment: at(k + 1, front) - at(k, front),
                    centre: middle(0.5 * (front + rear)),
                    area: 0.5 * (quad[0] - quad[2]).perp(&(quad[1] - quad[3])).abs(),
                });
            }
        }
        let strip = |f: &dyn Fn(usize) -> f64| (0..strips).map(f).collect();
        Self {
            chordwise,
            strips,
            nodes,
            trailing: (0..=strips).map(|k| at(k, 1.0)).collect(),
            panels,
            width: strip(&|k| planform.span[k + 1] - planform.span[k]),
            chord: strip(&|k| 0.5 * ((at(k, 0.0) - at(k, 1.0)).y + (at(k + 1, 0.0) - at(k + 1, 1.0)).y)),
            edge_length: strip(&|k| (at(k + 1, 0.0) - at(k, 0.0)).norm()),
            edge: (0..strips).map(|k| (at(k, 0.0) + at(k + 1, 0.0)) * 0.5).collect(),
        }
    }

    /// Nodes in a row.
    pub fn columns(&self) -> usize {
        self.strips + 1
    }

    /// How far a point lies ahead of the trailing edge along the chord, m; beyond root and tip the edge
    /// goes on at right angles to the chord.
    pub fn ahead_of_edge(&self, p: &Flat) -> f64 {
        let last = self.trailing.len() - 1;
        let k = self.trailing.partition_point(|edge| edge.x <= p.x).clamp(1, last);
        let (a, b) = (self.trailing[k - 1], self.trailing[k]);
        let share = ((p.x - a.x) / (b.x - a.x)).clamp(0.0, 1.0);
        p.y - (a.y + (b.y - a.y) * share)
    }
}

/// Where the wing is and how it moves, in axes whose y points outboard from the
/// plane of symmetry.
#[derive(Debug, Clone, Copy)]
pub struct Pose {
    /// The wing's origin, m.
    pub origin: Vector,
    /// Along the span, root to tip.
    pub e_r: Vector,
    /// Along the chord, trailing to leading edge.
    pub e_c: Vector,
    /// Velocity of the origin, m/s.
    pub velocity: Vector,
    /// Angular velocity, rad/s.
    pub omega: Vector,
}

impl Pose {
    /// A wing which turns about a hinge so far from the plane of symmetry, m.
    pub fn hinged(offset: f64, attitude: &Attitude) -> Self {
        Self {
            origin: Vector::new(0.0, offset, 0.0),
            e_r: attitude.e_r,
            e_c: attitude.e_c,
            velocity: Vector::zeros(),
            omega: attitude.omega,
        }
    }

    /// A point of the wing's plane in space.
    pub fn place(&self, p: &Flat) -> Vector {
        self.origin + self.e_r * p.x + self.e_c * p.y
    }

    /// Its velocity.
    pub fn velocity_of(&self, p: &Flat) -> Vector {
        self.velocity + self.omega.cross(&(self.e_r * p.x + self.e_c * p.y))
    }

    /// The side towards which positive circulation lifts.
    pub fn normal(&self) -> Vector {
        self.e_c.cross(&self.e_r)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_over_a_swept_wing_counts_from_its_own_stretch_of_the_edge() {
        let planform = Planform::straight(0.0, 2.0, 1.0, std::f64::consts::FRAC_PI_4, 4, 0.0);
        let lattice = Lattice::new(&planform, 2, &[0.0; 5]);
        // The trailing edge is at s = -r - 3/4.
        for (r, s, expected) in
            [(0.0, 0.0, 0.75), (1.1, 0.0, 1.85), (2.0, -3.0, -0.25), (-0.5, 0.0, 0.75), (3.5, 0.0, 2.75)]
        {
            let ahead = lattice.ahead_of_edge(&Flat::new(r, s));
            assert!((ahead - expected).abs() < 1e-12, "{r} {s}: {ahead}");
        }
    }
}
