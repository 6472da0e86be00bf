//! Whitted ray tracing: a hit shader and a loop shader (RA section 3.3).

use super::Integrator;
use super::frame::{Frame, Settings, SettingsError};
use super::node::{MAX_BOUNCES, Node, SHADOW_RAYS, splats};
use crate::film::Film;
use crate::scene::{Camera, Material, Scene};
use crate::schedule::{Batch, Output, Renderer};
use crate::shade::loop_stack::{EMPTY, LoopStack, Session};
use crate::shade::{ArenaUse, single, sort};
use crate::stream::{Hit, Ray};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::sync::Arc;

/// Bounces, unless chosen otherwise.
pub const WHITTED_BOUNCES: u32 = 8;

/// Whitted's algorithm (1980): direct light at every hit, perfect reflection and refraction followed
/// at every hit that has them, down to depth `max_bounces`; no other indirect light.
///
/// The hit shader sends the reflected ray on and leaves the refracted one on the loop stack; when a
/// path ends, the loop shader takes up what lies on top of its stack. So a camera ray has one ray in
/// flight and at most `max_bounces` loop entries, though it may grow a tree of 2^`max_bounces` paths.
#[derive(Debug)]
pub struct Whitted {
    frame: Frame,
    stack: LoopStack<Pending>,
}

/// The state of a path.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct WhittedState {
    /// What radiance along the ray counts for its pixel.
    throughput: [f32; 3],
    pixel: u32,
    sample: u32,
    depth: u32,
    /// Place in the tree of rays: 1 for the camera ray, 2n and 2n + 1 for the reflection and the
    /// refraction of ray n. Keeps the random numbers of branches apart.
    branch: u32,
    /// Topmost loop entry.
    head: u32,
}

/// A loop entry: a ray that waits for the path before it to end.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Pending {
    ray: Ray,
    throughput: [f32; 3],
    depth: u32,
    branch: u32,
}

/// What an unoccluded shadow ray adds.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct DirectLight {
    radiance: [f32; 3],
    pixel: u32,
}

type Rays<'a> = Output<'a, WhittedState, DirectLight>;

impl Whitted {
    /// A Whitted ray tracer for one frame.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(scene: Arc<Scene>, camera: &Camera, settings: Settings) -> Result<Self, SettingsError> {
        let frame = Frame::new(scene, camera, settings, MAX_BOUNCES, splats)?;
        Ok(Self { frame, stack: LoopStack::new() })
    }

    /// Where radiance is added up.
    pub fn film(&self) -> &Arc<Film> {
        self.frame.film()
    }

    /// What the loop stack has used.
    pub fn loop_stack(&self) -> ArenaUse {
        self.stack.usage()
    }

    fn shade_miss(&self, ray: &Ray, state: &WhittedState) {
        let (radiance, _) = single::sky(self.frame.lights(), Vec3::from_array(ray.direction));
        if radiance != Vec3::ZERO {
            self.frame.film().splat(state.pixel, Vec3::from_array(state.throughput) * radiance);
        }
    }

    /// The hit shader: emission, direct light, and the secondary rays. Returns whether the
    /// path ends here.
    fn shade_hit(
        &self,
        material: &Material,
        ray: &Ray,
        hit: &Hit,
        state: &WhittedState,
        session: &mut Session<'_, Pending>,
        out: &mut Rays<'_>,
    ) -> bool {
        let node = Node::new(&self.frame, material, ray, hit);
        let throughput = Vec3::from_array(state.throughput);
        if node.emitted != Vec3::ZERO {
            self.frame.film().splat(state.pixel, throughput * node.emitted);
        }
        let sampler = self.frame.sampler(state.pixel, state.sample);
        node.direct_light(&sampler, state.branch, throughput, |ray, radiance| {
            out.shadow(ray, DirectLight { radiance: radiance.into(), pixel: state.pixel });
        });
        if state.depth >= self.frame.settings().max_bounces {
            return true;
        }
        let smooth = node.smooth();
        let secondary = |way: Option<(Vec3, Vec3)>, branch: u32| {
            let (ray, throughput) = node.secondary(way, throughput)?;
            Some(Pending { ray, throughput: throughput.into(), depth: state.depth + 1, branch })
        };
        let reflection = secondary(smooth.reflection, 2 * state.branch);
        let refraction = secondary(smooth.transmission, 2 * state.branch + 1);
        match (reflection, refraction) {
            (Some(now), Some(later)) => {
                let head = session.push(state.head, &later);
                now.resume(&WhittedState { head, ..*state }, out);
            }
            (Some(only), None) | (None, Some(only)) => only.resume(state, out),
            (None, None) => return true,
        }
        false
    }
}

impl Pending {
    /// Sends the ray on its way, as part of the path whose pixel, sample and loop stack `path` has.
    fn resume(&self, path: &WhittedState, out: &mut Rays<'_>) {
        let Self { ray, throughput, depth, branch } = *self;
        out.ray(ray, WhittedState { throughput, depth, branch, ..*path });
    }
}

impl Integrator for Whitted {
    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn on(&self, frame: Frame) -> Self {
        Self { frame, stack: LoopStack::new() }
    }

    fn loop_stack_bytes(&self) -> usize {
        self.stack.usage().allocated_bytes
    }
}

impl Renderer for Whitted {
    type Payload = WhittedState;
    type ShadowPayload = DirectLight;

    fn tiles(&self) -> u64 {
        self.frame.tiles()
    }

    fn tile_rays(&self) -> usize {
        self.frame.tile_rays()
    }

    fn shadow_rays_per_ray(&self) -> usize {
        SHADOW_RAYS
    }

    fn most_in_flight(&self) -> usize {
        // One entry for each depth that a hit can have.
        LoopStack::<Pending>::most_paths(self.frame.settings().max_bounces as usize)
    }

    fn spawn(&self, tile: u64, out: &mut Rays<'_>) {
        self.frame.camera_rays(tile, |ray, pixel, sample| {
            let throughput = [1.0; 3];
            out.ray(ray, WhittedState { throughput, pixel, sample, depth: 0, branch: 1, head: EMPTY });
        });
    }

    fn shade(&self, batch: Batch<'_, WhittedState>, out: &mut Rays<'_>) {
        let scene = self.frame.scene();
        let mut session = self.stack.session();
        let mut ended = Vec::new();
        for run in sort(batch.hits, &scene.mesh.materials).runs() {
            let rays = run.rays.iter().map(|&i| i as usize);
            let Some(material) = run.material else {
                for i in rays {
                    self.shade_miss(&batch.rays[i], &batch.payloads[i]);
                    ended.push(i);
                }
                continue;
            };
            let material = &scene.materials[material as usize];
            for i in rays {
                let (ray, hit, state) = (&batch.rays[i], &batch.hits[i], &batch.payloads[i]);
                if self.shade_hit(material, ray, hit, state, &mut session, out) {
                    ended.push(i);
                }
            }
        }
        // The loop shader: every path that ended takes up its topmost entry. An entry of this
        // renderer always sends a ray, so one turn activates all that can be activated.
        for i in ended {
            let path = &batch.payloads[i];
            if let Some((entry, head)) = session.pop(path.head) {
                entry.resume(&WhittedState { head, ..*path }, out);
            }
        }
    }

    fn depth(&self, state: &WhittedState) -> u32 {
        state.depth
    }

    fn shadow(&self, _rays: &[Ray], payloads: &[DirectLight], occluded: &[u32]) {
        for (payload, &occluded) in payloads.iter().zip(occluded) {
            if occluded == 0 {
                self.frame.film().splat(payload.pixel, Vec3::from_array(payload.radiance));
            }
        }
    }
}
