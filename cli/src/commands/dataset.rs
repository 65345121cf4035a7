//! `manduca dataset` and `manduca study model`.

use std::fs::File;
use std::io::{BufWriter, IsTerminal, Write, stdout as terminal};
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};

use crate::args::{DatasetArgs, DatasetFormat, SurrogateArgs, SurrogateFormat};
use crate::endings;
use crate::exit::refused;
use crate::output::{Output, note};
use crate::whole::Whole;

/// Endings of a dataset's file.
const DATASETS: [(&str, DatasetFormat); 5] = [
    ("csv", DatasetFormat::Csv),
    ("ndjson", DatasetFormat::Ndjson),
    ("jsonl", DatasetFormat::Ndjson),
    ("json", DatasetFormat::Json),
    ("parquet", DatasetFormat::Parquet),
];
/// Endings of a surrogate's file.
const SURROGATES: [(&str, SurrogateFormat); 2] = [("json", SurrogateFormat::Json), ("onnx", SurrogateFormat::Onnx)];

/// Writes a dataset as it arrives, so that its size does not matter.
pub async fn dataset(args: DatasetArgs) -> Result<ExitCode> {
    let format = format(&args)?;
    let api = args.coordinator.api()?;
    let id = api.find(&args.study).await?;
    let media_type = match format {
        DatasetFormat::Csv => "text/csv",
        DatasetFormat::Json => "application/json",
        DatasetFormat::Ndjson => "application/x-ndjson",
        DatasetFormat::Parquet => "application/vnd.apache.parquet",
    };
    let part = if args.provenance { "dataset?provenance=true" } else { "dataset" };
    let response = api.part(id, part, media_type).await?;
    let whole = Whole::of(format, &response);
    save(response, args.output.as_deref(), Some(whole)).await?;
    Ok(ExitCode::SUCCESS)
}

/// Writes an answer as it arrives into a file, or to standard output; fails where it does not come whole.
pub async fn save(mut response: reqwest::Response, path: Option<&Path>, mut whole: Option<Whole>) -> Result<()> {
    let mut stdout;
    let mut file;
    let out: &mut dyn Write = match path {
        Some(path) => {
            file = BufWriter::new(File::create(path).with_context(|| format!("cannot write {}", path.display()))?);
            &mut file
        }
        None => {
            stdout = Output::stdout();
            stdout.writer()
        }
    };
    while let Some(chunk) = response.chunk().await.context("the answer broke off")? {
        out.write_all(&chunk)?;
        if let Some(whole) = &mut whole {
            whole.take(&chunk);
        }
    }
    out.flush()?;
    whole.as_ref().map_or(Ok(()), Whole::check)?;
    if let Some(path) = path {
        note(format_args!("wrote {}", path.display()));
    }
    Ok(())
}

/// Writes the surrogate of a study.
pub async fn model(args: SurrogateArgs) -> Result<ExitCode> {
    let output = args.output.as_deref();
    let format = endings::chosen("-o", output, args.format, &SURROGATES, SurrogateFormat::Json)?;
    let media_type = match format {
        SurrogateFormat::Json => "application/json",
        SurrogateFormat::Onnx => "application/onnx",
    };
    binary(format == SurrogateFormat::Onnx, output, "net.onnx")?;
    let api = args.coordinator.api()?;
    let id = api.find(&args.study).await?;
    save(api.part(id, "surrogate/model", media_type).await?, output, None).await?;
    Ok(ExitCode::SUCCESS)
}

/// As asked, else by the ending of the file.
fn format(args: &DatasetArgs) -> Result<DatasetFormat> {
    let output = args.output.as_deref();
    let format = endings::chosen("-o", output, args.format, &DATASETS, DatasetFormat::Csv)?;
    binary(format == DatasetFormat::Parquet, output, "samples.parquet")?;
    Ok(format)
}

/// Refuses to fill a terminal with bytes which are no text.
fn binary(is: bool, output: Option<&Path>, such_as: &str) -> Result<()> {
    if is && output.is_none() && terminal().is_terminal() {
        return Err(refused(format!("these bytes are no text for a terminal: name a file, such as -o {such_as}")));
    }
    Ok(())
}
