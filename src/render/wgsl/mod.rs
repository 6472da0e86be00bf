//! Integrators in WGSL as hit shaders: batches are sorted by material, and each piece of the program runs in lanes over
//! blocks of points.

mod block;
mod loop_entries;
mod shading;
mod surfaces;

pub use loop_entries::LoopEntries;

use super::{CameraSample, Contribution, Frame, HitShader, HitShading, Settings, SettingsError};
use crate::program::integrator::{HostFunction, IntegratorShader, MOST_PAYLOAD_BYTES};
use crate::scene::Camera;
use crate::schedule::{AnyRenderer, Batch, Output};
use crate::shade::LitScene;
use crate::shade::loop_stack::EMPTY;
use crate::stream::Ray;
use bytemuck::{Pod, Zeroable};
use loop_entries::HEADER;
use shading::Shading;
use std::sync::Arc;

/// Words of a payload.
const PAYLOAD: usize = MOST_PAYLOAD_BYTES / 4;

/// Bits of [`WgslState`] that count rays and tell questions.
const DEPTH_BITS: u32 = 16;
/// Marks a ray that only asks whether it hits nothing.
const QUESTION: u32 = 1 << (DEPTH_BITS - 1);
const DEPTH: u32 = QUESTION - 1;
const _: () = assert!(DEPTH > WgslShader::MAX_BOUNCES + 1);

/// The integrator that shades a frame with a shader in WGSL.
///
/// ```
/// use raystream::program::integrator::IntegratorShader;
/// use raystream::render::{Settings, WgslIntegrator, WgslShader};
/// use raystream::scene::{Camera, Scene};
/// use std::sync::Arc;
///
/// let shader = IntegratorShader::load(
///     "facing.wgsl",
///     "fn hit(at: Hit, p: Payload) -> vec3f { return vec3f(dot(at.wo, at.normal)); }
///      fn miss(direction: vec3f, p: Payload) -> vec3f { return vec3f(0.0); }",
///     [],
/// )?;
/// # fn f(shader: IntegratorShader, scene: Arc<Scene>, camera: Camera) -> Result<(), Box<dyn std::error::Error>> {
/// let integrator = WgslShader::shading(shader, scene, &camera, Settings::new(64, 64))?;
/// # let _: WgslIntegrator = integrator;
/// # Ok(())
/// # }
/// # Ok::<(), raystream::program::ShaderError>(())
/// ```
pub type WgslIntegrator = HitShading<WgslShader>;

/// An integrator in WGSL as a [`HitShader`].
#[derive(Clone, Debug)]
pub struct WgslShader(Arc<IntegratorShader>);

/// The state of a path of a [`WgslShader`].
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct WgslState {
    /// The shader's payload.
    own: [u32; PAYLOAD],
    pixel: u32,
    sample: u32,
    /// Lower half: the number of rays before this one, and whether it is a question. Upper half: the ray's
    /// [`crate::shade::Cone`].
    depth_and_cone: u32,
    /// Topmost loop entry.
    head: u32,
}

impl WgslShader {
    /// The integrator that shades a frame with a shader.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn shading(
        shader: IntegratorShader,
        scene: impl Into<LitScene>,
        camera: &Camera,
        settings: Settings,
    ) -> Result<WgslIntegrator, SettingsError> {
        HitShading::of(Self::from(shader), scene, camera, settings)
    }

    /// The most words of a loop entry.
    fn entry_words(&self) -> usize {
        let waiting = if self.0.keeps_rays() { 8 + PAYLOAD } else { 0 };
        HEADER + self.0.entry_words().max(waiting)
    }
}

impl From<IntegratorShader> for WgslShader {
    fn from(shader: IntegratorShader) -> Self {
        Self(Arc::new(shader))
    }
}

impl HitShader for WgslShader {
    type Payload = WgslState;
    type ShadowPayload = Contribution;
    type Memory = LoopEntries;
    const MAX_BOUNCES: u32 = 1 << 10;

    // Compiled once, here.
    #[inline(never)]
    fn erased(shading: Arc<HitShading<Self>>) -> AnyRenderer {
        AnyRenderer::new(shading)
    }

    fn splats(&self, max_bounces: u32) -> u64 {
        self.0.splats(max_bounces)
    }

    fn shadow_rays_per_ray(&self, frame: &Frame) -> usize {
        let is_shadow = |function| function == HostFunction::Shadow;
        // When a path ends, the loop shaders of all its depths may run.
        let depths = match self.0.loop_shaders().iter().any(|piece| piece.asks(is_shadow)) {
            true => frame.settings().max_bounces as usize + 1,
            false => 1,
        };
        self.0.shadow_rays() * depths
    }

    fn most_in_flight(&self, frame: &Frame) -> usize {
        match self.0.entries() * (frame.settings().max_bounces as usize + 1) {
            0 => usize::MAX,
            entries => LoopEntries::most_paths(entries),
        }
    }

    fn camera(&self, frame: &Frame) -> impl Fn(u32, u32) -> WgslState {
        let mut own = [0; PAYLOAD];
        own[..self.0.start().len()].copy_from_slice(self.0.start());
        let depth_and_cone = frame.cone().pack().get() << DEPTH_BITS;
        move |pixel, sample| WgslState { own, pixel, sample, depth_and_cone, head: EMPTY }
    }

    fn shade(
        &self,
        frame: &Frame,
        entries: &LoopEntries,
        batch: Batch<'_, WgslState>,
        out: &mut Output<'_, WgslState, Contribution>,
    ) {
        let session = entries.session(self.entry_words());
        let emitted = frame.simd().run(Shading::new(&self.0, frame, batch, session));
        for (&ray, &state) in emitted.rays.iter().zip(&emitted.states) {
            out.ray(ray, state);
        }
        for (&ray, &contribution) in emitted.shadow_rays.iter().zip(&emitted.contributions) {
            out.shadow(ray, contribution);
        }
    }

    fn shadow(&self, frame: &Frame, _: &[Ray], payloads: &[Contribution], occluded: &[u32]) {
        frame.add_unoccluded(payloads, occluded);
    }

    #[inline]
    fn depth(&self, state: &WgslState) -> u32 {
        state.depth_and_cone & DEPTH
    }

    #[inline]
    fn camera_sample(&self, state: &WgslState) -> Option<CameraSample> {
        let WgslState { pixel, sample, .. } = *state;
        (self.depth(state) == 0).then_some(CameraSample { pixel, sample })
    }

    #[inline]
    fn sample_of(&self, state: &WgslState) -> Option<CameraSample> {
        let WgslState { pixel, sample, .. } = *state;
        Some(CameraSample { pixel, sample })
    }
}
