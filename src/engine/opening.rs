//! A value that another thread makes, beside what goes on without it.

use crate::stream::catching;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::JoinHandle;

/// A value, or the reason why there is none, once a thread has made it.
#[derive(Debug)]
pub(super) struct Opening<T> {
    made: Arc<OnceLock<Result<T, String>>>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl<T: Send + Sync + 'static> Opening<T> {
    /// Begins to make a value on a thread of its own, with this name.
    pub fn start(name: &str, make: impl FnOnce() -> Result<T, String> + Send + 'static) -> Self {
        let made = Arc::new(OnceLock::new());
        let for_thread = Arc::clone(&made);
        let work = move || drop(for_thread.set(catching(make)));
        let thread = std::thread::Builder::new().name(name.into()).spawn(work);
        if let Err(error) = &thread {
            let _ = made.set(Err(format!("the system has no thread to open it: {error}")));
        }
        Self { made, thread: Mutex::new(thread.ok()) }
    }

    /// The value, if it has been made.
    pub fn get(&self) -> Option<&Result<T, String>> {
        self.made.get()
    }

    /// The value, which this waits for.
    pub fn wait(&self) -> &Result<T, String> {
        self.made.wait()
    }
}

impl<T> Drop for Opening<T> {
    /// Waits for the thread: a process should not exit while a driver opens a device.
    fn drop(&mut self) {
        let thread = self.thread.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(thread) = thread {
            // Panics are caught in the thread.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    #[test]
    fn a_value_is_there_when_its_thread_has_made_it() {
        let (send, receive) = mpsc::channel();
        let opening = Opening::start("test", move || receive.recv().map_err(|error| error.to_string()));
        assert_eq!(opening.get(), None);
        send.send(5).expect("the thread listens");
        assert_eq!((opening.wait(), opening.get()), (&Ok(5), Some(&Ok(5))));
        let panics: Opening<()> = Opening::start("test", || panic!("as it should"));
        assert_eq!(panics.wait(), &Err("it panicked: as it should".to_owned()));
    }
}
