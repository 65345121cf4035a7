//! `manduca dataset`.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::process::ExitCode;

use anyhow::{Context, Result};

use crate::args::{DatasetArgs, DatasetFormat};
use crate::output::{Output, note};

/// Writes a dataset as it arrives, so that its size does not matter.
pub async fn dataset(args: DatasetArgs) -> Result<ExitCode> {
    let api = args.coordinator.api()?;
    let id = api.find(&args.study).await?;
    let media_type = match args.format {
        DatasetFormat::Csv => "text/csv",
        DatasetFormat::Json => "application/json",
        DatasetFormat::Ndjson => "application/x-ndjson",
    };
    let mut response = api.dataset(id, media_type).await?;
    let mut stdout;
    let mut file;
    let out: &mut dyn Write = match &args.output {
        Some(path) => {
            file = BufWriter::new(File::create(path).with_context(|| format!("cannot write {}", path.display()))?);
            &mut file
        }
        None => {
            stdout = Output::stdout();
            stdout.writer()
        }
    };
    while let Some(chunk) = response.chunk().await.context("the dataset broke off")? {
        out.write_all(&chunk)?;
    }
    out.flush()?;
    if let Some(path) = &args.output {
        note(format_args!("wrote {}", path.display()));
    }
    Ok(ExitCode::SUCCESS)
}
