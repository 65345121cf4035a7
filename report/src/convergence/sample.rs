//! The strokes on which settings are compared.

use std::io;

use manduca_numerics::cases::CASES;
use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::{Clearance, ElevationPhase};
use manduca_numerics::parameters::{Bounds, Point};
use manduca_numerics::sampling::sample;
use manduca_numerics::simulation::Means;
use manduca_numerics::uvlm::Settings;

use crate::flights::fly_all;

/// Seed of the random strokes.
pub const SEED: u64 = 5;

/// Named strokes.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Names and parameters.
    pub strokes: Vec<(String, Point)>,
}

/// Means of every stroke of a sample; none where it has none.
pub type Flown = Vec<Option<Means>>;

/// How two sets of means differ, L+, D+, M+, P+.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Difference {
    /// Strokes which have means in both.
    pub strokes: usize,
    /// Root mean square.
    pub rms: [f64; 4],
    /// Mean.
    pub mean: [f64; 4],
    /// Root mean square of the change over the larger of 1 and the value.
    pub relative: [f64; 4],
}

/// A feasible random stroke of the design box.
///
/// # Errors
/// When too few are feasible.
pub fn random(seed: u64, index: u64) -> io::Result<Point> {
    let clearance = Clearance::new(&Insect::default(), ElevationPhase::default());
    sample(&Bounds::default(), seed, index, &|x| clearance.of(x) >= 0.0)
        .ok_or_else(|| io::Error::other("too few strokes of the design box are feasible"))
}

impl Sample {
    /// The published strokes and so many random ones.
    ///
    /// # Errors
    /// When too few strokes of the design box are feasible.
    pub fn new(count: u64) -> io::Result<Self> {
        let mut strokes: Vec<_> = CASES.iter().map(|case| (case.name.to_owned(), case.parameters)).collect();
        for index in 0..count {
            strokes.push((format!("random {index}"), random(SEED, index)?));
        }
        Ok(Self { strokes })
    }

    /// Flies all of it.
    pub fn fly(&self, settings: Settings) -> Flown {
        let flights: Vec<_> = self.strokes.iter().map(|(_, x)| super::flight(x, settings)).collect();
        fly_all(&flights).into_iter().map(Result::ok).collect()
    }
}

/// How `b` differs from `a`.
pub fn difference(a: &Flown, b: &Flown) -> Difference {
    let pairs: Vec<_> = a.iter().zip(b).filter_map(|(a, b)| Some((a.as_ref()?, b.as_ref()?))).collect();
    let n = pairs.len().max(1) as f64;
    let over = |f: &dyn Fn(f64, f64) -> f64| -> [f64; 4] {
        std::array::from_fn(|k| pairs.iter().map(|(a, b)| f(a.scaled[k].mean, b.scaled[k].mean)).sum::<f64>() / n)
    };
    Difference {
        strokes: pairs.len(),
        rms: over(&|a, b| (b - a).powi(2)).map(f64::sqrt),
        mean: over(&|a, b| b - a),
        relative: over(&|a, b| ((b - a) / a.abs().max(1.0)).powi(2)).map(f64::sqrt),
    }
}

/// The share `q` of values in order: 0.5 the median.
pub fn quantile(values: impl IntoIterator<Item = f64>, q: f64) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let place = (q * (values.len().max(1) - 1) as f64).round() as usize;
    values.get(place).copied().unwrap_or(f64::NAN)
}

/// Settings which fly in no time, for tests.
#[cfg(test)]
pub(super) fn coarse() -> Settings {
    Settings {
        chordwise_panels: 2,
        spanwise_panels: 4,
        steps_per_stroke: 12,
        strokes: 2,
        strokes_most: 2,
        strokes_dropped: 1,
        ..Settings::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_those_of_the_means() {
        let settings = coarse();
        let sample = Sample::new(1).unwrap();
        assert_eq!(sample.strokes.len(), CASES.len() + 1);
        let flown = sample.fly(settings);
        assert_eq!(difference(&flown, &flown).rms, [0.0; 4]);
        let other = sample.fly(Settings { suction_to_lift: 0.0, ..settings });
        let difference = difference(&flown, &other);
        assert!(difference.strokes == sample.strokes.len() && difference.mean[0] < 0.0);
        assert!(difference.rms[0] >= difference.mean[0].abs() && difference.relative[0] <= difference.rms[0]);
        assert_eq!(quantile([3.0, 1.0, 2.0], 0.5), 2.0);
    }
}
