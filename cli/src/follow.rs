//! Watching a study to its end.

use std::time::{Duration, Instant};

use anyhow::Result;
use manduca_protocol::ids::StudyId;
use manduca_protocol::view::{StudyState, StudyView};
use tokio_util::sync::CancellationToken;

use crate::api::Api;
use crate::progress::{Meter, glance};

mod workless;

/// Between two looks.
const LOOK: Duration = Duration::from_millis(400);
/// Failed looks in a row before following is given up: a coordinator may be restarted meanwhile.
const MOST_FAILURES: u32 = 150;

/// How following ended.
pub enum Followed {
    /// With the study.
    Ended(Box<StudyView>),
    /// By Ctrl-C.
    Interrupted,
}

/// Follows a study until it ends or `interrupted` is cancelled.
pub async fn follow(api: &Api, id: StudyId, interrupted: &CancellationToken) -> Result<Followed> {
    let (mut meter, mut workless) = (Meter::new(), workless::Workless::default());
    let mut failures = 0;
    loop {
        let look = tokio::select! {
            () = interrupted.cancelled() => {
                meter.finish(false);
                return Ok(Followed::Interrupted);
            }
            look = api.study(id) => look,
        };
        match look {
            Ok(view) if is_over(view.state) => {
                meter.finish(view.state == StudyState::Succeeded);
                return Ok(Followed::Ended(Box::new(view)));
            }
            Ok(view) => {
                if failures > 0 {
                    meter.say("the coordinator answers again");
                }
                failures = 0;
                meter.show(glance(&view));
                if workless.asks(workless::waits(&view), Instant::now())
                    && let Ok(there) = api.scaling().await
                    && let Some(text) = workless.says(&there, api.address(), Instant::now())
                {
                    meter.say(&text);
                }
            }
            Err(error) if error.is_passing() && failures < MOST_FAILURES => {
                if failures == 0 {
                    meter.say(&format!("{error}; trying again"));
                }
                failures += 1;
            }
            Err(error) => {
                meter.finish(false);
                return Err(error.into());
            }
        }
        tokio::select! {
            () = interrupted.cancelled() => {}
            () = tokio::time::sleep(LOOK) => {}
        }
    }
}

/// Whether a study has come to its end.
pub fn is_over(state: StudyState) -> bool {
    matches!(state, StudyState::Succeeded | StudyState::Failed | StudyState::Cancelled)
}
