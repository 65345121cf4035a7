//! What large results claim, computed again from what the study has: errors of a training on its samples,
//! the prediction and the clearance of an optimum, the strokes a search has met. Nothing is trained or
//! optimised a second time, for the bits of either differ from processor to processor.

mod optimum;
mod round;
mod training;

use manduca_numerics::parameters::{Bounds, Point};
use manduca_protocol::network;
use manduca_protocol::resolve;
use manduca_protocol::task::TrainResult;
use manduca_protocol::view::JobRole;

use crate::store::{Store, StoreError, Unchecked, parse_body, round_of};
use training::Trained;

/// Why a result is of no use.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Fault {
    /// It is not what its study asked for.
    #[error("{0}")]
    Useless(String),
    /// It is what its study asked for, and of no use: the study is to blame.
    #[error("{0}")]
    Poor(String),
    /// Its study cannot be read: nobody is to blame.
    #[error("its study cannot be read: {0}")]
    Unreadable(String),
    /// It claims what is not so, by far more than rounding.
    #[error("{0}")]
    False(String),
}

impl From<String> for Fault {
    fn from(why: String) -> Self {
        Self::Useless(why)
    }
}

/// What is wrong with a claim, a sentence; rounding may explain a small error.
fn differs(claimed: f64, found: f64, why: String) -> Fault {
    if agrees(claimed, found, FALSE, FALSE * 1e-3) { Fault::Useless(why) } else { Fault::False(why) }
}

/// Relative error from which on a claim is false.
const FALSE: f64 = 1e-3;
/// How far a parameter may lie beyond its bounds, in widths of the box.
const BEYOND: f64 = 1e-9;

/// Checks a result against its study.
///
/// # Errors
/// When the study cannot be read.
pub(crate) async fn check(store: &Store, unchecked: Unchecked) -> Result<Result<(), Fault>, StoreError> {
    let row = store.task_row(unchecked.result.job).await.map_err(|error| match error {
        StoreError::Corrupt(why) => StoreError::Corrupt(format!("its specification cannot be read: {why}")),
        error => error,
    })?;
    let faults = |faults: Vec<_>| StoreError::Corrupt(format!("the study is not valid: {faults:?}"));
    let study = resolve::study(&row.spec).map_err(faults)?;
    let body = unchecked.result.body;
    let (spec, ordinal) = (row.spec, row.ordinal);
    match row.role {
        JobRole::Train => {
            let (mut samples, mut after) = (Vec::new(), -1);
            while let Some((more, last)) = store.train_samples_after(row.study, after).await? {
                samples.extend(more);
                after = last;
            }
            beside(move || {
                let claimed: TrainResult = parse_body(body)?;
                Ok(training::check(&Trained { spec: &spec, study: &study, samples: &samples }, &claimed))
            })
            .await
        }
        JobRole::Optimise => {
            let trained = store.training_of(row.study).await?;
            let surrogate = trained.ok_or_else(|| StoreError::Corrupt("a study optimises without a network".into()))?;
            beside(move || {
                let surrogate = network::surrogate(&surrogate.surrogate).map_err(StoreError::Corrupt)?;
                let asked = optimum::Asked::new(&spec, &study, ordinal)?;
                Ok(optimum::check(&asked, &surrogate, &parse_body(body)?))
            })
            .await
        }
        JobRole::Search | JobRole::Generation => {
            let (index, _) = round_of(ordinal);
            let direct = spec.optimisations.get(index as usize).is_some_and(|o| o.is_direct());
            let (state, flown) = store.before_round(row.study, row.role, ordinal, direct).await?;
            beside(move || {
                let asked = optimum::Asked::new(&spec, &study, index)?;
                Ok(round::check(&asked, &state, &flown, &parse_body(body)?))
            })
            .await
        }
        _ => Ok(Ok(())),
    }
}

/// Computes on a thread of its own.
async fn beside(
    check: impl FnOnce() -> Result<Result<(), Fault>, StoreError> + Send + 'static,
) -> Result<Result<(), Fault>, StoreError> {
    tokio::task::spawn_blocking(check).await.map_err(|e| StoreError::Corrupt(e.to_string()))?
}

/// Checks that a point lies inside bounds.
fn inside(bounds: &Bounds, point: &Point) -> Result<(), String> {
    for (i, &value) in point.iter().enumerate() {
        let (lower, upper) = (bounds.lower[i], bounds.upper[i]);
        let slack = BEYOND * (upper - lower).max(lower.abs()).max(1e-3);
        if !(lower - slack..=upper + slack).contains(&value) {
            let name = manduca_numerics::parameters::TABLE[i].name;
            return Err(format!("{name} of {value} is outside the bounds, {lower} to {upper}"));
        }
    }
    Ok(())
}

/// Whether two numbers agree to a relative error, or to an error of `least`.
fn agrees(claimed: f64, found: f64, relative: f64, least: f64) -> bool {
    (claimed - found).abs() <= relative * claimed.abs().max(found.abs()) + least
}
