//! Where the `manduca` program is, built when it is missing or older than its sources.

use std::env;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::time::SystemTime;

/// Folders and files the program is made of.
const SOURCES: [&str; 11] = [
    "Cargo.toml",
    "Cargo.lock",
    "cli/src",
    "cli/Cargo.toml",
    "numerics/src",
    "protocol/src",
    "server/assets",
    "server/src",
    "worker/src",
    "migrations",
    "studies",
];

/// Root of the repository.
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package lies in the repository").to_owned()
}

/// The program under test: that of `MANDUCA_BIN`, or the one beside this test.
///
/// `cargo test --workspace` has built it already; cargo tells only the tests of
/// its own package where. Asking cargo for it in every test process would cost
/// more than it is worth, so cargo is asked only when some source is newer.
pub fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        if let Some(given) = env::var_os("MANDUCA_BIN") {
            return given.into();
        }
        let folder = profile_folder();
        let program = folder.join(format!("manduca{}", env::consts::EXE_SUFFIX));
        if !is_fresh(&program) {
            build(&folder);
        }
        assert!(program.exists(), "cargo has not made {}", program.display());
        program
    })
}

/// `target/<profile>`: this test lies in its `deps`.
fn profile_folder() -> PathBuf {
    let test = env::current_exe().expect("a running test is a file");
    let deps = test.parent().expect("a file lies in a folder");
    deps.parent().filter(|_| deps.ends_with("deps")).unwrap_or(deps).to_owned()
}

fn is_fresh(program: &Path) -> bool {
    let Some(made) = modified(program) else { return false };
    SOURCES.iter().all(|source| newest(&repository().join(source)).is_none_or(|changed| changed <= made))
}

fn modified(path: &Path) -> Option<SystemTime> {
    fs::metadata(path).and_then(|metadata| metadata.modified()).ok()
}

/// The last change of a file, or of any file below a folder.
fn newest(path: &Path) -> Option<SystemTime> {
    match fs::read_dir(path) {
        Ok(entries) => entries.flatten().filter_map(|entry| newest(&entry.path())).max(),
        Err(_) => modified(path),
    }
}

/// Builds the program into the folder this test was built into. Cargo does not
/// hold its lock while tests run, and its lock lets one of several tests build.
fn build(folder: &Path) {
    let profile = match folder.file_name().and_then(|name| name.to_str()) {
        Some("debug") | None => "dev",
        Some(name) => name,
    };
    let target = folder.parent().expect("a profile lies in the target folder");
    let cargo = env::var_os("CARGO").unwrap_or_else(|| OsString::from(env!("CARGO")));
    let status = Command::new(cargo)
        .args(["build", "--quiet", "--package", "manduca-cli", "--bin", "manduca", "--profile", profile])
        .arg("--target-dir")
        .arg(target)
        .current_dir(repository())
        .stdin(Stdio::null())
        .status()
        .expect("cargo can be started");
    assert!(status.success(), "the program under test does not build");
}

/// A command which starts the program, whatever the developer's environment says.
pub fn manduca(arguments: &[&str]) -> Command {
    let mut command = Command::new(program());
    command.args(arguments);
    unaffected(command)
}

/// [`manduca`] with so much address space, bytes.
pub fn manduca_within(space: u64, arguments: &[&str]) -> Command {
    // The shell makes way for the program, which keeps its process id and its limit.
    let mut command = Command::new("sh");
    let limit = format!("ulimit -v {} && exec \"$0\" \"$@\"", space >> 10);
    command.args(["-c", &limit]).arg(program()).args(arguments);
    unaffected(command)
}

/// A command without what the developer's environment says.
fn unaffected(mut command: Command) -> Command {
    command.stdin(Stdio::null());
    for (name, _) in env::vars_os() {
        let text = name.to_string_lossy();
        if text.starts_with("MANDUCA_") || text == "RUST_LOG" || text.eq_ignore_ascii_case("http_proxy") {
            command.env_remove(&name);
        }
    }
    command
}
