//! Environment variables beside options.

use std::ffi::OsStr;

use clap::builder::Resettable;
use clap::{Command, CommandFactory, FromArgMatches};

use super::Cli;

/// The command line of this process. A variable which is set to nothing counts as unset: compose files and batch
/// scripts pass such on.
pub fn parse() -> Cli {
    let empty = |name: &OsStr| std::env::var_os(name).is_some_and(|value| value.is_empty());
    let matches = without(Cli::command(), &empty).get_matches();
    Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}

/// The command without those of its variables which are empty, and so its subcommands.
fn without(command: Command, empty: &dyn Fn(&OsStr) -> bool) -> Command {
    let command = command.mut_args(|arg| match arg.get_env() {
        Some(name) if empty(name) => arg.env(Resettable::Reset),
        _ => arg,
    });
    let names: Vec<String> = command.get_subcommands().map(|c| c.get_name().to_owned()).collect();
    names.into_iter().fold(command, |command, name| command.mut_subcommand(name, |c| without(c, empty)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Variables of the command and all below it.
    fn variables(command: &Command) -> Vec<String> {
        let own = command.get_arguments().filter_map(|a| a.get_env()).map(|name| name.to_string_lossy().into_owned());
        own.chain(command.get_subcommands().flat_map(variables)).collect()
    }

    #[test]
    fn every_empty_variable_is_forgotten_and_no_other() {
        let all = variables(&Cli::command());
        for name in ["MANDUCA_DATA", "MANDUCA_KEEP_DAYS", "MANDUCA_SLOTS", "MANDUCA_COORDINATOR", "MANDUCA_LOG_FORMAT"]
        {
            assert!(all.iter().any(|known| known == name), "{name}");
        }
        assert_eq!(variables(&without(Cli::command(), &|_| true)), [""; 0]);
        assert_eq!(variables(&without(Cli::command(), &|_| false)), all);
        let data = |name: &OsStr| name == "MANDUCA_DATA";
        let left = variables(&without(Cli::command(), &data));
        assert!(!left.contains(&"MANDUCA_DATA".to_owned()) && left.contains(&"MANDUCA_LISTEN".to_owned()));
    }
}
