//! Streams between jobs: the storage that one job leaves serves the next, so that frame after frame
//! nothing is allocated.

use crate::stream::{Empty, RayStream};
use std::any::Any;
use std::sync::{Mutex, PoisonError};

/// Empty streams of jobs that have ended, by the types of their payloads.
pub(super) struct Pool {
    shelves: Mutex<Vec<Box<dyn Any + Send>>>,
    /// Jobs whose streams are kept; those of the oldest go first.
    most: usize,
}

impl Pool {
    pub fn new(most: usize) -> Self {
        Self { shelves: Mutex::default(), most }
    }

    /// Streams for a job; none if no job with such payloads has left any.
    pub fn take<P: Send + 'static, S: Send + 'static>(&self) -> Vec<RayStream<Empty, P, S>> {
        let mut shelves = self.shelves.lock().unwrap_or_else(PoisonError::into_inner);
        let found = shelves.iter().rposition(|shelf| shelf.is::<Vec<RayStream<Empty, P, S>>>());
        let shelf = found.map(|index| shelves.remove(index)).and_then(|shelf| shelf.downcast().ok());
        shelf.map_or_else(Vec::new, |streams| *streams)
    }

    /// Keeps a job's streams.
    pub fn give<P: Send + 'static, S: Send + 'static>(&self, streams: Vec<RayStream<Empty, P, S>>) {
        let mut shelves = self.shelves.lock().unwrap_or_else(PoisonError::into_inner);
        shelves.push(Box::new(streams));
        let surplus = shelves.len().saturating_sub(self.most);
        let surplus: Vec<_> = shelves.drain(..surplus).collect();
        drop(shelves);
        drop(surplus);
    }

    /// Frees all that is kept.
    pub fn clear(&self) {
        let shelves = std::mem::take(&mut *self.shelves.lock().unwrap_or_else(PoisonError::into_inner));
        drop(shelves);
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
    }
}
