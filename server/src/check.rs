//! A study is checked: by a submission, by a dry run, and by a program which
//! links this one, all by the same rules.

use manduca_numerics::parameters::Point;
use manduca_protocol::problem::FieldProblem;
use manduca_protocol::resolve::{self, ResolvedStudy};
use manduca_protocol::study::StudySpec;

use crate::config::RunLimits;
use crate::draw::{Drawn, draw_all};
use crate::effort;

/// A study which would be accepted.
#[derive(Debug, Clone)]
pub struct Checked {
    /// Its settings, every default filled in.
    pub resolved: ResolvedStudy,
    pub(crate) drawn: Vec<Drawn>,
}

impl Checked {
    /// The strokes of its samples, by index.
    pub fn strokes(&self) -> impl ExactSizeIterator<Item = &Point> {
        self.drawn.iter().map(|drawn| &drawn.point)
    }

    /// Simulations it would queue: the samples, each optimum once more, and what generations
    /// ask for at most; not what refining will.
    pub fn simulations(&self) -> u64 {
        (self.drawn.len() + self.resolved.optimisations.len()) as u64 + self.individuals()
    }

    /// Strokes which generations ask for at most.
    pub fn individuals(&self) -> u64 {
        self.resolved.optimisations.iter().map(|o| o.individuals() as u64).sum()
    }
}

/// Checks a study, what it costs beside what jobs may cost here, and draws its samples. Thousands of strokes are looked
/// at: not for a thread which serves.
///
/// # Errors
/// Every fault with its JSON pointer.
pub fn check(spec: &StudySpec, limits: &RunLimits) -> Result<Checked, Vec<FieldProblem>> {
    let (faults, resolved) = (resolve::texts(spec), resolve::study(spec));
    let resolved = match (resolved, faults.is_empty()) {
        (Ok(resolved), true) => resolved,
        (resolved, _) => return Err(faults.into_iter().chain(resolved.err().unwrap_or_default()).collect()),
    };
    let endless = effort::endless(spec, &resolved, limits);
    if !endless.is_empty() {
        return Err(endless);
    }
    let drawn = draw_all(spec, &resolved).map_err(|fault| vec![fault])?;
    Ok(Checked { resolved, drawn })
}
