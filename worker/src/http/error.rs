//! How a call can fail, and what that means for whoever made it.

use std::error::Error;
use std::io;

use manduca_protocol::problem::Problem;
use rustls::CertificateError;

/// How a call failed.
#[derive(Debug, thiserror::Error)]
pub enum CallError {
    /// Nothing answered, or the answer broke off.
    #[error("cannot reach {url}: {reason}")]
    Unreachable {
        /// The address of the call.
        url: String,
        /// The innermost cause.
        reason: String,
    },
    /// The other side's certificate is not accepted.
    #[error("the certificate of {url} is not accepted: {reason}")]
    Certificate {
        /// The address of the call.
        url: String,
        /// What is wrong with the certificate.
        reason: String,
        /// What to do about it.
        advice: &'static str,
    },
    /// The coordinator refuses, in a problem document of its own.
    #[error("{0}")]
    Refused(Box<Problem>),
    /// Something else than a coordinator answered: a proxy, a login page, another service.
    #[error("the answer of {url} is not from a manduca coordinator: {what}")]
    Foreign {
        /// The address of the call.
        url: String,
        /// Status of the answer.
        status: u16,
        /// The answer in short.
        what: String,
    },
}

/// What tells failures apart in a log: the variant and the status.
pub(crate) type Class = (u8, u16);

impl CallError {
    /// The status of a coordinator's refusal.
    pub fn status(&self) -> Option<u16> {
        match self {
            Self::Refused(problem) => Some(problem.status),
            _ => None,
        }
    }

    /// Whether the coordinator refuses with a problem of the type with this last part.
    pub fn is_problem(&self, slug: &str) -> bool {
        matches!(self, Self::Refused(problem) if problem.is(slug))
    }

    /// Whether the same call may succeed later. An answer which is not a coordinator's says
    /// nothing about the call.
    pub fn is_passing(&self) -> bool {
        match self {
            Self::Unreachable { .. } | Self::Certificate { .. } | Self::Foreign { .. } => true,
            Self::Refused(problem) => problem.status >= 500 || matches!(problem.status, 408 | 425 | 429),
        }
    }

    /// Whether the coordinator refuses what was sent, so that sending it again ends the same way.
    pub fn refuses_content(&self) -> bool {
        matches!(self.status(), Some(400 | 413 | 422))
    }

    /// What tells it from failures of another kind.
    pub(crate) fn class(&self) -> Class {
        match self {
            Self::Unreachable { .. } => (0, 0),
            Self::Certificate { .. } => (1, 0),
            Self::Refused(problem) => (2, problem.status),
            Self::Foreign { status, .. } => (3, *status),
        }
    }

    /// What to do about it, where the error itself is what tells.
    pub fn advice(&self) -> Option<&'static str> {
        match self {
            Self::Certificate { advice, .. } => Some(advice),
            Self::Foreign { .. } => Some(
                "is this a coordinator's address, and of the same version? A proxy or a login page on the way may have \
                 answered in its place",
            ),
            Self::Unreachable { .. } | Self::Refused(_) => None,
        }
    }
}

impl From<reqwest::Error> for CallError {
    fn from(error: reqwest::Error) -> Self {
        let url = error.url().map_or_else(|| "the coordinator".to_owned(), ToString::to_string);
        match tls_error(&error) {
            Some(rustls::Error::InvalidCertificate(why)) => {
                let (reason, advice) = certificate(why);
                Self::Certificate { url, reason, advice }
            }
            Some(rustls::Error::InvalidMessage(_)) => {
                Self::Unreachable { url, reason: "it does not speak TLS; does its address begin with http://?".into() }
            }
            _ => Self::Unreachable { url, reason: root_cause(&error) },
        }
    }
}

/// What is wrong with a certificate, and what to do about it.
fn certificate(error: &CertificateError) -> (String, &'static str) {
    use CertificateError as E;
    match error {
        // A trusted certificate of the same name has another key: it has been made anew.
        E::UnknownIssuer | E::BadSignature => (
            "no authority which this machine trusts has signed it".into(),
            "where the certificate is self-signed or of an authority of your own, name its PEM file in SSL_CERT_FILE",
        ),
        E::Expired | E::ExpiredContext { .. } => {
            ("it has expired".into(), "have it renewed; is the clock of this machine right?")
        }
        E::NotValidYet | E::NotValidYetContext { .. } => {
            ("it is not valid yet".into(), "is the clock of this machine right?")
        }
        E::NotValidForName | E::NotValidForNameContext { .. } => (
            wrong_name(error),
            "use a name which the certificate has in the address, or have it made for the name in use",
        ),
        other => (other.to_string(), "have it made anew by an authority which this machine trusts"),
    }
}

fn wrong_name(error: &CertificateError) -> String {
    match error {
        CertificateError::NotValidForNameContext { expected, presented } if !presented.is_empty() => {
            format!("it is for {}, not for {}", presented.join(", "), expected.to_str())
        }
        _ => "it is for another name".into(),
    }
}

/// The error of TLS below another error.
fn tls_error<'e>(error: &'e (dyn Error + 'static)) -> Option<&'e rustls::Error> {
    let mut cause = Some(error);
    while let Some(error) = cause {
        if let Some(found) = error.downcast_ref() {
            return Some(found);
        }
        // The source of an I/O error is that of the error inside it, not the error itself.
        if let Some(inner) = error.downcast_ref::<io::Error>().and_then(io::Error::get_ref) {
            return tls_error(inner);
        }
        cause = error.source();
    }
    None
}

/// The innermost cause says what happened; the outer ones repeat the address.
pub(super) fn root_cause(error: &dyn Error) -> String {
    let mut cause = error;
    while let Some(inner) = cause.source() {
        cause = inner;
    }
    cause.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(status: u16, slug: &str) -> CallError {
        CallError::Refused(Box::new(Problem {
            kind: format!("urn:manduca:problem:{slug}"),
            title: "no".into(),
            status,
            detail: String::new(),
            errors: Vec::new(),
        }))
    }

    #[test]
    fn only_a_coordinators_own_words_are_definite() {
        let foreign = |status| CallError::Foreign { url: "x".into(), status, what: String::new() };
        for status in [200, 302, 400, 401, 403, 404, 410, 413, 422, 502] {
            let error = foreign(status);
            assert!(error.is_passing() && !error.refuses_content() && !error.is_problem("unknown-worker"), "{status}");
        }
        assert!(refused(404, "unknown-worker").is_problem("unknown-worker"));
        assert!(!refused(404, "no-route").is_problem("unknown-worker"));
        assert!(
            refused(422, "invalid-request").refuses_content() && !refused(401, "unauthenticated").refuses_content()
        );
        assert!(refused(503, "unavailable").is_passing() && !refused(422, "invalid-request").is_passing());
    }

    #[test]
    fn a_certificate_which_is_not_accepted_says_why() {
        let (reason, advice) = certificate(&CertificateError::UnknownIssuer);
        assert!(reason.contains("no authority") && advice.contains("SSL_CERT_FILE"), "{reason}: {advice}");
        assert_eq!(certificate(&CertificateError::BadSignature).0, reason);
        assert!(certificate(&CertificateError::Expired).0.contains("expired"));
        assert!(certificate(&CertificateError::NotValidForName).0.contains("name"));
    }
}
