//! Memory of films that have been dropped, for the next film of the same kind.

use super::accumulation::Memory;
use std::sync::{Arc, Mutex, PoisonError};

/// Memory for one film, shared by a film and those made from it by [`super::Film::blank`]. So a viewer that renders one
/// frame after the other, or a frame in passes, uses the same memory again and again.
#[derive(Clone, Debug, Default)]
pub(super) struct Spare(Arc<Mutex<Option<Memory>>>);

impl Spare {
    /// Takes the memory, set to zeros. `None` if there is none.
    pub fn take(&self) -> Option<Memory> {
        let mut memory = self.0.lock().unwrap_or_else(PoisonError::into_inner).take()?;
        memory.sums.as_flattened_mut().iter_mut().for_each(|sum| *sum.get_mut() = 0);
        memory.samples.iter_mut().for_each(|count| *count.get_mut() = 0);
        memory.layers.iter_mut().for_each(|layers| layers.clear());
        Some(memory)
    }

    /// Keeps the memory of a film that is being dropped, unless no other film could use it or there is some already.
    pub fn keep(&self, memory: Memory) {
        if Arc::strong_count(&self.0) > 1 {
            self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(memory);
        }
    }
}
