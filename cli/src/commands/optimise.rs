//! `manduca optimise`: a further optimum on a network there is.

use std::process::ExitCode;

use anyhow::Result;
use manduca_protocol::study::{self, OptimisationSpec};

use super::study::watch;
use crate::args::{Method, OptimiseArgs};
use crate::exit::refused;
use crate::output::{Output, note};
use crate::text_file;

/// Asks a study for a further optimum.
pub async fn optimise(args: OptimiseArgs) -> Result<ExitCode> {
    let spec = specification(&args)?;
    let api = args.coordinator.api()?;
    let id = api.find(&args.study).await?;
    let added = api.add_optimisation(id, &spec).await?;
    if args.wait {
        note(format_args!("{} of study {id}", added.name));
        return watch(&api, id, args.json).await;
    }
    let mut out = Output::stdout();
    if args.json {
        out.json(&added)?;
    } else {
        out.line(format_args!("{} of {id} is asked for; `manduca optimum {id}` will show it", added.name))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The file's optimisation, or one of defaults, with the options' changes.
fn specification(args: &OptimiseArgs) -> Result<OptimisationSpec> {
    let mut spec: OptimisationSpec = match (&args.file, &args.name) {
        (Some(path), _) => {
            let text = text_file::read(path)?;
            let read = if text_file::is_json(path, &text) {
                serde_json::from_str(&text).map_err(|e| e.to_string())
            } else {
                toml::from_str(&text).map_err(|e| e.to_string())
            };
            read.map_err(|why| refused(format!("{}: {why}", path.display())))?
        }
        (None, name) => serde_json::from_value(serde_json::json!({ "name": name }))?,
    };
    if let Some(name) = &args.name {
        spec.name.clone_from(name);
    }
    if let Some(method) = args.method {
        spec = spec.by(match method {
            Method::Sqp => study::Method::Sqp,
            Method::Paper => study::Method::Paper,
            Method::Direct => study::Method::Direct,
        });
    }
    spec.starts = args.starts.unwrap_or(spec.starts);
    spec.population = args.population.or(spec.population);
    spec.generations = args.generations.or(spec.generations);
    spec.parameters.extend(args.set.iter().cloned());
    Ok(spec)
}
