//! Memory of films that have been dropped, for the next film of the same kind.

use super::accumulation::{Counts, Sums};
use std::sync::{Arc, Mutex, PoisonError};

/// Memory for one film, shared by a film and those made from it by [`super::Film::blank`]. So a viewer that renders one
/// frame after the other, or a frame in passes, uses the same memory again and again.
#[derive(Clone, Debug, Default)]
pub(super) struct Spare(Arc<Mutex<Option<(Sums, Counts)>>>);

impl Spare {
    /// Takes the memory, set to zeros. `None` if there is none.
    pub fn take(&self) -> Option<(Sums, Counts)> {
        let (mut sums, mut counts) = self.0.lock().unwrap_or_else(PoisonError::into_inner).take()?;
        sums.as_flattened_mut().iter_mut().for_each(|sum| *sum.get_mut() = 0);
        counts.iter_mut().for_each(|count| *count.get_mut() = 0);
        Some((sums, counts))
    }

    /// Keeps the memory of a film that is being dropped, unless no other film could use it or there is some already.
    pub fn keep(&self, sums: Sums, counts: Counts) {
        if Arc::strong_count(&self.0) > 1 {
            self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert((sums, counts));
        }
    }
}
