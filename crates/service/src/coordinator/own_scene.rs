//! The scene that a service shows unless another one is asked for.

use super::ledger::Ledger;
use super::store::Store;
use crate::contract::{Limits, Problem, ScenePack, refused};
use std::path::{Path, PathBuf};

/// The scene of a service.
#[derive(Clone, Debug)]
pub struct OwnScene {
    /// Its file.
    pub path: PathBuf,
    /// The scene as workers on other machines get it. Without it, they do not render its views.
    pub pack: Option<ScenePack>,
}

/// A service's scene, where workers find it.
#[derive(Debug)]
pub struct KeptScene {
    path: PathBuf,
    upload: Option<(String, Option<String>)>,
}

impl KeptScene {
    /// Puts the scene among those that were uploaded. If that fails, the log has it, and workers do not help.
    pub fn keep(scene: OwnScene, store: &Store, ledger: &Ledger, limits: &Limits) -> Self {
        let OwnScene { path, pack } = scene;
        let upload = pack.and_then(|pack| match keep(&pack, store, ledger, limits) {
            Ok(()) => Some((pack.sha256, pack.entry)),
            Err(problem) => {
                log::warn!("{}: workers do not render its views: {problem}", path.display());
                None
            }
        });
        Self { path, upload }
    }

    /// Its file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The SHA-256 by which workers find it, and the scene file in the archive.
    pub fn upload(&self) -> Option<&(String, Option<String>)> {
        self.upload.as_ref()
    }
}

fn keep(pack: &ScenePack, store: &Store, ledger: &Ledger, limits: &Limits) -> Result<(), Problem> {
    if ledger.scene(&pack.sha256)?.is_some() {
        return Ok(());
    }
    let mut upload = store.begin().map_err(refused)?;
    upload.write(&pack.bytes).map_err(refused)?;
    store.keep(upload, &pack.sha256, limits, |bytes| ledger.keep_scene(None, &pack.sha256, bytes))?;
    Ok(())
}
