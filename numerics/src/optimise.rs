//! Search for the stroke which flies at least power.
//!
//! [`Problem`] turns a surrogate into the fitness of the paper's Eq. 8; [`Ga`]
//! and [`NelderMead`] are asked for points and told fitnesses, so they know
//! nothing of networks or threads; [`optimise`] drives one after the other. [`sqp`]
//! needs derivatives and finds the constrained optimum itself.

pub mod analysis;
mod breed;
pub mod direct;
mod drive;
mod genetic;
mod problem;
mod simplex;
pub mod sobol;
pub mod sqp;
#[cfg(test)]
mod tests;

pub use drive::{Optimum, Phase, Progress, optimise};
pub use genetic::{Ga, GaSettings, GaSnapshot, GaStop, Generation};
pub use problem::{Clearances, Fitness, Predict, Problem, Score};
pub use simplex::{NelderMead, SimplexSettings, SimplexStop};

/// Why there is nothing to optimise.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OptimiseError {
    /// The bounds are not finite and in order.
    #[error("bounds of parameter {index} are not finite and in order")]
    Bounds {
        /// Place in the parameter table.
        index: usize,
    },
    /// Every parameter is held.
    #[error("every parameter is held")]
    NothingFree,
    /// A setting is out of range.
    #[error("{setting} is {value}; it must be {range}")]
    Setting {
        /// Name of the setting.
        setting: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        range: &'static str,
    },
    /// The number of fitnesses told is not the number of points asked.
    #[error("told {told} fitnesses for {asked} points")]
    Told {
        /// Points asked.
        asked: usize,
        /// Fitnesses told.
        told: usize,
    },
    /// A stored state of a search is not one of this search.
    #[error("the stored state does not fit the search: {0}")]
    Snapshot(&'static str),
    /// No descent reached an optimum.
    #[error("none of {starts} descents reached an optimum within the constraints")]
    NothingConverged {
        /// Descents begun.
        starts: usize,
    },
    /// No point met had a finite fitness.
    #[error("no point has a finite fitness")]
    NothingFinite,
}

/// Refuses a setting outside its range; NaN is outside every range.
fn check(
    setting: &'static str,
    value: f64,
    range: std::ops::RangeInclusive<f64>,
    words: &'static str,
) -> Result<(), OptimiseError> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(OptimiseError::Setting { setting, value, range: words })
}

/// The free parameters of sound bounds.
fn free(bounds: &crate::parameters::Bounds) -> Result<Vec<usize>, OptimiseError> {
    if let Some(index) = crate::surrogate::bad_bounds(bounds) {
        return Err(OptimiseError::Bounds { index });
    }
    let free: Vec<usize> = (0..crate::parameters::COUNT).filter(|&i| !bounds.is_held(i)).collect();
    if free.is_empty() { Err(OptimiseError::NothingFree) } else { Ok(free) }
}

/// The point of the box nearest to `x`; a held parameter takes its held value.
pub fn clamped(bounds: &crate::parameters::Bounds, x: &crate::parameters::Point) -> crate::parameters::Point {
    // Not `f64::clamp`, which panics where bounds are out of order; NaN stays
    // NaN, so that it cannot pass for a sound point.
    std::array::from_fn(|i| {
        if x[i] < bounds.lower[i] || bounds.is_held(i) {
            bounds.lower[i]
        } else if x[i] > bounds.upper[i] {
            bounds.upper[i]
        } else {
            x[i]
        }
    })
}
