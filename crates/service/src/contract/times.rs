//! Sizes and times that both sides of a bus keep to.

use std::time::Duration;

/// The most bytes of a part of a film or scene that travels in one message. Servers take messages of 1 MiB.
pub const PART_BYTES: usize = 512 << 10;

/// Questions that the coordinator answers at the same time.
pub const ANSWERED_TOGETHER: usize = 32;

/// The time for which a worker may be silent about a unit before another one gets it.
pub const LEASE: Duration = Duration::from_secs(15);

/// Reports of a worker within a lease, at least: a lost one is no reason to give its unit to another.
pub const BEATS: u32 = 3;

/// The time between two reports of a worker, which renew its leases. Orders to stop come back with the answer, so a job
/// is cancelled everywhere within a second.
pub const REPORT: Duration = Duration::from_millis(400);
