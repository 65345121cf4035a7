//! What the disk itself can do.

use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Result;

const LONG_ENOUGH: Duration = Duration::from_millis(1000);

/// Durable writes of 4 KiB per second, one after the other, over a file which does not grow.
pub fn syncs_per_s(folder: &Path) -> Result<f64> {
    let mut file = tempfile::tempfile_in(folder)?;
    let page = [0x5a_u8; 4096];
    for _ in 0..64 {
        file.write_all(&page)?;
    }
    file.sync_all()?;
    let (start, mut n) = (Instant::now(), 0_u32);
    while start.elapsed() < LONG_ENOUGH {
        file.seek(SeekFrom::Start(u64::from(n % 64) * 4096))?;
        file.write_all(&page)?;
        file.sync_data()?;
        n += 1;
    }
    Ok(f64::from(n) / start.elapsed().as_secs_f64())
}
