//! Streams between jobs: a job uses the streams that an earlier one has left, so that later frames allocate none.

use crate::stream::{Empty, RayStream};
use std::any::Any;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Empty streams of jobs that have ended, by the types of their payloads.
pub(super) struct Pool {
    /// A `Vec<RayStream<Empty, P, S>>` of each job, oldest first.
    entries: Mutex<Vec<Box<dyn Any + Send>>>,
    /// The most jobs whose streams are kept. The oldest entries are dropped first.
    most: AtomicUsize,
}

impl Pool {
    pub fn new(most: usize) -> Self {
        Self { entries: Mutex::default(), most: AtomicUsize::new(most) }
    }

    /// Streams for a job; an empty vector if no job with these payload types has left any.
    pub fn take<P: Send + 'static, S: Send + 'static>(&self) -> Vec<RayStream<Empty, P, S>> {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        let found = entries.iter().rposition(|entry| entry.is::<Vec<RayStream<Empty, P, S>>>());
        let entry = found.map(|index| entries.remove(index)).and_then(|entry| entry.downcast().ok());
        entry.map_or_else(Vec::new, |streams| *streams)
    }

    /// Keeps a job's streams.
    pub fn give<P: Send + 'static, S: Send + 'static>(&self, streams: Vec<RayStream<Empty, P, S>>) {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        entries.push(Box::new(streams));
        let surplus = entries.len().saturating_sub(self.most.load(Ordering::Relaxed));
        let surplus: Vec<_> = entries.drain(..surplus).collect();
        drop(entries);
        drop(surplus);
    }

    /// Drops all streams that are kept, and keeps none from now on.
    pub fn close(&self) {
        self.most.store(0, Ordering::Relaxed);
        self.clear();
    }

    /// Drops all streams that are kept.
    pub fn clear(&self) {
        let entries = std::mem::take(&mut *self.entries.lock().unwrap_or_else(PoisonError::into_inner));
        drop(entries);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_return_to_jobs_of_their_kind() {
        let pool = Pool::new(2);
        pool.give::<u32, u32>(vec![RayStream::new()]);
        pool.give::<u32, u64>(vec![RayStream::new(), RayStream::new()]);
        assert_eq!(pool.take::<u64, u64>().len(), 0);
        assert_eq!(pool.take::<u32, u64>().len(), 2);
        assert_eq!(pool.take::<u32, u64>().len(), 0);
        assert_eq!(pool.take::<u32, u32>().len(), 1);
    }

    #[test]
    fn the_oldest_go_first() {
        let pool = Pool::new(1);
        pool.give::<u32, u32>(vec![RayStream::new()]);
        pool.give::<u32, u64>(vec![RayStream::new()]);
        assert_eq!(pool.take::<u32, u32>().len(), 0);
        pool.clear();
        assert_eq!(pool.take::<u32, u64>().len(), 0);
        pool.close();
        pool.give::<u32, u64>(vec![RayStream::new()]);
        assert_eq!(pool.take::<u32, u64>().len(), 0);
    }
}
