//! What follows when a stage has no open job left. Decisions only: they are
//! given all they need and change nothing.

use manduca_protocol::resolve::MIN_SAMPLES;
use manduca_protocol::view::JobCounts;

use super::names::Stage;

/// Most further samples drawn in one operation: others wait behind it.
const MOST_DRAWN: u32 = 1000;

/// What a study does next.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Step {
    /// Draws this many further samples.
    Draw(u32),
    /// Goes on to a stage.
    Enter(Stage),
    /// Is done.
    Succeed,
    /// Cannot go on, for this reason.
    Fail(String),
}

/// All samples have ended. Further ones stand in for those without a result, up
/// to half as many as were wanted.
pub(super) fn after_sampling(samples: u32, next_sample: u32, counts: &JobCounts, last_failure: Option<&str>) -> Step {
    let missing = u64::from(samples).saturating_sub(counts.succeeded);
    let extras_left = (samples / 2 + 10).saturating_sub(next_sample.saturating_sub(samples));
    if missing > 0 && extras_left > 0 {
        let missing = u32::try_from(missing).unwrap_or(u32::MAX);
        return Step::Draw(missing.min(extras_left).min(MOST_DRAWN));
    }
    let ended = counts.succeeded + counts.infeasible + counts.dead;
    let why = if counts.dead * 2 > ended {
        "more than half of them failed for good"
    } else if counts.succeeded < u64::from(MIN_SAMPLES) {
        "too few to train on"
    } else {
        return Step::Enter(Stage::Training);
    };
    let last = last_failure.map(|reason| format!("; the last failure: {reason}")).unwrap_or_default();
    Step::Fail(format!(
        "of {ended} samples {} succeeded, {} are infeasible and {} failed: {why}{last}",
        counts.succeeded, counts.infeasible, counts.dead
    ))
}

/// The training has ended.
pub(super) fn after_training(counts: &JobCounts, optimisations: i64, last_failure: Option<&str>) -> Step {
    if counts.succeeded == 0 {
        return Step::Fail(format!("the training failed: {}", last_failure.unwrap_or("no reason is known")));
    }
    if optimisations == 0 { Step::Succeed } else { Step::Enter(Stage::Optimising) }
}

/// All optimisations have ended, so many with an optimum.
pub(super) fn after_optimising(found: usize, last_failure: Option<&str>) -> Step {
    if found == 0 {
        return Step::Fail(format!("no optimisation succeeded: {}", last_failure.unwrap_or("no reason is known")));
    }
    Step::Enter(Stage::Verifying)
}

/// The optima found of those asked for have been flown again. A study which misses an
/// answer it was asked for has failed, however many others it has.
pub(super) fn after_verifying(asked: i64, found: usize, verify: &JobCounts, last_failure: Option<&str>) -> Step {
    let verified = found as i64 - verify.dead as i64;
    if verified >= asked {
        return Step::Enter(Stage::Refining);
    }
    let last = last_failure.unwrap_or("no reason is known");
    let missing = asked - verified;
    Step::Fail(format!("{missing} of {asked} optimisations have no verified optimum; the last failure: {last}"))
}

/// No search around an optimum has anything left to do.
pub(super) fn after_refining(search: &JobCounts, last_failure: Option<&str>) -> Step {
    if search.dead == 0 {
        return Step::Succeed;
    }
    let last = last_failure.unwrap_or("no reason is known");
    Step::Fail(format!("{} searches failed; the last failure: {last}", search.dead))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(succeeded: u64, infeasible: u64, dead: u64) -> JobCounts {
        JobCounts { succeeded, infeasible, dead, ..JobCounts::default() }
    }

    #[test]
    fn missing_samples_are_drawn_until_the_limit() {
        assert_eq!(after_sampling(100, 100, &counts(100, 0, 0), None), Step::Enter(Stage::Training));
        assert_eq!(after_sampling(100, 100, &counts(90, 8, 2), None), Step::Draw(10));
        assert_eq!(after_sampling(100, 155, &counts(80, 75, 0), None), Step::Draw(5));
        assert_eq!(after_sampling(100, 160, &counts(80, 80, 0), None), Step::Enter(Stage::Training));
        assert_eq!(after_sampling(9000, 9000, &counts(0, 9000, 0), None), Step::Draw(MOST_DRAWN));
    }

    #[test]
    fn too_many_failures_end_a_study_with_their_reason() {
        let Step::Fail(why) = after_sampling(100, 160, &counts(75, 0, 85), Some("it burns")) else { panic!("goes on") };
        assert!(why.contains("more than half") && why.contains("it burns"), "{why}");
        let Step::Fail(why) = after_sampling(20, 40, &counts(19, 21, 0), None) else { panic!("goes on") };
        assert!(why.contains("too few"), "{why}");
    }

    #[test]
    fn a_missing_answer_fails_the_study() {
        assert_eq!(after_training(&counts(1, 0, 0), 0, None), Step::Succeed);
        assert_eq!(after_optimising(1, None), Step::Enter(Stage::Verifying));
        assert!(matches!(after_optimising(0, Some("x")), Step::Fail(_)));
        assert_eq!(after_verifying(2, 2, &counts(1, 1, 0), None), Step::Enter(Stage::Refining));
        assert_eq!(after_refining(&counts(3, 0, 0), None), Step::Succeed);
        assert!(matches!(after_refining(&counts(3, 0, 1), Some("x")), Step::Fail(_)));
        for (found, dead) in [(1, 0), (2, 1)] {
            let Step::Fail(why) = after_verifying(2, found, &counts(1, 0, dead), Some("x")) else { panic!("goes on") };
            assert!(why.contains("1 of 2"), "{why}");
        }
    }
}
