//! Forces on the wing from its circulations.

use crate::kinematics::Vector;
use crate::uvlm::geometry::{Flat, Lattice, Pose};
use crate::uvlm::suction::SuctionFit;
use crate::uvlm::{Air, Suction};

/// Force on one wing and its moment about the wing's origin.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WingLoad {
    /// Force, N.
    pub force: Vector,
    /// Moment about the wing's origin, N m.
    pub moment: Vector,
}

/// What the loads are computed from.
pub struct Flow<'a> {
    /// Ring circulations, m²/s.
    pub circulation: &'a [f64],
    /// Their rates of change, m²/s².
    pub rate: &'a [f64],
    /// Velocity of the air relative to each bound segment's middle, without the
    /// wing's own share, m/s.
    pub relative: &'a [Vector],
}

/// Unsteady Bernoulli (Katz & Plotkin 13.12) on a rigid planar wing, plus suction.
///
/// Per ring: ρ[v·∇Γ + dΓ/dt] A n. What is steady acts in the middle of the bound segment: the
/// chordwise gradient as the segment's own force, the spanwise one over the part of the wing the
/// ring covers. dΓ/dt acts in the middle of that part. Positive circulation lifts towards `pose.normal()`.
pub fn wing_load(
    lattice: &Lattice,
    pose: &Pose,
    air: &Air,
    suction: &Suction,
    fit: &SuctionFit,
    flow: &Flow<'_>,
) -> WingLoad {
    let strips = lattice.strips;
    let normal = pose.normal();
    let mut load = WingLoad::default();
    let mut add = |at: &Flat, force: Vector| {
        load.force += force;
        load.moment += (pose.e_r * at.x + pose.e_c * at.y).cross(&force);
    };
    for (ring, panel) in lattice.panels.iter().enumerate() {
        let v = Flat::new(flow.relative[ring].dot(&pose.e_r), flow.relative[ring].dot(&pose.e_c));
        let bound = bound_strength(flow.circulation, strips, ring);
        let steady = bound * (v.x * panel.segment.y - v.y * panel.segment.x);
        add(
            &panel.bound,
            normal * (air.density * (steady + v.x * span_gradient(lattice, flow.circulation, ring) * panel.area)),
        );
        add(&panel.centre, normal * (air.density * flow.rate[ring] * panel.area));
    }
    for strip in 0..strips {
        let chord = lattice.chord[strip];
        let front = (0..lattice.chordwise).map(|i| bound_strength(flow.circulation, strips, i * strips + strip));
        let w0 = fit.singularity(front) / chord;
        let per_span = std::f64::consts::PI * air.density * chord * w0 * w0;
        let lift = suction.to_lift * per_span * lattice.edge_length[strip] * w0.signum();
        add(&lattice.panels[strip].bound, normal * lift);
        add(&lattice.edge[strip], pose.e_c * (suction.in_plane * per_span * lattice.width[strip]));
    }
    load
}

/// Net circulation of a ring's leading segment.
fn bound_strength(circulation: &[f64], strips: usize, ring: usize) -> f64 {
    let ahead = if ring >= strips { circulation[ring - strips] } else { 0.0 };
    circulation[ring] - ahead
}

/// Spanwise gradient of circulation at a fixed fraction of the chord, with no
/// circulation beyond root and tip.
fn span_gradient(lattice: &Lattice, circulation: &[f64], ring: usize) -> f64 {
    let strip = ring % lattice.strips;
    let at_edge = |outer: usize| {
        // Between two strips: linear between their middles.
        let (a, b) = (lattice.width[outer - 1], lattice.width[outer]);
        let row = ring - strip;
        (circulation[row + outer - 1] * b + circulation[row + outer] * a) / (a + b)
    };
    let inboard = if strip == 0 { 0.0 } else { at_edge(strip) };
    let outboard = if strip + 1 == lattice.strips { 0.0 } else { at_edge(strip + 1) };
    (outboard - inboard) / lattice.width[strip]
}
