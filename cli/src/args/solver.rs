//! One option per setting of a solver, made from the solvers' own tables.

use std::collections::BTreeMap;

use clap::{Arg, ArgMatches, Args, Command, Error, FromArgMatches};
use manduca_numerics::table::{Field, Table};
use manduca_numerics::{quasi_steady, uvlm};

/// Settings given on the command line, by their names on the wire.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SolverOptions(pub BTreeMap<String, f64>);

/// The settings of both models with their headings; a name both have is the vortex lattice's.
fn fields() -> impl Iterator<Item = (&'static Field, &'static str)> {
    let lattice = <uvlm::Settings as Table>::FIELDS;
    let blades = <quasi_steady::Settings as Table>::FIELDS;
    let only_blades = blades.iter().filter(|b| lattice.iter().all(|l| l.name != b.name));
    let lattice = lattice.iter().map(|field| (field, "Settings of the vortex lattice"));
    lattice.chain(only_blades.map(|field| (field, "Settings of the blade elements (--model quasi-steady)")))
}

/// What a setting is, its unit, range and default, in one line.
pub fn describe(field: &Field) -> String {
    let unit = if field.unit.is_empty() { String::new() } else { format!(" {}", field.unit) };
    format!("{} [{} to {}{unit}; default: {}]", field.meaning, field.min, field.max, field.default)
}

impl Args for SolverOptions {
    fn augment_args(command: Command) -> Command {
        fields().fold(command, |command, (field, heading)| {
            let option = Arg::new(field.name)
                .long(field.name.replace('_', "-"))
                .value_name(if field.whole { "N" } else { "X" })
                .value_parser(clap::value_parser!(f64))
                .allow_negative_numbers(true)
                .help(describe(field))
                .help_heading(heading);
            command.arg(option)
        })
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for SolverOptions {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let given = |(field, _): (&Field, _)| Some((field.name.to_owned(), *matches.get_one::<f64>(field.name)?));
        Ok(Self(fields().filter_map(given).collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        self.0.extend(Self::from_arg_matches(matches)?.0);
        Ok(())
    }
}
