//! A job whose scene has been read.

use super::job_cost::FrameId;
use super::memory_pool::MemoryShare;
use crate::contract::hex;
use raystream::engine::PreparedScene;
use raystream::film::tev::Tev;
use raystream::film::{Picture, write_picture};
use raystream::picture::{FrameSum, Rendering, TimedScene, Watch, with_causes};
use raystream::render::{Pass, Patch};
use raystream::schedule::Service;
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// A job whose scene has been read: its rendering, on a service that others use too. Errors are sentences for whoever
/// sent the request.
#[derive(Clone, Debug)]
pub struct OpenJob {
    rendering: Rendering,
    service: Arc<Service>,
    viewer: Option<Arc<Tev>>,
    /// The way to its scene at other times.
    timed: Option<TimedScene>,
    /// Keeps the scene's share of the memory.
    _scene: Arc<KeptScene>,
    /// Hashes of what its frames are functions of, as far as they have been asked for.
    identities: Arc<Mutex<HashMap<u32, String>>>,
}

/// A prepared scene with the memory that it takes.
#[derive(Debug)]
pub struct KeptScene {
    pub(super) prepared: PreparedScene,
    pub(super) _share: MemoryShare,
}

impl OpenJob {
    /// A job of a rendering, whose finished pictures a viewer shows.
    pub(super) fn new(
        rendering: Rendering,
        service: Arc<Service>,
        viewer: Option<Arc<Tev>>,
        scene: Arc<KeptScene>,
    ) -> Self {
        Self { rendering, service, viewer, timed: None, _scene: scene, identities: Arc::default() }
    }

    /// The same with the way to its scene at other times, if it has animations.
    pub(super) fn with_times(self, timed: Option<TimedScene>) -> Self {
        Self { timed, ..self }
    }

    /// True if there is no other clone of it.
    pub(super) fn is_idle(&self) -> bool {
        Arc::strong_count(&self.identities) == 1
    }

    /// Its scene.
    pub fn prepared(&self) -> &PreparedScene {
        self.rendering.prepared()
    }

    /// A way to its scene at other times, if it has animations. What it keeps ends with it.
    pub fn timed(&self) -> Option<TimedScene> {
        self.timed.as_ref().map(TimedScene::fresh)
    }

    /// Its pictures.
    pub fn frames(&self) -> Vec<FrameId> {
        let frames = self.rendering.frames();
        frames.numbers().map(|number| FrameId::new(number, frames.name(number))).collect()
    }

    /// Returns a hash of all that a frame is a function of. Processes with the same hash make the same patches.
    ///
    /// # Errors
    /// If the job has no such frame.
    pub fn identity(&self, frame: u32) -> Result<String, String> {
        let known = || self.identities.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(identity) = known().get(&frame) {
            return Ok(identity.clone());
        }
        let camera = self.rendering.camera(frame).map_err(|error| with_causes(&error))?;
        let identity = self.rendering.identity(Some(&camera));
        let json = serde_json::to_vec(&identity).map_err(|error| error.to_string())?;
        let identity = hex(&Sha256::digest(json));
        known().insert(frame, identity.clone());
        Ok(identity)
    }

    /// Renders the samples of a piece of a frame's pass.
    ///
    /// # Errors
    /// Why not.
    pub fn patch(&self, frame: u32, piece: Pass, watch: &dyn Watch) -> Result<Patch, String> {
        let patch = self.rendering.patch(&self.service, frame, piece, watch);
        patch.map_err(|error| with_causes(&error))
    }

    /// A frame whose patches are to be added up: from its first sample, or from what [`FrameSum::save`] wrote.
    ///
    /// # Errors
    /// Why not.
    pub fn sum(&self, frame: u32, saved: Option<&[u8]>) -> Result<FrameSum, String> {
        let sum = self.rendering.sum(frame, saved).map_err(|error| with_causes(&error))?;
        Ok(match self.viewer.clone() {
            Some(viewer) => sum.shown_by(viewer, self.name(frame)),
            None => sum,
        })
    }

    /// The name of a picture in a viewer: the scene, whose folder is a hash, and the frame.
    fn name(&self, frame: u32) -> String {
        let scene = self.rendering.spec().scene.as_deref().unwrap_or(Path::new(""));
        let names = scene.iter().rev().take(2).map(|name| name.to_string_lossy());
        let names: Vec<String> = names.map(|name| name.chars().take(24).collect()).collect();
        format!("{} frame {frame}", names.into_iter().rev().collect::<Vec<_>>().join("/"))
    }

    /// Renders a frame whose samples the time decides. What has been rendered is kept in `checkpoint` from time to time
    /// and when the unit is stopped, and is gone on from. `None` if it was stopped.
    ///
    /// # Errors
    /// Why not.
    pub fn whole(
        &self,
        frame: u32,
        checkpoint: &Path,
        spent: Duration,
        watch: &dyn Watch,
    ) -> Result<Option<Picture>, String> {
        let whole = self.rendering.whole(&self.service, frame, checkpoint, spent, watch);
        whole.map_err(|error| with_causes(&error))
    }

    /// Writes a picture as the spec asks, in the format of the file's name.
    ///
    /// # Errors
    /// Why it cannot be written.
    pub fn write(&self, picture: &Picture, path: &Path) -> Result<(), String> {
        let spec = self.rendering.spec();
        let written = write_picture(path, picture, &spec.look.look(), &spec.encoding.options());
        written.map_err(|error| error.to_string())
    }
}
