//! From a task on the wire to a result on the wire: the only place where
//! messages and science meet.

mod optimise;
mod search;
mod simulate;
mod train;

pub use simulate::simulate;

use manduca_numerics::parameters::Bounds;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::task::{BoundsMessage, Checkpoint, JobResult, Progress, Scaled, Task};
use manduca_protocol::worker::Fault;

/// Why a task has no result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ComputeError {
    /// It makes no sense.
    #[error("the task is refused: {}", list(.0))]
    Refused(Vec<FieldProblem>),
    /// The numbers were lost on the way.
    #[error("non-finite result")]
    NonFinite,
    /// The science says why.
    #[error("{0}")]
    Failed(String),
}

impl ComputeError {
    /// Whether the task is not valid, or failed while it was computed.
    pub fn fault(&self) -> Fault {
        match self {
            Self::Refused(_) => Fault::Refused,
            Self::NonFinite | Self::Failed(_) => Fault::Failed,
        }
    }
}

fn list(faults: &[FieldProblem]) -> String {
    faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// Hears of a task while it is computed.
pub trait Listener {
    /// How far it is.
    fn progress(&mut self, at: Progress);
    /// Where it could be taken up again; `make` costs something and need not be called.
    fn checkpoint(&mut self, make: &dyn Fn() -> Checkpoint);
}

/// Computes any task; `listener` hears how far it is.
///
/// # Errors
/// When the task is refused, fails, or ends in numbers which are none.
pub fn run(task: &Task, listener: &mut dyn Listener) -> Result<JobResult, ComputeError> {
    Ok(match task {
        Task::Simulate(task) => JobResult::Simulate(Box::new(simulate(task)?)),
        Task::Train(task) => JobResult::Train(Box::new(train::train(task, listener)?)),
        Task::Optimise(task) => {
            JobResult::Optimise(Box::new(optimise::optimise(task, &mut |at| listener.progress(at))?))
        }
        Task::Search(task) => JobResult::Search(Box::new(search::search(task)?)),
    })
}

/// JSON has no NaN: it would arrive as null, or not at all.
fn finite(values: impl IntoIterator<Item = f64>) -> Result<(), ComputeError> {
    if values.into_iter().all(f64::is_finite) { Ok(()) } else { Err(ComputeError::NonFinite) }
}

fn bounds(message: &BoundsMessage) -> Bounds {
    Bounds { lower: message.lower, upper: message.upper }
}

fn scaled([lift, drag, pitch_moment, power]: [f64; 4]) -> Scaled {
    Scaled { lift, drag, pitch_moment, power }
}
