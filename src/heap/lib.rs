//! What the program asks of the allocator that safe Rust cannot: a package of its own, so that all of vdbake forbids unsafe code.

/// Gives the system back what has been freed, where the allocator would keep it for later (glibc's does).
pub fn give_back() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: malloc_trim takes any padding, and only unmaps or advises away pages in which nothing is allocated.
    unsafe {
        libc::malloc_trim(0);
    }
}
