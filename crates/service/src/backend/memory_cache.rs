//! Values in memory by key, within a bound of weight: a least-recently-used cache with single flight.
//!
//! Kept crates do not fit: quick_cache may turn a new value away at once, and moka lets its bound be passed for a
//! while. A scene that is read anew for each unit costs minutes, and one too many the machine's memory.

use std::collections::HashMap;
use std::fmt;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Values by key. The one that was not used for the longest time leaves first; clones that others hold live on.
pub struct MemoryCache<V> {
    most_weight: u64,
    weigh: fn(&V) -> u64,
    state: Mutex<State<V>>,
    loaded: Condvar,
}

struct State<V> {
    values: HashMap<String, Entry<V>>,
    uses: u64,
}

enum Entry<V> {
    /// A thread makes it.
    Loading,
    Ready {
        value: V,
        weight: u64,
        used: u64,
    },
}

impl<V> fmt::Debug for MemoryCache<V> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("MemoryCache").field("most_weight", &self.most_weight).finish_non_exhaustive()
    }
}

impl<V: Clone> MemoryCache<V> {
    /// A cache of values of so much weight together.
    pub fn new(most_weight: u64, weigh: fn(&V) -> u64) -> Self {
        let state = Mutex::new(State { values: HashMap::new(), uses: 0 });
        Self { most_weight, weigh, state, loaded: Condvar::new() }
    }

    fn lock(&self) -> MutexGuard<'_, State<V>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The value of a key. One thread loads it; others that want it wait, and one of them tries again if that fails.
    ///
    /// # Errors
    /// Those of `load`, which are not kept.
    pub fn get<E>(&self, key: &str, load: impl FnOnce() -> Result<V, E>) -> Result<V, E> {
        let mut state = self.lock();
        loop {
            state.uses += 1;
            let uses = state.uses;
            match state.values.get_mut(key) {
                Some(Entry::Ready { value, used, .. }) => {
                    *used = uses;
                    return Ok(value.clone());
                }
                Some(Entry::Loading) => {
                    state = self.loaded.wait(state).unwrap_or_else(PoisonError::into_inner);
                }
                None => break,
            }
        }
        state.values.insert(key.to_owned(), Entry::Loading);
        drop(state);
        // Even if loading panics, others do not wait for it.
        let pending = Pending { cache: self, key };
        let value = load()?;
        let weight = (self.weigh)(&value);
        let mut state = self.lock();
        let used = state.uses;
        state.values.insert(key.to_owned(), Entry::Ready { value: value.clone(), weight, used });
        state.shrink(self.most_weight);
        drop(state);
        drop(pending);
        Ok(value)
    }

    /// Lets go of the values whose keys begin with this text.
    pub fn forget(&self, start: &str) {
        self.lock().values.retain(|key, entry| matches!(entry, Entry::Loading) || !key.starts_with(start));
    }

    /// Lets go of the value that was not used for the longest time, of those that may go. False if none may.
    pub fn let_go(&self, may_go: impl Fn(&V) -> bool) -> bool {
        let mut state = self.lock();
        let oldest = state.values.iter().filter_map(|(key, entry)| match entry {
            Entry::Ready { value, used, .. } if may_go(value) => Some((*used, key.clone())),
            _ => None,
        });
        let Some((_, key)) = oldest.min() else { return false };
        let gone = state.values.remove(&key);
        drop(state);
        drop(gone);
        true
    }

    /// The weight of what is kept.
    pub fn weight(&self) -> u64 {
        self.lock().values.values().filter_map(Entry::ready).map(|(_, weight)| weight).sum()
    }
}

/// A value that is being loaded, until this is dropped.
struct Pending<'a, V> {
    cache: &'a MemoryCache<V>,
    key: &'a str,
}

impl<V> Drop for Pending<'_, V> {
    fn drop(&mut self) {
        let mut state = self.cache.state.lock().unwrap_or_else(PoisonError::into_inner);
        if matches!(state.values.get(self.key), Some(Entry::Loading)) {
            state.values.remove(self.key);
        }
        self.cache.loaded.notify_all();
    }
}

impl<V> Entry<V> {
    /// When it was used, and its weight.
    fn ready(&self) -> Option<(u64, u64)> {
        match self {
            Self::Ready { weight, used, .. } => Some((*used, *weight)),
            Self::Loading => None,
        }
    }
}

impl<V> State<V> {
    /// Lets values go until the rest fits. One may be heavier than the bound; it stays alone.
    fn shrink(&mut self, most_weight: u64) {
        loop {
            let all: Vec<(u64, u64)> = self.values.values().filter_map(Entry::ready).collect();
            let weight: u64 = all.iter().map(|(_, weight)| weight).sum();
            let Some(oldest) = all.iter().map(|(used, _)| *used).min() else { return };
            if weight <= most_weight || all.len() < 2 {
                return;
            }
            self.values.retain(|_, entry| entry.ready().is_none_or(|(used, _)| used != oldest));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
    use std::time::Duration;

    #[test]
    fn what_was_not_used_for_the_longest_time_leaves() {
        let cache = MemoryCache::new(20, |weight: &u64| *weight);
        let must_not = || Err::<u64, String>("it was there".into());
        for key in ["a", "b", "a", "c"] {
            cache.get(key, || Ok::<_, String>(10)).expect("a value");
        }
        assert!(cache.get("a", must_not).is_ok() && cache.get("c", must_not).is_ok());
        assert!(cache.get("b", must_not).is_err());
        assert_eq!(cache.get("b", || Ok::<_, String>(10)), Ok(10), "a failure is not kept");
        cache.forget("b");
        assert!(cache.get("b", must_not).is_err(), "it was forgotten");
        assert_eq!(cache.get("heavy", || Ok::<_, String>(99)), Ok(99));
        assert_eq!((cache.get("heavy", must_not), cache.weight()), (Ok(99), 99), "it stays alone");
        assert!(!cache.let_go(|value| *value < 99) && cache.let_go(|value| *value == 99));
        assert!(cache.get("heavy", must_not).is_err(), "it was let go");
    }

    #[test]
    fn a_value_is_loaded_once_however_many_want_it() {
        let (cache, count) = (MemoryCache::new(9, |()| 1), AtomicU32::new(0));
        let load = || {
            count.fetch_add(1, Relaxed);
            std::thread::sleep(Duration::from_millis(30));
            Ok::<(), String>(())
        };
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| cache.get("a", load).expect("a value"));
            }
        });
        assert_eq!(count.load(Relaxed), 1);
        cache.get("b", load).expect("a value");
        assert_eq!(count.load(Relaxed), 2, "another key is loaded");
    }

    #[test]
    fn a_load_that_fails_or_panics_leaves_the_next_one_free() {
        let cache = MemoryCache::new(9, |()| 1);
        assert_eq!(cache.get("a", || Err("no")), Err("no"));
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            cache.get("a", || -> Result<(), String> { panic!("a loader's") })
        }));
        assert!(panicked.is_err());
        assert_eq!(cache.get("a", || Ok::<(), String>(())), Ok(()));
        assert_eq!(cache.get("a", || Err("it is not loaded again")), Ok(()));
    }
}
