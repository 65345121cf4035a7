//! Rules of the house which no compiler checks.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use manduca_protocol::{resolve, study::StudySpec};
use manduca_tests::program::repository;

/// Longest source file, lines: about 400 are meant.
const LONGEST_FILE: usize = 450;

/// Crates a package must not reach, not even through others.
const FORBIDDEN: [(&str, &[&str]); 5] = [
    ("manduca-numerics", &["tokio", "axum", "sqlx", "serde", "serde_json", "tracing", "reqwest", "manduca-protocol"]),
    ("manduca-protocol", &["tokio", "axum", "sqlx", "reqwest", "manduca-server", "manduca-worker"]),
    ("manduca-report", &["tokio", "axum", "sqlx", "serde", "tracing", "reqwest", "clap", "manduca-protocol"]),
    ("manduca-worker", &["sqlx", "axum", "libsqlite3-sys", "manduca-server"]),
    ("manduca-server", &["reqwest", "clap", "manduca-worker"]),
];

/// Words which must not be in any source; written in parts, since this file is one.
const UNFINISHED: [&str; 4] =
    [concat!("TO", "DO"), concat!("FIX", "ME"), concat!("todo", "!("), concat!("unimple", "mented!(")];
const OF_A_MACHINE: [&str; 4] =
    [concat!("/ro", "ot/"), concat!("/ho", "me/"), concat!("/Us", "ers/"), concat!("/wo", "rk/")];

/// The repository's own files, by paths relative to its root.
fn files() -> Vec<PathBuf> {
    let root = repository();
    let listed = Command::new("git")
        .args(["ls-files", "--cached", "--others", "--exclude-standard", "-z"])
        .current_dir(&root)
        .output();
    let mut files = match listed {
        Ok(output) if output.status.success() => {
            String::from_utf8(output.stdout).unwrap().split_terminator('\0').map(PathBuf::from).collect()
        }
        // Not a clone, or no git: everything there is, but what is made.
        _ => walk(&root).iter().map(|path| path.strip_prefix(&root).unwrap().to_owned()).collect::<Vec<_>>(),
    };
    // A file deleted but not yet committed is still listed.
    files.retain(|path| root.join(path).is_file());
    assert!(files.len() > 100, "only {} files found", files.len());
    files
}

fn walk(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') || name == "target" || name == "manduca-data" {
            continue;
        }
        if entry.file_type().unwrap().is_dir() { found.extend(walk(&entry.path())) } else { found.push(entry.path()) }
    }
    found
}

/// Files with one of these endings, with their text.
fn texts(endings: &[&str]) -> Vec<(PathBuf, String)> {
    let wanted = |path: &Path| path.extension().is_some_and(|e| endings.iter().any(|ending| e == *ending));
    let files = files().into_iter().filter(|path| wanted(path));
    files.map(|path| (path.clone(), fs::read_to_string(repository().join(&path)).unwrap())).collect()
}

/// `path:line: text` of every line of these files which breaks a rule.
fn breaches(files: &[(PathBuf, String)], breaks: impl Fn(&Path, &str) -> bool) -> Vec<String> {
    let lines = files.iter().flat_map(|(path, text)| text.lines().enumerate().map(move |(i, line)| (path, i, line)));
    let broken = lines.filter(|(path, _, line)| breaks(path, line));
    broken.map(|(path, i, line)| format!("{}:{}: {}", path.display(), i + 1, line.trim())).collect()
}

fn assert_none(breaches: &[String]) {
    assert!(breaches.is_empty(), "\n{}", breaches.join("\n"));
}

/// A line of Rust without its comment.
fn code(line: &str) -> &str {
    line.split("//").next().unwrap_or_default()
}

#[test]
fn no_source_file_is_too_long() {
    let long: Vec<_> = texts(&["rs"])
        .iter()
        .map(|(path, text)| (path, text.lines().count()))
        .filter(|(_, lines)| *lines > LONGEST_FILE)
        .map(|(path, lines)| format!("{}: {lines} lines", path.display()))
        .collect();
    assert_none(&long);
}

#[test]
fn only_the_solver_is_trusted_with_memory() {
    let keyword = concat!("un", "safe");
    let is_word = |line: &str| code(line).split(|c: char| !(c.is_alphanumeric() || c == '_')).any(|w| w == keyword);
    assert_none(&breaches(&texts(&["rs"]), |path, line| !path.starts_with("numerics") && is_word(line)));
}

#[test]
fn nothing_is_left_unfinished() {
    let files = texts(&["rs", "toml", "sql", "md", "yml", "yaml"]);
    assert_none(&breaches(&files, |_, line| UNFINISHED.iter().any(|word| line.contains(word))));
}

#[test]
fn no_path_of_one_machine_is_in_any_file() {
    let files = texts(&["rs", "toml", "sql", "md", "yml", "yaml", "json", "lock"]);
    assert_none(&breaches(&files, |_, line| OF_A_MACHINE.iter().any(|path| line.contains(path))));
}

#[test]
fn each_package_knows_only_what_it_may() {
    let cargo = env::var("CARGO").unwrap_or_else(|_| env!("CARGO").into());
    for (package, forbidden) in FORBIDDEN {
        let tree = Command::new(&cargo)
            .args(["tree", "--offline", "--edges", "normal", "--prefix", "none", "--format", "{p}", "-p", package])
            .current_dir(repository())
            .output()
            .unwrap();
        assert!(tree.status.success(), "{}", String::from_utf8_lossy(&tree.stderr));
        let tree = String::from_utf8(tree.stdout).unwrap();
        let known: Vec<_> = tree.lines().filter_map(|line| line.split(' ').next()).collect();
        assert!(known.contains(&package) && known.len() > 3, "{tree}");
        for name in forbidden {
            assert!(!known.contains(name), "{package} depends on {name}");
        }
    }
}

#[test]
fn the_coordinator_flies_in_one_place_alone() {
    let server: Vec<_> = texts(&["rs"]).into_iter().filter(|(path, _)| path.starts_with("server/src")).collect();
    assert!(!server.is_empty());
    let calls = [
        "uvlm::fly",
        "quasi_steady::fly",
        "simulation::simulate",
        "simulate(&",
        "simulate_w",
        "record_while(",
        "surrogate::train",
        "uvlm::solver",
    ];
    let allowed = [Path::new("server/src/tests"), Path::new("server/src/look.rs")];
    assert_none(&breaches(&server, |path, line| {
        !allowed.iter().any(|place| path.starts_with(place)) && calls.iter().any(|call| code(line).contains(call))
    }));
}

#[test]
fn every_study_of_the_repository_is_accepted() {
    let studies: Vec<_> =
        texts(&["toml", "json"]).into_iter().filter(|(path, _)| path.starts_with("studies")).collect();
    assert!(studies.len() >= 2);
    for (path, text) in studies {
        let spec: StudySpec = if path.extension().is_some_and(|e| e == "json") {
            serde_json::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
        } else {
            toml::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
        };
        let resolved = resolve::study(&spec);
        assert!(resolved.is_ok(), "{}: {:?}", path.display(), resolved.err());
    }
}

#[test]
fn every_folder_of_the_workspace_follows_its_lints() {
    let manifests: Vec<_> = texts(&["toml"]).into_iter().filter(|(path, _)| path.ends_with("Cargo.toml")).collect();
    let without = manifests
        .iter()
        .filter(|(path, text)| path != Path::new("Cargo.toml") && !text.contains("[lints]\nworkspace = true"));
    assert_none(&without.map(|(path, _)| path.display().to_string()).collect::<Vec<_>>());
}
