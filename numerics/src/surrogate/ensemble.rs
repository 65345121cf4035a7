//! The surrogate: what was learnt in its frame, as one function of the ten parameters.

use super::features::{Frame, MIRROR_SIGNS};
use super::process::{Process, Ready};
use super::{Jacobian, Network, NetworkError};
use crate::parameters::{COUNT, Point, at};
use rayon::prelude::*;

/// Points predicted and mapped by one parallel task.
const TASK: usize = 1024;

/// Predicts L+, D+, M+, P+ of a stroke: the mean of one or more networks, or a gaussian
/// process, in a frame.
///
/// All networks are laid side by side as one, whose output weights are theirs over
/// their number. Where the mirror law holds each is joined by its own mirror image,
/// every neuron by one with phi0 and alpha0 reversed, so that predictions obey the law
/// to the last digits.
#[derive(Debug, Clone, PartialEq)]
pub struct Surrogate {
    frame: Frame,
    learnt: Learnt,
}

/// What predicts in the frame.
#[derive(Debug, Clone, PartialEq)]
enum Learnt {
    /// Networks, and all of them as one.
    Networks(Vec<Network>, Box<Network>),
    /// A gaussian process.
    Process(Box<Ready>),
}

impl Learnt {
    fn predict_into(&self, inputs: &[Point], out: &mut [[f64; 4]]) {
        match self {
            Self::Networks(_, joined) => joined.predict_into(inputs, out),
            Self::Process(process) => process.predict_into(inputs, out),
        }
    }

    fn jacobians_into(&self, inputs: &[Point], out: &mut [Jacobian]) {
        match self {
            Self::Networks(_, joined) => joined.jacobians_into(inputs, out),
            Self::Process(process) => process.jacobians_into(inputs, out),
        }
    }
}

impl Surrogate {
    /// A surrogate from its networks.
    ///
    /// # Errors
    /// When there is none, or they differ in their bounds.
    pub fn new(frame: Frame, members: Vec<Network>) -> Result<Self, NetworkError> {
        let first = members.first().ok_or(NetworkError::Empty)?;
        let bounds = first.bounds;
        if let Some(index) = (0..COUNT).find(|&i| {
            members.iter().any(|m| m.bounds.lower[i] != bounds.lower[i] || m.bounds.upper[i] != bounds.upper[i])
        }) {
            return Err(NetworkError::Bounds { index });
        }
        let joined = join(&frame, &members);
        Ok(Self { frame, learnt: Learnt::Networks(members, Box::new(joined)) })
    }

    /// A single network of the ten parameters themselves.
    pub fn of(network: Network) -> Self {
        Self { frame: Frame::Paper, learnt: Learnt::Networks(vec![network.clone()], Box::new(network)) }
    }

    /// A gaussian process in its frame.
    ///
    /// # Errors
    /// When its numbers are none or do not fit together.
    pub fn of_process(frame: Frame, process: Process) -> Result<Self, NetworkError> {
        Ok(Self { frame, learnt: Learnt::Process(Box::new(Ready::new(&frame, process)?)) })
    }

    /// The map between strokes and what was learnt.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The networks; none where a gaussian process predicts.
    pub fn members(&self) -> &[Network] {
        match &self.learnt {
            Learnt::Networks(members, _) => members,
            Learnt::Process(_) => &[],
        }
    }

    /// The gaussian process, where one predicts.
    pub fn process(&self) -> Option<&Process> {
        match &self.learnt {
            Learnt::Networks(..) => None,
            Learnt::Process(ready) => Some(&ready.process),
        }
    }

    /// `[L+, D+, M+, P+]` at a point in table units.
    pub fn predict(&self, x: &Point) -> [f64; 4] {
        let mut out = [[0.0; 4]];
        self.predict_into(std::slice::from_ref(x), &mut out);
        out[0]
    }

    /// Predicts a batch in parallel; each result has the bits of [`Surrogate::predict`].
    ///
    /// Where the two slices differ in length, the shorter one counts.
    pub fn predict_into(&self, xs: &[Point], out: &mut [[f64; 4]]) {
        if self.frame == Frame::Paper {
            return self.learnt.predict_into(xs, out);
        }
        xs.par_chunks(TASK).zip(out.par_chunks_mut(TASK)).for_each(|(xs, out)| {
            let inputs: Vec<Point> = xs.iter().map(|x| self.frame.inputs(x)).collect();
            self.learnt.predict_into(&inputs, out);
            for (x, y) in xs.iter().zip(out) {
                *y = self.frame.outward(x, y);
            }
        });
    }

    /// Outputs at a point in table units and their derivatives by the ten parameters,
    /// one row per output; those by parameters which the frame does not know and the
    /// box holds are 0.
    pub fn jacobian(&self, x: &Point) -> Jacobian {
        let mut out = [([0.0; 4], [[0.0; COUNT]; 4])];
        self.jacobians_into(std::slice::from_ref(x), &mut out);
        out[0]
    }

    /// The same at many points, on the calling thread; the shorter slice counts.
    pub fn jacobians_into(&self, xs: &[Point], out: &mut [Jacobian]) {
        let inputs: Vec<Point> = xs.iter().map(|x| self.frame.inputs(x)).collect();
        self.learnt.jacobians_into(&inputs, out);
        for (x, place) in xs.iter().zip(out) {
            *place = self.outward(x, place);
        }
    }

    /// From outputs and derivatives in the frame to those of the means.
    fn outward(&self, x: &Point, (inside, slopes): &Jacobian) -> Jacobian {
        let (by_inside, by_frame) = self.frame.slopes(x, inside);
        let by_own = self.frame.input_slopes(x);
        let mut jacobian = [[0.0; COUNT]; 4];
        for (o, row) in jacobian.iter_mut().enumerate() {
            for (i, d) in row.iter_mut().enumerate() {
                *d = by_own[i] * (0..4).map(|k| by_inside[o][k] * slopes[k][i]).sum::<f64>();
            }
            row[at::FREQUENCY] += by_frame[o][0];
            row[at::STROKE_PLANE] += by_frame[o][1];
        }
        (self.frame.outward(x, inside), jacobian)
    }
}

/// All networks side by side, mirror images beside their originals.
fn join(frame: &Frame, members: &[Network]) -> Network {
    let images: &[bool] = if matches!(frame, Frame::Physical { mirror: true, .. }) { &[false, true] } else { &[false] };
    let share = 1.0 / (members.len() * images.len()) as f64;
    let neurons = members.iter().flat_map(|m| (0..m.neurons()).map(move |j| (m, j)));
    let neurons: Vec<_> = neurons.flat_map(|(m, j)| images.iter().map(move |image| (m, j, *image))).collect();
    let mut joined = Network {
        bounds: members[0].bounds,
        hidden_weights: Vec::with_capacity(neurons.len() * COUNT),
        hidden_biases: neurons.iter().map(|(m, j, _)| m.hidden_biases[*j]).collect(),
        output_weights: Vec::with_capacity(neurons.len() * 4),
        output_biases: [0.0; 4],
    };
    for &(m, j, image) in &neurons {
        let reversed = |i: usize| image && (i == at::SWEEP_MEAN || i == at::ROTATION_MEAN);
        let row = &m.hidden_weights[j * COUNT..(j + 1) * COUNT];
        joined.hidden_weights.extend(row.iter().enumerate().map(|(i, w)| if reversed(i) { -w } else { *w }));
    }
    let sign = |k: usize, image: bool| if image { MIRROR_SIGNS[k] } else { 1.0 };
    for k in 0..4 {
        let weight =
            |&(m, j, image): &(&Network, usize, bool)| share * sign(k, image) * m.output_weights[k * m.neurons() + j];
        joined.output_weights.extend(neurons.iter().map(weight));
        let biases = members.iter().flat_map(|m| images.iter().map(move |image| sign(k, *image) * m.output_biases[k]));
        joined.output_biases[k] = share * biases.sum::<f64>();
    }
    joined
}
