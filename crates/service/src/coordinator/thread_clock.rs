//! The time that a thread has had a processor for.

#[cfg(target_os = "linux")]
use std::time::Duration;
#[cfg(not(target_os = "linux"))]
use std::time::Instant;

/// A clock of the time for which the calling thread has had a processor. Where there is none, of time.
#[derive(Debug)]
pub(super) struct ThreadClock(#[cfg(target_os = "linux")] Duration, #[cfg(not(target_os = "linux"))] Instant);

impl ThreadClock {
    #[cfg(target_os = "linux")]
    fn now() -> Duration {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Duration::new(time.tv_sec.unsigned_abs(), u32::try_from(time.tv_nsec).unwrap_or(0))
    }

    pub fn start() -> Self {
        #[cfg(target_os = "linux")]
        return Self(Self::now());
        #[cfg(not(target_os = "linux"))]
        return Self(Instant::now());
    }

    pub fn seconds(&self) -> f64 {
        #[cfg(target_os = "linux")]
        return Self::now().saturating_sub(self.0).as_secs_f64();
        #[cfg(not(target_os = "linux"))]
        return self.0.elapsed().as_secs_f64();
    }
}
