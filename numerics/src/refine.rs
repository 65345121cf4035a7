//! From the optimum of a surrogate to one which the simulation confirms.
//!
//! A surrogate is wrong at its own optimum: that is where its errors look like
//! gains. Around the optimum new strokes are flown, their residuals learnt
//! ([`Kriging`]), and the optimum sought again on the corrected surrogate within a
//! trust region, until prediction and simulation agree. [`step`] is one round and
//! knows nothing of queues: strokes flown go in, strokes to fly come out.

mod kriging;
mod local;
mod region;
#[cfg(test)]
mod tests;

pub use kriging::Kriging;
pub use local::Local;
pub use region::{
    Flown, Minimise, Minimum, Next, RefineSettings, RefineStop, Region, Tools, merit, off_trim, step, trimmed_power,
};
