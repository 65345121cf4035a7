//! Files written, removed, and read by others.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::Path;
use std::process::{Command, Stdio};

use manduca_tests::coordinator::Coordinator;
use manduca_tests::process::Process;
use manduca_tests::program::{manduca, program};
use manduca_tests::studies::{blades, endless, lattice};
use manduca_tests::wait_for;

use super::{outcome, stderr, study_file, write_study};

fn mode(path: &Path) -> u32 {
    path.metadata().unwrap().mode() & 0o777
}

fn names(folder: &Path) -> Vec<String> {
    let mut all: Vec<_> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    all.sort();
    all
}

/// Answers every request with the beginning of a dataset, and breaks off.
fn breaking_off() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let Ok(mut stream) = stream else { return };
            let mut asked = [0; 4096];
            let length = stream.read(&mut asked).unwrap_or_default();
            let is_model = String::from_utf8_lossy(&asked[..length]).contains("/surrogate/model");
            let of = if is_model { "application/onnx" } else { "text/csv" };
            let head = format!("HTTP/1.1 200 OK\r\ncontent-type: {of}\r\ntransfer-encoding: chunked\r\n\r\n");
            let _ = stream.write_all(format!("{head}6\r\nhalf,a\r\n").as_bytes());
        }
    });
    url
}

#[test]
fn a_download_that_breaks_off_leaves_the_old_file() {
    let (folder, url) = (tempfile::tempdir().unwrap(), breaking_off());
    let study = "01890000-0000-7000-8000-00000000abcd";
    for (command, name) in [(&["dataset", study][..], "a.csv"), (&["study", "model", study], "net.onnx")] {
        let file = folder.path().join(name);
        let arguments = [command, &["--coordinator", &url, "-o", file.to_str().unwrap()]].concat();
        let broken = outcome(&arguments);
        assert_eq!((broken.status.code(), names(folder.path()).len()), (Some(1), 0), "{}", stderr(&broken));
        fs::write(&file, "good").unwrap();
        let broken = outcome(&arguments);
        assert!(stderr(&broken).contains("broke off") && stderr(&broken).contains("as it was"), "{}", stderr(&broken));
        assert_eq!((fs::read_to_string(&file).unwrap(), names(folder.path())), ("good".into(), vec![name.to_owned()]));
        fs::remove_file(file).unwrap();
    }
}

#[test]
fn an_interrupted_download_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let file = folder.path().join("a.csv");
    fs::write(&file, "good").unwrap();
    let study = "01890000-0000-7000-8000-00000000abcd";
    let command = manduca(&["dataset", study, "--coordinator", &url, "-o", file.to_str().unwrap()]);
    let beside = tempfile::tempdir().unwrap();
    let mut process = Process::start(command, beside.path(), "dataset");
    let (mut stream, _) = listener.accept().unwrap();
    let _ = stream.read(&mut [0; 4096]);
    let head = "HTTP/1.1 200 OK\r\ncontent-type: text/csv\r\ntransfer-encoding: chunked\r\n\r\n";
    stream.write_all(format!("{head}6\r\nhalf,a\r\n").as_bytes()).unwrap();
    wait_for("a draft", || (names(folder.path()).len() == 2).then_some(()));
    process.terminate();
    assert_eq!(process.exit_code(), Some(130));
    assert_eq!((fs::read_to_string(&file).unwrap(), names(folder.path())), ("good".into(), vec!["a.csv".to_owned()]));
}

#[test]
fn a_database_and_tokens_are_their_owners_alone() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("deep/data");
    let named = data.to_str().unwrap();
    let token = folder.path().join("token");
    let file = token.to_str().unwrap();
    let create = ["token", "create", "root", "--scope", "admin", "--data", named, "--out", file];
    // A mistyped folder gets no database.
    for arguments in [&create[..], &["token", "list", "--data", named], &["token", "revoke", "x", "--data", named]] {
        let refused = outcome(arguments);
        assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
        assert!(
            stderr(&refused).contains("no database") && stderr(&refused).contains("--data"),
            "{}",
            stderr(&refused)
        );
        assert!(!data.exists() && !token.exists());
    }
    let made = outcome(&[&create[..], &["--init"]].concat());
    assert_eq!((made.status.code(), made.stdout.len()), (Some(0), 0), "{}", stderr(&made));
    assert!(fs::read_to_string(&token).unwrap().starts_with("manduca_"));
    let again = ["token", "create", "other", "--scope", "read", "--data", named, "--out", file];
    assert_eq!(outcome(&again).status.code(), Some(2), "a file is not written over");
    let listed = String::from_utf8(outcome(&["token", "list", "--data", named]).stdout).unwrap();
    assert!(listed.contains("root") && !listed.contains("other"), "{listed}");

    let serve = manduca(&["serve", "--listen", "127.0.0.1:0", "--data", named, "--token-file", file]);
    let mut serve = Process::start(serve, folder.path(), "serve");
    wait_for("a coordinator", || {
        assert!(serve.ended().is_none(), "{}", serve.said());
        serve.said().contains("listening on").then_some(())
    });
    assert_eq!((mode(&data), mode(&token)), (0o700, 0o600));
    let files = names(&data);
    assert!(files.len() >= 5, "{files:?}");
    for name in files {
        assert_eq!(mode(&data.join(&name)), 0o600, "{name}");
    }
    // What others may write is nobody's secret; what they may read is worth a word.
    for (permissions, code) in [(0o602, 2), (0o604, 1)] {
        fs::set_permissions(&token, PermissionsExt::from_mode(permissions)).unwrap();
        let asked = outcome(&["study", "list", "--coordinator", "http://127.0.0.1:9", "--token-file", file]);
        assert_eq!(asked.status.code(), Some(code), "{}", stderr(&asked));
        assert!(stderr(&asked).contains("chmod 600"), "{}", stderr(&asked));
    }
}

#[test]
fn slots_have_no_token() {
    let coordinator =
        Coordinator::start_with(|_| vec![("MANDUCA_TOKEN".into(), format!("manduca_{}", "ab".repeat(32)))]);
    let folder = tempfile::tempdir().unwrap();
    let token = folder.path().join("token");
    let file = token.to_str().unwrap();
    let create = ["token", "create", "node", "--scope", "worker", "--data", &coordinator.data(), "--out", file];
    assert!(outcome(&create).status.success());
    let study = write_study(folder.path(), "endless", &endless("endless"));
    let submitted = manduca(&["study", "submit", &study, "--coordinator", &coordinator.url()])
        .env("MANDUCA_TOKEN", format!("manduca_{}", "ab".repeat(32)))
        .output()
        .unwrap();
    assert!(submitted.status.success(), "{}", stderr(&submitted));
    let mut command = manduca(&["worker", "--coordinator", &coordinator.url(), "--slots", "1", "--name", "node"]);
    command.env("MANDUCA_TOKEN", fs::read_to_string(&token).unwrap().trim()).env("MANDUCA_TOKEN_FILE", file);
    let worker = Process::start(command, folder.path(), "node");
    let slot = wait_for("a slot", || worker.children().first().copied());
    let environment = wait_for("its environment", || {
        // Until it has become the program it has its parent's.
        let name = fs::read_to_string(format!("/proc/{slot}/cmdline")).ok()?;
        let bytes = fs::read(format!("/proc/{slot}/environ")).ok()?;
        name.contains("slot").then(|| String::from_utf8_lossy(&bytes).replace('\0', "\n"))
    });
    assert!(!environment.contains("MANDUCA_TOKEN") && environment.contains("PATH="), "{environment}");
}

#[test]
fn a_database_that_is_taken_away_is_noticed() {
    let coordinator = Coordinator::start();
    let data = coordinator.folder().join("data");
    coordinator.submit(&blades("before", 1, 30));
    for name in ["manduca.db", "manduca.db-wal"] {
        let (path, away) = (data.join(name), data.join("away"));
        fs::rename(&path, &away).unwrap();
        assert_eq!(coordinator.ask("/readyz").status, 503, "{name}");
        let refused = coordinator.post("/v1/studies", &blades("during", 2, 30));
        assert_eq!(refused.status, 503, "{name}: {}", refused.body);
        assert!(refused.body.contains("removed, replaced or cut short"), "{}", refused.body);
        assert!(!path.exists(), "nothing is made in its place");
        fs::rename(&away, &path).unwrap();
        wait_for("a coordinator which is ready again", || (coordinator.ask("/readyz").status == 200).then_some(()));
        coordinator.submit(&blades("after", 3, 30));
    }
    assert!(coordinator.said().contains("removed, replaced or cut short"), "{}", coordinator.said());
    // A copy in its place is another file.
    fs::copy(data.join("manduca.db"), data.join("copy")).unwrap();
    fs::rename(data.join("copy"), data.join("manduca.db")).unwrap();
    assert_eq!(coordinator.post("/v1/studies", &blades("lost", 4, 30)).status, 503);
    assert_eq!(coordinator.ask("/readyz").status, 503);
    assert_eq!(coordinator.ask("/healthz").status, 200);
}

#[test]
fn a_database_that_is_cut_short_takes_no_change() {
    for name in ["manduca.db-wal", "manduca.db"] {
        let coordinator = Coordinator::start();
        coordinator.submit(&blades("before", 1, 30));
        let path = coordinator.folder().join("data").join(name);
        fs::File::options().write(true).open(path).unwrap().set_len(0).unwrap();
        assert_eq!(coordinator.ask("/readyz").status, 503, "{name}");
        assert_eq!(coordinator.post("/v1/studies", &blades("during", 2, 30)).status, 503, "{name}");
    }
}

#[test]
fn a_run_whose_folder_is_removed_fails_and_makes_none() {
    let folder = tempfile::tempdir().unwrap();
    let study = write_study(folder.path(), "removed", &lattice("removed", 1, 5000));
    let data = folder.path().join("data");
    let command = manduca(&["run", &study, "--data", data.to_str().unwrap(), "--slots", "1"]);
    let mut run = Process::start(command, folder.path(), "run");
    wait_for("samples", || run.said().contains("sampling").then_some(()));
    fs::remove_dir_all(&data).unwrap();
    assert_eq!(run.exit_code(), Some(1), "{}", run.said());
    assert!(run.said().contains("is gone") && !run.said().contains("next "), "{}", run.said());
    assert!(!data.exists(), "{:?}", names(&data));
}

#[test]
fn a_limit_of_file_sizes_is_a_refusal() {
    let folder = tempfile::tempdir().unwrap();
    let study = study_file(folder.path(), "limited", 1, 30);
    let data = folder.path().join("data");
    // 100 blocks of half a KiB or of one: less than the tables need.
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -f 100; exec \"$0\" \"$@\""]).arg(program());
    command.args(["run", &study, "--data"]).arg(&data).args(["--slots", "1"]).stdin(Stdio::null());
    let ended = command.output().unwrap();
    assert_eq!(ended.status.code(), Some(1), "{:?}: {}", ended.status, stderr(&ended));
    assert!(stderr(&ended).contains("ulimit -f"), "{}", stderr(&ended));
}

#[test]
fn containers_which_compute_have_no_token_that_allows_everything() {
    let text = fs::read_to_string(manduca_tests::program::repository().join("docker-compose.yml")).unwrap();
    let worker = text.split("\n  worker:\n").nth(1).unwrap().split("\nvolumes:").next().unwrap();
    assert!(worker.contains("MANDUCA_TOKEN_FILE") && !worker.contains("MANDUCA_TOKEN:"), "{worker}");
    assert!(text.contains("--scope worker"), "{text}");
}
