//! When tasks ran, and for how long. The clock also counts the time of other threads on the same core, and a device's
//! thread, which is one more than there are cores, is interrupted wherever it wakes another.

/// The times of a task, in nanoseconds since the start of the service.
#[derive(Clone, Copy)]
pub struct TaskTimes {
    pub start_ns: u64,
    pub end_ns: u64,
    /// CPU time of the thread, where it counts.
    pub cpu_ns: Option<u64>,
}

/// CPU time of the calling thread in nanoseconds; `None` on systems other than Linux.
#[cfg(target_os = "linux")]
pub fn thread_ns() -> Option<u64> {
    use rustix::time::{ClockId, clock_gettime};
    let time = clock_gettime(ClockId::ThreadCPUTime);
    Some(u64::try_from(time.tv_sec).ok()? * 1_000_000_000 + u64::try_from(time.tv_nsec).ok()?)
}

/// CPU time of the calling thread in nanoseconds; `None` on systems other than Linux.
#[cfg(not(target_os = "linux"))]
pub fn thread_ns() -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    #[test]
    fn a_thread_that_sleeps_takes_no_time() {
        let Some(before) = thread_ns() else { return };
        std::thread::sleep(Duration::from_millis(60));
        let slept = thread_ns().expect("again") - before;
        assert!(slept < 30_000_000, "{slept} ns");
        let begun = Instant::now();
        while thread_ns().expect("again") - before - slept < 1_000_000 {
            assert!(begun.elapsed() < Duration::from_secs(60));
        }
    }
}
