//! `docs/cli.md`, made of the help itself, so that the two cannot differ.

use std::fmt::Write;
use std::path::Path;

use clap::{Command, CommandFactory};

use super::Cli;

const HEAD: &str = "\
# The command line

What `manduca COMMAND --help` says, command by command, and what holds for all. This page is made of the
help (a test keeps it so; `MANDUCA_WRITE=1 cargo test -p manduca-cli page` writes it anew).

## For all commands

Answers go to standard output, everything else to standard error, so that `manduca ... > file` and
`manduca ... --json | jq` have the answer alone. With `--json` the answer is one JSON object; where several
are fetched as they come (`dataset`), the format says what is written. Numbers in JSON and CSV are read back
as the same numbers. An error says what to do about it.

A study is named by its id, by the end of its id as far as it is the only one, or by `latest`.

| exit code | means |
|---|---|
| 0 | done; a stroke which cannot be flown is an answer, too, as is an optimum which is not in trim (a warning says so), and so is a reader who has read enough (`| head`) |
| 1 | failed: nobody answers, a disk is full, a study ended without what was waited for |
| 2 | refused: the line, a file or a request makes no sense as it stands; nothing was changed |
| 130 | interrupted by Ctrl-C; what was begun elsewhere goes on, and `manduca run` goes on where it was when called again |

A variable which is set to nothing counts as unset.

| variable | is |
|---|---|
| `MANDUCA_COORDINATOR` | address of the coordinator, for `--coordinator` |
| `MANDUCA_TOKEN`, `MANDUCA_TOKEN_FILE` | the token it asks for; a file which has it |
| `MANDUCA_DATA`, `MANDUCA_LISTEN`, `MANDUCA_ALLOW_HOST`, `MANDUCA_KEEP_DAYS` | of `serve` and `run` |
| `MANDUCA_SLOTS`, `MANDUCA_IDLE_EXIT`, `MANDUCA_MAX_RUNTIME`, `MANDUCA_DRAIN_TIMEOUT` | of `worker` |
| `MANDUCA_LOG`, `RUST_LOG`, `MANDUCA_LOG_FORMAT` | which log lines, such as `info,sqlx=warn`; `text` or `json` |
| `NO_COLOR` | not empty: no colours on a terminal |

`manduca completions bash|zsh|fish` prints what makes a shell complete all of this.
";

/// The help of a command and of those below it.
fn add(page: &mut String, command: &mut Command, path: &str) {
    let names: Vec<String> = command
        .get_subcommands()
        .filter(|c| !c.is_hide_set() && c.get_name() != "help")
        .map(|c| c.get_name().to_owned())
        .collect();
    if names.is_empty() {
        let help = command.render_long_help().to_string();
        let help: Vec<&str> = help.lines().map(str::trim_end).collect();
        let _ = write!(page, "\n## {path}\n\n```text\n{}\n```\n", help.join("\n").trim_end());
    }
    for name in names {
        if let Some(below) = command.find_subcommand_mut(&name) {
            add(page, below, &format!("{path} {name}"));
        }
    }
}

fn page() -> String {
    let mut page = HEAD.to_owned();
    // The developer's own settings are not for others to read.
    let mut command = without_environment(Cli::command());
    command.build();
    add(&mut page, &mut command, "manduca");
    page
}

fn without_environment(command: Command) -> Command {
    command.mut_args(|argument| argument.hide_env_values(true)).mut_subcommands(without_environment)
}

#[test]
fn the_page_is_what_the_help_says() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/cli.md");
    let page = page();
    if std::env::var_os("MANDUCA_WRITE").is_some() {
        std::fs::write(&path, &page).unwrap();
    }
    let written = std::fs::read_to_string(&path).unwrap();
    assert!(written == page, "docs/cli.md is not what the help says: MANDUCA_WRITE=1 cargo test -p manduca-cli page");
}
