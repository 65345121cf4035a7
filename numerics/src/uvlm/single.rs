//! The wake's velocities in single precision.

use crate::uvlm::kernel::{Edge, Node, Points, Sheet, induce};

/// Single-precision copies of a sheet and targets, in units of the sheet's own size.
#[derive(Debug, Clone, Default)]
pub struct SingleWake {
    nodes: Vec<Node<f32>>,
    targets: Points<f32>,
    velocity: Points<f32>,
}

/// The power of two (so that scaling rounds nothing) which brings a size to 16 to 32: then products of sixteen lengths,
/// of a core or across the whole wake, are in single precision's range. From the exponent's bits: a logarithm
/// may differ between machines.
fn scale_for(size: f64) -> f64 {
    let exponent = ((size.to_bits() >> 52) & 0x7ff) as i32 - 1023;
    2.0_f64.powi((4 - exponent).clamp(-60, 60))
}

/// Square of the least core in these units: keeps what a distance divides from being all rounding error.
const LEAST_CORE2: f32 = 1.6e-11;

/// Lengths x `scale`; velocity then comes out divided by it.
fn edge(from: &Edge, scale: f64) -> Edge<f32> {
    Edge {
        vector: from.vector.map(|x| (x * scale) as f32),
        minus_length2: (from.minus_length2 * (scale * scale)) as f32,
    }
}

fn node(from: &Node, scale: f64) -> Node<f32> {
    Node {
        place: from.place.map(|x| (x * scale) as f32),
        core2: ((from.core2 * (scale * scale)) as f32).max(LEAST_CORE2),
        spanwise: edge(&from.spanwise, scale),
        chordwise: edge(&from.chordwise, scale),
    }
}

impl SingleWake {
    /// Adds the velocity the sheet induces at the targets, m/s.
    pub fn induce(&mut self, sheet: &Sheet<'_>, targets: &Points, velocity: &mut Points) {
        let size = sheet.nodes.iter().flat_map(|n| n.place).fold(0.0_f64, |m, x| m.max(x.abs()));
        let scale = scale_for(size);
        self.nodes.clear();
        self.nodes.extend(sheet.nodes.iter().map(|n| node(n, scale)));
        self.targets.resize(targets.len());
        self.velocity.resize(targets.len());
        self.velocity.clear();
        for i in 0..targets.len() {
            self.targets.set(i, targets.get(i).map(|x| x * scale));
        }
        let single = Sheet { columns: sheet.columns, nodes: &self.nodes };
        induce(&single, &self.targets, &mut self.velocity);
        let sums = [&mut velocity.x, &mut velocity.y, &mut velocity.z];
        for (sum, add) in sums.into_iter().zip([&self.velocity.x, &self.velocity.y, &self.velocity.z]) {
            for (sum, add) in sum.iter_mut().zip(add) {
                *sum += f64::from(*add) * scale;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::uvlm::probe::Workload;

    #[test]
    fn sizes_come_to_between_sixteen_and_thirty_two() {
        for size in [0.03, 0.25, 1.0, 7.9, 300.0] {
            assert!((16.0..32.0).contains(&(size * scale_for(size))), "{size}");
        }
        assert!(scale_for(0.0).is_finite());
    }

    #[test]
    fn a_wake_much_larger_than_its_cores_has_velocities() {
        // Two by three nodes a millimetre apart with cores of a seventh of that, and a row a metre away.
        let place = |i: usize| [1e-3 * (i % 3) as f64, if i < 6 { 1e-3 * (i / 3) as f64 } else { 1.0 }, 0.0];
        let core = 1.5e-4;
        let edge = |from: usize, to: usize| Edge::between(place(from), place(to), [core; 2], 0.1);
        let node = |i: usize| Node {
            place: place(i),
            core2: core * core,
            spanwise: if i.is_multiple_of(3) { Edge::NONE } else { edge(i - 1, i) },
            chordwise: if i >= 3 { edge(i - 3, i) } else { Edge::NONE },
        };
        let nodes: Vec<_> = (0..9).map(node).collect();
        let sheet = Sheet { columns: 3, nodes: &nodes };
        let mut targets = Points::zeros(9);
        (0..9).for_each(|i| targets.set(i, place(i)));
        let (mut double, mut single) = (Points::zeros(9), Points::zeros(9));
        induce(&sheet, &targets, &mut double);
        SingleWake::default().induce(&sheet, &targets, &mut single);
        let largest = (0..9).flat_map(|i| double.get(i)).fold(0.0_f64, |m, v| m.max(v.abs()));
        for i in 0..9 {
            let off = double.get(i).iter().zip(single.get(i)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-3 * largest, "{i}: {:?} {:?}", double.get(i), single.get(i));
            assert!(single.get(i).iter().all(|v| v.is_finite()), "{i}");
        }
    }

    #[test]
    fn single_precision_agrees_with_double_to_its_digits() {
        let work = Workload::new(12, 7);
        let mut double = Points::zeros(work.targets.len());
        let mut single = Points::zeros(work.targets.len());
        induce(&work.sheet(), &work.targets, &mut double);
        SingleWake::default().induce(&work.sheet(), &work.targets, &mut single);
        let largest = (0..double.len()).flat_map(|i| double.get(i)).fold(0.0_f64, |m, v| m.max(v.abs()));
        for i in 0..double.len() {
            for (a, b) in double.get(i).iter().zip(single.get(i)) {
                assert!((a - b).abs() < 1e-3 * largest, "{i}: {a} {b}");
            }
        }
        assert!((0..double.len()).any(|i| double.get(i) != single.get(i)), "they are of different precision");
    }
}
