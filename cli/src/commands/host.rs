//! What the machine says about itself.

use std::io;
use std::path::{Path, PathBuf};

/// The program a compute slot starts: this very one. On Linux by way of `/proc`,
/// so that a worker whose file is replaced while it runs does not start slots of
/// another version.
pub fn this_program() -> io::Result<PathBuf> {
    let link = Path::new("/proc/self/exe");
    if link.exists() { Ok(link.to_owned()) } else { std::env::current_exe() }
}

/// Name of the host, or `worker` where it has none.
pub fn name() -> String {
    let told = std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let told = told.or_else(|| std::env::var("HOSTNAME").ok()).or_else(|| std::env::var("COMPUTERNAME").ok());
    told.map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).unwrap_or_else(|| "worker".into())
}
