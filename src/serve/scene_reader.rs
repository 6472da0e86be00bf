//! Reads scenes that may be hostile: a process of its own tries each one first.

use super::{Limits, Pictures, Shots};
use crate::schedule::Service;
use serde_json::{Map, Value};
use std::collections::VecDeque;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// Scenes that are remembered as loadable. One that was forgotten is tried again.
const REMEMBERED: usize = 1024;

/// Reads scenes, and remembers which ones a process of their own has read before.
pub struct SceneReader {
    pictures: Arc<dyn Pictures>,
    limits: Limits,
    loadable: Mutex<VecDeque<String>>,
}

impl std::fmt::Debug for SceneReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SceneReader").field("limits", &self.limits).finish_non_exhaustive()
    }
}

impl SceneReader {
    /// A reader that has read nothing yet.
    pub fn new(pictures: Arc<dyn Pictures>, limits: Limits) -> Self {
        Self { pictures, limits, loadable: Mutex::default() }
    }

    /// The scheduler that renders what is read.
    pub fn service(&self) -> &Arc<Service> {
        self.pictures.service()
    }

    /// Reads the scene of a job whose options have been checked, or finds it in the cache. `folder` has its files.
    ///
    /// # Errors
    /// Why it cannot be read.
    pub fn open(
        &self,
        options: &Map<String, Value>,
        scene: &Path,
        folder: &Path,
    ) -> Result<Box<dyn Shots>, String> {
        let of_loader = ["allow-missing", "env", "variant"].map(|key| options.get(key));
        let key = format!("{} {of_loader:?}", scene.display());
        if !self.is_loadable(&key) {
            let triangles = self.pictures.try_scene(options, scene, folder, self.limits.load_time)?;
            let most = self.limits.triangles;
            if triangles > most {
                return Err(format!(
                    "triangles: the scene has {triangles}, and the limit is {most}; make it smaller"
                ));
            }
            self.remember(key);
        }
        self.pictures.open(options, scene, folder)
    }

    fn is_loadable(&self, key: &str) -> bool {
        self.loadable.lock().expect("no holder panics").iter().any(|known| known == key)
    }

    fn remember(&self, key: String) {
        let mut loadable = self.loadable.lock().expect("no holder panics");
        if !loadable.contains(&key) {
            if loadable.len() >= REMEMBERED {
                loadable.pop_front();
            }
            loadable.push_back(key);
        }
    }
}
