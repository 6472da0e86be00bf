//! Hit shaders of one ray at a time.

use super::frame::CAMERA_DIMENSION;
use super::{CameraSample, Contribution, Frame, HitShader, HitShading, Settings, SettingsError};
use crate::geom::Sampler;
use crate::lanes::SingleLane;
use crate::scene::{Camera, Material, Scene};
use crate::schedule::{Batch, Output};
use crate::shade::bsdf::Smoothness;
use crate::shade::loop_stack::{EMPTY, LoopStack};
use crate::shade::single::{self, Bsdf, Interaction, LightSample};
use crate::shade::{LitScene, sort};
use crate::stream::{Hit, Ray};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::marker::PhantomData;
use std::ops::Deref;

/// The first sampler dimension of [`RayHit::light`]; a shader's own are below.
pub const LIGHT_DIMENSION: u32 = 1 << 16;

/// A hit shader that is called for one ray at a time, in plain numbers. `P` travels with each ray; its size is a
/// multiple of 4 bytes.
///
/// The engine keeps everything else: the frame, pixels and samples, depths, shadow rays, the loop stack.
/// [`PerRay::shading`] makes an integrator of it. A [`HitShader`] in lanes is faster: it shades 8 or 16 rays at a time.
///
/// # Example
/// Fog, lit by the scene's lights:
///
/// ```
/// use raystream::glam::Vec3;
/// use raystream::render::{RayHit, RayShader};
///
/// struct Fog {
///     density: f32,
/// }
///
/// impl RayShader for Fog {
///     const SHADOW_RAYS: usize = 1;
///
///     fn shade(&self, hit: &mut RayHit<'_>) -> Vec3 {
///         let clear = libm::expf(-self.density * hit.t());
///         if let Some(surface) = hit.surface() {
///             hit.light(&surface, Vec3::splat(clear));
///         }
///         Vec3::splat(0.7 * (1.0 - clear))
///     }
/// }
/// ```
///
/// A payload is plain data ([`Pod`]). A crate that does not depend on `bytemuck` itself names the one that raystream
/// re-exports:
///
/// ```
/// use raystream::bytemuck::{Pod, Zeroable};
///
/// /// The weight of light along a ray.
/// #[derive(Clone, Copy, Pod, Zeroable)]
/// #[repr(C)]
/// #[bytemuck(crate = "raystream::bytemuck")]
/// struct Weight(f32);
/// # assert_eq!(Weight::zeroed().0, 0.0);
/// ```
pub trait RayShader<P: Pod + Send + Sync = ()>: Send + Sync + 'static {
    /// The largest setting of max bounces.
    const MAX_BOUNCES: u32 = 1 << 10;

    /// The most shadow rays that one call emits.
    const SHADOW_RAYS: usize = 0;

    /// The most rays that one call emits. The first continues the path. The others wait on the path's loop stack (RA
    /// section 3.3) until it ends.
    const RAYS: usize = 1;

    /// The payload of a camera ray.
    fn camera(&self) -> P {
        P::zeroed()
    }

    /// The most splats of a sample. The film's precision depends on it. The default counts each call and each shadow
    /// ray once.
    fn splats(&self, max_bounces: u32) -> u64 {
        let calls = match Self::RAYS as u64 {
            0 => 1,
            1 => u64::from(max_bounces) + 1,
            rays => rays.saturating_pow(max_bounces + 1),
        };
        calls.saturating_mul(1 + Self::SHADOW_RAYS as u64)
    }

    /// Shades a ray, which has hit a surface or nothing. Returns the radiance that is added to the ray's pixel.
    fn shade(&self, hit: &mut RayHit<'_, P>) -> Vec3;
}

/// A [`RayShader`] as a [`HitShader`].
#[derive(Debug)]
pub struct PerRay<S, P = ()> {
    shader: S,
    payload: PhantomData<fn() -> P>,
}

impl<P: Pod + Send + Sync, S: RayShader<P>> PerRay<S, P> {
    /// Wraps the shader.
    pub fn new(shader: S) -> Self {
        Self { shader, payload: PhantomData }
    }

    /// The shader.
    pub fn shader(&self) -> &S {
        &self.shader
    }

    /// The integrator that shades a frame with the shader.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn shading(
        shader: S,
        scene: impl Into<LitScene>,
        camera: &Camera,
        settings: Settings,
    ) -> Result<HitShading<Self>, SettingsError> {
        HitShading::of(Self::new(shader), scene, camera, settings)
    }
}

/// The payload of a [`RayShader`]'s ray, with what the engine adds.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, packed)]
pub struct RayState<P> {
    own: P,
    pixel: u32,
    sample: u32,
    depth: u32,
    /// Topmost loop entry.
    head: u32,
}

/// A loop entry: a ray that waits until the path before it has ended.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, packed)]
pub struct WaitingRay<P> {
    ray: Ray,
    own: P,
    depth: u32,
}

/// A traced ray as a [`RayShader`] sees it.
#[derive(Debug)]
pub struct RayHit<'a, P: Pod = ()> {
    frame: &'a Frame,
    ray: &'a Ray,
    hit: &'a Hit,
    material: Option<u32>,
    state: RayState<P>,
    /// Rays that the call has emitted.
    rays: &'a mut Vec<(Ray, P)>,
    /// Shadow rays that the call has emitted.
    shadows: &'a mut Vec<(Ray, Contribution)>,
}

impl<'a, P: Pod> RayHit<'a, P> {
    /// The frame that is being rendered.
    pub fn frame(&self) -> &'a Frame {
        self.frame
    }

    /// The ray.
    pub fn ray(&self) -> &'a Ray {
        self.ray
    }

    /// The unit direction of the ray.
    pub fn direction(&self) -> Vec3 {
        Vec3::from_array(self.ray.direction).normalize()
    }

    /// The distance to the hit in units of the ray's direction; +∞ for a miss.
    pub fn t(&self) -> f32 {
        self.hit.t
    }

    /// Payload that travels with the ray.
    pub fn payload(&self) -> P {
        self.state.own
    }

    /// The number of rays before this one on its path; 0 for a camera ray.
    pub fn depth(&self) -> u32 {
        self.state.depth
    }

    /// The pixel, counted row by row from the top.
    pub fn pixel(&self) -> u32 {
        self.state.pixel
    }

    /// The random numbers of this sample of this pixel. Dimension 0 is the position in the pixel filter; those from
    /// [`LIGHT_DIMENSION`] on are taken. Use another dimension for each decision and each depth.
    pub fn sampler(&self) -> Sampler {
        self.frame.sampler(self.state.pixel, self.state.sample)
    }

    /// The surface that the ray has hit; `None` if it has hit nothing.
    pub fn surface(&self) -> Option<SurfaceHit<'a>> {
        let scene = self.frame.scene();
        let material = &scene.materials[self.material? as usize];
        Some(SurfaceHit::new(scene, material, self.ray, self.hit))
    }

    /// Radiance of the environment in the ray's direction.
    pub fn sky(&self) -> Vec3 {
        single::sky(self.frame.lights(), self.direction()).0
    }

    /// True if the rays that the call emits will be traced: not after the last bounce.
    pub fn may_go_on(&self) -> bool {
        self.state.depth < self.frame.settings().max_bounces
    }

    /// Emits a ray with its payload. It comes back in [`RayShader::shade`]. After the last bounce it is not emitted.
    pub fn send(&mut self, ray: Ray, payload: P) {
        if self.may_go_on() {
            self.rays.push((ray, payload));
        }
    }

    /// Emits a shadow ray, which adds radiance to the pixel if nothing lies between its ends.
    pub fn send_shadow(&mut self, ray: Ray, radiance: Vec3) {
        if radiance != Vec3::ZERO {
            let pixel = self.frame.target_of(self.state.pixel, self.state.sample);
            self.shadows.push((ray, Contribution { radiance: radiance.into(), pixel }));
        }
    }

    /// Chooses a light at random and emits the shadow ray to it. The radiance that the surface reflects of it, times
    /// `weight`, is added to the pixel if nothing lies between. On average over the samples these are all lights.
    /// Mirrors and smooth glass reflect none.
    pub fn light(&mut self, surface: &SurfaceHit<'a>, weight: Vec3) {
        let (lights, bsdf) = (self.frame.lights(), surface.bsdf());
        if bsdf.is_smooth() || !lights.are_sampled() {
            return;
        }
        let (sampler, call) = (self.sampler(), self.state.depth * 64 + self.shadows.len() as u32);
        let dimension = LIGHT_DIMENSION + 2 * call;
        let (u, u2) = (sampler.single(dimension), sampler.pair(dimension + 1));
        let Some(light) = LightSample::any(lights, surface.scene, &surface.receiver(), u, u2) else { return };
        if light.wi.dot(surface.normal) > 0.0 {
            let local = |direction| surface.basis.to_local(direction);
            let (value, _) = bsdf.evaluate(local(surface.wo), local(light.wi));
            self.send_shadow(light.ray(surface), weight * value * light.radiance / light.pdf);
        }
    }
}

/// A surface where a ray has hit it: an [`Interaction`] with its material.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceHit<'a> {
    /// The material.
    pub material: &'a Material,
    scene: &'a Scene,
    at: Interaction,
}

impl Deref for SurfaceHit<'_> {
    type Target = Interaction;

    fn deref(&self) -> &Interaction {
        &self.at
    }
}

impl<'a> SurfaceHit<'a> {
    /// The surface of material `material` where a ray has hit it.
    pub(super) fn new(scene: &'a Scene, material: &'a Material, ray: &Ray, hit: &Hit) -> Self {
        Self { material, scene, at: Interaction::new(scene, material, ray, hit) }
    }

    /// The surface's BSDF.
    pub fn bsdf(&self) -> Bsdf<'a> {
        Bsdf::new(self.scene, &self.material.surface, &self.at, Smoothness::EXACT)
    }

    /// The radiance that the surface emits towards the ray's origin.
    pub fn emitted(&self) -> Vec3 {
        let constant = single::emission(self.scene, self.material.emission.as_ref(), &self.at);
        constant + self.at.computed_emission(self.scene, self.material)
    }

    /// The ray that leaves the surface in a direction.
    pub fn ray(&self, direction: Vec3) -> Ray {
        Ray::new(self.at.origin(self.position, direction), direction)
    }

    /// The direction of the mirrored ray.
    pub fn mirrored(&self) -> Vec3 {
        let local = self.basis.to_local(self.wo);
        self.smooth_direction(Vec3::new(-local.x, -local.y, local.z))
    }
}

impl<P: Pod + Send + Sync, S: RayShader<P>> HitShader for PerRay<S, P> {
    type Payload = RayState<P>;
    type ShadowPayload = Contribution;
    type Memory = LoopStack<WaitingRay<P>>;
    const MAX_BOUNCES: u32 = S::MAX_BOUNCES;

    fn splats(&self, max_bounces: u32) -> u64 {
        self.shader.splats(max_bounces)
    }

    fn shadow_rays_per_ray(&self, _: &Frame) -> usize {
        S::SHADOW_RAYS
    }

    fn most_in_flight(&self, frame: &Frame) -> usize {
        // At each depth a path leaves all rays but one.
        match (S::RAYS.max(1) - 1) * frame.settings().max_bounces as usize {
            0 => usize::MAX,
            entries => LoopStack::<WaitingRay<P>>::most_paths(entries),
        }
    }

    fn camera(&self, _: &Frame) -> impl Fn(u32, u32) -> RayState<P> {
        let own = self.shader.camera();
        move |pixel, sample| RayState { own, pixel, sample, depth: 0, head: EMPTY }
    }

    fn shade(
        &self,
        frame: &Frame,
        stack: &Self::Memory,
        batch: Batch<'_, RayState<P>>,
        out: &mut Output<'_, RayState<P>, Contribution>,
    ) {
        let mut session = stack.session();
        let (mut rays, mut shadows) = (Vec::new(), Vec::new());
        for run in sort(SingleLane, batch.hits, frame.scene()).runs() {
            for i in run.rays.iter().map(|&i| i as usize) {
                let state = batch.payloads[i];
                let mut hit = RayHit {
                    frame,
                    ray: &batch.rays[i],
                    hit: &batch.hits[i],
                    material: run.material,
                    state,
                    rays: &mut rays,
                    shadows: &mut shadows,
                };
                let radiance = self.shader.shade(&mut hit);
                if radiance != Vec3::ZERO {
                    frame.splat(run.material, frame.target_of(state.pixel, state.sample), radiance);
                }
                check("shadow rays", "SHADOW_RAYS", shadows.len(), S::SHADOW_RAYS);
                for (ray, contribution) in shadows.drain(..) {
                    frame.send_contribution(out, run.material, ray, contribution);
                }
                check("rays", "RAYS", rays.len(), S::RAYS);
                let (mut head, depth) = (state.head, state.depth + 1);
                for (ray, own) in rays.drain(rays.len().min(1)..).rev() {
                    head = session.push(head, &WaitingRay { ray, own, depth });
                }
                if let Some((ray, own)) = rays.pop() {
                    out.ray(ray, RayState { own, depth, head, ..state });
                } else if let Some((WaitingRay { ray, own, depth }, head)) = session.pop(head) {
                    out.ray(ray, RayState { own, depth, head, ..state });
                }
            }
        }
    }

    fn shadow(&self, frame: &Frame, _: &[Ray], payloads: &[Contribution], occluded: &[u32]) {
        frame.add_unoccluded(payloads, occluded);
    }

    #[inline]
    fn depth(&self, state: &RayState<P>) -> u32 {
        state.depth
    }

    #[inline]
    fn camera_sample(&self, state: &RayState<P>) -> Option<CameraSample> {
        let RayState { pixel, sample, depth, .. } = *state;
        (depth == 0).then_some(CameraSample { pixel, sample })
    }

    #[inline]
    fn sample_of(&self, state: &RayState<P>) -> Option<CameraSample> {
        let RayState { pixel, sample, .. } = *state;
        Some(CameraSample { pixel, sample })
    }
}

/// Checks a promise of the shader's constants.
fn check(what: &str, constant: &str, found: usize, most: usize) {
    assert!(found <= most, "the shader emitted {found} {what} at one hit; RayShader::{constant} says {most}");
}

const _: () = assert!(CAMERA_DIMENSION == 0, "the documentation of samplers says so");
