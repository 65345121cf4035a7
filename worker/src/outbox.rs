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
}

/// Results in the order they came. Only one batch is ever under way, and it is
/// the front of the queue, so an answer needs no bookkeeping to be matched.
#[derive(Debug)]
pub(crate) struct Outbox {
    waiting: VecDeque<Report>,
    batch: usize,
}

impl Outbox {
    pub(crate) fn new() -> Self {
        Self { waiting: VecDeque::new(), batch: MAX_BATCH }
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

    /// Forgets the batch just answered.
    pub(crate) fn answered(&mut self, batch: usize, answer: &ExchangeResponse) -> Delivered {
        self.batch = MAX_BATCH;
        let accepted: HashSet<JobId> = answer.accepted.iter().copied().collect();
        for rejected in &answer.rejected {
            warn!(job = %rejected.job, reason = rejected.reason, "result refused");
        }
        let mut delivered = Delivered::default();
        for report in self.waiting.drain(..batch.min(self.waiting.len())) {
            match report {
                _ if !accepted.contains(&report.of().0) => delivered.refused += 1,
                Report::Complete(_) => delivered.completed += 1,
                Report::Fail(_) => delivered.failed += 1,
            }
        }
        delivered
    }

    /// The coordinator will not even read the batch, and sending it again would
    /// end the same way. Sent one by one, the culprit shows: a result becomes a
    /// failure, which is plain text, and a failure is dropped.
    pub(crate) fn refused(&mut self, batch: usize, why: &str) {
        if batch > 1 {
            self.batch = 1;
            return;
        }
        self.batch = MAX_BATCH;
        match self.waiting.pop_front() {
            Some(Report::Complete(Completion { job, attempt, .. })) => {
                error!(%job, why, "the coordinator cannot read this result");
                let reason = format!("the coordinator cannot read the result: {why}");
                let fault = Some(Fault::Machine);
                self.waiting.push_front(Report::Fail(Failure { job, attempt, reason, fault }));
            }
            Some(Report::Fail(Failure { job, .. })) => error!(%job, why, "dropped a failure report"),
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
        assert_eq!(outbox.answered(batch, &answer), Delivered { completed: 0, failed: 1, refused: 1 });
        assert_eq!(outbox.len(), 1);
    }

    #[test]
    fn an_unreadable_report_is_found_and_does_not_block_the_rest() {
        let mut outbox = Outbox::new();
        outbox.push(failure(1));
        outbox.push(failure(2));
        outbox.refused(2, "422");
        let mut request = ExchangeRequest::default();
        assert_eq!(outbox.fill(&mut request), 1);
        outbox.refused(1, "422");
        assert_eq!(outbox.len(), 1);
    }
}
