//! Ambient occlusion: a hit shader that emits shadow rays only.

use super::frame::{CAMERA_DIMENSION, Frame};
use super::settings::{Settings, SettingsError};
use super::{CameraSample, HitShader, HitShading, NewRays, hits_of, rays_of};
use crate::film::Film;
use crate::geom::{Sampler, warp::lanes as warp};
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num, Vector};
use crate::scene::{Camera, Material, Scene};
use crate::schedule::{AnyRenderer, Batch, Output};
use crate::shade::{Interaction, LitScene, sort};
use crate::stream::Ray;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::sync::Arc;

/// Maximum value of the setting; ambient occlusion has no bounces.
const MAX_BOUNCES: u32 = 1 << 10;

/// Ambient occlusion: the cosine-weighted fraction of directions above a surface in which nothing is hit within reach;
/// 1 where the camera ray misses. Colours and lights of the scene are ignored.
pub type AmbientOcclusion = HitShading<OcclusionShader>;

/// The hit shader of [`AmbientOcclusion`].
#[derive(Debug)]
pub struct OcclusionShader {
    /// Length of the shadow rays in world units.
    pub reach: f32,
}

/// The sample that a camera ray belongs to.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SampleState {
    /// The pixel, counted row by row from the top.
    pub pixel: u32,
    /// The number of the pixel's sample.
    pub sample: u32,
}

impl AmbientOcclusion {
    /// Ambient occlusion of one frame, with a reach in world units.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(
        scene: impl Into<LitScene>,
        camera: &Camera,
        settings: Settings,
        reach: f32,
    ) -> Result<Self, SettingsError> {
        Self::of(OcclusionShader { reach }, scene, camera, settings)
    }

    /// The default reach: an eighth of the scene's radius, which shows creases as well as rooms.
    pub fn usual_reach(scene: &Scene) -> f32 {
        scene.bounds().radius() / 8.0
    }
}

/// A batch being shaded.
struct Shading<'a, 'o> {
    shader: &'a OcclusionShader,
    frame: &'a Frame,
    batch: Batch<'a, SampleState>,
    out: &'a mut Output<'o, SampleState, u32>,
}

impl LaneTask for Shading<'_, '_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(mut self, l: L) {
        let frame = self.frame;
        let scene = frame.scene();
        for run in sort(l, self.batch.hits, scene).runs() {
            for rays in run.rays.chunks(L::LANES) {
                // Lanes that are left over repeat the first ray and count for nothing.
                let (ids, lanes) = Int::some(l, rays, rays[0]);
                let [pixel, sample] = ids.rows(bytemuck::cast_slice(self.batch.payloads));
                let target = frame.target(pixel, sample);
                match run.material {
                    None => frame.splat_lanes(None, lanes, target, Vector::splat(l, Vec3::ONE)),
                    Some(material) => {
                        let sampler = Sampler::of(pixel, sample, frame.settings().seed);
                        self.hit(&scene.materials[material as usize], ids, lanes, target, &sampler);
                    }
                }
            }
        }
    }
}

impl Shading<'_, '_> {
    #[inline(always)]
    fn hit<L: Lanes>(
        &mut self,
        material: &Material,
        ids: Int<L>,
        lanes: Mask<L>,
        target: Int<L>,
        sampler: &Sampler<L>,
    ) {
        let l = target.lanes();
        let (_, direction) = rays_of(&self.batch, ids);
        let hits = hits_of(&self.batch, ids);
        let at = Interaction::new(self.frame.scene(), material, direction, &hits, Num::zero(l));
        let up = sampler.two(Int::splat(l, CAMERA_DIMENSION + 1));
        let to = at.basis.world(warp::cosine_hemisphere(up));
        // A bent normal may point a direction into the surface, where nothing is open.
        let lanes = lanes & at.is_above(to);
        let t_max = Num::splat(l, self.shader.reach);
        let rays = NewRays { origin: at.scattered_origin(to), direction: to, t_max }.rows(lanes);
        let mut pixels = L::array(0);
        let count = target.append(lanes, pixels.as_mut());
        self.out.shadow_row(count, bytemuck::cast_slice(rays.as_ref()), pixels.as_ref());
    }
}

/// Directions whose shadow rays have been traced.
struct Answered<'a> {
    film: &'a Film,
    pixels: &'a [u32],
    occluded: &'a [u32],
}

impl LaneTask for Answered<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        for (some, occluded) in self.pixels.chunks(L::LANES).zip(self.occluded.chunks(L::LANES)) {
            let (pixels, _) = Int::some(l, some, 0);
            let (taken, _) = Int::some(l, occluded, 1);
            self.film.splat_lanes(taken.is(0), pixels, Vector::splat(l, Vec3::ONE));
        }
    }
}

impl HitShader for OcclusionShader {
    type Payload = SampleState;
    type ShadowPayload = u32;
    type Memory = ();
    const MAX_BOUNCES: u32 = MAX_BOUNCES;

    // Compiled once, here.
    #[inline(never)]
    fn erased(shading: Arc<HitShading<Self>>) -> AnyRenderer {
        AnyRenderer::new(shading)
    }

    fn splats(&self, _: u32) -> u64 {
        1
    }

    fn shadow_rays_per_ray(&self, _: &Frame) -> usize {
        1
    }

    fn camera(&self, _: &Frame) -> impl Fn(u32, u32) -> SampleState {
        |pixel, sample| SampleState { pixel, sample }
    }

    fn shade(
        &self,
        frame: &Frame,
        _: &(),
        batch: Batch<'_, SampleState>,
        out: &mut Output<'_, SampleState, u32>,
    ) {
        frame.simd().run(Shading { shader: self, frame, batch, out });
    }

    #[inline]
    fn camera_sample(&self, state: &SampleState) -> Option<CameraSample> {
        let SampleState { pixel, sample } = *state;
        Some(CameraSample { pixel, sample })
    }

    fn shadow(&self, frame: &Frame, _: &[Ray], payloads: &[u32], occluded: &[u32]) {
        frame.simd().run(Answered { film: frame.film(), pixels: payloads, occluded });
    }
}
