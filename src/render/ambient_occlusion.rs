//! Ambient occlusion: a hit shader that sends shadow rays only.

use super::Integrator;
use super::frame::{CAMERA_DIMENSION, Frame, Settings, SettingsError};
use crate::film::Film;
use crate::geom::warp;
use crate::scene::{Camera, Scene};
use crate::schedule::{Batch, Output, Renderer};
use crate::shade::single::Interaction;
use crate::shade::sort;
use crate::stream::Ray;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::sync::Arc;

/// The most bounces that may be asked for; there are none.
const MAX_BOUNCES: u32 = 1 << 10;

/// How open the surroundings of what is seen are: the share of cosine-weighted directions above a surface in
/// which nothing lies within reach; 1 where nothing is seen. The colours and lights of a scene do not matter.
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
    /// For one frame, with a reach in world units.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(
        scene: Arc<Scene>,
        camera: &Camera,
        settings: Settings,
        reach: f32,
    ) -> Result<Self, SettingsError> {
        let frame = Frame::new(scene, camera, settings, MAX_BOUNCES, |_| 1)?;
        Ok(Self { frame, reach })
    }

    /// A reach that shows a scene's creases as well as its rooms: an eighth of its radius.
    pub fn usual_reach(scene: &Scene) -> f32 {
        scene.bounds().radius() / 8.0
    }

    /// Where openness is added up.
    pub fn film(&self) -> &Arc<Film> {
        self.frame.film()
    }
}

impl Integrator for AmbientOcclusion {
    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn on(&self, frame: Frame) -> Self {
        Self { frame, reach: self.reach }
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

    fn spawn(&self, tile: u64, out: &mut Output<'_, SampleState, u32>) {
        self.frame.camera_rays(tile, |ray, pixel, sample| out.ray(ray, SampleState { pixel, sample }));
    }

    fn shade(&self, batch: Batch<'_, SampleState>, out: &mut Output<'_, SampleState, u32>) {
        let scene = self.frame.scene();
        for run in sort(batch.hits, &scene.mesh.materials).runs() {
            let rays = run.rays.iter().map(|&i| i as usize);
            let Some(material) = run.material else {
                rays.for_each(|i| self.frame.film().splat(batch.payloads[i].pixel, Vec3::ONE));
                continue;
            };
            let material = &scene.materials[material as usize];
            for i in rays {
                let SampleState { pixel, sample } = batch.payloads[i];
                let at = Interaction::new(scene, material, &batch.rays[i], &batch.hits[i]);
                let up = self.frame.sampler(pixel, sample).pair(CAMERA_DIMENSION + 1);
                let to = at.frame.to_world(warp::cosine_hemisphere(up));
                // A bent normal may point a direction into the surface, where nothing is open.
                if to.dot(at.normal) > 0.0 {
                    out.shadow(Ray { t_max: self.reach, ..Ray::new(at.origin(at.raised, to), to) }, pixel);
                }
            }
        }
    }

    fn shadow(&self, _rays: &[Ray], payloads: &[u32], occluded: &[u32]) {
        for (&pixel, &occluded) in payloads.iter().zip(occluded) {
            if occluded == 0 {
                self.frame.film().splat(pixel, Vec3::ONE);
            }
        }
    }
}
