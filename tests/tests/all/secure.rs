//! A coordinator which asks for tokens, behind a reverse proxy which speaks TLS.

use std::path::Path;
use std::process::{Command, Output};

use manduca_tests::coordinator::Coordinator;
use manduca_tests::process::Process;
use manduca_tests::program::manduca;
use manduca_tests::studies::blades;
use manduca_tests::tls::TlsProxy;
use manduca_tests::wait_for;
use serde_json::{Value, json};

/// The operator's own token, given to the coordinator by its environment.
const GIVEN: &str = "manduca_0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";

/// A command with a token, which trusts the certificates of one file and no others.
fn trusting(certificate: &Path, token: &str, arguments: &[&str]) -> Command {
    let mut command = manduca(arguments);
    command.env("SSL_CERT_FILE", certificate).env("MANDUCA_TOKEN", token).env_remove("SSL_CERT_DIR");
    command
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn behind_tls_a_study_needs_the_right_tokens_and_the_right_certificate() {
    let coordinator = Coordinator::start_with(|_| vec![("MANDUCA_TOKEN".to_owned(), GIVEN.to_owned())]);
    let proxy = TlsProxy::before(coordinator.url().trim_start_matches("http://"));
    let (url, folder) = (proxy.url(), coordinator.folder());
    let certificate = proxy.write_certificate(folder.join("proxy.pem"));
    let made = |name: &str, scope: &str| {
        let data = folder.join("data").display().to_string();
        let output = manduca(&["token", "create", name, "--scope", scope, "--data", &data]).output().unwrap();
        String::from_utf8(output.stdout).unwrap().trim().to_owned()
    };
    let (ada, node) = (made("ada", "submit"), made("node", "worker"));
    std::fs::write(folder.join("study.json"), blades("secret", 7, 30).to_string()).unwrap();
    let submit = |certificate: &Path, token: &str| {
        let study = folder.join("study.json").display().to_string();
        let arguments = ["study", "submit", &study, "--coordinator", &url, "--wait", "--json"];
        trusting(certificate, token, &arguments).output().unwrap()
    };

    // Nobody gets in with a worker's token, with none, or through a proxy which is not known.
    let stranger = TlsProxy::before("127.0.0.1:9").write_certificate(folder.join("stranger.pem"));
    for (certificate, token, why) in
        [(&certificate, node.as_str(), "submit"), (&certificate, "", "token"), (&stranger, ada.as_str(), "certificate")]
    {
        let refused = submit(certificate, token);
        let words = said(&refused);
        assert!(!refused.status.success() && words.to_lowercase().contains(why), "{why}: {words}");
        assert!(token.is_empty() || !words.contains(token), "a token is never shown: {words}");
    }

    let worker = ["worker", "--coordinator", &url, "--slots", "1", "--name", "node"];
    let mut worker = Process::start(trusting(&certificate, &node, &worker), folder, "node");
    let answer = submit(&certificate, &ada);
    assert!(answer.status.success(), "{}\n{}", said(&answer), worker.said());
    let answer: Value = serde_json::from_slice(&answer.stdout).unwrap();
    assert_eq!(answer["samples"]["succeeded"], json!(30));

    let doctor = ["doctor", "--coordinator", &url, "--data", "nowhere", "--json"];
    let found = trusting(&certificate, &ada, &doctor).output().unwrap();
    let findings: Value = serde_json::from_slice(&found.stdout).unwrap();
    let verdict =
        |what: &str| findings.as_array().unwrap().iter().find(|f| f["what"] == what).unwrap()["verdict"].clone();
    assert_eq!((verdict("coordinator"), verdict("token")), (json!("well"), json!("well")), "{findings}");

    // A token which is ended lets nobody in any more, the worker at work included.
    let data = folder.join("data").display().to_string();
    assert!(manduca(&["token", "revoke", "node", "--data", &data]).status().unwrap().success());
    wait_for("a worker which is told that its token is ended", || worker.said().contains("401").then_some(()));
    worker.terminate();
    assert!(worker.exit_code().is_some(), "and it can still be stopped");
    let told = coordinator.said();
    assert!([GIVEN, &ada, &node].iter().all(|secret| !told.contains(*secret)), "no secret in the log");
}

#[test]
fn without_tokens_a_coordinator_answers_under_its_own_names() {
    let hosts = ["--allow-host", "Manduca.Example", "--allow-host", "10.1.2.3,::7"];
    let coordinator = Coordinator::start_serving(&hosts);
    let asked = |host: &str| coordinator.send(coordinator.request("GET", "/v1/studies").header("host", host)).status;
    for own in ["localhost:1", "127.0.0.1", "manduca.example:443", "10.1.2.3:8080", "[::7]:80"] {
        assert_eq!(asked(own), 200, "{own}");
    }
    for foreign in ["rebind.example", "10.1.2.4", "a.manduca.example"] {
        assert_eq!(asked(foreign), 421, "{foreign}");
    }
    for wrong in ["manduca.example:80", "http://a", "*", "a b"] {
        let output = manduca(&["serve", "--listen", "127.0.0.1:0", "--allow-host", wrong]).output().unwrap();
        assert!(
            output.status.code() == Some(2) && said(&output).contains("--allow-host"),
            "{wrong}: {}",
            said(&output)
        );
    }
}

/// A command on a machine without certificates.
fn without_certificates(arguments: &[&str]) -> Command {
    let mut command = manduca(arguments);
    command.env("SSL_CERT_FILE", "nowhere/none.pem").env("SSL_CERT_DIR", "nowhere");
    command
}

#[test]
fn plain_http_needs_no_certificates_and_https_says_that_it_does() {
    let coordinator = Coordinator::start();
    let url = coordinator.url();
    let health = format!("{url}/healthz");
    for arguments in [&["healthcheck", "--url", &health][..], &["study", "list", "--coordinator", &url]] {
        let output = without_certificates(arguments).output().unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", said(&output));
    }
    let worker = without_certificates(&["worker", "--coordinator", &url, "--slots", "1", "--name", "bare"]);
    let _worker = Process::start(worker, coordinator.folder(), "bare");
    wait_for("a worker without certificates", || coordinator.worker_view("bare"));
    let output = without_certificates(&["study", "list", "--coordinator", "https://localhost:1"]).output().unwrap();
    let words = said(&output);
    assert_eq!(output.status.code(), Some(2), "{words}");
    assert!(words.contains("ca-certificates") && words.contains("SSL_CERT_FILE"), "{words}");
}

#[test]
fn a_certificate_which_is_not_accepted_says_why_and_what_to_do() {
    let coordinator = Coordinator::start();
    let folder = coordinator.folder();
    let (proxy, expired) = (TlsProxy::before(coordinator.address()), TlsProxy::expired_before(coordinator.address()));
    let (good, old) =
        (proxy.write_certificate(folder.join("good.pem")), expired.write_certificate(folder.join("old.pem")));
    let other = proxy.url().replace("localhost", "127.0.0.1");
    for (certificate, url, why, advice) in [
        (&old, proxy.url(), "no authority", "SSL_CERT_FILE"),
        (&good, other, "it is for ", "use a name"),
        (&old, expired.url(), "has expired", "renewed"),
    ] {
        let output = trusting(certificate, "", &["study", "list", "--coordinator", &url]).output().unwrap();
        let words = said(&output);
        assert_eq!(output.status.code(), Some(1), "{words}");
        assert!(words.contains("is not accepted") && words.contains(why) && words.contains(advice), "{words}");
        assert!(!words.contains("is a coordinator running there"), "{words}");
    }
    // A worker waits for a certificate it accepts, says so, and still leaves when its time is over.
    let arguments = ["worker", "--coordinator", &proxy.url(), "--slots", "1", "--idle-exit", "1"];
    let output = trusting(&old, "", &arguments).output().unwrap();
    let words = said(&output);
    assert_eq!(output.status.code(), Some(1), "{words}");
    assert!(words.contains("SSL_CERT_FILE") && words.contains("without having been registered"), "{words}");
    // What answers in plain text is no TLS, and the other way round.
    let tls = coordinator.url().replace("http://", "https://");
    let output = trusting(&good, "", &["study", "list", "--coordinator", &tls]).output().unwrap();
    assert!(said(&output).contains("does not speak TLS"), "{}", said(&output));
}
