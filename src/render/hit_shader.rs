//! Hit shaders, and the integrator that the engine makes of each.

use super::{CameraSample, Frame, Integrator, Settings, SettingsError};
use crate::film::Film;
use crate::lanes::SimdLevel;
use crate::scene::Camera;
use crate::schedule::{AnyRenderer, Batch, Output, Renderer, SceneId, SeeThrough};
use crate::shade::{LitScene, LoopStack};
use crate::stream::Ray;
use bytemuck::Pod;
use std::fmt;
use std::sync::Arc;

/// A hit shader (RA section 3.1): what is computed for a batch of traced rays. [`HitShading`] makes an integrator of
/// it, with a frame, camera rays, passes and films.
///
/// A shader of one ray at a time is shorter: see [`super::RayShader`].
///
/// The scheduler calls [`HitShader::shade`] from many threads at once, with the batches of a frame in no particular
/// order. What a shader accumulates must not depend on the order; the film's sums do not.
///
/// # Example
/// The distance to the first hit, as a grey value:
///
/// ```
/// use raystream::render::{Frame, HitShader, HitShading};
/// use raystream::schedule::{Batch, Output};
/// use raystream::stream::Ray;
///
/// #[derive(Debug)]
/// struct Distance;
///
/// impl HitShader for Distance {
///     type Payload = u32; // the pixel
///     type ShadowPayload = (); // no shadow rays
///     type Memory = (); // no loop stack
///     const MAX_BOUNCES: u32 = 0;
///
///     fn splats(&self, _max_bounces: u32) -> u64 {
///         1
///     }
///
///     fn camera(&self, _frame: &Frame) -> impl Fn(u32, u32) -> u32 {
///         |pixel, _sample| pixel
///     }
///
///     fn shade(&self, frame: &Frame, _: &(), batch: Batch<'_, u32>, _: &mut Output<'_, u32, ()>) {
///         for (hit, &pixel) in batch.hits.iter().zip(batch.payloads) {
///             let grey = if hit.is_miss() { 0.0 } else { 1.0 / (1.0 + hit.t) };
///             frame.film().splat(pixel, glam::Vec3::splat(grey));
///         }
///     }
///
///     fn shadow(&self, _: &Frame, _: &[Ray], _: &[()], _: &[u32]) {}
/// }
/// # type Distances = HitShading<Distance>;
/// ```
pub trait HitShader: Send + Sync + Sized + 'static {
    /// Payload that travels with a ray: its pixel, for instance.
    type Payload: Pod + Send + Sync;

    /// Payload that travels with a shadow ray. [`super::Contribution`] serves most shaders.
    type ShadowPayload: Pod + Send + Sync;

    /// Memory that the paths of a frame share while it is rendered: `()`, or a [`LoopStack`].
    type Memory: PathMemory;

    /// The largest setting of max bounces.
    const MAX_BOUNCES: u32;

    /// The most splats of a sample. The film's precision depends on it.
    fn splats(&self, max_bounces: u32) -> u64;

    /// The most shadow rays that [`HitShader::shade`] emits for each ray of its batch.
    fn shadow_rays_per_ray(&self, _frame: &Frame) -> usize {
        0
    }

    /// The most paths in flight that [`HitShader::Memory`] holds: [`LoopStack::most_paths`] for a loop stack.
    fn most_in_flight(&self, _frame: &Frame) -> usize {
        usize::MAX
    }

    /// Prepares a frame for this shader. The path tracer, for instance, calls [`Frame::without_uniform_sky`].
    fn prepare(&self, frame: Frame) -> Frame {
        frame
    }

    /// The payload of a camera ray, as a function of its pixel and its sample. Called once for each tile.
    fn camera(&self, frame: &Frame) -> impl Fn(u32, u32) -> Self::Payload;

    /// Shades a batch: splats radiance and emits, for each ray, at most one ray and at most
    /// [`HitShader::shadow_rays_per_ray`] shadow rays.
    fn shade(
        &self,
        frame: &Frame,
        memory: &Self::Memory,
        batch: Batch<'_, Self::Payload>,
        out: &mut Output<'_, Self::Payload, Self::ShadowPayload>,
    );

    /// Receives traced shadow rays; `occluded[i]` is 1 if `rays[i]` hits anything between its ends, else 0.
    /// [`Frame::add_unoccluded`] does the rest for [`super::Contribution`].
    fn shadow(&self, frame: &Frame, rays: &[Ray], payloads: &[Self::ShadowPayload], occluded: &[u32]);

    /// The number of rays before this one on its path, for the report.
    #[inline]
    fn depth(&self, _payload: &Self::Payload) -> u32 {
        0
    }

    /// The pixel and the sample of a camera ray, as [`HitShader::camera`] was given them; `None` for other rays. A
    /// frame has layers only with shaders that tell. They also pass [`Frame::target`] instead of the pixel to what adds
    /// radiance, for the AOV variance.
    fn camera_sample(&self, _payload: &Self::Payload) -> Option<CameraSample> {
        None
    }

    /// The pixel and the sample of any ray. They select the random numbers by which rays pass surfaces of computed
    /// opacity, and clear walls. By default only camera rays tell; the numbers of others follow from the rays.
    fn sample_of(&self, payload: &Self::Payload) -> Option<CameraSample> {
        self.camera_sample(payload)
    }

    /// [`Renderer::erased`].
    fn erased(shading: Arc<HitShading<Self>>) -> AnyRenderer {
        AnyRenderer::new(shading)
    }

    /// True if the shader itself adds what its camera rays hit to the frame's layers. Only shaders of this crate can:
    /// they compute the interactions anyway.
    #[doc(hidden)]
    const ADDS_FIRST_HITS: bool = false;
}

/// Memory that the paths of a frame share while it is rendered.
pub trait PathMemory: Default + Send + Sync + 'static {
    /// Bytes allocated.
    fn bytes(&self) -> usize;
}

impl PathMemory for () {
    fn bytes(&self) -> usize {
        0
    }
}

impl<T: Pod> PathMemory for LoopStack<T> {
    fn bytes(&self) -> usize {
        self.usage().allocated_bytes
    }
}

/// The integrator that shades with a [`HitShader`]. The engine owns the frame: film, passes, tiles, camera rays, other
/// cameras.
pub struct HitShading<S: HitShader> {
    shader: Arc<S>,
    frame: Frame,
    memory: S::Memory,
}

impl<S: HitShader> HitShading<S> {
    /// Shades a frame of a scene.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn of(
        shader: S,
        scene: impl Into<LitScene>,
        camera: &Camera,
        settings: Settings,
    ) -> Result<Self, SettingsError> {
        let frame = Frame::new(scene, camera, settings, S::MAX_BOUNCES, |bounces| shader.splats(bounces))?;
        let frame = shader.prepare(frame);
        Ok(Self { shader: Arc::new(shader), frame, memory: S::Memory::default() })
    }

    /// The shader.
    pub fn shader(&self) -> &S {
        &self.shader
    }

    /// Memory that the paths of the frame share.
    pub fn memory(&self) -> &S::Memory {
        &self.memory
    }

    /// The film that radiance is added to. While the frame is rendered it is too dark: see [`Frame::film`].
    pub fn film(&self) -> &Arc<Film> {
        self.frame.film()
    }

    /// The same integrator, shading at this SIMD level: see [`Frame::with_simd`].
    pub fn with_simd(self, simd: SimdLevel) -> Self {
        Self { frame: self.frame.with_simd(simd), ..self }
    }
}

impl<S: HitShader> fmt::Debug for HitShading<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shader = std::any::type_name::<S>();
        f.debug_struct("HitShading").field("shader", &shader).field("frame", &self.frame).finish()
    }
}

impl<S: HitShader> Integrator for HitShading<S> {
    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn with_frame(&self, frame: Frame) -> Self {
        Self { shader: Arc::clone(&self.shader), frame, memory: S::Memory::default() }
    }

    fn with_simd(self, simd: SimdLevel) -> Self {
        Self::with_simd(self, simd)
    }

    fn loop_stack_bytes(&self) -> usize {
        self.memory.bytes()
    }

    fn tells_camera_rays(&self) -> bool {
        self.shader.camera_sample(&self.shader.camera(&self.frame)(0, 0)).is_some()
    }
}

impl<S: HitShader> Renderer for HitShading<S> {
    type Payload = S::Payload;
    type ShadowPayload = S::ShadowPayload;

    fn erased(self: Arc<Self>) -> AnyRenderer {
        S::erased(self)
    }

    fn tiles(&self) -> u64 {
        self.frame.tiles()
    }

    fn tile_rays(&self) -> usize {
        self.frame.tile_rays()
    }

    fn shadow_rays_per_ray(&self) -> usize {
        self.shader.shadow_rays_per_ray(&self.frame)
    }

    fn most_in_flight(&self) -> usize {
        self.shader.most_in_flight(&self.frame)
    }

    fn scene_id(&self) -> Option<SceneId> {
        Some(self.frame.scene_id())
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, S::Payload, S::ShadowPayload>) {
        let payload = self.shader.camera(&self.frame);
        self.frame.camera_rays(tile, |rays, pixels, samples| {
            out.rays(rays, pixels.iter().zip(samples).map(|(&pixel, &sample)| payload(pixel, sample)));
        });
    }

    fn shade(&self, batch: Batch<'_, S::Payload>, out: &mut Output<'_, S::Payload, S::ShadowPayload>) {
        let Self { shader, frame, memory } = self;
        let camera_sample = |payload: &S::Payload| shader.camera_sample(payload);
        match frame.add_first_hits(&batch, !S::ADDS_FIRST_HITS, camera_sample) {
            None => shader.shade(frame, memory, batch, out),
            Some(given) if given.is_empty() => {}
            Some(given) => shader.shade(frame, memory, given.batch(), out),
        }
    }

    #[inline]
    fn depth(&self, payload: &S::Payload) -> u32 {
        self.shader.depth(payload)
    }

    fn warnings(&self) -> Vec<String> {
        self.frame.dropped_warnings()
    }

    fn passing(&self, batch: &Batch<'_, S::Payload>) -> Vec<u32> {
        let Self { shader, frame, .. } = self;
        let sample_of =
            |payload: &S::Payload| (shader.sample_of(payload), shader.camera_sample(payload).is_some());
        frame.passing_rays(batch, sample_of)
    }

    fn see_through(&self) -> Option<&dyn SeeThrough> {
        self.frame.see_through()
    }

    fn shadow(&self, rays: &[Ray], payloads: &[S::ShadowPayload], occluded: &[u32]) {
        self.shader.shadow(&self.frame, rays, payloads, occluded);
    }
}
