//! `manduca token`: who may ask a coordinator for what.

use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use manduca_server::{Offline, OfflineError, Secret};

use super::serve::DATABASE;
use crate::args::{CreateTokenArgs, RevokeTokenArgs, TokenCommand, TokenListArgs};
use crate::exit::refused;
use crate::file::begin_secret;
use crate::output::{Output, note};

/// Does what was asked for.
pub async fn token(command: TokenCommand) -> Result<ExitCode> {
    match command {
        TokenCommand::Create(args) => create(args).await,
        TokenCommand::List(args) => list(args).await,
        TokenCommand::Revoke(args) => revoke(args).await,
    }
}

/// The database of a folder, to be changed. None is made: a mistyped folder would get one.
pub async fn open(data: &Path) -> Result<Offline> {
    Ok(Offline::open(&data.join(DATABASE)).await?)
}

/// The database of a folder, to look at.
pub async fn look(data: &Path) -> Result<Offline> {
    Ok(Offline::look(&data.join(DATABASE)).await?)
}

/// A refusal is the user's to mend; anything else is not.
pub fn told(error: OfflineError) -> anyhow::Error {
    match error {
        OfflineError::Refused(why) => refused(why),
        other => other.into(),
    }
}

async fn create(args: CreateTokenArgs) -> Result<ExitCode> {
    // Before the token is made: one nobody ever sees would be of no use, and its name is gone.
    let file = args.out.as_deref().map(|path| (path, begin_secret(path)));
    let file = match file {
        Some((path, Ok(file))) => Some((path, file)),
        Some((path, Err(error))) => return Err(refused(format!("--out {}: {error}", path.display()))),
        None => None,
    };
    let mut database = match args.init {
        true => Offline::make(&args.data.join(DATABASE)).await?,
        false => open(&args.data).await?,
    };
    let secret = database.create_token(&args.name, args.scope.iter().copied().collect()).await.map_err(told)?;
    database.close().await;
    if let Some((path, file)) = file {
        keep(path, file, &secret).with_context(|| {
            format!("token `{}` is made, but not written to {}: revoke it", args.name, path.display())
        })?;
        if args.json {
            Output::stdout().json(&serde_json::json!({ "name": args.name, "scopes": scopes(&args), "file": path }))?;
        }
        note(format_args!("token `{}` made; {} has it, and only you can read that", args.name, path.display()));
        return Ok(ExitCode::SUCCESS);
    }
    let mut out = Output::stdout();
    if args.json {
        out.json(&serde_json::json!({ "name": args.name, "scopes": scopes(&args), "token": secret.reveal() }))?;
    } else {
        out.line(secret.reveal())?;
    }
    note(format_args!("token `{}` made; it is shown this once and stored nowhere", args.name));
    Ok(ExitCode::SUCCESS)
}

fn scopes(args: &CreateTokenArgs) -> Vec<String> {
    args.scope.iter().map(ToString::to_string).collect()
}

/// Writes a token into its file.
fn keep(path: &Path, mut file: tempfile::NamedTempFile, secret: &Secret) -> io::Result<()> {
    writeln!(file, "{}", secret.reveal())?;
    file.as_file().sync_all()?;
    file.persist_noclobber(path)?;
    Ok(())
}

async fn list(args: TokenListArgs) -> Result<ExitCode> {
    let mut database = look(&args.data).await?;
    let tokens = database.tokens().await?;
    database.close().await;
    let mut out = Output::stdout();
    if args.json {
        out.json(&tokens)?;
        return Ok(ExitCode::SUCCESS);
    }
    let head = ["name", "scopes", "created", "revoked"].map(str::to_owned);
    let rows =
        tokens.into_iter().map(|t| vec![t.name, t.scopes, t.created_at, t.revoked_at.unwrap_or_else(|| "-".into())]);
    out.table(&head, &rows.collect::<Vec<_>>())?;
    Ok(ExitCode::SUCCESS)
}

async fn revoke(args: RevokeTokenArgs) -> Result<ExitCode> {
    let mut database = open(&args.data).await?;
    database.revoke_token(&args.name).await.map_err(told)?;
    database.close().await;
    if args.json {
        Output::stdout().json(&serde_json::json!({ "name": args.name, "revoked": true }))?;
    } else {
        note(format_args!("token `{}` allows nothing any more", args.name));
    }
    Ok(ExitCode::SUCCESS)
}
