//! Ambient occlusion: a hit shader that emits shadow rays only.

use super::Integrator;
use super::frame::{CAMERA_DIMENSION, Frame, Settings, SettingsError, ray_rows};
use crate::film::Film;
use crate::geom::{Sampler, warp::lanes as warp};
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num, SimdLevel, Vector};
use crate::scene::{Camera, Material, Scene};
use crate::schedule::{Batch, Output, Renderer};
use crate::shade::{Hits, Interaction, sort};
use crate::stream::Ray;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::sync::Arc;

/// Maximum value of the setting; ambient occlusion has no bounces.
const MAX_BOUNCES: u32 = 1 << 10;

/// Ambient occlusion: the cosine-weighted fraction of directions above a surface in which nothing is hit within reach;
/// 1 where the camera ray misses. Colours and lights of the scene are ignored.
#[derive(Debug)]
pub struct AmbientOcclusion {
    frame: Frame,
    reach: f32,
}

/// The sample that a camera ray belongs to.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SampleState {
    pixel: u32,
    sample: u32,
}

impl AmbientOcclusion {
    /// Ambient occlusion of one frame, with a reach in world units.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(
        scene: Arc<Scene>,
        camera: &Camera,
        settings: Settings,
        reach: f32,
    ) -> Result<Self, SettingsError> {
        let frame = Frame::new(scene, camera, settings, MAX_BOUNCES, |_| 1)?;
        Ok(Self { frame, reach })
    }

    /// The same integrator, shading at this SIMD level: see [`Frame::with_simd`].
    pub fn with_simd(self, simd: SimdLevel) -> Self {
        Self { frame: self.frame.with_simd(simd), ..self }
    }

    /// The default reach: an eighth of the scene's radius, which shows creases as well as rooms.
    pub fn usual_reach(scene: &Scene) -> f32 {
        scene.bounds().radius() / 8.0
    }

    /// The film that openness is added to.
    pub fn film(&self) -> &Arc<Film> {
        self.frame.film()
    }
}

impl Integrator for AmbientOcclusion {
    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn with_frame(&self, frame: Frame) -> Self {
        Self { frame, reach: self.reach }
    }
}

/// A batch being shaded.
struct Shading<'a, 'o> {
    occlusion: &'a AmbientOcclusion,
    batch: Batch<'a, SampleState>,
    out: &'a mut Output<'o, SampleState, u32>,
}

impl LaneTask for Shading<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self, l: L) {
        let frame = &self.occlusion.frame;
        let scene = frame.scene();
        for run in sort(l, self.batch.hits, scene).runs() {
            for rays in run.rays.chunks(L::LANES) {
                // Lanes that are left over repeat the first ray and count for nothing.
                let (ids, lanes) = Int::some(l, rays, rays[0]);
                let [pixel, sample] = ids.rows(bytemuck::cast_slice(self.batch.payloads));
                match run.material {
                    None => frame.film().splat_lanes(lanes, pixel, Vector::splat(l, Vec3::ONE)),
                    Some(material) => {
                        let sampler = Sampler::of(pixel, sample, frame.settings().seed);
                        self.hit(&scene.materials[material as usize], ids, lanes, pixel, &sampler);
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
        pixel: Int<L>,
        sampler: &Sampler<L>,
    ) {
        let l = pixel.lanes();
        let AmbientOcclusion { frame, reach } = self.occlusion;
        let [_, _, _, _, x, y, z, _] = ids.rows_of(bytemuck::cast_slice(self.batch.rays));
        let [t, u, v, primitive] = ids.rows_of(bytemuck::cast_slice(self.batch.hits));
        let hits = Hits { t, u, v, primitive: primitive.to_bits() };
        let at = Interaction::new(frame.scene(), material, Vector::new(x, y, z), &hits, Num::zero(l));
        let up = sampler.two(Int::splat(l, CAMERA_DIMENSION + 1));
        let to = at.basis.world(warp::cosine_hemisphere(up));
        // A bent normal may point a direction into the surface, where nothing is open.
        let lanes = lanes & to.dot(at.normal).above(0.0);
        let rays = ray_rows(lanes, at.origin(at.raised, to), to, Num::splat(l, *reach));
        let mut pixels = L::array(0);
        let count = pixel.append(lanes, pixels.as_mut());
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

impl Renderer for AmbientOcclusion {
    type Payload = SampleState;
    type ShadowPayload = u32;

    fn tiles(&self) -> u64 {
        self.frame.tiles()
    }

    fn tile_rays(&self) -> usize {
        self.frame.tile_rays()
    }

    fn shadow_rays_per_ray(&self) -> usize {
        1
    }

    fn most_in_flight(&self) -> usize {
        usize::MAX
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, SampleState, u32>) {
        self.frame.camera_rays(tile, |rays, pixels, samples| {
            let of = |(&pixel, &sample)| SampleState { pixel, sample };
            out.rays(rays, pixels.iter().zip(samples).map(of));
        });
    }

    fn shade(&self, batch: Batch<'_, SampleState>, out: &mut Output<'_, SampleState, u32>) {
        self.frame.simd().run(Shading { occlusion: self, batch, out });
    }

    fn shadow(&self, _rays: &[Ray], payloads: &[u32], occluded: &[u32]) {
        self.frame.simd().run(Answered { film: self.film(), pixels: payloads, occluded });
    }
}
