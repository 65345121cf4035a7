//! Surrogates between the wire and the science. One from the wire may have any
//! shape; one of the wrong shape would panic deep inside, so it is checked here.

use manduca_numerics::parameters::Bounds;
use manduca_numerics::surrogate::process::{AscentStop, Climbed};
use manduca_numerics::surrogate::{Checkpoint, Epoch, Frame, Member, Network, Process, ProcessOutput, Stop, Surrogate};

use crate::task::{
    AscentMessage, BoundsMessage, EpochMessage, FitCheckpoint, FrameMessage, MemberMessage, NetworkMessage,
    ProcessMessage, ProcessOutputMessage, SurrogateMessage, TrainCheckpoint,
};

impl From<&Bounds> for BoundsMessage {
    fn from(bounds: &Bounds) -> Self {
        Self { lower: bounds.lower, upper: bounds.upper }
    }
}

impl From<&BoundsMessage> for Bounds {
    fn from(message: &BoundsMessage) -> Self {
        Self { lower: message.lower, upper: message.upper }
    }
}

impl From<&Network> for NetworkMessage {
    fn from(n: &Network) -> Self {
        Self {
            bounds: (&n.bounds).into(),
            hidden_weights: n.hidden_weights.clone(),
            hidden_biases: n.hidden_biases.clone(),
            output_weights: n.output_weights.clone(),
            output_biases: n.output_biases,
        }
    }
}

impl From<&Surrogate> for SurrogateMessage {
    fn from(surrogate: &Surrogate) -> Self {
        let frame = match *surrogate.frame() {
            Frame::Paper => FrameMessage::Paper,
            Frame::Physical { reference_hz, arm, mirror, sharpness } => {
                FrameMessage::Physical { reference_hz, arm, mirror, sharpness }
            }
        };
        let networks = surrogate.members().iter().map(Into::into).collect();
        Self { frame, networks, process: surrogate.process().map(|p| Box::new(p.into())) }
    }
}

impl From<&Process> for ProcessMessage {
    fn from(process: &Process) -> Self {
        let output = |o: &ProcessOutput| ProcessOutputMessage {
            lengths: o.lengths,
            amplitude: o.amplitude,
            noise: o.noise,
            mean: o.mean,
            weights: o.weights.clone(),
        };
        let outputs = process.outputs.each_ref().map(output);
        Self { bounds: (&process.bounds).into(), points: process.points.clone(), outputs }
    }
}

impl From<&ProcessMessage> for Process {
    fn from(message: &ProcessMessage) -> Self {
        let output = |o: &ProcessOutputMessage| ProcessOutput {
            lengths: o.lengths,
            amplitude: o.amplitude,
            noise: o.noise,
            mean: o.mean,
            weights: o.weights.clone(),
        };
        let outputs = message.outputs.each_ref().map(output);
        Self { bounds: (&message.bounds).into(), points: message.points.clone(), outputs }
    }
}

/// The network of a message.
///
/// # Errors
/// A sentence, when its arrays do not fit together.
pub fn network(message: &NetworkMessage) -> Result<Network, String> {
    Network::new_checked(
        (&message.bounds).into(),
        message.hidden_weights.clone(),
        message.hidden_biases.clone(),
        message.output_weights.clone(),
        message.output_biases,
    )
    .map_err(|e| e.to_string())
}

/// The surrogate of a message.
///
/// # Errors
/// A sentence, when its numbers are none or do not fit together.
pub fn surrogate(message: &SurrogateMessage) -> Result<Surrogate, String> {
    let frame = match message.frame {
        FrameMessage::Paper => Frame::Paper,
        FrameMessage::Physical { reference_hz, arm, mirror, sharpness } => {
            if !(reference_hz.is_finite() && reference_hz > 0.0 && arm.iter().all(|a| a.is_finite())) {
                return Err("the frame's numbers are none".into());
            }
            Frame::Physical { reference_hz, arm, mirror, sharpness }
        }
    };
    if let Some(process) = &message.process {
        if !message.networks.is_empty() {
            return Err("it has both networks and a gaussian process".into());
        }
        return Surrogate::of_process(frame, (&**process).into()).map_err(|e| e.to_string());
    }
    let networks = message.networks.iter().map(network).collect::<Result<_, _>>()?;
    Surrogate::new(frame, networks).map_err(|e| e.to_string())
}

fn count(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

/// The iterations of network `of` of an ensemble.
pub fn curve(of: usize, curve: &[Epoch]) -> Vec<EpochMessage> {
    let message = |e: &Epoch| EpochMessage {
        network: count(of),
        iteration: count(e.iteration),
        train_mse: e.train_mse,
        validation_mse: e.validation_mse,
        test_mse: e.test_mse,
        damping: e.damping,
    };
    curve.iter().map(message).collect()
}

fn epochs(curve: &[EpochMessage]) -> Vec<Epoch> {
    let epoch = |e: &EpochMessage| Epoch {
        iteration: e.iteration as usize,
        train_mse: e.train_mse,
        validation_mse: e.validation_mse,
        test_mse: e.test_mse,
        damping: e.damping,
    };
    curve.iter().map(epoch).collect()
}

/// Every reason to stop and how it is told.
const STOPS: [(Stop, &str); 5] = [
    (Stop::Validation, "the validation error no longer fell"),
    (Stop::MaxIterations, "all iterations were made"),
    (Stop::Gradient, "the gradient vanished"),
    (Stop::Damping, "no step made the error smaller"),
    (Stop::Interrupted, "interrupted"),
];

/// A reason to stop as it is told.
pub fn stopped(stop: Stop) -> &'static str {
    STOPS.iter().find(|(s, _)| *s == stop).map_or("", |(_, told)| told)
}

/// What the reasons for an ascent to end are called.
const ENDS: [(AscentStop, &str); 5] = [
    (AscentStop::Flat, "the likelihood no longer rose"),
    (AscentStop::MaxIterations, "all iterations were made"),
    (AscentStop::Stuck, "no step made the samples likelier"),
    (AscentStop::Interrupted, "interrupted"),
    (AscentStop::Constant, "the output is the same in all samples"),
];

/// Why the search of a gaussian process's numbers ended, as it is told.
pub fn climbed(stop: AscentStop) -> &'static str {
    ENDS.iter().find(|(s, _)| *s == stop).map_or("", |(_, told)| told)
}

/// The ended ascents of a fit as they travel.
pub fn fit_message(ended: &[Climbed]) -> FitCheckpoint {
    let ascent = |c: &Climbed| AscentMessage {
        ascent: count(c.ascent),
        at: c.at.clone(),
        iterations: count(c.iterations),
        stopped: climbed(c.stop).into(),
    };
    FitCheckpoint { ascents: ended.iter().map(ascent).collect() }
}

/// The ended ascents of a message; one which makes no sense is left out, and is made again.
pub fn fit(message: &FitCheckpoint) -> Vec<Climbed> {
    let ascent = |a: &AscentMessage| {
        let (stop, _) = ENDS.iter().find(|(_, told)| *told == a.stopped)?;
        let (ascent, iterations) = (a.ascent as usize, a.iterations as usize);
        Some(Climbed { ascent, at: a.at.clone(), iterations, stop: *stop })
    };
    message.ascents.iter().filter_map(ascent).collect()
}

/// A checkpoint as it travels.
pub fn checkpoint_message(at: &Checkpoint) -> TrainCheckpoint {
    let member = |(of, m): (usize, &Member)| MemberMessage {
        network: (&m.network).into(),
        curve: curve(of, &m.curve),
        best_iteration: count(m.best_iteration),
        stopped: stopped(m.stopped).into(),
    };
    TrainCheckpoint {
        members: at.members.iter().enumerate().map(member).collect(),
        network: (&at.network).into(),
        objective: at.objective,
        damping: at.damping,
        growth: at.growth,
        curve: curve(at.members.len(), &at.curve),
        best: (&at.best).into(),
    }
}

/// The checkpoint of a message.
///
/// # Errors
/// A sentence, when its networks are none.
pub fn checkpoint(message: &TrainCheckpoint) -> Result<Checkpoint, String> {
    let member = |m: &MemberMessage| -> Result<Member, String> {
        let stop = STOPS.iter().find(|(_, told)| *told == m.stopped);
        Ok(Member {
            network: network(&m.network)?,
            curve: epochs(&m.curve),
            best_iteration: m.best_iteration as usize,
            stopped: stop.ok_or("an unknown reason to stop")?.0,
        })
    };
    Ok(Checkpoint {
        members: message.members.iter().map(member).collect::<Result<_, _>>()?,
        network: network(&message.network)?,
        objective: message.objective,
        damping: message.damping,
        growth: message.growth,
        curve: epochs(&message.curve),
        best: network(&message.best)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message() -> NetworkMessage {
        let bounds = BoundsMessage { lower: [0.0; 10], upper: [1.0; 10] };
        NetworkMessage {
            bounds,
            hidden_weights: (0..20).map(|i| 0.1 / f64::from(i + 1)).collect(),
            hidden_biases: vec![0.3; 2],
            output_weights: vec![1.0 / 3.0; 8],
            output_biases: [0.1, 0.2, 0.3, 0.4],
        }
    }

    #[test]
    fn a_surrogate_survives_its_message() {
        let frame = FrameMessage::Physical { reference_hz: 27.5, arm: [0.1, -0.7], mirror: true, sharpness: true };
        let sent = SurrogateMessage { frame, networks: vec![message(), message()], process: None };
        let json = serde_json::to_string(&sent).unwrap();
        let taken = surrogate(&serde_json::from_str(&json).unwrap()).unwrap();
        assert_eq!(SurrogateMessage::from(&taken), sent);
    }

    #[test]
    fn a_surrogate_of_the_wrong_shape_is_refused() {
        let of = |networks| surrogate(&SurrogateMessage { frame: FrameMessage::Paper, networks, process: None });
        assert!(of(vec![message()]).is_ok());
        assert!(of(Vec::new()).is_err());
        let mut short = message();
        short.output_weights.pop();
        assert!(of(vec![short]).is_err());
        let mut elsewhere = message();
        elsewhere.bounds.upper[4] = 2.0;
        assert!(of(vec![message(), elsewhere]).is_err());
        let frame = FrameMessage::Physical { reference_hz: 0.0, arm: [0.0; 2], mirror: true, sharpness: true };
        assert!(surrogate(&SurrogateMessage { frame, networks: vec![message()], process: None }).is_err());
    }

    #[test]
    fn a_gaussian_process_survives_its_message_and_stands_alone() {
        let bounds = BoundsMessage { lower: [0.0; 10], upper: [1.0; 10] };
        let output = ProcessOutputMessage {
            lengths: [1.0 / 3.0; 10],
            amplitude: 2.0,
            noise: 1e-3,
            mean: 0.1,
            weights: vec![0.7, -1e-17],
        };
        let process =
            ProcessMessage { bounds, points: vec![[0.25; 10], [0.1; 10]], outputs: [(); 4].map(|()| output.clone()) };
        let mut sent =
            SurrogateMessage { frame: FrameMessage::Paper, networks: Vec::new(), process: Some(Box::new(process)) };
        let json = serde_json::to_string(&sent).unwrap();
        let taken = surrogate(&serde_json::from_str(&json).unwrap()).unwrap();
        assert_eq!(SurrogateMessage::from(&taken), sent);
        assert!(taken.predict(&[0.25; 10])[0] > 0.1);
        sent.networks.push(message());
        assert!(surrogate(&sent).unwrap_err().contains("both"));
        sent.networks.clear();
        sent.process.as_mut().unwrap().outputs[3].weights.pop();
        assert!(surrogate(&sent).unwrap_err().contains("weights has 1 numbers; 2"), "{:?}", surrogate(&sent));
    }

    #[test]
    fn a_checkpoint_survives_its_message_to_the_last_bit() {
        let network = network(&message()).unwrap();
        let epoch = Epoch { iteration: 0, train_mse: 0.1, validation_mse: 1.0 / 3.0, test_mse: 3e-17, damping: 1e-3 };
        let member =
            Member { network: network.clone(), curve: vec![epoch], best_iteration: 0, stopped: Stop::Validation };
        let sent = Checkpoint {
            members: vec![member],
            network: network.clone(),
            objective: 0.1 + 0.2,
            damping: 1e-20,
            growth: 4.0,
            curve: vec![epoch],
            best: network,
        };
        let json = serde_json::to_string(&checkpoint_message(&sent)).unwrap();
        assert_eq!(checkpoint(&serde_json::from_str(&json).unwrap()), Ok(sent));
    }
}
