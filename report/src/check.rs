//! One check: what was expected, what came out, how far apart they may be.

use crate::markdown::{Table, percent, signed, significant};

/// What a number must be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Expected {
    /// This value within a share of it.
    Within {
        /// The value.
        value: f64,
        /// The share.
        share: f64,
    },
    /// This value within an absolute distance.
    Near {
        /// The value.
        value: f64,
        /// The distance.
        distance: f64,
    },
    /// Between two values.
    Between {
        /// The lower one.
        low: f64,
        /// The upper one.
        high: f64,
    },
    /// Of no greater size than this: a quantity which is zero but for rounding.
    Below(f64),
}

/// At which numerical settings a check was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Setup {
    /// Small cores, lattice and step chosen for the check: is the method right?
    Fine,
    /// The default settings on the lattice and with the step the expected value is for: are they right?
    Production,
    /// The default lattice and the step of a hawkmoth's stroke too: what do these cost?
    Flown,
}

impl Setup {
    /// All.
    pub const ALL: [Self; 3] = [Self::Fine, Self::Production, Self::Flown];

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fine => "fine",
            Self::Production => "default",
            Self::Flown => "as flown",
        }
    }
}

/// One number against what it must be.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The quantity and the condition.
    pub what: String,
    /// Where the expected value is from.
    pub source: &'static str,
    /// At which settings.
    pub setup: Setup,
    /// What it must be.
    pub expected: Expected,
    /// What it is.
    pub got: f64,
}

impl Row {
    /// Whether it is what it must be.
    pub fn pass(&self) -> bool {
        match self.expected {
            Expected::Within { value, share } => (self.got / value - 1.0).abs() <= share,
            Expected::Near { value, distance } => (self.got - value).abs() <= distance,
            Expected::Between { low, high } => (low..=high).contains(&self.got),
            Expected::Below(limit) => self.got.abs() <= limit,
        }
    }

    /// How far it is from the expected value, as the tolerance counts it.
    pub fn error(&self) -> f64 {
        match self.expected {
            Expected::Within { value, .. } => self.got / value - 1.0,
            Expected::Near { value, .. } => self.got - value,
            // What is not a number stays none.
            Expected::Between { low, high } if (low..=high).contains(&self.got) => 0.0,
            Expected::Between { low, high } => self.got - if self.got < low { low } else { high },
            Expected::Below(_) => self.got,
        }
    }

    /// Error over tolerance: more than one fails. Not a number counts as infinite.
    pub fn excess(&self) -> f64 {
        // An error begins where a range ends: no error there, and the whole tolerance used.
        let (used, limit) = match self.expected {
            Expected::Within { share, .. } => (0.0, share),
            Expected::Near { distance, .. } => (0.0, distance),
            Expected::Between { low, high } => (1.0, high - low),
            Expected::Below(limit) => (0.0, limit),
        };
        let excess = used + self.error().abs() / limit;
        if excess.is_nan() { f64::INFINITY } else { excess }
    }

    /// Expected value and tolerance as text.
    pub fn wanted(&self) -> [String; 2] {
        match self.expected {
            Expected::Within { value, share } => {
                [significant(value, 4), format!("{} %", (1e4 * share).round() / 100.0)]
            }
            Expected::Near { value, distance } => [significant(value, 4), significant(distance, 1)],
            Expected::Between { low, high } => {
                [format!("{} to {}", significant(low, 3), significant(high, 3)), "inside".to_owned()]
            }
            Expected::Below(limit) => ["0".to_owned(), significant(limit, 1)],
        }
    }

    /// Value, error and verdict as text.
    pub fn found(&self) -> [String; 3] {
        let off = match self.expected {
            Expected::Within { .. } => percent(self.error(), 1),
            Expected::Near { distance, .. } if distance >= 0.1 => signed(self.error(), 1),
            Expected::Near { .. } => significant(self.error(), 1),
            Expected::Between { .. } if self.error() == 0.0 => "inside".to_owned(),
            Expected::Between { .. } => signed(self.error(), 2),
            Expected::Below(_) => String::new(),
        };
        let digits = if matches!(self.expected, Expected::Below(_)) { 1 } else { 4 };
        [significant(self.got, digits), off, if self.pass() { "yes" } else { "**no**" }.to_owned()]
    }
}

/// Checks of one kind.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Name.
    pub title: &'static str,
    /// What is done and why, for the document.
    pub about: String,
    /// The checks.
    pub rows: Vec<Row>,
}

impl Group {
    /// As a table, a line for each quantity, the settings beside each other.
    pub fn table(&self) -> Table {
        let made = |setup: &Setup| self.rows.iter().any(|r| r.setup == *setup);
        let setups: Vec<_> = Setup::ALL.into_iter().filter(made).collect();
        let mut header = vec!["", "expected", "within"];
        header.extend(setups.iter().flat_map(|setup| [setup.name(), "off by", "pass"]));
        let mut table = Table::new(header);
        let mut told: Vec<&str> = Vec::new();
        for row in &self.rows {
            if told.contains(&row.what.as_str()) {
                continue;
            }
            told.push(&row.what);
            let alike = |setup: &Setup| self.rows.iter().find(|r| r.what == row.what && r.setup == *setup);
            let [expected, mut within] = row.wanted();
            for other in setups.iter().filter_map(alike).filter(|r| r.wanted() != row.wanted()) {
                within.push_str(&format!("; {} {}", other.setup.name(), other.wanted()[1]));
            }
            let mut cells = vec![row.what.clone(), expected, within];
            for setup in &setups {
                let found = alike(setup);
                cells.extend(found.map_or([String::new(), String::new(), String::new()], Row::found));
            }
            table.row(cells);
        }
        table
    }

    /// Where the expected values are from, each once.
    pub fn sources(&self) -> Vec<&'static str> {
        let mut sources = Vec::new();
        for row in &self.rows {
            if !row.source.is_empty() && !sources.contains(&row.source) {
                sources.push(row.source);
            }
        }
        sources
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(expected: Expected, got: f64) -> Row {
        Row { what: "x".into(), source: "book", setup: Setup::Fine, expected, got }
    }

    #[test]
    fn a_number_passes_only_inside_its_tolerance() {
        let within = Expected::Within { value: 2.0, share: 0.01 };
        let near = Expected::Near { value: 0.0, distance: 3.0 };
        let between = Expected::Between { low: 19.3, high: 22.5 };
        let good = [(within, 2.019), (near, -2.9), (between, 19.3), (Expected::Below(1e-9), -1e-9)];
        let bad = [(within, 1.979), (near, 3.1), (between, 22.6), (Expected::Below(1e-9), 2e-9)];
        assert!(good.iter().all(|(e, got)| row(*e, *got).pass()));
        assert!(bad.iter().all(|(e, got)| !row(*e, *got).pass()));
        for expected in [within, near, between, Expected::Below(1.0)] {
            let lost = row(expected, f64::NAN);
            assert!(!lost.pass() && lost.error().is_nan() && lost.excess() == f64::INFINITY, "{expected:?}");
        }
    }

    #[test]
    fn a_table_has_the_settings_side_by_side() {
        let expected = Expected::Within { value: 2.0, share: 0.01 };
        let (fine, bad) = (row(expected, 2.0), Row { setup: Setup::Production, ..row(expected, 2.1) });
        let other = Row { what: "y".into(), ..row(Expected::Below(1e-8), 3e-12) };
        let looser = Row { setup: Setup::Production, ..row(Expected::Below(1e-6), 2e-7) };
        let looser = Row { what: "y".into(), ..looser };
        let group = Group { title: "t", about: String::new(), rows: vec![fine, other, bad, looser] };
        assert_eq!(group.sources(), ["book"]);
        assert!(!group.table().to_string().contains(Setup::Flown.name()), "no check was made at these");
        let lines: Vec<_> = group.table().to_string().lines().skip(2).map(str::to_owned).collect();
        let both = "| x | 2.000 | 1 % | 2.000 | 0.0 % | yes | 2.100 | +5.0 % | **no** |";
        assert_eq!(lines, [both, "| y | 0 | 1e-8; default 1e-6 | 3e-12 |  | yes | 2e-7 |  | yes |"]);
    }
}
