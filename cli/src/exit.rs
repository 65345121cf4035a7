//! How the program ends: 0 done, 1 failed, 2 refused, 130 interrupted.

use std::fmt;
use std::io;
use std::process::ExitCode;

use manduca_server::{OfflineError, OpenError, ServerError, chain};
use manduca_worker::WorkerError;
use manduca_worker::http::CallError;

use crate::output::complain_with;

/// Ended by Ctrl-C, as shells count it.
pub const INTERRUPTED: u8 = 130;
const FAILED: u8 = 1;
const REFUSED: u8 = 2;

/// What was asked for makes no sense as it stands; the text says what to change.
#[derive(Debug)]
pub struct Refused(pub String);

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Refused {}

/// An error which says what to change.
pub fn refused(text: impl Into<String>) -> anyhow::Error {
    anyhow::Error::new(Refused(text.into()))
}

/// Tells the error and picks the exit code.
pub fn report(error: &anyhow::Error) -> ExitCode {
    if is_broken_pipe(error) {
        // `manduca dataset latest | head` has read enough: that is no failure.
        return ExitCode::SUCCESS;
    }
    complain_with(format_args!("error: {}", chain(error.as_ref())), advice(error));
    ExitCode::from(code(error))
}

/// What to do about an error which does not say so itself.
fn advice(error: &anyhow::Error) -> Option<&'static str> {
    error.chain().find_map(|cause| of_database(cause).or_else(|| of_call(cause)))
}

/// The error of a database is found as it is, or as the cause of one that shows its words alone.
fn opening<'e>(cause: &'e (dyn std::error::Error + 'static)) -> Option<&'e OpenError> {
    cause.downcast_ref::<OpenError>().or_else(|| match cause.downcast_ref::<ServerError>() {
        Some(ServerError::Open(error)) => Some(error),
        _ => match cause.downcast_ref::<OfflineError>()? {
            OfflineError::Open(error) => Some(error),
            _ => None,
        },
    })
}

fn of_database(cause: &(dyn std::error::Error + 'static)) -> Option<&'static str> {
    opening(cause).map(OpenError::advice)
}

fn of_call(cause: &(dyn std::error::Error + 'static)) -> Option<&'static str> {
    match cause.downcast_ref::<CallError>()? {
        error @ (CallError::Certificate { .. } | CallError::Foreign { .. }) => error.advice(),
        CallError::Unreachable { .. } => Some(
            "is a coordinator running there? `manduca serve` starts one; --coordinator URL or MANDUCA_COORDINATOR \
             names another",
        ),
        CallError::Refused(problem) => match problem.status {
            401 => Some("MANDUCA_TOKEN or --token-file FILE gives a token; `manduca token create` makes one there"),
            404 if problem.kind.ends_with("not-yet") => Some("`manduca study watch STUDY` follows it until there is"),
            404 if problem.kind.ends_with("unknown-study") => Some("`manduca study list` shows which there are"),
            429 | 503 => Some("the same line a little later may do"),
            _ => None,
        },
    }
}

fn code(error: &anyhow::Error) -> u8 {
    let refused = error.chain().any(|cause| {
        let by_coordinator = matches!(
            cause.downcast_ref::<CallError>().and_then(CallError::status),
            Some(400 | 401 | 403 | 404 | 409 | 413 | 421 | 422)
        );
        let by_worker =
            matches!(cause.downcast_ref::<WorkerError>(), Some(WorkerError::Settings(_) | WorkerError::Refused(_)));
        // Nothing was changed, and something other than this line has to be.
        let by_database = matches!(
            opening(cause),
            Some(
                OpenError::Missing(_)
                    | OpenError::Held { .. }
                    | OpenError::Newer { .. }
                    | OpenError::Older { .. }
                    | OpenError::Other { .. }
            )
        );
        by_coordinator || by_worker || by_database || cause.is::<Refused>()
    });
    if refused { REFUSED } else { FAILED }
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|c| c.downcast_ref::<io::Error>().is_some_and(|e| e.kind() == io::ErrorKind::BrokenPipe))
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context;

    #[test]
    fn codes_follow_the_cause_however_deep() {
        let deep = Err::<(), _>(refused("no such study")).context("while looking").unwrap_err();
        assert_eq!(code(&deep), REFUSED);
        assert_eq!(code(&anyhow::anyhow!("disk full")), FAILED);
        let nobody = CallError::Unreachable { url: "http://x".into(), reason: "refused".into() };
        let nobody = anyhow::Error::from(nobody).context("while looking");
        assert_eq!(code(&nobody), FAILED);
        assert!(advice(&nobody).is_some_and(|a| a.contains("manduca serve")) && advice(&deep).is_none());
        let foreign = CallError::Foreign { url: "http://x".into(), status: 404, what: "404 Not Found".into() };
        let foreign = anyhow::Error::from(foreign);
        assert!(code(&foreign) == FAILED && advice(&foreign).is_some_and(|a| a.contains("proxy")));
        assert!(foreign.to_string().contains("not from a manduca coordinator"), "{foreign}");
        let pipe = anyhow::Error::from(io::Error::from(io::ErrorKind::BrokenPipe)).context("writing");
        assert!(is_broken_pipe(&pipe) && !is_broken_pipe(&deep));
    }
}
