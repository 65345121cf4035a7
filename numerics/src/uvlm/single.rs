//! The wake's velocities in single precision.

use crate::uvlm::kernel::{Points, Segments, Sheet, induce};

/// Single-precision copies of a sheet and targets, in units of the sheet's own size.
#[derive(Debug, Clone, Default)]
pub struct SingleWake {
    nodes: [Vec<f32>; 3],
    spanwise: [Vec<f32>; 3],
    chordwise: [Vec<f32>; 3],
    targets: Points<f32>,
    velocity: Points<f32>,
}

fn copy(to: &mut Vec<f32>, from: &[f64], scale: f64) {
    to.clear();
    to.extend(from.iter().map(|x| (x * scale) as f32));
}

/// Lengths x `scale`; velocity then comes out divided by it.
fn copy_segments(to: &mut [Vec<f32>; 3], from: &Segments<'_>, scale: f64) {
    copy(&mut to[0], from.strength, 1.0);
    copy(&mut to[1], from.length2, scale * scale);
    copy(&mut to[2], from.core, scale.powi(4));
}

fn segments(from: &[Vec<f32>; 3]) -> Segments<'_, f32> {
    Segments { strength: &from[0], length2: &from[1], core: &from[2] }
}

impl SingleWake {
    /// Adds the velocity the sheet induces at the targets, m/s.
    pub fn induce(&mut self, sheet: &Sheet<'_>, targets: &Points, velocity: &mut Points) {
        let size = sheet.nodes.iter().flat_map(|c| c.iter()).fold(0.0_f64, |m, x| m.max(x.abs()));
        // A power of two, so that scaling rounds nothing; sizes of about ten keep all products in range.
        let scale = 2.0_f64.powi(3 - size.log2().ceil() as i32);
        for (to, from) in self.nodes.iter_mut().zip(sheet.nodes) {
            copy(to, from, scale);
        }
        copy_segments(&mut self.spanwise, &sheet.spanwise, scale);
        copy_segments(&mut self.chordwise, &sheet.chordwise, scale);
        self.targets.resize(targets.len());
        self.velocity.resize(targets.len());
        self.velocity.clear();
        for i in 0..targets.len() {
            self.targets.set(i, targets.get(i).map(|x| x * scale));
        }
        let [x, y, z] = &self.nodes;
        let single = Sheet {
            columns: sheet.columns,
            nodes: [x, y, z],
            spanwise: segments(&self.spanwise),
            chordwise: segments(&self.chordwise),
        };
        induce(&single, &self.targets, &mut self.velocity);
        let sums = [&mut velocity.x, &mut velocity.y, &mut velocity.z];
        for (sum, add) in sums.into_iter().zip([&self.velocity.x, &self.velocity.y, &self.velocity.z]) {
            for (sum, add) in sum.iter_mut().zip(add) {
                *sum += f64::from(*add) * scale;
            }
        }
    }
}
