//! Tells workers that wait that there are units again.

use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// A bell that counts how often it was rung, so that no one misses a ring between two looks.
#[derive(Debug, Default)]
pub struct Bell {
    rings: Mutex<u64>,
    rung: Condvar,
}

impl Bell {
    /// Rings it.
    pub fn ring(&self) {
        *self.rings.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        self.rung.notify_all();
    }

    /// The number of times that it was rung.
    pub fn rings(&self) -> u64 {
        *self.rings.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until it was rung more often than this, for so long at most.
    pub fn wait(&self, rings: u64, patience: Duration) {
        let own = self.rings.lock().unwrap_or_else(PoisonError::into_inner);
        drop(self.rung.wait_timeout_while(own, patience, |own| *own <= rings));
    }
}
