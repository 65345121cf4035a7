//! Open files: what the system allows, and what compute slots need.

use anyhow::Result;

use crate::exit::refused;
use crate::output::note;

/// Open files of one compute slot: three pipes and the process itself.
const PER_SLOT: u64 = 4;
/// Open files of a process beside its slots: connections, the database, logs, slots being started.
const OTHERS: u64 = 64;

/// Slots which may be started: as many as asked for, or by default as many as the open files allow.
///
/// # Errors
/// When not even the hard limit of open files suffices for what is asked for.
pub fn slots(asked: Option<usize>, default: usize) -> Result<usize> {
    let wanted = asked.unwrap_or(default);
    // Where the limit cannot be had, whatever fails says so itself.
    let allowed = rlimit::increase_nofile_limit(needed(wanted)).unwrap_or(u64::MAX);
    match (fitting(wanted, allowed), asked) {
        (fits, _) if fits >= wanted => Ok(wanted),
        (fits, None) if fits > 0 => {
            note(format_args!("{fits} slots instead of {default}: {}", limit(wanted, allowed)));
            Ok(fits)
        }
        (fits, _) => Err(refused(format!("{}; --slots {} would fit", limit(wanted, allowed), fits.max(1)))),
    }
}

/// As many connections as wanted, or as the system lets this process have open.
pub fn connections(wanted: usize) -> usize {
    match rlimit::increase_nofile_limit(wanted as u64 + OTHERS) {
        Ok(files) => usize::try_from(files.saturating_sub(OTHERS)).unwrap_or(wanted).clamp(16, wanted),
        Err(_) => wanted,
    }
}

fn needed(slots: usize) -> u64 {
    OTHERS.saturating_add(PER_SLOT.saturating_mul(slots as u64))
}

/// Slots for which so many open files suffice.
fn fitting(wanted: usize, allowed: u64) -> usize {
    usize::try_from(allowed.saturating_sub(OTHERS) / PER_SLOT).unwrap_or(usize::MAX).min(wanted)
}

fn limit(wanted: usize, allowed: u64) -> String {
    let needed = needed(wanted);
    format!(
        "{wanted} slots need {needed} open files and this process may have {allowed} (`ulimit -n` shows the limit, the \
         system's administrator raises it)"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_need_four_open_files_each() {
        assert_eq!((needed(80), fitting(80, needed(80)), fitting(80, needed(80) - 1)), (384, 80, 79));
        assert_eq!((fitting(80, 256), fitting(80, 64), fitting(80, 10), fitting(80, u64::MAX)), (48, 0, 0, 80));
        assert!(limit(80, 256).contains("384") && limit(80, 256).contains("256"));
    }
}
