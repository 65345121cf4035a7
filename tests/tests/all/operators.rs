//! What operators see, and what becomes of their files.

// Several starts on one folder.
#[path = "operators/hold.rs"]
mod hold;
// Files written, read, removed.
#[path = "operators/files.rs"]
mod files;
// A clock far ahead.
#[path = "operators/clock.rs"]
mod clock;
// Databases which cannot be opened, or only be read.
#[path = "operators/looks.rs"]
mod looks;
// Log lines which cannot be written.
#[path = "operators/log.rs"]
mod log;

use std::fs;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Output};

use manduca_tests::program::manduca;
use manduca_tests::studies::blades;
use serde_json::Value;

/// The user nobody, on every Linux.
const NOBODY: u32 = 65_534;

/// Runs the program to its end.
fn outcome(arguments: &[&str]) -> Output {
    manduca(arguments).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A study file; a study of blade elements is done within a second or two.
fn study_file(folder: &Path, name: &str, seed: u64, samples: u32) -> String {
    write_study(folder, name, &blades(name, seed, samples))
}

fn write_study(folder: &Path, name: &str, study: &Value) -> String {
    let file = folder.join(format!("{name}.json"));
    fs::write(&file, study.to_string()).unwrap();
    file.to_str().unwrap().to_owned()
}

/// Makes a command that of another user, where this one may do that; tells whether a file mode binds it.
fn as_nobody(command: &mut Command) -> bool {
    if !is_root() {
        return false;
    }
    command.uid(NOBODY).gid(NOBODY);
    true
}

fn is_root() -> bool {
    use std::os::unix::fs::MetadataExt;
    fs::metadata("/proc/self").unwrap().uid() == 0
}
