//! Prepared scenes that may be needed again, within a bound of memory.

use crate::engine::PreparedScene;
use std::collections::HashMap;
use std::fmt;
use std::sync::{Arc, Condvar, Mutex};

/// Prepared scenes by a key. The one that was not used for the longest time leaves first; those that jobs hold stay in
/// memory as long as they do.
pub struct SceneCache {
    most_bytes: u64,
    state: Mutex<State>,
    loaded: Condvar,
}

#[derive(Default)]
struct State {
    scenes: HashMap<String, Entry>,
    uses: u64,
}

enum Entry {
    /// A thread reads it.
    Loading,
    Ready {
        scene: Arc<PreparedScene>,
        bytes: u64,
        used: u64,
    },
}

impl fmt::Debug for SceneCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SceneCache").field("most_bytes", &self.most_bytes).finish_non_exhaustive()
    }
}

impl SceneCache {
    /// A cache of scenes and trees of so many bytes.
    pub fn new(most_bytes: u64) -> Self {
        Self { most_bytes, state: Mutex::default(), loaded: Condvar::new() }
    }

    /// The scene of a key. One thread loads it; others that want it wait.
    ///
    /// # Errors
    /// Those of `load`.
    pub fn get<E>(
        &self,
        key: &str,
        load: impl FnOnce() -> Result<PreparedScene, E>,
    ) -> Result<Arc<PreparedScene>, E> {
        let mut state = self.state.lock().expect("no holder panics");
        loop {
            state.uses += 1;
            let uses = state.uses;
            match state.scenes.get_mut(key) {
                Some(Entry::Ready { scene, used, .. }) => {
                    *used = uses;
                    return Ok(Arc::clone(scene));
                }
                Some(Entry::Loading) => state = self.loaded.wait(state).expect("no holder panics"),
                None => break,
            }
        }
        state.scenes.insert(key.to_owned(), Entry::Loading);
        drop(state);
        // Even if loading panics, others do not wait for it.
        let pending = Pending { cache: self, key };
        let scene = Arc::new(load()?);
        let bytes = scene.scene.bytes() + scene.bvh.bytes() as u64;
        let mut state = self.state.lock().expect("no holder panics");
        let used = state.uses;
        state.scenes.insert(key.to_owned(), Entry::Ready { scene: Arc::clone(&scene), bytes, used });
        state.shrink(self.most_bytes);
        drop(state);
        drop(pending);
        Ok(scene)
    }

    /// Lets go of the scenes whose keys begin with this text.
    pub fn forget(&self, start: &str) {
        let mut state = self.state.lock().expect("no holder panics");
        state.scenes.retain(|key, entry| matches!(entry, Entry::Loading) || !key.starts_with(start));
    }
}

/// A scene that is being loaded.
struct Pending<'a> {
    cache: &'a SceneCache,
    key: &'a str,
}

impl Drop for Pending<'_> {
    fn drop(&mut self) {
        let mut state = self.cache.state.lock().expect("no holder panics");
        if matches!(state.scenes.get(self.key), Some(Entry::Loading)) {
            state.scenes.remove(self.key);
        }
        self.cache.loaded.notify_all();
    }
}

impl State {
    /// Lets scenes go until the rest fits. One may be larger than the bound; it stays alone.
    fn shrink(&mut self, most_bytes: u64) {
        loop {
            let ready = |entry: &Entry| match entry {
                Entry::Ready { bytes, used, .. } => Some((*used, *bytes)),
                Entry::Loading => None,
            };
            let all: Vec<(u64, u64)> = self.scenes.values().filter_map(ready).collect();
            let bytes: u64 = all.iter().map(|(_, bytes)| bytes).sum();
            metrics::gauge!("raystream_scene_cache_bytes").set(bytes as f64);
            let Some(oldest) = all.iter().map(|(used, _)| *used).min() else { return };
            if bytes <= most_bytes || all.len() < 2 {
                return;
            }
            self.scenes.retain(|_, entry| ready(entry).is_none_or(|(used, _)| used != oldest));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::Units;
    use crate::scene::recipe::Recipe;

    fn prepared() -> PreparedScene {
        let recipe = Recipe::parse(
            r#"{ "environment": [1, 1, 1], "materials": { "grey": { "colour": [0.5, 0.5, 0.5] } }, "shapes":
            [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 4, "material": "grey" } ] }"#,
        );
        let scene = recipe.and_then(|recipe| recipe.build()).expect("a scene");
        PreparedScene::new(scene, &Units::cpu()).expect("a valid scene")
    }

    #[test]
    fn what_was_not_used_for_the_longest_time_leaves() {
        let one = prepared();
        let bytes = one.scene.bytes() + one.bvh.bytes() as u64;
        let cache = SceneCache::new(2 * bytes);
        let load = || Ok::<_, String>(prepared());
        let must_not = || Err::<PreparedScene, String>("it was there".into());
        for key in ["a", "b", "a", "c"] {
            cache.get(key, load).expect("a scene");
        }
        assert!(cache.get("a", must_not).is_ok() && cache.get("c", must_not).is_ok());
        assert!(cache.get("b", must_not).is_err());
        assert!(cache.get("b", load).is_ok(), "a failure is not kept");
        cache.forget("b");
        assert!(cache.get("b", must_not).is_err(), "it was forgotten");
    }
}
