//! Reads scenes that may be hostile: a process of its own tries each one first.

use super::open_job::OpenJob;
use super::{MemoryCache, RenderBackend};
use crate::contract::Limits;
use raystream::picture::RenderSpec;
use raystream::schedule::Service;
use std::path::Path;
use std::sync::Arc;

/// Scenes that are remembered as loadable. One that was forgotten is tried again.
const REMEMBERED: u64 = 1024;

/// Reads scenes, and remembers which ones a process of their own has read before.
pub struct SceneReader {
    backend: Arc<RenderBackend>,
    limits: Limits,
    /// Scenes that a process of its own could load.
    loadable: MemoryCache<()>,
}

impl std::fmt::Debug for SceneReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SceneReader").field("limits", &self.limits).finish_non_exhaustive()
    }
}

impl SceneReader {
    /// A reader that has read nothing yet.
    pub fn new(backend: Arc<RenderBackend>, limits: Limits) -> Self {
        Self { backend, limits, loadable: MemoryCache::new(REMEMBERED, |()| 1) }
    }

    /// The scheduler that renders what is read.
    pub fn service(&self) -> &Arc<Service> {
        self.backend.service()
    }

    /// Reads no more, and ends the processes that do.
    pub fn end(&self) {
        self.backend.end();
    }

    /// Lets go of what was read from a folder: its files may have been others.
    pub fn forget(&self, folder: &Path) {
        let start = format!("{}/", folder.display());
        self.loadable.forget(&start);
        self.backend.forget(folder);
    }

    /// Reads the scene of a job whose spec has been checked, or finds it in the cache. `folder` has its files.
    ///
    /// # Errors
    /// Why it cannot be read.
    pub fn open(&self, spec: &RenderSpec, scene: &Path, folder: &Path) -> Result<OpenJob, String> {
        let pictures: Vec<_> = spec.surface.iter().flat_map(|surface| surface.pictures()).collect();
        let key = format!("{} {:?} {:?} {pictures:?}", scene.display(), spec.loading, spec.light.env);
        self.loadable.get(&key, || {
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
