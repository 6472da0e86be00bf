//! Frames of a scene that moves: each is of the scene at its own time, or at several while the shutter is open.

use super::checked::afford;
use super::{AnyIntegrator, CheckedSpec, Rendering, scene_file};
use crate::engine::{PreparedScene, Units};
use crate::memory::MemoryBudget;
use crate::render::{Integrator, PASSES_IN_FLIGHT, Pass};
use crate::scene::Scene;
use crate::scene::load::{LoadOptions, load_with};
use anyhow::{Context, Result, ensure};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Scenes of other frames that are kept: workers render several units of a frame, and several frames at a time.
const KEPT: usize = 4;

/// Scenes that are kept where each is of one moment of a frame; that of the frame's own time comes to them.
const KEPT_MOMENTS: usize = PASSES_IN_FLIGHT;

/// The way to the scene at the time of each frame, and at each moment while the shutter is open.
#[derive(Clone, Debug)]
pub struct Moving {
    options: LoadOptions,
    memory: MemoryBudget,
    units: Units,
    /// Each with its time.
    kept: Arc<Mutex<VecDeque<(f64, PreparedScene)>>>,
}

impl Moving {
    /// Reads the scene's file anew for each time, with these options but for the time.
    pub fn new(options: LoadOptions, memory: MemoryBudget, units: Units) -> Self {
        Self { options, memory, units, kept: Arc::default() }
    }

    /// The scene at a time. Its light, and the width of its points and lines, are those of the scene that the rendering
    /// was opened with: what that lacked, and was assumed, is assumed for all times.
    fn scene(&self, seconds: f64, opened: &Rendering) -> Result<PreparedScene> {
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        {
            let mut kept = kept();
            let known = kept.iter().position(|(kept, _)| *kept == seconds);
            if let Some(found) = known.and_then(|known| kept.remove(known)) {
                // What was used last is kept longest.
                kept.push_back(found.clone());
                return Ok(found.1);
            }
        }
        let checked: &CheckedSpec = opened.checked();
        let path = checked.scene_file()?;
        ensure!(
            !scene_file::is_standard_input(path),
            "a scene that moves is read anew for each frame; name a file"
        );
        // Its warnings have been told.
        let options = self.options.clone().with_time(seconds);
        let width = opened.prepared().scene.stroke_width;
        let mut scene =
            load_with(path, &width.iter().fold(options, |options, &width| options.with_stroke_width(width)))?;
        drop(checked.change_materials(&mut scene, &self.options)?);
        scene.environment = opened.prepared().scene.environment.clone();
        let bytes = PreparedScene::building_bytes(&scene);
        afford(&self.memory, format!("the scene at {seconds} s and its tree"), bytes)?;
        let has_frames = opened.spec().animation.frames.is_some();
        let most = if opened.steps() > 1 { KEPT_MOMENTS + usize::from(has_frames) } else { KEPT };
        {
            let mut kept = kept();
            let more = (kept.len() + 1).saturating_sub(most);
            kept.drain(..more);
        }
        let prepared = PreparedScene::new(scene, &self.units)?;
        kept().push_back((seconds, prepared.clone()));
        Ok(prepared)
    }
}

impl Rendering {
    /// The same with the way to the scenes of frames, if the spec has frames of a scene that moves.
    pub fn with_moving(self, moving: impl FnOnce() -> Moving) -> Self {
        let has_times = self.spec().animation.frames.is_some() || self.steps() > 1;
        match self.start() {
            Some(_) if has_times => self.moved_by(moving()),
            _ => self,
        }
    }

    /// The time of frame 0, if the scene looks different at other times.
    fn start(&self) -> Option<f64> {
        self.spec().loading.time.filter(|_| self.prepared().scene.is_animated)
    }

    /// The time of a frame, if the scene looks different at other times.
    fn time(&self, frame: u32) -> Option<f64> {
        let spec = self.spec();
        let frame = spec.animation.frames.as_ref().map_or(0, |_| frame);
        Some(self.start()? + f64::from(frame) / spec.animation.rate())
    }

    /// Moments at which each frame is seen: one, unless the shutter is open for a time.
    pub fn steps(&self) -> u32 {
        self.spec().animation.steps()
    }

    /// True if its frames have different scenes, and this is the rendering of all of them.
    pub fn moves(&self) -> bool {
        let differs = self.moving().is_some() || self.prepared().scene.reads_moment();
        differs && !self.is_of_frame() && self.spec().animation.frames.is_some()
    }

    /// The same at a moment of a frame, so many seconds from its time, for surfaces that ask for it.
    fn at_moment(&self, frame: u32, offset: f64) -> Result<Self> {
        let (prepared, moment) = (self.prepared(), self.checked().moment(frame, offset));
        if !prepared.scene.reads_moment() || prepared.scene.moment == moment {
            return Ok(self.clone());
        }
        // Its lights are those of all frames.
        prepared.lit();
        let scene = Scene { moment, ..Scene::clone(&prepared.scene) };
        Ok(self.with_prepared(prepared.with_scene(scene)?))
    }

    /// The rendering of a frame's scene: this one, if the scene does not move.
    ///
    /// # Errors
    /// If the scene cannot be read.
    pub fn of_frame(&self, frame: u32) -> Result<Self> {
        if !self.moves() {
            return Ok(self.clone());
        }
        let prepared = match (self.moving(), self.time(frame)) {
            (Some(moving), Some(seconds)) => {
                moving.scene(seconds, self).with_context(|| format!("frame {frame}"))?
            }
            _ => self.prepared().clone(),
        };
        self.with_prepared(prepared).at_moment(frame, 0.0)
    }

    /// The rendering and the integrator of a pass of a frame, whose own integrator is given. If the shutter is open for
    /// a time, they are those of the moment of the pass's samples: scene and camera are where they are then.
    ///
    /// # Errors
    /// If the scene cannot be read, or the camera is invalid at that time.
    pub fn exposed(
        &self,
        integrator: &AnyIntegrator,
        frame: u32,
        pass: Pass,
    ) -> Result<(Self, Arc<AnyIntegrator>)> {
        if self.steps() == 1 {
            return Ok((self.clone(), integrator.with_pass(pass).into()));
        }
        let step = integrator.frame().settings().step_of(pass.samples().start);
        let offset = self.spec().animation.offset(step);
        let moment = || format!("frame {frame}, {offset:+} s from its time");
        let mut own = self.clone();
        if let (Some(moving), Some(time)) = (self.moving(), self.time(frame)) {
            own = self.with_prepared(moving.scene(time + offset, self).with_context(moment)?);
            ensure!(
                integrator.frame().aovs().is_empty()
                    || has_same_ids(&self.prepared().scene, &own.prepared().scene),
                "{}: objects or materials come or go while the shutter is open, and layers number them; leave out the \
                 layers, or choose another time",
                moment()
            );
        }
        own = own.at_moment(frame, offset)?;
        let camera = self.frames().camera_at(self.spec(), frame, offset).with_context(moment)?;
        let bare = own.bare_integrator(&camera).with_context(moment)?;
        let exposed = integrator.frame().exposed(bare.frame(), pass);
        Ok((own, bare.with_frame(exposed).into()))
    }
}

/// True if layers number the objects and materials of two scenes alike.
fn has_same_ids(a: &Scene, b: &Scene) -> bool {
    let objects = |scene: &Scene| -> Vec<(String, Option<u32>)> {
        scene.objects.iter().map(|object| (object.name.clone(), object.parent)).collect()
    };
    a.materials.len() == b.materials.len() && objects(a) == objects(b)
}
