//! Reads scenes that may be hostile: a process of its own tries each one first.

use super::RenderBackend;
use super::open_job::OpenJob;
use crate::picture::RenderSpec;
use crate::schedule::Service;
use crate::service::contract::Limits;
use std::collections::{HashSet, VecDeque};
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Scenes that are remembered as loadable. One that was forgotten is tried again.
const REMEMBERED: usize = 1024;

/// Reads scenes, and remembers which ones a process of their own has read before.
pub struct SceneReader {
    backend: Arc<RenderBackend>,
    limits: Limits,
    tries: Tries,
}

/// What has been tried, by a key, and what is being tried.
#[derive(Debug, Default)]
struct Tries {
    state: Mutex<State>,
    ended: Condvar,
}

#[derive(Debug, Default)]
struct State {
    passed: VecDeque<String>,
    under_way: HashSet<String>,
}

impl std::fmt::Debug for SceneReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SceneReader").field("limits", &self.limits).finish_non_exhaustive()
    }
}

impl SceneReader {
    /// A reader that has read nothing yet.
    pub fn new(backend: Arc<RenderBackend>, limits: Limits) -> Self {
        Self { backend, limits, tries: Tries::default() }
    }

    /// The scheduler that renders what is read.
    pub fn service(&self) -> &Arc<Service> {
        self.backend.service()
    }

    /// Lets go of what was read from a folder: its files may have been others.
    pub fn forget(&self, folder: &Path) {
        let start = format!("{}/", folder.display());
        self.tries.lock().passed.retain(|key| !key.starts_with(&start));
        self.backend.forget(folder);
    }

    /// Reads the scene of a job whose spec has been checked, or finds it in the cache. `folder` has its files.
    ///
    /// # Errors
    /// Why it cannot be read.
    pub fn open(&self, spec: &RenderSpec, scene: &Path, folder: &Path) -> Result<OpenJob, String> {
        let key = format!("{} {:?} {:?}", scene.display(), spec.loading, spec.light.env);
        self.tries.once(&key, || {
            let triangles = self.backend.try_scene(spec, scene, folder, self.limits.load_time)?;
            let most = self.limits.triangles;
            if triangles > most {
                return Err(format!(
                    "triangles: the scene has {triangles}, and the limit is {most}; make it smaller"
                ));
            }
            Ok(())
        })?;
        self.backend.open(spec, scene, folder)
    }
}

impl Tries {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tries what has not passed before. One thread does it; others that want the same wait, and try it themselves if
    /// it has failed.
    fn once<E>(&self, key: &str, work: impl FnOnce() -> Result<(), E>) -> Result<(), E> {
        let mut state = self.lock();
        loop {
            if state.passed.iter().any(|known| known == key) {
                return Ok(());
            }
            if state.under_way.insert(key.to_owned()) {
                break;
            }
            state = self.ended.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        drop(state);
        let own = UnderWay { tries: self, key };
        work()?;
        let mut state = self.lock();
        if state.passed.len() >= REMEMBERED {
            state.passed.pop_front();
        }
        state.passed.push_back(key.to_owned());
        drop(state);
        drop(own);
        Ok(())
    }
}

/// What is being tried, until it is dropped, even by a panic.
struct UnderWay<'a> {
    tries: &'a Tries,
    key: &'a str,
}

impl Drop for UnderWay<'_> {
    fn drop(&mut self) {
        self.tries.lock().under_way.remove(self.key);
        self.tries.ended.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
    use std::time::Duration;

    #[test]
    fn a_scene_is_tried_once_however_many_want_it() {
        let (tries, count) = (Tries::default(), AtomicU32::new(0));
        let work = || {
            count.fetch_add(1, Relaxed);
            std::thread::sleep(Duration::from_millis(30));
            Ok::<(), String>(())
        };
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| tries.once("a", work).expect("it passes"));
            }
        });
        assert_eq!(count.load(Relaxed), 1);
        tries.once("b", work).expect("it passes");
        assert_eq!(count.load(Relaxed), 2, "another scene is tried");
    }

    #[test]
    fn a_try_that_fails_or_panics_leaves_the_next_one_free() {
        let tries = Tries::default();
        assert_eq!(tries.once("a", || Err("no")), Err("no"));
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            tries.once("a", || -> Result<(), String> { panic!("a loader's") })
        }));
        assert!(panicked.is_err());
        assert_eq!(tries.once("a", || Ok::<(), String>(())), Ok(()));
        assert_eq!(tries.once("a", || Err("it is not tried again")), Ok(()));
    }
}
