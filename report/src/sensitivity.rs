//! What the means of the published strokes are sensitive to.

use manduca_numerics::cases::{CASES, Case};
use manduca_numerics::kinematics::ElevationPhase;
use manduca_numerics::simulation::{Infeasible, Means};
use manduca_numerics::table::Table as _;
use manduca_numerics::uvlm::Settings;

use crate::flights::{Flight, fly_all};
use crate::markdown::{Table, fixed, percent, signed};

/// A change to a flight at the default settings.
#[derive(Debug, Clone)]
pub struct Variation {
    /// What is changed, for people.
    pub name: String,
    change: Change,
}

/// What may be changed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Change {
    /// Nothing.
    Nothing,
    /// Share of the leading-edge suction turned into lift.
    SuctionToLift(f64),
    /// All suction stays in the wing's plane.
    SuctionInPlane,
    /// Area by mean chord at the same length, times.
    Area(f64),
    /// All cores, times.
    Cores(f64),
    /// Feathering axis, chords behind the leading edge.
    Axis(f64),
    /// Distance of the hinges from the plane of symmetry, m.
    Hinge(f64),
    /// Sign of the elevation's second harmonic.
    Elevation(ElevationPhase),
}

impl Change {
    /// The flight with this change.
    pub fn of(self, mut flight: Flight) -> Flight {
        match self {
            Self::Nothing => {}
            Self::SuctionToLift(share) => flight.settings.suction_to_lift = share,
            Self::SuctionInPlane => {
                (flight.settings.suction_to_lift, flight.settings.suction_in_plane) = (0.0, 1.0);
            }
            Self::Area(factor) => flight.insect.mean_chord_m *= factor,
            Self::Cores(factor) => flight.settings = with_cores(flight.settings, factor),
            Self::Axis(share) => flight.insect.feathering_axis = share,
            Self::Hinge(offset) => flight.insect.hinge_offset_m = offset,
            Self::Elevation(phase) => flight.elevation_phase = phase,
        }
        flight
    }
}

/// All cores times a factor, within what is accepted.
fn with_cores(mut settings: Settings, factor: f64) -> Settings {
    for field in Settings::FIELDS.iter().filter(|f| f.unit == "c" && f.name.contains("core")) {
        let value = settings.get(field.name).unwrap_or(field.default) * factor;
        // The value is inside the field's range.
        let _ = settings.set(field.name, value.clamp(field.min, field.max));
    }
    settings
}

/// The changes in order of the document; the first is none.
pub fn variations() -> Vec<Variation> {
    let variation = |name: String, change| Variation { name, change };
    let mut all = vec![variation("none".into(), Change::Nothing)];
    for share in [0.0, 0.25, 0.5, 1.0] {
        all.push(variation(format!("suction_to_lift {share}"), Change::SuctionToLift(share)));
    }
    all.push(variation("all suction in the wing's plane".into(), Change::SuctionInPlane));
    for (factor, name) in [(0.9, "area - 10 %"), (1.1, "area + 10 %")] {
        all.push(variation(name.into(), Change::Area(factor)));
    }
    for (factor, name) in [(0.5, "all cores x 0.5"), (2.0, "all cores x 2")] {
        all.push(variation(name.into(), Change::Cores(factor)));
    }
    for share in [0.22, 0.25, 0.3, 0.32] {
        all.push(variation(format!("feathering axis {share:.2} c"), Change::Axis(share)));
    }
    for millimetres in [6.0, 8.0, 10.0] {
        all.push(variation(format!("hinges {millimetres} mm off"), Change::Hinge(millimetres / 1e3)));
    }
    all.push(variation("elevation sign -".into(), Change::Elevation(ElevationPhase::Minus)));
    all
}

/// Answers of one variation, case by case.
#[derive(Debug, Clone)]
pub struct Answer {
    /// The variation.
    pub variation: Variation,
    /// Means of each case, none where it cannot be flown.
    pub means: Vec<Result<Means, Infeasible>>,
}

/// All variations of all published strokes.
#[derive(Debug, Clone)]
pub struct Study {
    cases: &'static [Case],
    answers: Vec<Answer>,
}

/// Mean, least and greatest of a quantity over the cases that fly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Least.
    pub low: f64,
    /// Greatest.
    pub high: f64,
    /// How many fly.
    pub count: usize,
}

/// Quantities of the tables.
type Quantity = fn(&Means) -> f64;
const QUANTITIES: [Quantity; 5] =
    [|m| m.scaled[0].mean, |m| m.scaled[1].mean, |m| m.scaled[2].mean, |m| m.scaled[3].mean, Means::power_per_lift];

impl Study {
    /// Flies everything, each change made to these settings.
    pub fn fly(settings: Settings) -> Self {
        Self::of(&CASES, &variations(), |case| Flight { settings, ..Flight::of_case(case) })
    }

    fn of(cases: &'static [Case], variations: &[Variation], base: impl Fn(&Case) -> Flight) -> Self {
        let flights: Vec<_> =
            variations.iter().flat_map(|v| cases.iter().map(|case| v.change.of(base(case)))).collect();
        let means = fly_all(&flights);
        let answers = variations.iter().zip(means.chunks(cases.len()));
        let answers =
            answers.map(|(variation, means)| Answer { variation: variation.clone(), means: means.to_vec() }).collect();
        Self { cases, answers }
    }

    /// The answer to a change.
    pub fn answer(&self, change: Change) -> Option<&Answer> {
        self.answers.iter().find(|a| a.variation.change == change)
    }

    /// Change of a quantity, in order of [`QUANTITIES`], against no change; of the last one relative.
    fn change(&self, answer: &Answer, quantity: usize) -> Spread {
        let of = QUANTITIES[quantity];
        let pairs = self.answers[0].means.iter().zip(&answer.means);
        let changes = pairs.filter_map(|(base, other)| match (base, other) {
            (Ok(base), Ok(other)) if quantity == 4 => Some(of(other) / of(base) - 1.0),
            (Ok(base), Ok(other)) => Some(of(other) - of(base)),
            _ => None,
        });
        spread(&changes.collect::<Vec<_>>())
    }

    /// Change of L+ for a change; nothing flies: NaN.
    pub fn lift_change(&self, change: Change) -> f64 {
        self.answer(change).map_or(f64::NAN, |answer| self.change(answer, 0).mean)
    }

    /// Greatest change of P/L of any stroke for a change, relative; nothing flies: NaN.
    pub fn power_per_lift_change(&self, change: Change) -> f64 {
        let spread = self.answer(change).map(|answer| self.change(answer, 4)).filter(|s| s.count > 0);
        spread.map_or(f64::NAN, |s| s.low.abs().max(s.high.abs()))
    }

    /// Changes as mean over the cases, with least and greatest.
    pub fn changes(&self) -> Table {
        let mut table = Table::new(["change", "L+", "D+", "M+", "P+", "P/L"]);
        for answer in &self.answers[1..] {
            let mut cells = vec![answer.variation.name.clone()];
            cells.extend((0..QUANTITIES.len()).map(|quantity| {
                let text = |x: f64| if quantity == 4 { percent(x, 1) } else { signed(x, 3) };
                let s = self.change(answer, quantity);
                if s.count == 0 {
                    return "-".to_owned();
                }
                format!("{} ({} to {})", text(s.mean), text(s.low), text(s.high))
            }));
            table.row(cells);
        }
        table
    }

    /// L+ and P/L of each case.
    pub fn by_case(&self) -> Table {
        let mut header = vec!["change".to_owned()];
        header.extend(self.cases.iter().map(|case| format!("{}: L+, P/L", case.name)));
        let mut table = Table::new(header);
        for answer in &self.answers {
            let mut cells = vec![answer.variation.name.clone()];
            cells.extend(answer.means.iter().map(|means| match means {
                Ok(means) => format!("{}, {}", fixed(means.scaled[0].mean, 3), fixed(means.power_per_lift(), 2)),
                Err(Infeasible::Collision { .. }) => "collide".to_owned(),
                Err(Infeasible::BlowUp { .. } | Infeasible::Beyond { .. }) => "blows up".to_owned(),
            }));
            table.row(cells);
        }
        table
    }
}

fn spread(values: &[f64]) -> Spread {
    let n = values.len();
    Spread {
        mean: values.iter().sum::<f64>() / n as f64,
        low: values.iter().copied().fold(f64::INFINITY, f64::min),
        high: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        count: n,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn coarse(case: &Case) -> Flight {
        let settings = Settings {
            chordwise_panels: 4,
            spanwise_panels: 6,
            steps_per_stroke: 24,
            strokes: 3,
            strokes_most: 3,
            strokes_dropped: 1,
            ..Settings::default()
        };
        Flight { settings, ..Flight::of_case(case) }
    }

    #[test]
    fn each_change_changes_what_it_names() {
        let flight = Flight::of_case(&CASES[0]);
        for variation in &variations() {
            let changed = variation.change.of(flight);
            let is_default = match variation.change {
                Change::Nothing => true,
                Change::SuctionToLift(share) => share == flight.settings.suction_to_lift,
                Change::Hinge(offset) => offset == flight.insect.hinge_offset_m,
                Change::Axis(share) => share == flight.insect.feathering_axis,
                _ => false,
            };
            assert_eq!(changed == flight, is_default, "{}", variation.name);
        }
        let doubled = with_cores(Settings::default(), 2.0);
        assert_eq!(doubled.bound_core, 2.0 * Settings::default().bound_core);
        assert_eq!(doubled.core_growth_time, Settings::default().core_growth_time);
    }

    /// Suction and area lift, in proportion; what cannot fly is said to collide.
    #[test]
    fn changes_have_their_directions() {
        let changes = [
            ("none", Change::Nothing),
            ("no suction", Change::SuctionToLift(0.0)),
            ("all suction", Change::SuctionToLift(1.0)),
            ("area", Change::Area(1.1)),
            ("hinge", Change::Hinge(-0.02)),
        ];
        let variations: Vec<_> =
            changes.iter().map(|(name, change)| Variation { name: (*name).into(), change: *change }).collect();
        let study = Study::of(&CASES, &variations, coarse);
        let lift = |i: usize| study.lift_change(changes[i].1);
        assert_eq!(lift(0), 0.0);
        assert!(lift(1) < -0.02 && lift(2) > 0.02 && lift(3) > 0.02, "{} {} {}", lift(1), lift(2), lift(3));
        assert!(lift(4).is_nan());
        let text = study.by_case().to_string();
        assert!(text.contains("| hinge | collide | collide"), "{text}");
        assert_eq!(study.changes().to_string().lines().count(), 2 + 4);
    }
}
