//! `manduca dataset` and `manduca study model`.

use std::io::{IsTerminal, Write, stdout as terminal};
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};

use crate::args::{DatasetArgs, DatasetFormat, SurrogateArgs, SurrogateFormat};
use crate::endings;
use crate::exit::{INTERRUPTED, refused};
use crate::file::Draft;
use crate::output::{Output, note};
use crate::signals;
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
    save(response, args.output.as_deref(), Some(whole)).await
}

/// Writes an answer as it arrives, to standard output or into a file, which appears when all of it is there;
/// fails where it does not come whole.
pub async fn save(mut response: reqwest::Response, path: Option<&Path>, mut whole: Option<Whole>) -> Result<ExitCode> {
    let Some(path) = path else {
        let mut out = Output::stdout();
        while let Some(chunk) = response.chunk().await.context("the answer broke off")? {
            out.writer().write_all(&chunk)?;
            take(&mut whole, &chunk);
        }
        out.writer().flush()?;
        whole.as_ref().map_or(Ok(()), Whole::check)?;
        return Ok(ExitCode::SUCCESS);
    };
    let told = || format!("cannot write {}", path.display());
    let mut draft = Draft::begin(path).with_context(told)?;
    let interrupted = signals::shutdown();
    loop {
        let chunk = tokio::select! {
            chunk = response.chunk() => chunk,
            () = interrupted.drain.cancelled() => {
                note(format_args!("interrupted; {} is as it was", path.display()));
                return Ok(ExitCode::from(INTERRUPTED));
            }
        };
        let chunk = chunk.with_context(|| format!("the answer broke off; {} is as it was", path.display()))?;
        let Some(chunk) = chunk else { break };
        draft.write_all(&chunk).with_context(told)?;
        take(&mut whole, &chunk);
    }
    let checked = whole.as_ref().map_or(Ok(()), Whole::check);
    checked.with_context(|| format!("{} is as it was", path.display()))?;
    draft.finish().with_context(told)?;
    note(format_args!("wrote {}", path.display()));
    Ok(ExitCode::SUCCESS)
}

fn take(whole: &mut Option<Whole>, chunk: &[u8]) {
    if let Some(whole) = whole {
        whole.take(chunk);
    }
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
    save(api.part(id, "surrogate/model", media_type).await?, output, None).await
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
