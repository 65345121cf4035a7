//! Databases which cannot be opened, and such as may only be read.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;
use std::time::SystemTime;

use manduca_tests::coordinator::Coordinator;
use manduca_tests::program::manduca;
use manduca_tests::studies::blades;

use super::{as_nobody, is_root, outcome, stderr, study_file};

/// A folder with a database nobody has open, which holds a study.
fn closed_database() -> (tempfile::TempDir, String) {
    let mut coordinator = Coordinator::start();
    coordinator.submit(&blades("there", 1, 30));
    coordinator.leave();
    copy_of(&coordinator)
}

fn copy_of(coordinator: &Coordinator) -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    fs::create_dir(&data).unwrap();
    for name in ["manduca.db", "manduca.db-wal"] {
        let from = coordinator.folder().join("data").join(name);
        if from.exists() {
            fs::copy(from, data.join(name)).unwrap();
        }
    }
    let named = data.to_str().unwrap().to_owned();
    (folder, named)
}

/// Every file of a folder, with its bytes and the time of its last change.
fn state(folder: &Path) -> BTreeMap<String, (Vec<u8>, SystemTime)> {
    let entries = fs::read_dir(folder).unwrap().map(Result::unwrap);
    let state = |path: &Path| (fs::read(path).unwrap(), path.metadata().unwrap().modified().unwrap());
    entries.map(|entry| (entry.file_name().to_string_lossy().into_owned(), state(&entry.path()))).collect()
}

/// The commands which only look, on a folder; a copy goes into another one.
fn assert_looks(data: &str, prepare: impl Fn(&mut Command)) {
    let elsewhere = tempfile::tempdir().unwrap();
    fs::set_permissions(elsewhere.path(), PermissionsExt::from_mode(0o777)).unwrap();
    let copy = elsewhere.path().join("copy.db");
    for arguments in [
        &["db", "check"][..],
        &["db", "backup", copy.to_str().unwrap()],
        &["db", "prune", "--older-than-days", "0", "--dry-run"],
        &["token", "list"],
    ] {
        let mut command = manduca(&[arguments, &["--data", data]].concat());
        prepare(&mut command);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    }
    // A copy is one file, whole by itself, and its owner's alone.
    assert_eq!(fs::read_dir(elsewhere.path()).unwrap().count(), 1);
    assert_eq!(copy.metadata().unwrap().permissions().mode() & 0o777, 0o600);
    let mut command = manduca(&["doctor", "--data", data, "--coordinator", "http://127.0.0.1:9", "--json"]);
    prepare(&mut command);
    let findings: serde_json::Value = serde_json::from_slice(&command.output().unwrap().stdout).unwrap();
    let database = findings.as_array().unwrap().iter().find(|f| f["what"] == "database").unwrap();
    assert_eq!(database["verdict"], "well", "{findings}");
}

#[test]
fn looking_changes_nothing() {
    let (_folder, data) = closed_database();
    let before = state(Path::new(&data));
    assert_looks(&data, |_| {});
    assert_eq!(state(Path::new(&data)), before);
    // What a killed coordinator left is in the log; there is no index.
    let mut coordinator = Coordinator::start();
    coordinator.submit(&blades("there", 1, 30));
    coordinator.kill();
    let (_folder, data) = copy_of(&coordinator);
    let before = state(Path::new(&data));
    assert!(before.contains_key("manduca.db-wal") && before.len() == 2);
    assert_looks(&data, |_| {});
    let counted = outcome(&["db", "check", "--json", "--data", &data]);
    let counted: serde_json::Value = serde_json::from_slice(&counted.stdout).unwrap();
    assert_eq!(counted["keys"], 30, "the log is read");
    assert_eq!(state(Path::new(&data)), before);
}

#[test]
fn looking_needs_no_right_to_write() {
    let set = |path: &Path, mode| fs::set_permissions(path, PermissionsExt::from_mode(mode)).unwrap();
    let mut killed = Coordinator::start();
    killed.submit(&blades("there", 1, 30));
    killed.kill();
    for (folder, data) in [closed_database(), copy_of(&killed)] {
        set(folder.path(), 0o755);
        for name in state(Path::new(&data)).keys() {
            set(&Path::new(&data).join(name), 0o444);
        }
        set(Path::new(&data), 0o555);
        assert_looks(&data, |command| {
            as_nobody(command);
        });
        set(Path::new(&data), 0o755);
    }
    // And beside a coordinator, by another user.
    let running = Coordinator::start();
    running.submit(&blades("there", 1, 30));
    set(running.folder(), 0o755);
    let data = running.folder().join("data");
    set(&data, 0o755);
    for name in ["manduca.db", "manduca.db-wal", "manduca.db-shm"] {
        set(&data.join(name), 0o644);
    }
    assert_looks(data.to_str().unwrap(), |command| {
        as_nobody(command);
    });
}

/// The one cause is told once, with what to do.
fn assert_told(arguments: &[&str], cause: &str, advice: &str, prepare: impl Fn(&mut Command)) {
    for _ in 0..5 {
        let mut command = manduca(arguments);
        prepare(&mut command);
        let output = command.output().unwrap();
        let said = stderr(&output);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{arguments:?}: {said}");
        assert_eq!(said.matches(cause).count(), 1, "{arguments:?}: {said}");
        assert!(said.contains(advice) && said.contains("->"), "{arguments:?}: {said}");
        assert!(!said.contains("cannot reach") && !said.contains("listening"), "{arguments:?}: {said}");
    }
}

#[test]
fn what_keeps_a_database_from_being_opened_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let study = study_file(folder.path(), "tiny", 1, 30);
    let data = folder.path().join("data");
    let named = data.to_str().unwrap();
    let run = ["run", &study, "--data", named, "--slots", "1"];
    let serve = ["serve", "--listen", "127.0.0.1:0", "--data", named];
    fs::create_dir(&data).unwrap();
    fs::write(data.join("manduca.db"), "no database at all, but a text of some length\n".repeat(100)).unwrap();
    for arguments in [&run[..], &serve] {
        assert_told(arguments, "file is not a database", "restore a copy", |_| {});
    }
    // A file where the folder should be.
    fs::remove_dir_all(&data).unwrap();
    fs::write(&data, "a file").unwrap();
    assert_told(&run, "exists", "--data DIR", |_| {});
    fs::remove_file(&data).unwrap();
    if !is_root() {
        return;
    }
    fs::create_dir(&data).unwrap();
    fs::set_permissions(folder.path(), PermissionsExt::from_mode(0o755)).unwrap();
    fs::set_permissions(&data, PermissionsExt::from_mode(0o555)).unwrap();
    for arguments in [&run[..], &serve] {
        assert_told(arguments, "Permission denied", "--data DIR", |command| {
            as_nobody(command);
        });
    }
    assert_eq!(fs::read_dir(&data).unwrap().count(), 0);
}

#[test]
fn pages_that_are_damaged_are_told_as_such() {
    let (_folder, data) = closed_database();
    let study = study_file(Path::new(&data), "tiny", 2, 30);
    let file = Path::new(&data).join("manduca.db");
    let mut bytes = fs::read(&file).unwrap();
    let end = bytes.len();
    // All but the first pages, which hold the names of the tables.
    for page in bytes[4096 * 8..end].chunks_mut(4096) {
        let most = page.len().min(200);
        page[..most].fill(0x55);
    }
    fs::write(&file, bytes).unwrap();
    let output = outcome(&["run", &study, "--data", &data, "--slots", "1"]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("malformed") || said.contains("damaged"), "{said}");
    assert!(!said.contains("cannot reach"), "{said}");
    let checked = outcome(&["db", "check", "--data", &data]);
    assert_eq!(checked.status.code(), Some(1), "{}", stderr(&checked));
}

#[test]
fn older_readers_of_sqlite_read_the_file() {
    let (_folder, data) = closed_database();
    let file = format!("{data}/manduca.db");
    let query = "select count(*) from study_specs where json_valid(spec)";
    let Ok(output) = Command::new("sqlite3").args([&file, query]).output() else { return };
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "1", "{}", stderr(&output));
}
