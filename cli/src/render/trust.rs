//! What a study's audits found, and whose results are not believed.

use std::io;

use manduca_protocol::trust::{AuditVerdicts, DistrustedWorker};
use manduca_protocol::view::StudyView;

use super::study::disowned;
use crate::output::{Output, counted};

/// Audits compared, workers that are not believed, and results that the study still rests on.
pub fn trust(out: &mut Output, view: &StudyView) -> io::Result<()> {
    if let Some(line) = audits(&view.audit_verdicts) {
        out.line(line)?;
    }
    for worker in &view.distrusted {
        out.line(distrusted(worker))?;
    }
    disowned(out, view.disowned_results)
}

fn audits(verdicts: &AuditVerdicts) -> Option<String> {
    if verdicts.is_empty() {
        return None;
    }
    let agree = verdicts.independent + verdicts.not_independent;
    let mut line = format!("audits    {agree} agree, {} of them not independent", verdicts.not_independent);
    if verdicts.disputed > 0 {
        line += &format!("; {} differ and are flown by the coordinator", verdicts.disputed);
    }
    if verdicts.undecided > 0 {
        line += &format!("; {} differ and could not be settled", verdicts.undecided);
    }
    Some(line)
}

fn distrusted(worker: &DistrustedWorker) -> String {
    let standing = worker.reason.as_deref().map_or("readmitted since".into(), |why| format!("set aside: {why}"));
    format!(
        "DOUBTFUL  worker `{}`, {standing}; {} dropped and computed again, {} kept",
        worker.name,
        counted(worker.replaced, "result"),
        worker.disowned
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use manduca_protocol::ids::WorkerId;

    #[test]
    fn what_was_compared_and_who_lied_is_told() {
        assert_eq!(audits(&AuditVerdicts::default()), None);
        let verdicts = AuditVerdicts { independent: 7, not_independent: 2, disputed: 1, undecided: 0 };
        let told = audits(&verdicts).unwrap();
        assert!(told.contains("9 agree, 2 of them not independent; 1 differ"), "{told}");
        let worker = DistrustedWorker {
            worker: WorkerId::new(),
            name: "node17".into(),
            token: None,
            reason: Some("its result of job 3 differs".into()),
            replaced: 1,
            disowned: 0,
        };
        let told = distrusted(&worker);
        assert!(told.contains("`node17`, set aside: its result of job 3 differs; 1 result dropped"), "{told}");
    }
}
