//! What the machine has, and what this process took of it.

use std::fs;
use std::io::Write;
use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::OnceLock;
use std::time::Instant;

use cpu_time::ThreadTime;

/// Memory taken for granted where the system does not tell.
const UNKNOWN: u64 = 4 << 30;
/// Bytes that each thread reserves: for its stack, with what guards it, and for what the allocator keeps apart for it.
const STACK: u64 = (2 << 20) + (64 << 10);
const HEAP: u64 = 64 << 20;
/// Bytes that are free before threads are begun, or nothing is.
const BEGINNING: usize = 4 << 20;
/// MiB that are written, and kept, at once to learn how fast a disk is.
const PIECE: usize = 32;
/// So many times a piece is written at most, and for no more than so many seconds is another one begun.
const PIECES: usize = 64;
const PATIENCE: f64 = 3.0;
/// One byte in so many is written.
const ONE_IN: u64 = 4;

/// Three quarters of the memory that this process may use, in bytes.
pub(super) fn default_budget() -> u64 {
    let installed = field_in_kib("/proc/meminfo", "MemTotal:").unwrap_or(UNKNOWN);
    let limits = [group_limit(), process_limit()].into_iter().flatten();
    limits.fold(installed, u64::min) / 4 * 3
}

/// Threads to work with: one for each processor, or fewer where the address space is limited so much that they would reserve
/// half of it.
pub(super) fn threads() -> usize {
    let processors = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    let space = fs::read_to_string("/proc/self/limits").ok();
    let space = space.and_then(|limits| soft_limit(&limits, "Max address space")).unwrap_or(u64::MAX);
    processors.min(usize::try_from(space / 2 / (STACK + HEAP)).unwrap_or(usize::MAX)).max(1)
}

/// Whether the system has the memory that so many threads take to begin with, of which this is one.
pub(super) fn is_room_for(threads: usize) -> bool {
    let stacks = usize::try_from(STACK).ok().and_then(|stack| stack.checked_mul(threads));
    let bytes = stacks.and_then(|stacks| stacks.checked_add(BEGINNING));
    bytes.is_some_and(|bytes| Vec::<u8>::new().try_reserve_exact(bytes).is_ok())
}

/// As `/proc/self/limits` has it, in bytes; `None` where it is unlimited.
fn soft_limit(limits: &str, name: &str) -> Option<u64> {
    let line = limits.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse().ok()
}

/// Bytes that this process may use where the system limits its address space or data (`ulimit -v`, `ulimit -d`); `None`
/// where it does not, or does not tell. Found out once, best when all threads run: stacks and allocators reserve more than
/// they use, and that counts, too.
pub(super) fn process_limit() -> Option<u64> {
    static LIMIT: OnceLock<Option<u64>> = OnceLock::new();
    *LIMIT.get_or_init(|| {
        let limits = fs::read_to_string("/proc/self/limits").ok()?;
        let left = |name: &str, reserved: &str, used: &str| {
            let limit = soft_limit(&limits, name)?;
            let [reserved, used] = [reserved, used].map(|name| field_in_kib("/proc/self/status", name));
            Some(limit.saturating_sub(reserved?.saturating_sub(used?)))
        };
        let space = left("Max address space", "VmSize:", "VmRSS:");
        space.into_iter().chain(left("Max data size", "VmData:", "RssAnon:")).min()
    })
}

/// Largest resident size of this process so far, in bytes; `None` where the system does not tell.
pub(super) fn peak_memory() -> Option<u64> {
    field_in_kib("/proc/self/status", "VmHWM:")
}

/// Resident size of this process now, in bytes; `None` where the system does not tell.
pub(super) fn memory() -> Option<u64> {
    field_in_kib("/proc/self/status", "VmRSS:")
}

/// Bytes that a folder's disk has free; `None` where the system does not tell.
pub(super) fn free_space(folder: &Path) -> Option<u64> {
    fs4::available_space(folder).ok()
}

/// Seconds that a folder's disk takes to keep a byte of so many, by the clock and of a processor, tried out on a nameless file;
/// `None` where none can be made.
///
/// A part of as many is written, since many disks are fast at first only: what counts by the clock is the last quarter.
#[allow(clippy::cast_precision_loss, reason = "sizes")]
pub(super) fn disk_speed(folder: &Path, bytes: u64) -> Option<[f64; 2]> {
    let mut file = tempfile::tempfile_in(folder).ok()?;
    // Other than zeros, which some disks do not keep.
    let mebibyte: Vec<u8> =
        (0..1_u32 << 18).flat_map(|n| n.wrapping_mul(0x9e37_79b9).to_le_bytes()).collect();
    let piece = PIECE * mebibyte.len();
    let most = usize::try_from(bytes / ONE_IN).unwrap_or(usize::MAX) / piece;
    let (clock, cpu) = (Instant::now(), ThreadTime::now());
    let mut seconds = Vec::new();
    while seconds.len() < most.clamp(1, PIECES) && clock.elapsed().as_secs_f64() < PATIENCE {
        let begun = Instant::now();
        (0..PIECE).try_for_each(|_| file.write_all(&mebibyte)).and_then(|()| file.sync_data()).ok()?;
        seconds.push(begun.elapsed().as_secs_f64());
    }
    let last = &seconds[seconds.len() - seconds.len().div_ceil(4)..];
    let per_byte = |seconds: f64, pieces: usize| seconds / (pieces * piece) as f64;
    Some([per_byte(last.iter().sum(), last.len()), per_byte(cpu.elapsed().as_secs_f64(), seconds.len())])
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
