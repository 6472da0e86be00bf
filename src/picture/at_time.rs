//! A scene at any time of any of its animations, for views that play them.

use super::{CheckedSpec, Moving, Rendering};
use crate::engine::{PreparedScene, Units};
use crate::film::Exposure;
use crate::memory::MemoryBudget;
use crate::scene::load::LoadOptions;
use crate::scene::{AnimationSpan, Scene};
use anyhow::{Result, ensure};
use std::sync::{Arc, Mutex, PoisonError};

/// The animation that was shown last, and the way to its times.
type Last = Option<(Option<String>, Moving)>;

/// A scene at any time of any of its animations. Clones share what they keep.
#[derive(Clone, Debug)]
pub struct TimedScene {
    /// Of a still picture, at rest.
    rendering: Rendering,
    options: LoadOptions,
    memory: MemoryBudget,
    units: Units,
    last: Arc<Mutex<Last>>,
}

impl TimedScene {
    /// The scene of a rendering, which was read with these options at rest. `None` if it looks the same at all times.
    pub fn new(
        rendering: &Rendering,
        options: LoadOptions,
        memory: MemoryBudget,
        units: Units,
    ) -> Option<Self> {
        let scene = &rendering.prepared().scene;
        (!scene.animations.is_empty()).then(|| Self {
            rendering: rendering.clone(),
            options,
            memory,
            units,
            last: Arc::default(),
        })
    }

    /// The same, which keeps no scenes that others have asked for.
    pub fn fresh(&self) -> Self {
        Self { last: Arc::default(), ..self.clone() }
    }

    /// The animations. Where none is named, the first one is shown.
    pub fn animations(&self) -> &[AnimationSpan] {
        &self.rendering.prepared().scene.animations
    }

    /// Checks that there is an animation of a name.
    ///
    /// # Errors
    /// The names that there are.
    pub fn check(&self, name: &str) -> Result<()> {
        let names: Vec<String> = self.animations().iter().map(|span| format!("{:?}", span.name)).collect();
        let is_known = self.animations().iter().any(|span| span.name == name);
        ensure!(is_known, "the scene has no animation {name:?}; choose one of {}", names.join(", "));
        Ok(())
    }

    /// The scene at a time of an animation, of the first one without a name. Its light is that of the scene at rest.
    ///
    /// # Errors
    /// If the time is not finite, there is no animation of the name, or the scene cannot be read.
    pub fn at(&self, seconds: f64, animation: Option<&str>) -> Result<PreparedScene> {
        let mut spec = self.rendering.spec().clone();
        ensure!(seconds.is_finite(), "time: write a finite number of seconds, as in 1.5");
        animation.map_or(Ok(()), |name| self.check(name))?;
        (spec.loading.time, spec.loading.animation) = (Some(seconds), animation.map(str::to_owned));
        // One frame, whose exposure is no part of the scene.
        spec.animation.frames = Some(0..1);
        spec.look.exposure = Exposure::Stops(0.0);
        let checked = CheckedSpec::new(spec, self.rendering.checked().registry())?;
        let rest = self.rendering.prepared();
        let moved = Scene { is_animated: true, camera_motion: None, ..Scene::clone(&rest.scene) };
        let rendering = Rendering::new(&checked, rest.with_scene(moved)?)?;
        let moving = self.moving(animation);
        Ok(rendering.with_moving(|| moving).of_frame(0)?.prepared().clone())
    }

    /// The way to the times of an animation. Those of one that was shown before are read anew.
    fn moving(&self, animation: Option<&str>) -> Moving {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((name, moving)) = &*last
            && name.as_deref() == animation
        {
            return moving.clone();
        }
        let options = self.options.clone();
        let options = animation.iter().fold(options, |options, name| options.with_animation(*name));
        let moving = Moving::new(options, self.memory, self.units.clone());
        *last = Some((animation.map(str::to_owned), moving.clone()));
        moving
    }
}
