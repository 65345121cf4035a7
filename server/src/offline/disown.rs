//! Results of a worker disowned beside a coordinator.

use manduca_protocol::ids::WorkerId;

use super::{Offline, OfflineError};
use crate::clock::{Clock, SystemClock};
use crate::config::Config;
use crate::store::disown_in;

impl Offline {
    /// Sets workers aside and disowns their results: the one of this id, or all that ever had this name.
    ///
    /// # Errors
    /// When there is none, or the database cannot be changed; then nothing is.
    pub async fn disown(&mut self, worker: &str) -> Result<Vec<WorkerId>, OfflineError> {
        let mut transaction = self.file.begin().await?;
        // Of the numbers of a coordinator none counts here.
        let (now, config) = (SystemClock::start().now_ms(), Config::new(""));
        let disowned = disown_in(&mut transaction, now, &config, worker).await;
        let disowned = disowned.map_err(|e| OfflineError::Refused(e.to_string()))?;
        if disowned.is_empty() {
            return Err(OfflineError::Refused(format!("no worker's name or id is `{worker}`")));
        }
        transaction.commit().await?;
        Ok(disowned)
    }
}
