//! The token of a command: from a file or a variable, never from the command line.

use std::path::Path;

use anyhow::Result;
use manduca_worker::http::{Http, Token};

use crate::api::Api;
use crate::args::Coordinator;
use crate::exit::refused;
use crate::output::note;

/// The variable which may hold a token.
const VARIABLE: &str = "MANDUCA_TOKEN";

/// The token given to this command, if any: the file's before the variable's.
pub fn given(file: Option<&Path>) -> Result<Option<String>> {
    if let Some(file) = file {
        check_permissions(file)?;
        let text = std::fs::read_to_string(file);
        let text = text.map_err(|e| refused(format!("--token-file {}: {e}", file.display())))?;
        return Ok(Some(text.trim().to_owned()));
    }
    match std::env::var(VARIABLE) {
        Ok(text) => Ok(Some(text.trim().to_owned()).filter(|text| !text.is_empty())),
        Err(std::env::VarError::NotPresent) => Ok(None),
        Err(_) => Err(refused(format!("{VARIABLE} is not text"))),
    }
}

/// Warns of a file others can read, and refuses one others can write: they could put their token there, which a
/// coordinator would let in and a worker would follow. Secrets mounted into a container may be read by all.
#[cfg(unix)]
fn check_permissions(file: &Path) -> Result<()> {
    use std::os::unix::fs::MetadataExt;
    // What is wrong with a file that cannot be looked at is told when it is read.
    let Ok(mode) = file.metadata().map(|m| m.mode()) else { return Ok(()) };
    let path = file.display();
    if mode & 0o002 != 0 {
        return Err(refused(format!("--token-file {path}: everybody can write it; `chmod 600 {path}` keeps it yours")));
    }
    if mode & 0o004 != 0 {
        note(format_args!("--token-file {path}: everybody here can read it; `chmod 600 {path}` keeps it yours"));
    }
    Ok(())
}

#[cfg(not(unix))]
fn check_permissions(_: &Path) -> Result<()> {
    Ok(())
}

impl Coordinator {
    /// The token it is to be given.
    pub fn token(&self) -> Result<Option<Token>> {
        let given = given(self.token_file.as_deref())?;
        given.map(|text| Token::new(&text)).transpose().map_err(refused)
    }

    /// A client of it.
    pub fn http(&self) -> Result<Http> {
        let token = self.token()?;
        let http = Http::with_token(&self.url, token.as_ref()).map_err(refused)?;
        if token.is_some() && http.is_in_the_clear() {
            note(format_args!("{}: the token goes over the network in the clear; https:// would hide it", self.url));
        }
        Ok(http)
    }

    /// The coordinator as the command line sees it.
    pub fn api(&self) -> Result<Api> {
        Ok(Api::of(self.http()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_gives_its_text_without_the_line_end() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("token");
        std::fs::write(&file, "manduca_0123\n").unwrap();
        assert_eq!(given(Some(&file)).unwrap().as_deref(), Some("manduca_0123"));
        let missing = given(Some(&folder.path().join("missing"))).unwrap_err();
        assert!(missing.to_string().contains("--token-file"), "{missing}");
    }
}
