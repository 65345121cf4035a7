//! A compute slot: a child process which is handed one task at a time.
//!
//! Parent and child speak one JSON object per line. The parent writes a
//! [`Task`](manduca_protocol::task::Task) to the child's standard input; the
//! child answers with any number of [`Message::Progress`] and [`Message::Checkpoint`] and one
//! [`Message::Done`] or [`Message::Failed`]. The child outlives its jobs and is
//! started anew only after a crash or a kill.

mod child;
mod parent;
mod stderr;

pub use child::slot_main;
pub use parent::{Outcome, Slot};

use manduca_protocol::task::{Checkpoint, JobResult, Progress, Provenance};
use manduca_protocol::worker::Fault;
use serde::{Deserialize, Serialize};

/// What is known of a task while it is computed.
#[derive(Debug, Clone, Default)]
pub struct News {
    /// How far it is.
    pub progress: Option<Progress>,
    /// Where it could be taken up again.
    pub checkpoint: Option<Checkpoint>,
}

/// What a child says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "message", rename_all = "kebab-case")]
pub enum Message {
    /// Still at it.
    Progress(Progress),
    /// Where it could be taken up again.
    Checkpoint {
        /// By whatever computes it next.
        at: Checkpoint,
    },
    /// The task's result.
    Done {
        /// What came out.
        result: JobResult,
        /// How it was computed.
        provenance: Provenance,
    },
    /// The task could not be computed; the child is fit for another.
    Failed {
        /// Why.
        reason: String,
        /// What is to blame.
        fault: Fault,
    },
}
