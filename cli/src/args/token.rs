//! `manduca token ...`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use manduca_server::Scope;

/// `manduca token ...`.
#[derive(Debug, Subcommand)]
pub enum TokenCommand {
    /// Make a token and print it, once: it is stored nowhere.
    Create(CreateTokenArgs),
    /// List the tokens by name, the revoked ones too.
    List(TokenListArgs),
    /// End a token.
    Revoke(RevokeTokenArgs),
}

/// `manduca token create`.
#[derive(Debug, Args)]
#[command(after_help = "\
Works on the coordinator's database, while it runs too: on its machine, as its user.

Scopes:
  read     look at everything
  submit   submit and steer studies, and look at them
  worker   take jobs and return results
  admin    all of these, and drain workers

Examples:
  manduca token create cluster --scope worker --out worker-token
  manduca token create ada --scope submit
  manduca token create root --scope admin --init         before the first start of a coordinator")]
pub struct CreateTokenArgs {
    /// Name for people, to revoke it by.
    pub name: String,
    /// What it allows; may be given more than once.
    #[arg(long, required = true, value_delimiter = ',')]
    pub scope: Vec<Scope>,
    /// Folder of the database.
    #[arg(long, value_name = "DIR", default_value = "manduca-data", env = "MANDUCA_DATA")]
    pub data: PathBuf,
    /// Write the token to a new file which only you can read, instead of printing it.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Make the database when there is none yet.
    #[arg(long)]
    pub init: bool,
    /// Print one JSON object: name, scopes and the token, or its file.
    #[arg(long)]
    pub json: bool,
}

/// `manduca token list`.
#[derive(Debug, Args)]
pub struct TokenListArgs {
    /// Folder of the database.
    #[arg(long, value_name = "DIR", default_value = "manduca-data", env = "MANDUCA_DATA")]
    pub data: PathBuf,
    /// Print one JSON array.
    #[arg(long)]
    pub json: bool,
}

/// `manduca token revoke`.
#[derive(Debug, Args)]
#[command(after_help = "A running coordinator notices within a second.")]
pub struct RevokeTokenArgs {
    /// Its name.
    pub name: String,
    /// Folder of the database.
    #[arg(long, value_name = "DIR", default_value = "manduca-data", env = "MANDUCA_DATA")]
    pub data: PathBuf,
    /// Print one JSON object: the name.
    #[arg(long)]
    pub json: bool,
}
