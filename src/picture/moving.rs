//! Frames of a scene that moves: each is of the scene at its own time.

use super::checked::afford;
use super::{CheckedSpec, Rendering, scene_file};
use crate::engine::{PreparedScene, Units};
use crate::memory::MemoryBudget;
use crate::scene::load::{LoadOptions, load_with};
use anyhow::{Context, Result, ensure};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Scenes of other frames that are kept: workers render several units of a frame, and several frames at a time.
const KEPT: usize = 4;

/// The way to the scene at the time of each frame.
#[derive(Clone, Debug)]
pub struct Moving {
    options: LoadOptions,
    memory: MemoryBudget,
    units: Units,
    kept: Arc<Mutex<VecDeque<(u32, PreparedScene)>>>,
}

impl Moving {
    /// Reads the scene's file anew for each frame, with these options but for the time.
    pub fn new(options: LoadOptions, memory: MemoryBudget, units: Units) -> Self {
        Self { options, memory, units, kept: Arc::default() }
    }

    /// The scene of a frame. Its light is that of the scene that the rendering was opened with: what that lacked, and
    /// was assumed, is assumed for all frames.
    fn scene(&self, frame: u32, seconds: f64, opened: &Rendering) -> Result<PreparedScene> {
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, found)) = kept().iter().find(|(kept, _)| *kept == frame) {
            return Ok(found.clone());
        }
        let checked: &CheckedSpec = opened.checked();
        let path = checked.scene_file()?;
        ensure!(
            !scene_file::is_standard_input(path),
            "a scene that moves is read anew for each frame; name a file"
        );
        // Its warnings have been told.
        let mut scene = load_with(path, &self.options.clone().with_time(seconds))?;
        drop(checked.change_materials(&mut scene)?);
        scene.environment = opened.prepared().scene.environment.clone();
        let bytes = PreparedScene::building_bytes(&scene);
        afford(&self.memory, format!("the scene of frame {frame} and its tree"), bytes)?;
        let prepared = PreparedScene::new(scene, &self.units)?;
        let mut kept = kept();
        if kept.len() >= KEPT {
            kept.pop_front();
        }
        kept.push_back((frame, prepared.clone()));
        Ok(prepared)
    }
}

impl Rendering {
    /// The same with the way to the scenes of frames, if the spec has frames of a scene that moves.
    pub fn with_moving(self, moving: impl FnOnce() -> Moving) -> Self {
        match self.start() {
            Some(_) => self.moved_by(moving()),
            None => self,
        }
    }

    /// The time of frame 0, if frames have different scenes.
    fn start(&self) -> Option<f64> {
        let spec = self.spec();
        let is_animated = spec.animation.frames.is_some() && self.prepared().scene.is_animated;
        spec.loading.time.filter(|_| is_animated)
    }

    /// True if its frames have different scenes.
    pub fn moves(&self) -> bool {
        self.moving().is_some()
    }

    /// The rendering of a frame's scene: this one, if the scene does not move.
    ///
    /// # Errors
    /// If the scene cannot be read.
    pub fn of_frame(&self, frame: u32) -> Result<Self> {
        let (Some(moving), Some(start)) = (self.moving(), self.start()) else { return Ok(self.clone()) };
        let seconds = start + f64::from(frame) / self.spec().animation.rate();
        let prepared = moving.scene(frame, seconds, self).with_context(|| format!("frame {frame}"))?;
        Ok(self.with_prepared(prepared))
    }
}
