//! No statement of the running coordinator reads all jobs or all results: with a
//! million of them it would stop everything else for a tenth of a second.

use std::path::{Path, PathBuf};

use sqlx::Row;

use super::bench::Bench;

/// Rooms whose statements are run by `manduca db`, beside no coordinator.
const OFFLINE: [&str; 2] = ["upkeep.rs", "inspect.rs"];

/// Tables whose rows grow with the work done.
const LARGE: [&str; 3] = ["jobs", "results", "checkpoints"];

/// The files of the store.
fn rooms(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(rooms(&path));
        } else if !OFFLINE.iter().any(|name| path.ends_with(name)) {
            found.push(path);
        }
    }
    found
}

/// The statements in a source: its texts which begin as one.
fn statements(source: &str) -> Vec<String> {
    let texts = source.split('"').skip(1).step_by(2);
    let begins = |text: &&str| ["select ", "update ", "delete ", "insert "].iter().any(|verb| text.starts_with(verb));
    // `insert into ... (columns)` alone is completed while the coordinator runs.
    texts
        .filter(begins)
        .filter(|text| !text.trim_end().ends_with(')') || text.contains("values"))
        .map(Into::into)
        .collect()
}

/// The names by which a statement calls a table.
fn aliases<'a>(statement: &'a str, table: &'a str) -> Vec<&'a str> {
    let words: Vec<&str> =
        statement.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|w| !w.is_empty()).collect();
    let named = words.windows(3).filter(|w| w[0] == table && w[1] == "as").map(|w| w[2]);
    named.chain([table]).collect()
}

/// Whether a step of a plan goes through all rows of a large table. Indexes of part of
/// a table hold the few jobs in one state.
fn reads_all(statement: &str, step: &str) -> bool {
    let Some(scanned) = step.strip_prefix("SCAN ") else { return false };
    let (name, how) = scanned.split_once(' ').unwrap_or((scanned, ""));
    let of_part = how.contains("INDEX jobs_");
    !of_part && LARGE.iter().any(|table| aliases(statement, table).contains(&name))
}

#[tokio::test]
async fn no_statement_reads_all_jobs() {
    let bench = Bench::open().await;
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/store");
    let (mut seen, mut slow) = (0, Vec::new());
    for room in rooms(&folder) {
        for statement in statements(&std::fs::read_to_string(&room).expect("a source")) {
            let asked = sqlx::AssertSqlSafe(format!("explain query plan {statement}"));
            let plan = sqlx::query(asked).fetch_all(bench.state.store().readers()).await;
            for step in plan.unwrap_or_else(|e| panic!("{}: {statement}: {e}", room.display())) {
                let step: String = step.get("detail");
                if reads_all(&statement, &step) {
                    slow.push(format!("{}: {step}: {statement}", room.display()));
                }
            }
            seen += 1;
        }
    }
    assert!(seen > 50, "only {seen} statements found");
    assert!(slow.is_empty(), "{}", slow.join("\n"));
}

#[test]
fn a_scan_of_jobs_is_told_from_one_of_few() {
    let statement = "select j.job from jobs as j join results as r on r.job = j.job";
    for (step, all) in [
        ("SCAN j", true),
        ("SCAN r", true),
        ("SCAN j USING COVERING INDEX sqlite_autoindex_jobs_1", true),
        ("SCAN j USING INDEX jobs_leased", false),
        ("SEARCH r USING INTEGER PRIMARY KEY (rowid=?)", false),
        ("SCAN d VIRTUAL TABLE INDEX 1:", false),
    ] {
        assert_eq!(reads_all(statement, step), all, "{step}");
    }
}
