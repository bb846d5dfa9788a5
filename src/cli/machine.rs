//! What the machine has, and what this process took of it.

use std::fs;
use std::path::Path;

/// Memory taken for granted where the system does not tell.
const UNKNOWN: u64 = 4 << 30;

/// Three quarters of the memory that this process may use, in bytes.
pub(super) fn default_budget() -> u64 {
    let installed = field_in_kib("/proc/meminfo", "MemTotal:").unwrap_or(UNKNOWN);
    installed.min(group_limit().unwrap_or(u64::MAX)) / 4 * 3
}

/// Largest resident size of this process so far, in bytes; `None` where the system does not tell.
pub(super) fn peak_memory() -> Option<u64> {
    field_in_kib("/proc/self/status", "VmHWM:")
}

/// A line such as `MemTotal:  123 kB`, in bytes.
fn field_in_kib(path: &str, name: &str) -> Option<u64> {
    let text = fs::read_to_string(path).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// The smallest limit among this process's control groups, which is how containers and batch systems cap memory.
fn group_limit() -> Option<u64> {
    let groups = fs::read_to_string("/proc/self/cgroup").ok()?;
    let group = groups.lines().find_map(|line| line.strip_prefix("0::/"))?;
    let root = Path::new("/sys/fs/cgroup");
    root.join(group)
        .ancestors()
        .take_while(|folder| folder.starts_with(root))
        .filter_map(|folder| fs::read_to_string(folder.join("memory.max")).ok()?.trim().parse().ok())
        .min()
}
