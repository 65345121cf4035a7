//! Work of known size, to measure a machine by. Nothing here keeps time.

use pulp::{Simd, WithSimd};

use crate::lanes::dispatch;
use crate::uvlm::kernel::{Edge, Node, Points, Sheet};

/// Independent chains of multiply-adds: enough to hide their latency, and with their constants no
/// more than the sixteen registers which every level has.
const CHAINS: usize = 12;

/// Does `rounds` rounds of multiply-adds in registers; returns how many floating
/// point operations that was and a number which depends on all of them.
pub fn multiply_adds(rounds: u64) -> (u64, f64) {
    dispatch(MultiplyAdds { rounds })
}

struct MultiplyAdds {
    rounds: u64,
}

impl WithSimd for MultiplyAdds {
    type Output = (u64, f64);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> (u64, f64) {
        let (factor, rest) = (simd.splat_f64s(0.999_999_9), simd.splat_f64s(1e-7));
        // The compiler must not know that it is the fixed point.
        let mut chains = [simd.splat_f64s(std::hint::black_box(1.0)); CHAINS];
        for _ in 0..self.rounds {
            for chain in &mut chains {
                *chain = simd.mul_add_f64s(*chain, factor, rest);
            }
        }
        let mut sum = simd.splat_f64s(0.0);
        for chain in chains {
            sum = simd.add_f64s(sum, chain);
        }
        (self.rounds * (2 * CHAINS * S::F64_LANES) as u64, simd.reduce_sum_f64s(sum))
    }
}

/// A sheet and targets of the size of a production sample's wake, at places
/// without meaning.
#[derive(Debug, Clone)]
pub struct Workload {
    columns: usize,
    nodes: Vec<Node>,
    /// The targets: the nodes themselves.
    pub targets: Points,
}

impl Workload {
    /// A sheet of `rows x columns` nodes.
    pub fn new(rows: usize, columns: usize) -> Self {
        let count = rows * columns;
        // Multiples of irrational numbers, folded into the unit cube.
        let place =
            |i: usize| [0.618_033_988_7, 0.414_213_562_4, 0.732_050_807_6].map(|step| (i as f64 * step).fract());
        let mut targets = Points::zeros(count);
        (0..count).for_each(|i| targets.set(i, place(i)));
        let core = |i: usize| 0.02 + 0.01 * (i as f64 * 0.236_067_977_5).fract();
        let edge = |from: usize, to: usize| Edge::between(place(from), place(to), [core(from), core(to)], 0.25);
        let node = |i: usize| Node {
            place: place(i),
            core2: core(i).powi(2),
            spanwise: if i.is_multiple_of(columns) { Edge::NONE } else { edge(i - 1, i) },
            chordwise: if i >= columns { edge(i - columns, i) } else { Edge::NONE },
        };
        Self { columns, nodes: (0..count).map(node).collect(), targets }
    }

    /// The sheet.
    pub fn sheet(&self) -> Sheet<'_> {
        Sheet { columns: self.columns, nodes: &self.nodes }
    }
}

/// The sheet's velocity at one point, segment by segment as a textbook writes it:
/// what the kernel is measured against and tested with.
pub fn induce_plainly(sheet: &Sheet<'_>, target: [f64; 3]) -> [f64; 3] {
    let mut velocity = [0.0; 3];
    let mut add = |from: &Node, to: &Node, edge: &Edge| {
        let [a, b] = [from, to].map(|n| [0, 1, 2].map(|c: usize| target[c] - n.place[c]));
        let cross = |p: [f64; 3], q: [f64; 3]| {
            [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
        };
        let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
        let (ra, rb) = ((dot(a, a) + from.core2).sqrt(), (dot(b, b) + to.core2).sqrt());
        let product = ra * rb;
        let factor = 0.5 * (ra + rb) / (product * (product + dot(a, b) + (from.core2 * to.core2).sqrt()));
        velocity.iter_mut().zip(cross(edge.vector, b)).for_each(|(v, c)| *v += factor * c);
    };
    for (i, node) in sheet.nodes.iter().enumerate() {
        if !i.is_multiple_of(sheet.columns) {
            add(&sheet.nodes[i - 1], node, &node.spanwise);
        }
        if i >= sheet.columns {
            add(&sheet.nodes[i - sheet.columns], node, &node.chordwise);
        }
    }
    velocity
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::uvlm::kernel::induce;

    #[test]
    fn the_kernel_agrees_with_the_textbook() {
        for (rows, columns) in [(1, 2), (2, 2), (7, 5), (12, 11)] {
            let work = Workload::new(rows, columns);
            let mut velocity = Points::zeros(work.targets.len());
            induce(&work.sheet(), &work.targets, &mut velocity);
            for i in 0..work.targets.len() {
                let plain = induce_plainly(&work.sheet(), work.targets.get(i));
                for (v, p) in velocity.get(i).iter().zip(plain) {
                    assert!((v - p).abs() <= 1e-9 * (1.0 + p.abs()), "{rows} x {columns}, {i}: {v} {p}");
                }
            }
        }
    }

    /// ∫ dl x r / (r² + c²)^(3/2) by the midpoint rule, c going linearly from end to end.
    #[test]
    fn a_segment_is_vorticity_spread_over_its_core() {
        let (from, to, cores, target) = ([0.0, 0.0, 0.0], [0.3, 0.1, -0.2], [0.02, 0.4], [0.1, -0.2, 0.25]);
        let edge = Edge::between(from, to, cores, 1.0);
        let node = |place, core: f64, spanwise| Node { place, core2: core * core, spanwise, chordwise: Edge::NONE };
        let nodes = [node(from, cores[0], Edge::NONE), node(to, cores[1], edge)];
        let mut targets = Points::zeros(1);
        targets.set(0, target);
        let mut velocity = Points::zeros(1);
        induce(&Sheet { columns: 2, nodes: &nodes }, &targets, &mut velocity);
        let mut expected = [0.0; 3];
        const PARTS: usize = 20_000;
        for i in 0..PARTS {
            let t = (i as f64 + 0.5) / PARTS as f64;
            let r = [0, 1, 2].map(|c: usize| target[c] - from[c] - t * (to[c] - from[c]));
            let core = cores[0] + t * (cores[1] - cores[0]);
            let rho = (r.iter().map(|x| x * x).sum::<f64>() + core * core).sqrt();
            let l = [0, 1, 2].map(|c: usize| (to[c] - from[c]) / PARTS as f64);
            let cross = [l[1] * r[2] - l[2] * r[1], l[2] * r[0] - l[0] * r[2], l[0] * r[1] - l[1] * r[0]];
            for (sum, cross) in expected.iter_mut().zip(cross) {
                *sum += cross / (4.0 * std::f64::consts::PI * rho.powi(3));
            }
        }
        for (v, e) in velocity.get(0).iter().zip(expected) {
            assert!((v - e).abs() < 1e-8 * e.abs(), "{v} {e}");
        }
    }

    #[test]
    fn multiply_adds_are_counted() {
        let (operations, sum) = multiply_adds(1000);
        // x -> 0.9999999 x + 1e-7 stays at its fixed point 1: the sum tells how many numbers there are.
        assert_eq!(operations, 2000 * sum.round() as u64);
        assert!((sum / CHAINS as f64).fract().abs() < 1e-9 && sum > 11.0, "{sum}");
    }
}
