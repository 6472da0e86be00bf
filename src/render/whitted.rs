//! Whitted ray tracing: a hit shader and a loop shader (RA section 3.3).

use super::frame::Frame;
use super::settings::{Settings, SettingsError};
use super::whitted_node::{MAX_BOUNCES, Node, SHADOW_RAYS, Sent, splats};
use super::{CameraSample, Contribution, HitShader, HitShading, NewRays, hits_of, rays_of};
use crate::geom::Sampler;
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num, SingleLane, Vector};
use crate::scene::{BlockFinishes, Camera};
use crate::schedule::{AnyRenderer, Batch, Output};
use crate::shade::finish_blocks::{FinishBlocks, HitSource};
use crate::shade::loop_stack::{EMPTY, LoopStack, Session};
use crate::shade::{ArenaUse, Cone, Hits, LitScene, sort};
use crate::stream::Ray;
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

/// Bits of [`WhittedState::depth_and_cone`] that count rays.
const DEPTH_BITS: u32 = 16;
const DEPTH: u32 = (1 << DEPTH_BITS) - 1;
const _: () = assert!(MAX_BOUNCES < DEPTH && DEPTH_BITS + Cone::<SingleLane>::BITS <= 32);

/// Default maximum number of bounces.
pub const WHITTED_BOUNCES: u32 = 8;

/// Whitted's algorithm (1980): direct light at every hit, perfect reflection and refraction followed
/// at every hit that has them, down to depth `max_bounces`; no other indirect light.
///
/// The hit shader emits the reflected ray and pushes the refracted one onto the loop stack. When a path ends, the loop
/// shader pops the topmost entry. So a camera ray has one ray in flight and at most `max_bounces` loop entries, though
/// its tree may have 2^`max_bounces` paths.
pub type Whitted = HitShading<WhittedShader>;

/// The hit shader and the loop shader of [`Whitted`].
#[derive(Clone, Copy, Debug)]
pub struct WhittedShader;

/// The state of a path.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct WhittedState {
    /// Throughput: the weight of radiance along the ray in its pixel.
    throughput: [f32; 3],
    pixel: u32,
    sample: u32,
    /// Lower half: the number of rays before this one. Upper half: the ray's [`Cone`].
    depth_and_cone: u32,
    /// Position in the tree of rays: 1 for the camera ray, 2n and 2n + 1 for the reflection and the refraction of
    /// ray n. It selects the branch's random numbers.
    branch: u32,
    /// Topmost loop entry.
    head: u32,
}

/// A loop entry: a ray that is traced when the path before it has ended.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Pending {
    ray: Ray,
    throughput: [f32; 3],
    depth_and_cone: u32,
    branch: u32,
}

type Rays<'a> = Output<'a, WhittedState, Contribution>;

impl Whitted {
    /// A Whitted ray tracer for one frame.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(
        scene: impl Into<LitScene>,
        camera: &Camera,
        settings: Settings,
    ) -> Result<Self, SettingsError> {
        Self::of(WhittedShader, scene, camera, settings)
    }

    /// Use of the loop stack.
    pub fn loop_stack(&self) -> ArenaUse {
        self.memory().usage()
    }
}

/// [`WhittedState`] in lanes.
#[derive(Clone, Copy)]
struct States<L: Lanes> {
    throughput: Vector<L>,
    pixel: Int<L>,
    sample: Int<L>,
    depth: Int<L>,
    cone: Cone<L>,
    branch: Int<L>,
    head: Int<L>,
}

impl<L: Lanes> States<L> {
    #[inline(always)]
    fn of(payloads: &[WhittedState], ids: Int<L>) -> Self {
        let [r, g, b, pixel, sample, packed, branch, head] = ids.rows(bytemuck::cast_slice(payloads));
        let throughput = Vector::new(r.to_num_bits(), g.to_num_bits(), b.to_num_bits());
        let (depth, cone) = (packed & DEPTH, Cone::unpack(packed >> DEPTH_BITS));
        Self { throughput, pixel, sample, depth, cone, branch, head }
    }

    /// As rows in memory: the lanes of a mask, packed.
    #[inline(always)]
    fn rows(self, lanes: Mask<L>) -> L::Array<[f32; 8]> {
        let [x, y, z] = [self.throughput.x, self.throughput.y, self.throughput.z];
        let [pixel, sample] = [self.pixel.to_num_bits(), self.sample.to_num_bits()];
        let packed = self.depth + (self.cone.pack() << DEPTH_BITS);
        let [packed, branch] = [packed.to_num_bits(), self.branch.to_num_bits()];
        Num::packed_rows(lanes, [x, y, z, pixel, sample, packed, branch, self.head.to_num_bits()])
    }
}

/// A batch being shaded.
struct Shading<'a, 'o> {
    frame: &'a Frame,
    batch: Batch<'a, WhittedState>,
    session: Session<'a, Pending>,
    /// Rays whose paths have ended.
    ended: Vec<u32>,
    out: &'a mut Rays<'o>,
}

impl LaneTask for Shading<'_, '_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(mut self, l: L) {
        let scene = self.frame.scene();
        for run in sort(l, self.batch.hits, scene).runs() {
            let mut blocks =
                run.material.and_then(|number| FinishBlocks::of(scene, &scene.materials[number as usize]));
            for (i, rays) in run.rays.chunks(L::LANES).enumerate() {
                // Lanes that are left over repeat the first ray and count for nothing.
                let (ids, lanes) = Int::some(l, rays, rays[0]);
                let goes_on = match run.material {
                    None => self.miss(ids, lanes),
                    Some(material) => {
                        let at = i * L::LANES;
                        let finishes = FinishBlocks::reach(&mut blocks, l, run.rays, at, &self.batch);
                        self.hit(material, finishes, ids, lanes)
                    }
                };
                let mut ended = L::array(0);
                let count = ids.append(lanes & !goes_on, ended.as_mut());
                self.ended.extend_from_slice(&ended.as_ref()[..count]);
            }
        }
        self.take_up();
    }
}

impl Shading<'_, '_> {
    /// Adds the environment for rays that left the scene; their paths end.
    #[inline(always)]
    fn miss<L: Lanes>(&self, ids: Int<L>, lanes: Mask<L>) -> Mask<L> {
        let frame = self.frame;
        let state = States::of(self.batch.payloads, ids);
        let (radiance, _) = frame.lights().sky(rays_of(&self.batch, ids).1);
        let sees = lanes & !radiance.is_zero();
        frame.splat_lanes(None, sees, frame.target(state.pixel, state.sample), state.throughput * radiance);
        Mask::splat(ids.lanes(), false)
    }

    /// The hit shader: emission, direct light, and the secondary rays. Returns the lanes whose paths continue.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn hit<L: Lanes>(
        &mut self,
        number: u32,
        finishes: Option<BlockFinishes<'_>>,
        ids: Int<L>,
        lanes: Mask<L>,
    ) -> Mask<L> {
        let frame = self.frame;
        let state = States::of(self.batch.payloads, ids);
        let hits = hits_of(&self.batch, ids);
        let t = hits.t;
        let material = &frame.scene().materials[number as usize];
        let node = Node::new(frame, material, rays_of(&self.batch, ids).1, &hits, state.cone, finishes);
        let shines = lanes & !node.emitted.is_zero();
        let target = frame.target(state.pixel, state.sample);
        frame.splat_lanes(Some(number), shines, target, state.throughput * node.emitted);
        let sampler = Sampler::of(state.pixel, state.sample, frame.settings().seed);
        for light in 0..node.lights() {
            let sent = node.lit(light, &sampler, state.branch, state.throughput);
            let lanes = lanes & sent.lanes;
            frame.send_contributions(self.out, Some(number), lanes, &sent.rays(), sent.radiance, target);
        }
        let lanes = lanes & state.depth.below(frame.settings().max_bounces);
        if lanes.none() {
            return lanes;
        }
        let [reflected, refracted] = node.secondary(state.throughput);
        let reflects = lanes & reflected.lanes;
        let reflects = frame.finite_lanes(Some(number), reflects, state.pixel, reflected.radiance);
        let refracts = lanes & refracted.lanes;
        let refracts = frame.finite_lanes(Some(number), refracts, state.pixel, refracted.radiance);
        let both = reflects & refracts;
        let depth = state.depth + 1;
        let (cone, branch) = (state.cone.at(t), state.branch * 2 + 1);
        let next = States { throughput: refracted.radiance, depth, cone, branch, ..state };
        let mut head = state.head;
        if both.any() {
            head = self.leave(both, &refracted, &next);
        }
        let now = States {
            throughput: Vector::select(reflects, reflected.radiance, next.throughput),
            branch: Int::select(reflects, state.branch * 2, next.branch),
            head,
            ..next
        };
        let origin = Vector::select(reflects, reflected.origin, refracted.origin);
        let direction = Vector::select(reflects, reflected.direction, refracted.direction);
        let lanes = reflects | refracts;
        let states = now.rows(lanes);
        NewRays::new(origin, direction).emit(self.out, lanes, bytemuck::cast_slice(states.as_ref()));
        lanes
    }

    /// Pushes the rays of a mask onto the loop stacks; returns the new top of every lane.
    #[inline(always)]
    fn leave<L: Lanes>(&mut self, lanes: Mask<L>, sent: &Sent<L>, states: &States<L>) -> Int<L> {
        let all = Mask::splat(states.head.lanes(), true);
        let rays = sent.rays().rows(all);
        let states_rows = states.rows(all);
        let mut heads = states.head.to_array();
        for lane in lanes.iter() {
            let state: WhittedState = bytemuck::cast(states_rows[lane]);
            heads[lane] = self.session.push(heads[lane], &Pending::new(bytemuck::cast(rays[lane]), &state));
        }
        Int::from_array(states.head.lanes(), &heads)
    }

    /// The loop shader: every path that ended pops its topmost entry. An entry of this renderer always emits a ray, so
    /// one pop per path suffices.
    fn take_up(&mut self) {
        for &i in &self.ended {
            let path = &self.batch.payloads[i as usize];
            if let Some((entry, head)) = self.session.pop(path.head) {
                entry.resume(&WhittedState { head, ..*path }, self.out);
            }
        }
    }
}

impl Pending {
    fn new(ray: Ray, state: &WhittedState) -> Self {
        let WhittedState { throughput, depth_and_cone, branch, .. } = *state;
        Self { ray, throughput, depth_and_cone, branch }
    }

    /// Emits the ray, as part of the path whose pixel, sample and loop stack `path` has.
    fn resume(&self, path: &WhittedState, out: &mut Rays<'_>) {
        let Self { ray, throughput, depth_and_cone, branch } = *self;
        out.ray(ray, WhittedState { throughput, depth_and_cone, branch, ..*path });
    }
}

impl HitSource for Batch<'_, WhittedState> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn hits<L: Lanes>(&self, ids: Int<L>) -> (Vector<L>, Hits<L>, Num<L>) {
        let hits = hits_of(self, ids);
        let cone = States::of(self.payloads, ids).cone.at(hits.t);
        (rays_of(self, ids).1, hits, cone.width)
    }
}

impl HitShader for WhittedShader {
    type Payload = WhittedState;
    type ShadowPayload = Contribution;
    type Memory = LoopStack<Pending>;
    const MAX_BOUNCES: u32 = MAX_BOUNCES;

    // Compiled once, here.
    #[inline(never)]
    fn erased(shading: Arc<HitShading<Self>>) -> AnyRenderer {
        AnyRenderer::new(shading)
    }

    fn splats(&self, max_bounces: u32) -> u64 {
        splats(max_bounces)
    }

    fn shadow_rays_per_ray(&self, _: &Frame) -> usize {
        SHADOW_RAYS
    }

    fn most_in_flight(&self, frame: &Frame) -> usize {
        // One entry for each depth that a hit can have.
        LoopStack::<Pending>::most_paths(frame.settings().max_bounces as usize)
    }

    fn camera(&self, frame: &Frame) -> impl Fn(u32, u32) -> WhittedState {
        let depth_and_cone = frame.cone().pack().get() << DEPTH_BITS;
        let (throughput, branch, head) = ([1.0; 3], 1, EMPTY);
        move |pixel, sample| WhittedState { throughput, pixel, sample, depth_and_cone, branch, head }
    }

    fn shade(
        &self,
        frame: &Frame,
        stack: &LoopStack<Pending>,
        batch: Batch<'_, WhittedState>,
        out: &mut Rays<'_>,
    ) {
        frame.simd().run(Shading { frame, batch, session: stack.session(), ended: Vec::new(), out });
    }

    #[inline]
    fn depth(&self, state: &WhittedState) -> u32 {
        state.depth_and_cone & DEPTH
    }

    #[inline]
    fn camera_sample(&self, state: &WhittedState) -> Option<CameraSample> {
        let WhittedState { pixel, sample, .. } = *state;
        (self.depth(state) == 0).then_some(CameraSample { pixel, sample })
    }

    #[inline]
    fn sample_of(&self, state: &WhittedState) -> Option<CameraSample> {
        let WhittedState { pixel, sample, .. } = *state;
        Some(CameraSample { pixel, sample })
    }

    fn shadow(&self, frame: &Frame, _: &[Ray], payloads: &[Contribution], occluded: &[u32]) {
        frame.add_unoccluded(payloads, occluded);
    }
}
