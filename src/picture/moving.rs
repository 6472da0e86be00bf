//! Frames of a scene that moves: each is of the scene at its own time, or at several while the shutter is open.

use super::checked::afford;
use super::shaders::Pictures;
use super::{AnyIntegrator, CheckedSpec, Rendering, scene_file};
use crate::engine::PreparedScene;
use crate::memory::MemoryBudget;
use crate::render::{Integrator, PASSES_IN_FLIGHT, Pass};
use crate::scene::Scene;
use crate::scene::load::{AnimatedFile, LoadOptions};
use anyhow::{Context, Result, ensure};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};

/// Scenes of other frames that are kept: workers render several units of a frame, and several frames at a time.
const KEPT: usize = 4;

/// Scenes that are kept where each is of one moment of a frame; that of the frame's own time comes to them.
const KEPT_MOMENTS: usize = PASSES_IN_FLIGHT;

/// The way to the scene at the time of each frame, and at each moment while the shutter is open.
#[derive(Clone, Debug)]
pub struct Moving {
    options: LoadOptions,
    memory: MemoryBudget,
    /// Read when it is first needed.
    file: Arc<Mutex<Option<Arc<AnimatedFile>>>>,
    /// Those of shaders.
    pictures: Arc<Mutex<Pictures>>,
    scenes: Arc<Mutex<Scenes>>,
}

/// The scenes that are there or are being made.
#[derive(Debug, Default)]
struct Scenes {
    /// Each with its time; that which was used last is the last one.
    kept: VecDeque<(f64, PreparedScene)>,
    /// The frame that was asked for last.
    last: Option<u32>,
    /// The scene of a frame that is expected next, and its time.
    next: Option<(f64, JoinHandle<Result<PreparedScene>>)>,
}

impl Moving {
    /// Reads the scene's file once, with these options but for the time.
    pub fn new(options: LoadOptions, memory: MemoryBudget) -> Self {
        Self { options, memory, file: Arc::default(), pictures: Arc::default(), scenes: Arc::default() }
    }

    /// The scene at a time. Its light, and the width of its points and lines, are those of the scene that the rendering
    /// was opened with: what that lacked, and was assumed, is assumed for all times.
    pub(super) fn scene(&self, seconds: f64, opened: &Rendering) -> Result<PreparedScene> {
        let next = {
            let Scenes { kept, next, .. } = &mut *lock(&self.scenes);
            let known = kept.iter().position(|(kept, _)| *kept == seconds);
            if let Some(found) = known.and_then(|known| kept.remove(known)) {
                // What was used last is kept longest.
                kept.push_back(found.clone());
                return Ok(found.1);
            }
            next.take_if(|(next, _)| *next == seconds)
        };
        match next {
            Some((_, next)) => next.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)),
            None => self.make(seconds, opened),
        }
    }

    /// Begins to make the scene of a frame if frames are asked for one after the other. A worker that renders now this
    /// frame and now that one makes none in vain.
    fn make_ahead(&self, frame: u32, opened: &Rendering) {
        let follows = frame.checked_sub(2).is_some_and(|before| lock(&self.scenes).last == Some(before));
        lock(&self.scenes).last = frame.checked_sub(1);
        let is_last = !opened.frames().numbers().contains(&frame) || opened.steps() > 1;
        let Some(seconds) = opened.time(frame).filter(|_| follows && !is_last) else { return };
        let mut scenes = lock(&self.scenes);
        let is_there = scenes.kept.iter().any(|(kept, _)| *kept == seconds);
        if is_there || scenes.next.as_ref().is_some_and(|(_, making)| !making.is_finished()) {
            return;
        }
        let (moving, opened) = (self.clone(), opened.clone());
        let make = move || moving.make(seconds, &opened);
        // Without a thread it is made when it is asked for.
        let making = thread::Builder::new().name("next frame".into()).spawn(make);
        scenes.next = making.ok().map(|making| (seconds, making));
    }

    /// Makes the scene at a time from one that is there: see [`PreparedScene::with_scene`].
    fn make(&self, seconds: f64, opened: &Rendering) -> Result<PreparedScene> {
        let checked: &CheckedSpec = opened.checked();
        let file = self.file(opened)?;
        // Its warnings have been told.
        let mut scene = file.at(seconds)?;
        let mut pictures = lock(&self.pictures).clone();
        drop(checked.change_materials(&mut scene, &self.options, &mut pictures)?);
        *lock(&self.pictures) = pictures;
        scene.environment = opened.prepared().scene.environment.clone();
        let bytes = PreparedScene::building_bytes(&scene).saturating_add(file.bytes());
        afford(&self.memory, format!("the scene at {seconds} s and its tree"), bytes)?;
        let has_frames = opened.spec().animation.frames.is_some();
        let most = if opened.steps() > 1 { KEPT_MOMENTS + usize::from(has_frames) } else { KEPT };
        let former = {
            let Scenes { kept, .. } = &mut *lock(&self.scenes);
            let former = kept.back().map_or_else(|| opened.prepared().clone(), |(_, former)| former.clone());
            let more = (kept.len() + 1).saturating_sub(most);
            kept.drain(..more);
            former
        };
        let prepared = former.with_scene(scene)?;
        lock(&self.scenes).kept.push_back((seconds, prepared.clone()));
        Ok(prepared)
    }

    /// The scene's file.
    fn file(&self, opened: &Rendering) -> Result<Arc<AnimatedFile>> {
        let mut file = lock(&self.file);
        if let Some(file) = &*file {
            return Ok(Arc::clone(file));
        }
        let path = opened.checked().scene_file()?;
        ensure!(
            !scene_file::is_standard_input(path),
            "the file of a scene that moves is read again; name a file"
        );
        let width = opened.prepared().scene.stroke_width;
        let options =
            width.iter().fold(self.options.clone(), |options, &width| options.with_stroke_width(width));
        let read = Arc::new(AnimatedFile::read(path, &options)?);
        *file = Some(Arc::clone(&read));
        Ok(read)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
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
            (Some(moving), Some(seconds)) if Some(seconds) != self.start() => {
                let prepared = moving.scene(seconds, self).with_context(|| format!("frame {frame}"))?;
                moving.make_ahead(frame + 1, self);
                prepared
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
