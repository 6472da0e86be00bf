//! A recursive shader as a renderer.

use super::Shader;
use super::calls::{CallState, Engine, ShaderFrame, engine};
use super::exchange::ShadowState;
use crate::film::Film;
use crate::render::{Frame, Integrator, Settings, SettingsError};
use crate::scene::Camera;
use crate::schedule::{Batch, Output, Renderer, SceneId, SeeThrough};
use crate::shade::arena::Arena;
use crate::shade::{ArenaUse, LitScene};
use crate::stream::Ray;
use self_cell::self_cell;
use std::any::Any;
use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

/// The most memory for calls, unless one tile needs more.
const MAX_BYTES: usize = 1 << 30;

type AnyShaderFrame = Box<dyn Any + Send + Sync>;
type BoxedEngine<'a> = Box<dyn Engine + 'a>;

self_cell! {
    /// An engine and what its calls borrow: the shader and the frame.
    struct Running {
        owner: AnyShaderFrame,
        #[not_covariant]
        dependent: BoxedEngine,
    }
}

/// Runs a [`Shader`] for one frame.
pub struct Recursion<S> {
    running: Running,
    most_in_flight: usize,
    shader: PhantomData<fn(S)>,
}

impl<S> fmt::Debug for Recursion<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Recursion").finish_non_exhaustive()
    }
}

impl<S: Shader> Recursion<S> {
    /// Makes a renderer of a frame from a shader.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(
        shader: S,
        scene: impl Into<LitScene>,
        camera: &Camera,
        settings: Settings,
    ) -> Result<Self, SettingsError> {
        let splats = |max_bounces| shader.splats(max_bounces);
        let frame = Frame::new(scene, camera, settings, S::MAX_BOUNCES, splats)?;
        Ok(Self::at(Arc::new(shader), frame))
    }

    fn at(shader: Arc<S>, frame: Frame) -> Self {
        let tile_rays = frame.tile_rays();
        let most_calls = shader.most_calls(frame.settings().max_bounces);
        let shader_frame: AnyShaderFrame = Box::new(ShaderFrame { shader, frame });
        let running = Running::new(shader_frame, |shader_frame| engine(typed::<S>(shader_frame)));
        let call_bytes = running.with_dependent(|_, engine| engine.call_bytes());
        let most_in_flight =
            (MAX_BYTES / (call_bytes * most_calls)).min(Arena::<()>::most_paths(most_calls)).max(tile_rays);
        Self { running, most_in_flight, shader: PhantomData }
    }

    /// The film to which radiance is added.
    pub fn film(&self) -> &Arc<Film> {
        self.frame().film()
    }

    /// The calls' use of their arena.
    pub fn calls(&self) -> ArenaUse {
        self.engine(|engine| engine.usage())
    }

    /// Bytes per call: its future and its slot.
    pub fn call_bytes(&self) -> usize {
        self.engine(|engine| engine.call_bytes())
    }

    fn engine<T>(&self, work: impl FnOnce(&dyn Engine) -> T) -> T {
        self.running.with_dependent(|_, engine| work(&**engine))
    }
}

/// The frame of a shader of this type.
fn typed<S: Shader>(shader_frame: &AnyShaderFrame) -> &ShaderFrame<S> {
    shader_frame.downcast_ref().expect("the owner's type is that of the shader")
}

impl<S: Shader> Integrator for Recursion<S> {
    fn frame(&self) -> &Frame {
        &typed::<S>(self.running.borrow_owner()).frame
    }

    fn with_frame(&self, frame: Frame) -> Self {
        Self::at(Arc::clone(&typed::<S>(self.running.borrow_owner()).shader), frame)
    }

    fn tells_camera_rays(&self) -> bool {
        true
    }

    fn loop_stack_bytes(&self) -> usize {
        self.calls().allocated_bytes
    }
}

impl<S: Shader> Renderer for Recursion<S> {
    type Payload = CallState;
    type ShadowPayload = ShadowState;

    fn tiles(&self) -> u64 {
        self.frame().tiles()
    }

    fn tile_rays(&self) -> usize {
        self.frame().tile_rays()
    }

    fn shadow_rays_per_ray(&self) -> usize {
        S::SHADOW_RAYS
    }

    fn most_in_flight(&self) -> usize {
        self.most_in_flight
    }

    fn scene_id(&self) -> Option<SceneId> {
        Some(self.frame().scene_id())
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, CallState, ShadowState>) {
        self.engine(|engine| engine.spawn(tile, out));
    }

    fn shade(&self, batch: Batch<'_, CallState>, out: &mut Output<'_, CallState, ShadowState>) {
        self.engine(|engine| engine.shade(batch, out));
    }

    fn warnings(&self) -> Vec<String> {
        self.frame().dropped_warnings()
    }

    fn passing(&self, batch: &Batch<'_, CallState>) -> Vec<u32> {
        self.frame().passing_rays(batch, CallState::sample)
    }

    fn see_through(&self) -> Option<&dyn SeeThrough> {
        self.frame().see_through()
    }

    fn shadow(&self, _rays: &[Ray], payloads: &[ShadowState], occluded: &[u32]) {
        self.engine(|engine| engine.shadow(payloads, occluded));
    }
}
