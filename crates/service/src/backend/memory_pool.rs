//! One budget of memory over all scenes of a process: those that are being read, here and in processes of their own,
//! and those that the cache, jobs and views hold.

use raystream::memory::readable;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long whoever waits looks away.
const LOOK: Duration = Duration::from_millis(100);

/// Bytes that scenes share.
#[derive(Debug)]
pub struct MemoryPool {
    total: u64,
    taken: Mutex<u64>,
    given_back: Condvar,
}

/// Bytes of a pool, until this is dropped.
#[derive(Debug)]
pub struct MemoryShare {
    pool: Arc<MemoryPool>,
    bytes: u64,
}

/// Memory that others hold for too long.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "memory: reading the scene may take {}, and jobs, views and scenes that are being read hold {} of {}; try again \
     when fewer are open, or start the service with a larger --memory",
    readable(*.needed), readable(*.taken), readable(*.total)
)]
pub struct NoRoom {
    needed: u64,
    taken: u64,
    total: u64,
}

impl MemoryPool {
    /// A pool of so many bytes.
    pub fn new(total: u64) -> Arc<Self> {
        Arc::new(Self { total, taken: Mutex::new(0), given_back: Condvar::new() })
    }

    fn taken(&self) -> MutexGuard<'_, u64> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes bytes, all of them at most. If others have them, `make_room` is asked to let go of something that no one
    /// needs, and says whether it has; then this waits for as long as its patience lasts, or until the process ends.
    ///
    /// # Errors
    /// If they are not free by then.
    pub fn take(
        self: &Arc<Self>,
        bytes: u64,
        patience: Duration,
        is_ending: &AtomicBool,
        make_room: impl Fn() -> bool,
    ) -> Result<MemoryShare, NoRoom> {
        let (began, bytes) = (Instant::now(), bytes.min(self.total));
        let mut taken = self.taken();
        while *taken + bytes > self.total {
            drop(taken);
            let has_room = make_room();
            taken = self.taken();
            if has_room || *taken + bytes <= self.total {
                continue;
            }
            if began.elapsed() >= patience || is_ending.load(Relaxed) {
                return Err(NoRoom { needed: bytes, taken: *taken, total: self.total });
            }
            let waited = self.given_back.wait_timeout(taken, LOOK.min(patience));
            taken = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        *taken += bytes;
        self.tell(*taken);
        Ok(MemoryShare { pool: Arc::clone(self), bytes })
    }

    fn tell(&self, taken: u64) {
        metrics::gauge!("raystream_scene_memory_bytes").set(taken as f64);
    }

    fn give_back(&self, bytes: u64) {
        let mut taken = self.taken();
        *taken -= bytes;
        self.tell(*taken);
        drop(taken);
        self.given_back.notify_all();
    }
}

impl MemoryShare {
    /// Gives back all but so many bytes.
    pub fn shrink_to(&mut self, bytes: u64) {
        let more = self.bytes.saturating_sub(bytes);
        self.bytes -= more;
        self.pool.give_back(more);
    }
}

impl Drop for MemoryShare {
    fn drop(&mut self) {
        self.pool.give_back(self.bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicU64;

    static GOES_ON: AtomicBool = AtomicBool::new(false);

    #[test]
    fn no_more_is_taken_than_there_is() {
        let (pool, held, most) = (MemoryPool::new(100), AtomicU64::new(0), AtomicU64::new(0));
        std::thread::scope(|scope| {
            for bytes in [30, 70, 50, 100, 1000, 20] {
                let (pool, held, most) = (&pool, &held, &most);
                scope.spawn(move || {
                    for _ in 0..20 {
                        let share =
                            pool.take(bytes, Duration::from_secs(60), &GOES_ON, || false).expect("room");
                        let now = held.fetch_add(share.bytes, Relaxed) + share.bytes;
                        most.fetch_max(now, Relaxed);
                        std::thread::yield_now();
                        held.fetch_sub(share.bytes, Relaxed);
                    }
                });
            }
        });
        assert_eq!((most.load(Relaxed), *pool.taken()), (100, 0));
    }

    #[test]
    fn whoever_waits_gets_what_others_let_go_or_a_refusal() {
        let pool = MemoryPool::new(100);
        let take = |bytes, patience| pool.take(bytes, Duration::from_millis(patience), &GOES_ON, || false);
        let mut first = take(80, 0).expect("room");
        let refused = take(40, 10).expect_err("none");
        assert_eq!(refused, NoRoom { needed: 40, taken: 80, total: 100 });
        assert!(refused.to_string().contains("40 bytes") && refused.to_string().contains("--memory"));
        first.shrink_to(60);
        let second = take(40, 0).expect("room");
        // What no one needs is let go of first.
        let idle = Mutex::new(Some(first));
        let third =
            pool.take(50, Duration::ZERO, &GOES_ON, || idle.lock().expect("no panic").take().is_some());
        assert!(third.is_ok() && idle.lock().expect("no panic").is_none());
        drop((second, third));
        let ending = AtomicBool::new(true);
        let _all = take(100, 0).expect("room");
        let began = Instant::now();
        assert!(pool.take(1, Duration::from_secs(60), &ending, || false).is_err());
        assert!(began.elapsed() < Duration::from_secs(30));
    }
}
