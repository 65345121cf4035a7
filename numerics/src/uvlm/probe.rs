//! Work of known size, to measure a machine by. Nothing here keeps time.

use crate::uvlm::kernel::{Points, Segments, Sheet};

/// Independent chains of multiply-adds: enough to hide their latency.
const CHAINS: usize = 12;
/// Numbers side by side in a chain.
const LANES: usize = 8;

/// Does `rounds` rounds of multiply-adds in registers; returns how many floating
/// point operations that was and a number which depends on all of them.
pub fn multiply_adds(rounds: u64) -> (u64, f64) {
    let sum = pulp::Arch::new().dispatch(MultiplyAdds { rounds });
    (rounds * (2 * CHAINS * LANES) as u64, sum)
}

struct MultiplyAdds {
    rounds: u64,
}

impl pulp::NullaryFnOnce for MultiplyAdds {
    type Output = f64;

    #[inline(always)]
    fn call(self) -> f64 {
        let mut chains = [[1.0_f64; LANES]; CHAINS];
        for _ in 0..self.rounds {
            for chain in &mut chains {
                for x in chain {
                    *x = x.mul_add(0.999_999_9, 1e-7);
                }
            }
        }
        chains.iter().flatten().sum()
    }
}

/// A sheet and targets of the size of a production sample's wake, at places
/// without meaning.
#[derive(Debug, Clone)]
pub struct Workload {
    columns: usize,
    nodes: [Vec<f64>; 3],
    strengths: Vec<f64>,
    /// Squared lengths of spanwise and chordwise segments.
    lengths2: [Vec<f64>; 2],
    cores: Vec<f64>,
    /// The targets: the nodes themselves.
    pub targets: Points,
}

impl Workload {
    /// A sheet of `rows x columns` nodes.
    pub fn new(rows: usize, columns: usize) -> Self {
        let count = rows * columns;
        // Multiples of irrational numbers, folded into the unit cube.
        let folded = |step: f64| (0..count).map(|i| (i as f64 * step).fract()).collect::<Vec<_>>();
        let nodes = [folded(0.618_033_988_7), folded(0.414_213_562_4), folded(0.732_050_807_6)];
        let mut targets = Points::zeros(count);
        (0..count).for_each(|i| targets.set(i, [0, 1, 2].map(|c: usize| nodes[c][i])));
        let length2 = |a: usize, b: usize| nodes.iter().map(|c| (c[a] - c[b]).powi(2)).sum::<f64>();
        let across = (0..rows * (columns - 1)).map(|i| i / (columns - 1) * columns + i % (columns - 1));
        let lengths2 = [
            across.map(|first| length2(first, first + 1)).collect(),
            (0..(rows - 1) * columns).map(|first| length2(first, first + columns)).collect(),
        ];
        Self { columns, lengths2, strengths: vec![0.01; count], cores: vec![1e-4; count], nodes, targets }
    }

    fn segments(&self, direction: usize, count: usize) -> Segments<'_> {
        Segments { strength: &self.strengths[..count], length2: &self.lengths2[direction], core: &self.cores[..count] }
    }

    /// The sheet.
    pub fn sheet(&self) -> Sheet<'_> {
        let rows = self.nodes[0].len() / self.columns;
        let (across, along) = (rows * (self.columns - 1), (rows - 1) * self.columns);
        Sheet {
            columns: self.columns,
            nodes: [&self.nodes[0], &self.nodes[1], &self.nodes[2]],
            spanwise: self.segments(0, across),
            chordwise: self.segments(1, along),
        }
    }
}

/// The sheet's velocity at one point, segment by segment as a textbook writes it:
/// what the kernel is measured against and tested with.
pub fn induce_plainly(sheet: &Sheet<'_>, target: [f64; 3]) -> [f64; 3] {
    let columns = sheet.columns;
    let node = |i: usize| [0, 1, 2].map(|c| target[c] - sheet.nodes[c][i]);
    let mut velocity = [0.0; 3];
    let mut add = |from: usize, to: usize, strength: f64, core: f64| {
        let (a, b) = (node(from), node(to));
        let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
        let (ra, rb) = (dot(a, a).sqrt(), dot(b, b).sqrt());
        let product = ra * rb;
        let den = product * (dot(cross, cross) + core);
        if den > 0.0 {
            let factor = 2.0 * strength * (ra + rb) * (product - dot(a, b)) / den;
            velocity.iter_mut().zip(cross).for_each(|(v, c)| *v += factor * c);
        }
    };
    for (i, strength) in sheet.spanwise.strength.iter().enumerate() {
        let first = i / (columns - 1) * columns + i % (columns - 1);
        add(first, first + 1, *strength, sheet.spanwise.core[i]);
    }
    for (i, strength) in sheet.chordwise.strength.iter().enumerate() {
        add(i, i + columns, *strength, sheet.chordwise.core[i]);
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

    #[test]
    fn multiply_adds_are_counted() {
        let (operations, sum) = multiply_adds(1000);
        assert_eq!(operations, 192_000);
        // x -> 0.9999999 x + 1e-7 stays at its fixed point 1.
        assert!((sum - 96.0).abs() < 1e-9);
    }
}
