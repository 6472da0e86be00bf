//! Values that calls of several threads read and change.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A value whose clones share memory. Its lock is held for moments only, so that no fork finds it held.
#[derive(Debug)]
pub struct Guarded<T> {
    /// `None` while a thread changes it.
    value: Mutex<Option<T>>,
}

/// Error of a call while another thread changes what it asks.
fn changing() -> PyErr {
    PyRuntimeError::new_err("another thread is changing this object")
}

impl<T: Clone> Guarded<T> {
    pub fn new(value: T) -> Self {
        Self { value: Mutex::new(Some(value)) }
    }

    fn locked(&self) -> MutexGuard<'_, Option<T>> {
        self.value.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The value as it is now.
    ///
    /// # Errors
    /// While another thread changes it.
    pub fn now(&self) -> PyResult<T> {
        self.locked().clone().ok_or_else(changing)
    }

    /// Changes the value. Meanwhile other threads get an error, and the lock is not held.
    ///
    /// # Errors
    /// While another thread changes it.
    pub fn change<R>(&self, change: impl FnOnce(&mut T) -> R) -> PyResult<R> {
        let mut value = self.locked().take().ok_or_else(changing)?;
        let result = change(&mut value);
        *self.locked() = Some(value);
        Ok(result)
    }

    /// Changes the value in a moment, unless another thread is at it.
    pub fn try_change(&self, change: impl FnOnce(&mut T)) {
        if let Some(value) = &mut *self.locked() {
            change(value);
        }
    }
}
