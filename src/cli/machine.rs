//! What the machine has, and what this process took of it.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

use cpu_time::ThreadTime;

/// Memory taken for granted where the system does not tell.
const UNKNOWN: u64 = 4 << 30;
/// MiB that are written to learn how fast a disk is.
const TRIAL: usize = 32;

/// Three quarters of the memory that this process may use, in bytes.
pub(super) fn default_budget() -> u64 {
    let installed = field_in_kib("/proc/meminfo", "MemTotal:").unwrap_or(UNKNOWN);
    installed.min(group_limit().unwrap_or(u64::MAX)) / 4 * 3
}

/// Largest resident size of this process so far, in bytes; `None` where the system does not tell.
pub(super) fn peak_memory() -> Option<u64> {
    field_in_kib("/proc/self/status", "VmHWM:")
}

/// Bytes that a folder's disk has free; `None` where the system does not tell.
pub(super) fn free_space(folder: &Path) -> Option<u64> {
    fs4::available_space(folder).ok()
}

/// Seconds that a folder's disk takes to keep a byte, by the clock and of a processor, tried out on a nameless file; `None`
/// where none can be made.
pub(super) fn disk_speed(folder: &Path) -> Option<[f64; 2]> {
    let mut file = tempfile::tempfile_in(folder).ok()?;
    // Other than zeros, which some disks do not keep.
    let piece: Vec<u8> = (0..1_u32 << 18).flat_map(|n| n.wrapping_mul(0x9e37_79b9).to_le_bytes()).collect();
    let (clock, cpu) = (Instant::now(), ThreadTime::now());
    (0..TRIAL).try_for_each(|_| file.write_all(&piece)).and_then(|()| file.sync_all()).ok()?;
    #[allow(clippy::cast_precision_loss, reason = "32 MiB")]
    let bytes = (TRIAL * piece.len()) as f64;
    Some([clock.elapsed(), cpu.elapsed()].map(|time| time.as_secs_f64() / bytes))
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
