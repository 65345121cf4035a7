//! What the coordinator has not yet answered for.

use std::collections::{HashSet, VecDeque};

use manduca_protocol::ids::JobId;
use manduca_protocol::worker::{Completion, ExchangeRequest, ExchangeResponse, Failure, Fault, MAX_BATCH};
use tracing::{error, warn};

/// One thing to report.
#[derive(Debug, Clone)]
pub(crate) enum Report {
    Complete(Completion),
    Fail(Failure),
}

impl Report {
    /// The job and the attempt.
    fn of(&self) -> (JobId, u32) {
        match self {
            Self::Complete(c) => (c.job, c.attempt),
            Self::Fail(f) => (f.job, f.attempt),
        }
    }
}

/// How the coordinator took a batch.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Delivered {
    pub(crate) completed: u64,
    pub(crate) failed: u64,
    pub(crate) refused: u64,
    /// Reports which the answer leaves out. They stay.
    pub(crate) untold: usize,
}

/// Results in the order they came. Only one batch is ever under way, and it is
/// the front of the queue, so an answer needs no bookkeeping to be matched.
#[derive(Debug)]
pub(crate) struct Outbox {
    waiting: VecDeque<Report>,
    batch: usize,
    /// How often the report in front was refused when it was sent by itself.
    refusals: u32,
}

/// How often the coordinator must refuse to read a report before it is taken for unreadable: something
/// on the way may have damaged it.
const TRIES: u32 = 5;

impl Outbox {
    pub(crate) fn new() -> Self {
        Self { waiting: VecDeque::new(), batch: MAX_BATCH, refusals: 0 }
    }

    pub(crate) fn push(&mut self, report: Report) {
        self.waiting.push_back(report);
    }

    pub(crate) fn len(&self) -> usize {
        self.waiting.len()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// The jobs reported and their attempts.
    pub(crate) fn jobs(&self) -> impl Iterator<Item = (JobId, u32)> {
        self.waiting.iter().map(Report::of)
    }

    pub(crate) fn clear(&mut self) {
        self.waiting.clear();
    }

    /// Copies the next batch into a request; says how many it put there.
    pub(crate) fn fill(&self, request: &mut ExchangeRequest) -> usize {
        let batch = self.waiting.len().min(self.batch);
        for report in self.waiting.iter().take(batch) {
            match report.clone() {
                Report::Complete(c) => request.complete.push(c),
                Report::Fail(f) => request.fail.push(f),
            }
        }
        batch
    }

    /// Whether the report in front may be one which the coordinator cannot read.
    pub(crate) fn is_suspect(&self) -> bool {
        self.batch == 1
    }

    /// Forgets the reports of a batch which its answer tells about.
    pub(crate) fn answered(&mut self, batch: usize, answer: &ExchangeResponse) -> Delivered {
        let accepted: HashSet<JobId> = answer.accepted.iter().copied().collect();
        let rejected: HashSet<JobId> = answer.rejected.iter().map(|rejected| rejected.job).collect();
        for rejected in &answer.rejected {
            warn!(job = %rejected.job, reason = rejected.reason, "result refused");
        }
        let (mut delivered, mut untold) = (Delivered::default(), Vec::new());
        for report in self.waiting.drain(..batch.min(self.waiting.len())) {
            let job = report.of().0;
            match report {
                Report::Complete(_) if accepted.contains(&job) => delivered.completed += 1,
                Report::Fail(_) if accepted.contains(&job) => delivered.failed += 1,
                _ if rejected.contains(&job) => delivered.refused += 1,
                report => untold.push(report),
            }
        }
        delivered.untold = untold.len();
        if batch > 0 {
            (self.batch, self.refusals) = ((2 * self.batch).min(MAX_BATCH), 0);
        }
        untold.into_iter().rev().for_each(|report| self.waiting.push_front(report));
        delivered
    }

    /// The coordinator will not even read the batch. In ever smaller batches the culprit shows, if it was
    /// not just the size: a result which is refused again and again becomes a failure, which is plain
    /// text, and a failure is dropped.
    pub(crate) fn refused(&mut self, batch: usize, why: &str) {
        if batch == 0 {
            return;
        }
        self.refusals = if batch == 1 { self.refusals + 1 } else { 0 };
        self.batch = (batch / 2).max(1);
        if self.refusals < TRIES {
            return;
        }
        (self.batch, self.refusals) = (MAX_BATCH, 0);
        match self.waiting.pop_front() {
            Some(Report::Complete(Completion { job, attempt, .. })) => {
                error!(%job, attempt, why, "result lost: the coordinator cannot read it");
                let reason = format!("the coordinator cannot read the result: {why}");
                let fault = Some(Fault::Machine);
                self.waiting.push_front(Report::Fail(Failure { job, attempt, reason, fault }));
            }
            Some(Report::Fail(Failure { job, attempt, .. })) => {
                error!(%job, attempt, why, "failure report lost: the coordinator cannot read it");
            }
            None => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use manduca_protocol::worker::Rejected;

    fn failure(job: i64) -> Report {
        Report::Fail(Failure { job: JobId(job), attempt: 1, reason: "x".into(), fault: None })
    }

    #[test]
    fn what_is_not_answered_stays() {
        let mut outbox = Outbox::new();
        outbox.push(failure(1));
        outbox.push(failure(2));
        let mut request = ExchangeRequest::default();
        let batch = outbox.fill(&mut request);
        assert_eq!((batch, request.fail.len()), (2, 2));
        // The answer was lost: the same batch goes out again, with what came since behind it.
        outbox.push(failure(3));
        let answer = ExchangeResponse {
            accepted: vec![JobId(1)],
            rejected: vec![Rejected { job: JobId(2), reason: "stale".into() }],
            ..ExchangeResponse::default()
        };
        assert_eq!(outbox.answered(batch, &answer), Delivered { completed: 0, failed: 1, refused: 1, untold: 0 });
        assert_eq!(outbox.len(), 1);
        // An answer which leaves a report out is no answer to it.
        let told = outbox.answered(1, &ExchangeResponse::default());
        assert_eq!((told, outbox.len()), (Delivered { untold: 1, ..Delivered::default() }, 1));
    }

    #[test]
    fn an_unreadable_report_is_found_and_does_not_block_the_rest() {
        let mut outbox = Outbox::new();
        outbox.push(failure(1));
        outbox.push(failure(2));
        outbox.refused(2, "422");
        assert!(outbox.is_suspect());
        let mut request = ExchangeRequest::default();
        assert_eq!(outbox.fill(&mut request), 1);
        // What carried no report refuses none.
        outbox.refused(0, "422");
        for tries in 1..=TRIES {
            assert_eq!(outbox.len(), 2, "after {tries} tries");
            outbox.refused(1, "422");
        }
        assert_eq!((outbox.len(), outbox.is_suspect()), (1, false));
    }
}
