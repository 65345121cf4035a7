//! Tokens, copies and checks of a database, and the doctor, as an operator types them.

use std::fs;

use serde_json::{Value, json};

use super::{STUDY, folder_with, json as object, outcome};

/// What the doctor found, by matter: its verdict and its words.
fn found(findings: &Value, what: &str) -> (String, String) {
    let all = findings.as_array().unwrap();
    let one = all.iter().find(|f| f["what"] == what).unwrap_or_else(|| panic!("no {what} in {findings}"));
    (one["verdict"].as_str().unwrap().to_owned(), one["detail"].as_str().unwrap().to_owned())
}

#[test]
fn tokens_are_made_listed_and_ended_by_scripts_too() {
    let folder = tempfile::tempdir().unwrap();
    let create = ["token", "create", "ada", "--scope", "submit,read", "--json"];
    let nowhere = outcome(folder.path(), &create);
    assert_eq!((nowhere.status.code(), nowhere.stdout.len()), (Some(2), 0), "there is no database yet");
    assert!(!folder.path().join("manduca-data").exists());
    let made = object(&outcome(folder.path(), &[&create[..], &["--init"]].concat()));
    assert_eq!((&made["name"], &made["scopes"]), (&json!("ada"), &json!(["submit", "read"])));
    let secret = made["token"].as_str().unwrap();
    assert!(secret.starts_with("manduca_") && secret.len() > 40, "{} characters", secret.len());

    let again = outcome(folder.path(), &create);
    assert_eq!((again.status.code(), again.stdout.len()), (Some(2), 0), "a second token of one name");
    let plain = outcome(folder.path(), &["token", "create", "cluster", "--scope", "worker"]);
    assert!(plain.stdout.starts_with(b"manduca_") && plain.stdout.ends_with(b"\n"), "one line for a file");

    let revoke = ["token", "revoke", "ada", "--json"];
    assert_eq!(object(&outcome(folder.path(), &revoke)), json!({ "name": "ada", "revoked": true }));
    let listed = object(&outcome(folder.path(), &["token", "list", "--json"]));
    let ended: Vec<_> = listed.as_array().unwrap().iter().map(|t| (&t["name"], t["revoked_at"].is_string())).collect();
    assert_eq!(ended, [(&json!("ada"), true), (&json!("cluster"), false)]);
    assert!(!listed.to_string().contains(&secret[8..]), "a list shows no secret");
}

#[test]
fn a_copy_takes_the_place_of_its_database() {
    let folder = folder_with(STUDY);
    let run = ["run", "study.toml", "--slots", "2", "--json"];
    let first = object(&outcome(folder.path(), &run));
    fs::create_dir(folder.path().join("restored")).unwrap();
    let backup = ["db", "backup", "restored/manduca.db", "--json"];
    let written = object(&outcome(folder.path(), &backup));
    let bytes = fs::metadata(folder.path().join("restored/manduca.db")).unwrap().len();
    assert_eq!(written, json!({ "file": "restored/manduca.db", "bytes": bytes }));
    let over = outcome(folder.path(), &backup);
    assert_eq!(over.status.code(), Some(2), "a copy is not written over another");

    let checked = object(&outcome(folder.path(), &["db", "check", "--data", "restored", "--json"]));
    assert_eq!((&checked["damage"], &checked["breaches"]), (&json!([]), &json!([])));
    let again = object(&outcome(folder.path(), &[&run[..], &["--data", "restored"]].concat()));
    assert_eq!(again["optimisations"], first["optimisations"]);
}

#[test]
fn the_doctor_looks_at_a_folder_and_says_what_it_found() {
    let folder = folder_with(STUDY);
    let data = folder.path().join("manduca-data");
    let doctor = ["doctor", "--coordinator", "http://127.0.0.1:9", "--json"];
    let findings = object(&outcome(folder.path(), &doctor));
    assert_eq!(found(&findings, "compute slot").0, "well");
    let (verdict, words) = found(&findings, "coordinator");
    assert!(verdict == "note" && words.contains("127.0.0.1:9"), "{words}");
    assert_eq!(found(&findings, "database").0, "note", "there is no folder yet, and that is no fault");

    object(&outcome(folder.path(), &["run", "study.toml", "--slots", "2", "--json"]));
    let (verdict, words) = found(&object(&outcome(folder.path(), &doctor)), "database");
    assert!(verdict == "well" && words.contains("results"), "{words}");

    // Pages in the middle of the file, where the results are.
    let file = data.join("manduca.db");
    let mut bytes = fs::read(&file).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle..middle + 8192].fill(0x55);
    fs::write(&file, bytes).unwrap();
    let output = outcome(folder.path(), &doctor);
    assert_eq!(output.status.code(), Some(1));
    let findings: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found(&findings, "database").0, "wrong", "{findings}");
    let plain = outcome(folder.path(), &doctor[..3]);
    assert!(String::from_utf8_lossy(&plain.stdout).contains("WRONG database"));
}
