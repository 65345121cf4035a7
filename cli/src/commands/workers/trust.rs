//! `manduca workers disown` and `readmit`.

use std::process::ExitCode;

use anyhow::Result;
use manduca_protocol::ids::WorkerId;

use crate::api::Api;
use crate::args::{DisownArgs, ReadmitArgs};
use crate::commands::token::{open, told};
use crate::exit::refused;
use crate::output::{Output, note};

/// Sets workers aside and disowns their results.
pub async fn disown(args: DisownArgs) -> Result<ExitCode> {
    let ids = if let Some(data) = &args.data {
        let mut database = open(data).await?;
        let ids = database.disown(&args.worker).await.map_err(told)?;
        database.close().await;
        ids
    } else {
        let api = args.coordinator.api()?;
        let ids = meant(&api, &args.worker).await?;
        for id in &ids {
            api.disown(*id).await?;
        }
        ids
    };
    done(&ids, args.json, "is set aside, and its results are disowned")
}

/// Gives jobs again to workers that were set aside.
pub async fn readmit(args: ReadmitArgs) -> Result<ExitCode> {
    let api = args.coordinator.api()?;
    let ids = meant(&api, &args.worker).await?;
    for id in &ids {
        api.readmit(*id).await?;
    }
    done(&ids, args.json, "may have jobs again")
}

fn done(ids: &[WorkerId], json: bool, what: &str) -> Result<ExitCode> {
    for id in ids {
        note(format_args!("worker {id} {what}"));
    }
    if json {
        Output::stdout().json(&ids)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The worker of an id, known to the list or not, or all listed of a name.
async fn meant(api: &Api, text: &str) -> Result<Vec<WorkerId>> {
    if let Ok(id) = text.parse() {
        return Ok(vec![id]);
    }
    let ids: Vec<_> = api.workers_called(text).await?.into_iter().map(|w| w.id).collect();
    if ids.is_empty() {
        let why = "no worker which is there has this name; give the id: `manduca dataset --provenance` and `manduca explain` name who computed what";
        return Err(refused(format!("`{text}`: {why}")));
    }
    Ok(ids)
}
