//! A budget of memory, checked before large things are allocated.
//!
//! Whoever is about to allocate counts the bytes first and asks the budget, so that a small file or a slip of the
//! keyboard is refused with both numbers, and the process is never killed for it.

#[doc(hidden)]
pub mod huge_vectors;

use std::path::Path;

/// The most bytes that a process may take. A plain value: callers add up what they hold.
///
/// ```
/// use raystream_rays::memory::MemoryBudget;
///
/// let budget = MemoryBudget::of_bytes(1 << 30);
/// assert!(budget.check("a picture", 28 * 1920 * 1080).is_ok());
/// let refusal = budget.check("a picture", 28 << 28).unwrap_err();
/// assert_eq!(refusal.to_string(), "a picture needs 7.52 GB of memory, but at most 1.07 GB may be used");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryBudget {
    bytes: u64,
}

/// Memory that cannot be had.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum OutOfMemory {
    /// More is needed than the budget allows.
    #[error("{what} needs {} of memory, but at most {} may be used", readable(*needed), readable(*allowed))]
    OverBudget {
        /// Purpose of the memory.
        what: String,
        /// The bytes that are needed.
        needed: u64,
        /// The bytes of the budget.
        allowed: u64,
    },
    /// The system does not give it.
    #[error("{what} needs {} of memory, which the system does not give", readable(*needed))]
    Refused {
        /// Purpose of the memory.
        what: String,
        /// The bytes that are needed.
        needed: u64,
    },
}

impl MemoryBudget {
    /// No limit.
    pub const UNLIMITED: Self = Self { bytes: u64::MAX };

    /// A limit in bytes.
    pub fn of_bytes(bytes: u64) -> Self {
        Self { bytes }
    }

    /// Seven eighths of what this process can have: the least of the machine's memory, the limits of its control
    /// groups, and the limit of its address space. Unlimited where the system does not tell (outside Linux).
    pub fn of_machine() -> Self {
        let limits = [physical(), control_group(), address_space()];
        limits.into_iter().flatten().min().map_or(Self::UNLIMITED, |bytes| Self { bytes: bytes / 8 * 7 })
    }

    /// The limit in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Checks that `needed` bytes are within the budget. `what` begins the message: a noun and what it consists of.
    ///
    /// # Errors
    /// When they are not, with both numbers.
    pub fn check(&self, what: impl Into<String>, needed: u64) -> Result<(), OutOfMemory> {
        if needed <= self.bytes {
            return Ok(());
        }
        Err(OutOfMemory::OverBudget { what: what.into(), needed, allowed: self.bytes })
    }
}

/// The budget of the machine.
impl Default for MemoryBudget {
    fn default() -> Self {
        Self::of_machine()
    }
}

/// Bytes in a unit that keeps the number short.
pub fn readable(bytes: u64) -> String {
    match bytes {
        0..1_000_000 => format!("{bytes} bytes"),
        1_000_000..1_000_000_000 => format!("{:.2} MB", bytes as f64 * 1e-6),
        _ => format!("{:.2} GB", bytes as f64 * 1e-9),
    }
}

/// The machine's memory.
fn physical() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    kibibytes(&text, "MemTotal:")
}

/// Bytes that may still be mapped into the address space (`ulimit -v`).
fn address_space() -> Option<u64> {
    let limits = std::fs::read_to_string("/proc/self/limits").ok()?;
    let limit = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    let limit: u64 = limit.split_whitespace().next()?.parse().ok()?;
    let mapped = kibibytes(&std::fs::read_to_string("/proc/self/status").ok()?, "VmSize:")?;
    Some(limit.saturating_sub(mapped))
}

/// A number of a list such as `/proc/meminfo`, in bytes.
fn kibibytes(text: &str, key: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// The least limit of the process's control group and the groups that contain it, of either version.
fn control_group() -> Option<u64> {
    let groups = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    groups.lines().flat_map(|line| group_limit(line, Path::new("/sys/fs/cgroup"))).min()
}

/// The least limit that one line of `/proc/self/cgroup` leads to. A container may see its own group as the root.
fn group_limit(line: &str, root: &Path) -> Option<u64> {
    let mut parts = line.splitn(3, ':').skip(1);
    let (controllers, path) = (parts.next()?, parts.next()?);
    let (root, file) = match controllers {
        "" => (root.to_owned(), "memory.max"),
        _ if controllers.split(',').any(|name| name == "memory") => {
            (root.join("memory"), "memory.limit_in_bytes")
        }
        _ => return None,
    };
    let limit =
        |group: &Path| -> Option<u64> { std::fs::read_to_string(group.join(file)).ok()?.trim().parse().ok() };
    let group = root.join(path.trim_start_matches('/'));
    group.ancestors().take_while(|group| group.starts_with(&root)).filter_map(limit).min()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refusals_give_both_numbers_in_readable_units() {
        let budget = MemoryBudget::of_bytes(2_500_000);
        assert_eq!(budget.check("it", 2_500_000), Ok(()));
        let refusal = budget.check("it", 2_500_001).unwrap_err();
        assert_eq!(refusal.to_string(), "it needs 2.50 MB of memory, but at most 2.50 MB may be used");
        assert_eq!(readable(4096), "4096 bytes");
        assert!(MemoryBudget::UNLIMITED.check("all", u64::MAX).is_ok());
    }

    #[test]
    fn machines_have_memory() {
        let bytes = MemoryBudget::of_machine().bytes();
        assert!(bytes > 1 << 20, "{bytes}");
        assert_eq!(kibibytes("A:  1 kB\nMemTotal:   12 kB\n", "MemTotal:"), Some(12 << 10));
    }

    #[test]
    fn the_least_limit_of_nested_groups_counts() {
        let root = std::env::temp_dir().join(format!("raystream-groups-{}", std::process::id()));
        let write = |group: &str, file: &str, limit: &str| {
            let group = root.join(group);
            std::fs::create_dir_all(&group).expect("folder");
            std::fs::write(group.join(file), limit).expect("file");
        };
        write("a/b", "memory.max", "max\n");
        write("a", "memory.max", "3000\n");
        write("memory/c", "memory.limit_in_bytes", "500\n");
        write("memory", "memory.limit_in_bytes", "9223372036854771712\n");
        let limit = |line: &str| group_limit(line, &root);
        assert_eq!(limit("0::/a/b"), Some(3000));
        assert_eq!(limit("4:memory:/c"), Some(500));
        assert_eq!(limit("4:memory:/elsewhere"), Some(9_223_372_036_854_771_712));
        assert_eq!(limit("3:cpuset:/a"), None);
        assert_eq!(limit("0::/x"), None);
        std::fs::remove_dir_all(&root).expect("the folder");
    }
}
