//! Path tracing: a hit shader without loop shaders.

use super::dispersion::{ByChannel, OneChannel};
use super::frame::{CAMERA_DIMENSION, Frame};
use super::media::Walking;
use super::path_state::{DEPTH, FACING_SHIFT, Mirrored, ONE_CHANNEL, PathState, SEEKS, States};
use super::reflected_lamps::{mirrored, reflected_densities};
use super::settings::{Settings, SettingsError};
use super::{CameraSample, Contribution, HitShader, HitShading, NewRays, hits_of, rays_of};
use crate::geom::Sampler;
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num, SingleLane, Vector};
use crate::scene::{BlockFinishes, Camera, Medium};
use crate::schedule::{AnyRenderer, Batch, Output};
use crate::shade::bsdf::Smoothness;
use crate::shade::finish_blocks::{FinishBlocks, HitSource};
use crate::shade::light::Receiver;
use crate::shade::{Bsdf, Hits, Interaction, LightSample, LitScene, lookup, medium, prefetch_hits, sort};
use crate::stream::Ray;
use std::sync::Arc;

/// Bounces after which Russian roulette may end a path, unless the caller chooses another number.
pub const ROULETTE_BOUNCES: u32 = 2;

/// Maximum number of bounces.
pub(super) const MAX_BOUNCES: u32 = 1 << 10;

const _: () = assert!(MAX_BOUNCES < DEPTH && FACING_SHIFT + Receiver::<SingleLane>::FACING_BITS <= 32);

/// A path survives roulette with this many times the energy that it carries, at most with certainty: survivors then
/// weigh at most a quarter of a fresh path, and rare deep light is less noisy than with one times the energy.
const SURVIVAL_PER_ENERGY: f32 = 4.0;

/// The least chance of surviving a roulette: no survivor gains more than fifty times its weight.
const MIN_SURVIVAL: f32 = 0.02;

/// The least squared density that is told from 0.
const LEAST_SQUARE: f32 = 1e-36;

/// Unidirectional path tracing with next-event estimation: at each hit up to depth `max_bounces` one
/// light and one direction of the BSDF are sampled and weighted by the power heuristic. The ray after the last bounce
/// only collects emission.
pub type PathTracer = HitShading<PathShader>;

/// The hit shader of the [`PathTracer`].
#[derive(Clone, Copy, Debug)]
pub struct PathShader {
    roulette_bounces: Option<u32>,
    indirect_limit: Option<f32>,
}

impl PathShader {
    /// A shader whose paths may end by Russian roulette after `roulette_bounces` bounces: see [`PathTracer::new`].
    pub const fn new(roulette_bounces: Option<u32>) -> Self {
        Self { roulette_bounces, indirect_limit: None }
    }

    /// The same with each contribution of indirect light scaled down until its greatest channel is at most `limit`, a
    /// radiance. This removes bright dots and light with them: the picture is biased. Emission that the camera sees,
    /// and direct light at the first hit, are as they were; so is emission seen in a mirror.
    pub const fn with_indirect_limit(self, limit: f32) -> Self {
        Self { indirect_limit: Some(limit), ..self }
    }

    /// Radiance to which contributions of indirect light are clamped, if they are.
    pub const fn indirect_limit(&self) -> Option<f32> {
        self.indirect_limit
    }

    /// Light that reaches a pixel by a path of `bounces` bounces, clamped if it is indirect.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn clamped<L: Lanes>(&self, light: Vector<L>, bounces: Int<L>) -> Vector<L> {
        let Some(limit) = self.indirect_limit else { return light };
        let brightest = light.max_element();
        let clamps = brightest.above(limit) & !bounces.below(2);
        Vector::select(clamps, light * (limit / brightest), light)
    }
}

/// Sampler dimensions that each depth uses, from [`Dimension::at`] on.
#[derive(Clone, Copy)]
enum Dimension {
    Light = 0,
    LightPoint = 1,
    Lobe = 2,
    Direction = 3,
    Roulette = 4,
}

impl Dimension {
    const COUNT: u32 = 5;

    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn at<L: Lanes>(self, depth: Int<L>) -> Int<L> {
        depth * Self::COUNT + (CAMERA_DIMENSION + 1 + self as u32)
    }
}

impl PathTracer {
    /// A path tracer for one frame. After `roulette_bounces` bounces paths may end by Russian roulette, which does not
    /// bias; `None` leaves it out. A path survives with probability 4·T·η², at least 0.02 and at most 1, where T is the
    /// greatest channel of its throughput and η the index of refraction of the medium that it is in, relative to the
    /// medium in which it began. `docs/lab/noise.md` compares other rules. In media that scatter light, scatterings
    /// count as bounces for the roulette, and for nothing else.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(
        scene: impl Into<LitScene>,
        camera: &Camera,
        settings: Settings,
        roulette_bounces: Option<u32>,
    ) -> Result<Self, SettingsError> {
        Self::of(PathShader::new(roulette_bounces), scene, camera, settings)
    }
}

/// The chance of surviving a roulette.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn survival<L: Lanes>(throughput: Vector<L>, index2: Num<L>) -> Num<L> {
    let energy = throughput.max_element() * index2;
    (energy * SURVIVAL_PER_ENERGY).clamp(MIN_SURVIVAL, 1.0)
}

/// Weight of a sample of density `pdf` beside another technique of density `other` (Veach's power
/// heuristic, exponent 2). An infinite density has weight 1.
#[cfg_attr(not(unoptimised), inline(always))]
fn power_heuristic<L: Lanes>(pdf: Num<L>, other: Num<L>) -> Num<L> {
    let ratio = other / pdf;
    1.0 / (1.0 + ratio * ratio)
}

/// Receivers of light at hits. `is_frosted` tells whether light from below counts.
#[cfg_attr(not(unoptimised), inline(always))]
fn receiver<L: Lanes>(frame: &Frame, at: &Interaction<L>, is_frosted: impl Fn() -> bool) -> Receiver<L> {
    let mut receiver = Receiver::position_of(at);
    if frame.lights().are_many() {
        receiver = Receiver::of(at);
        if is_frosted() {
            receiver = receiver.two_sided();
        }
    }
    receiver
}

/// The light that is sampled at hits.
#[cfg_attr(not(unoptimised), inline(always))]
fn light_sample<L: Lanes>(
    frame: &Frame,
    receiver: &Receiver<L>,
    sampler: &Sampler<L>,
    depth: Int<L>,
) -> LightSample<L> {
    let mut u = None;
    if frame.lights().are_many() {
        u = Some(sampler.one(Dimension::Light.at(depth)));
    }
    let u2 = sampler.two(Dimension::LightPoint.at(depth));
    frame.lights().sample(frame.scene(), receiver, u, u2)
}

/// Hits on a material, numbered in the scene.
pub(super) struct Place<'a, L: Lanes> {
    pub number: u32,
    pub at: &'a Interaction<L>,
    pub bsdf: &'a Bsdf<'a, L>,
    /// The channel of the paths, if the surface is dispersive.
    dispersed: Option<&'a OneChannel>,
    /// What [`PathState::pdf`] is for rays that the surface mirrors.
    mirrored: Num<L>,
}

impl<L: Lanes> Place<'_, L> {
    /// Light that crosses the surface in the lanes of `crosses`, and the lanes whose paths take one channel.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn dispersed(&self, light: Vector<L>, crosses: Mask<L>, state: &States<L>) -> (Vector<L>, Mask<L>) {
        let Some(one) = self.dispersed else { return (light, Mask::splat(light.lanes(), false)) };
        let takes = (crosses | !self.at.outside) & state.one_channel.is(0);
        (one.of(light, takes), takes)
    }
}

impl HitSource for Batch<'_, PathState> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn hits<L: Lanes>(&self, ids: Int<L>) -> (Vector<L>, Hits<L>, Num<L>) {
        let hits = hits_of(self, ids);
        let cone = States::of(self.payloads, ids).cone.at(hits.t);
        (rays_of(self, ids).1, hits, cone.width)
    }
}

/// A batch being shaded.
pub(super) struct Shading<'a, 'o> {
    pub shader: &'a PathShader,
    pub frame: &'a Frame,
    batch: Batch<'a, PathState>,
    pub out: &'a mut Output<'o, PathState, Contribution>,
}

impl LaneTask for Shading<'_, '_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(mut self, l: L) {
        let scene = self.frame.scene();
        for run in sort(l, self.batch.hits, scene).runs() {
            let mut by_channel = None;
            if let Some(material) = run.material {
                let material = &scene.materials[material as usize];
                let seed = self.frame.settings().seed;
                by_channel = ByChannel::sorted(material, run.rays, self.batch.payloads, seed);
            }
            for part in 0..if by_channel.is_none() { 1 } else { ByChannel::PARTS } {
                let mut blocks = run
                    .material
                    .and_then(|number| FinishBlocks::of(scene, &scene.materials[number as usize]));
                let (of_part, dispersed) = match &by_channel {
                    None => (run.rays, None),
                    Some(sorted) => sorted.part(part),
                };
                for (i, rays) in of_part.chunks(L::LANES).enumerate() {
                    // Lanes beyond the end of the part repeat a ray and are masked out.
                    let (ids, lanes) = Int::some(l, rays, rays[0]);
                    match run.material {
                        None => self.miss(ids, lanes),
                        Some(material) => {
                            let next = (i + 1) * L::LANES;
                            prefetch_hits(&scene.mesh, self.batch.hits, of_part, next, L::LANES);
                            let at = i * L::LANES;
                            let finishes = FinishBlocks::reach(&mut blocks, l, of_part, at, &self.batch);
                            self.hit(material, dispersed, finishes, ids, lanes);
                        }
                    }
                }
            }
        }
    }
}

impl Shading<'_, '_> {
    /// Rays that left the scene see the environment.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn miss<L: Lanes>(&self, ids: Int<L>, lanes: Mask<L>) {
        let frame = self.frame;
        let state = States::of(self.batch.payloads, ids);
        let mut direction = Vector::zero(ids.lanes());
        if !frame.lights().environment().is_even() {
            direction = rays_of(&self.batch, ids).1;
        }
        let sky = self.sky(&state, direction);
        frame.splat_lanes(None, lanes & !sky.is_zero(), state.target(frame), sky);
        frame.add_sky_features(state.pixel, sky, lanes & !state.seeks.is(0));
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn sampler<L: Lanes>(&self, state: &States<L>) -> Sampler<L> {
        Sampler::of(state.pixel, state.sample, self.frame.settings().seed)
    }

    /// Adds the environment's radiance for rays that leave the scene.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn sky<L: Lanes>(&self, state: &States<L>, direction: Vector<L>) -> Vector<L> {
        let (radiance, found) = self.frame.lights().sky(direction);
        // Light samples find lamps alone by mirrors.
        let far = Num::splat(found.lanes(), f32::INFINITY);
        let pdf = Num::select(Mirrored::is_in(state.pdf), far, state.pdf);
        let light = state.throughput * radiance * power_heuristic(pdf, found);
        self.shader.clamped(light, state.depth)
    }

    /// The hit shader: emission, then one light sample and one BSDF sample.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn hit<L: Lanes>(
        &mut self,
        number: u32,
        dispersed: Option<&OneChannel>,
        finishes: Option<BlockFinishes<'_>>,
        ids: Int<L>,
        lanes: Mask<L>,
    ) {
        let (frame, scene) = (self.frame, self.frame.scene());
        let material = &scene.materials[number as usize];
        let mut state = States::of(self.batch.payloads, ids);
        let hits = hits_of(&self.batch, ids);
        let t = hits.t;
        let (origin, direction) = rays_of(&self.batch, ids);
        let cone = state.cone.at(t);
        let mut lanes = lanes;
        let mut at = Interaction::without_finish(scene, material, direction, &hits, cone.width);
        at.set_finish(scene, material, finishes);
        if let Some(medium) = &material.medium {
            if medium.scatters() {
                lanes = self.walk((number, medium), &at, (origin, direction, t), &mut state, lanes);
            } else {
                state.throughput = state.throughput * medium::passed(medium, &at, t);
            }
        }
        frame.add_first_hits_on(number, &at, state.pixel, lanes & state.depth.is(0));
        let (mut shines, mut light) = (Mask::splat(t.lanes(), false), Vector::zero(t.lanes()));
        if let Some(emission) = &material.emission {
            let emitted = lookup::emission(scene, emission, &at.texture, at.front);
            shines = lanes & !emitted.is_zero();
            if shines.any() {
                let cosine = at.normal.dot(at.wo);
                let lit = Receiver { position: origin, facing: state.facing };
                let found = frame.lights().pdf_emitter(&lit, hits.primitive, t * t, cosine);
                let (pdf, found) = reflected_densities(frame, &state, (hits.primitive, t, cosine), found);
                light = state.throughput * emitted * power_heuristic(pdf, found);
            }
        }
        if let Some(emitted) = at.computed_emission(scene, material) {
            // Light sampling does not find computed emission, so its weight is 1.
            light = light.only(shines) + state.throughput * emitted;
            shines |= lanes & !emitted.is_zero();
        }
        if shines.any() {
            let light = self.shader.clamped(light, state.depth);
            frame.splat_lanes(Some(number), shines, state.target(frame), light);
        }
        let lanes = lanes & state.depth.below(frame.settings().max_bounces + 1);
        if lanes.none() {
            return;
        }
        let surface = match dispersed {
            None => &material.surface,
            Some(one) => &one.surface,
        };
        let bsdf = Bsdf::new(scene, surface, &at, frame.smoothness(number, Smoothness::IN_MEDIA));
        let sampler = self.sampler(&state);
        let receiver = receiver(frame, &at, || bsdf.is_frosted());
        let mirrored = mirrored(frame, (number, &at, &bsdf), &state, t);
        let place = Place { number, at: &at, bsdf: &bsdf, dispersed, mirrored };
        state.seeks = self.meet(&place, &state, lanes);
        state.cone = cone;
        if !bsdf.is_smooth() && frame.lights().are_sampled() {
            self.sample_light(&place, &receiver, &state, &sampler, lanes);
            self.sample_reflected_lamp(&place, &receiver, &state, &sampler, lanes);
        }
        let state = States { facing: receiver.facing, ..state };
        self.sample_bsdf(&place, &state, &sampler, lanes);
    }

    /// Scatters light on its way through the medium of a material, or takes it to the surface. Returns the lanes whose
    /// rays meet the surface.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn walk<L: Lanes>(
        &mut self,
        (number, medium): (u32, &Medium),
        at: &Interaction<L>,
        (origin, direction, t): (Vector<L>, Vector<L>, Num<L>),
        state: &mut States<L>,
        lanes: Mask<L>,
    ) -> Mask<L> {
        let inside = lanes & !at.outside;
        if inside.none() {
            return lanes;
        }
        let (sampler, of, roulette) = (self.sampler(state), *state, self.shader.roulette_bounces);
        let out = &mut *self.out;
        let walking =
            Walking { out, sampler, medium, origin, direction, t, state: of, lanes: inside, roulette };
        let (scattered, throughput) = t.lanes().outlined(walking);
        if self.frame.has_features() {
            let met = scattered & !state.seeks.is(0);
            self.frame.add_features_on(number, at, state.pixel, state.throughput, met);
        }
        state.throughput = throughput;
        lanes & !scattered
    }

    /// Adds what paths see to the features that guide a denoiser, if it is not seen in a mirror or through glass.
    /// Returns [`SEEKS`] for the paths that have met none yet.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn meet<L: Lanes>(&self, place: &Place<'_, L>, state: &States<L>, lanes: Mask<L>) -> Int<L> {
        if !self.frame.has_features() {
            return state.seeks;
        }
        let l = state.pixel.lanes();
        let met = lanes & !state.seeks.is(0) & !place.bsdf.shows_others(l);
        self.frame.add_features_on(place.number, place.at, state.pixel, state.throughput, met);
        Int::select(met, Int::splat(l, 0), state.seeks)
    }

    /// Sends a shadow ray to a light.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn sample_light<L: Lanes>(
        &mut self,
        place: &Place<'_, L>,
        receiver: &Receiver<L>,
        state: &States<L>,
        sampler: &Sampler<L>,
        lanes: Mask<L>,
    ) {
        let Place { number, at, bsdf, .. } = *place;
        let frame = self.frame;
        let light = light_sample(frame, receiver, sampler, state.depth);
        let wi = at.basis.local(light.wi);
        let mut reached = at.is_above(light.wi);
        if bsdf.is_frosted() {
            // Light from below counts too, if both normals agree that it is below.
            reached = !(reached ^ wi.z.above(0.0));
        }
        let lanes = lanes & light.valid & reached;
        if lanes.none() {
            return;
        }
        let (value, pdf) = bsdf.evaluate(at.basis.local(at.wo), wi);
        let (value, _) = place.dispersed(value, wi.z.below(0.0), state);
        // Lights without extent are found by light sampling alone and have weight 1.
        let other = pdf.only(!light.delta);
        let squares = light.pdf * light.pdf + other * other;
        let share = light.pdf / squares.clamp(LEAST_SQUARE, f32::INFINITY);
        let radiance = state.throughput * value * light.radiance * share;
        let radiance = self.shader.clamped(radiance, state.depth + 1);
        let (origin, direction, t_max) = light.rays(at);
        let lanes = lanes & !value.is_zero();
        let rays = NewRays { origin, direction, t_max };
        frame.send_contributions(self.out, Some(number), lanes, &rays, radiance, state.target(frame));
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn sample_bsdf<L: Lanes>(
        &mut self,
        place: &Place<'_, L>,
        state: &States<L>,
        sampler: &Sampler<L>,
        lanes: Mask<L>,
    ) {
        let Place { number, at, bsdf, .. } = *place;
        let mut u = Num::zero(at.wo.lanes());
        if bsdf.is_choice() {
            u = sampler.one(Dimension::Lobe.at(state.depth));
        }
        let u2 = sampler.two(Dimension::Direction.at(state.depth));
        let sample = bsdf.sample(at.basis.local(at.wo), u, u2);
        let specular = sample.specular;
        let mut wi = at.basis.world(sample.wi);
        if specular.any() {
            wi = Vector::select(specular, at.smooth_direction(sample.wi, sample.crosses), wi);
        }
        // A bent normal may scatter into the wrong side of the surface; such directions carry no light.
        let crosses = sample.crosses;
        let mut lanes = lanes & sample.valid & (specular | (at.is_above(wi) ^ crosses));
        let (weight, takes) = place.dispersed(sample.weight, crosses, state);
        let mut throughput = state.throughput * weight;
        let index2 = state.index2 * sample.eta * sample.eta;
        let depth = state.depth + 1;
        lanes = self.frame.finite_lanes(Some(number), lanes, state.pixel, throughput);
        if let Some(bounces) = self.shader.roulette_bounces {
            let played = !depth.below(bounces.saturating_add(1)) & lanes;
            if played.any() {
                let survival = survival(throughput, index2);
                let dies = !sampler.one(Dimension::Roulette.at(state.depth)).lt(survival);
                lanes &= !(played & dies);
                throughput = Vector::select(played, throughput * (1.0 / survival), throughput);
            }
        }
        lanes &= !throughput.is_zero();
        let far = Num::splat(u.lanes(), f32::INFINITY);
        let cone = state.cone.scattered(Num::select(specular, far, sample.pdf));
        let pdf = Num::select(specular, Num::select(crosses, far, place.mirrored), sample.pdf);
        let mut next = States { throughput, index2, cone, depth, pdf, ..*state };
        if place.dispersed.is_some() {
            let one_channel = Int::splat(u.lanes(), ONE_CHANNEL);
            next.one_channel = Int::select(takes, one_channel, next.one_channel);
        }
        let from_surface = at.origin(at.position, wi);
        let origin = Vector::select(specular | crosses, from_surface, at.scattered_origin(wi));
        let last = lanes & !depth.below(self.frame.settings().max_bounces + 1);
        if last.any() {
            lanes &= !self.end(&next, origin, wi, last);
        }
        let states = next.rows(lanes);
        NewRays::new(origin, wi).emit(self.out, lanes, bytemuck::cast_slice(states.as_ref()));
    }

    /// Ends paths after the last bounce, where only emission counts. A ray that misses the bounds of all emitters is
    /// not traced; under an environment it becomes a shadow ray that adds the environment if it is not occluded. The
    /// picture is the same, but for the noise of surfaces that rays may pass. Returns the lanes that became shadow
    /// rays.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn end<L: Lanes>(
        &mut self,
        next: &States<L>,
        origin: Vector<L>,
        direction: Vector<L>,
        lanes: Mask<L>,
    ) -> Mask<L> {
        let lights = self.frame.lights();
        let far = Num::splat(lanes.lanes(), f32::INFINITY);
        let ended = lanes & !lights.emitter_bounds().lies_ahead(origin, direction, far);
        if ended.none() || lights.environment().is_black() {
            return ended;
        }
        let sky = self.sky(next, direction);
        let open = ended & !sky.is_zero();
        let rays = NewRays::new(origin, direction);
        self.frame.send_contributions(self.out, None, open, &rays, sky, next.target(self.frame));
        ended
    }
}

impl HitShader for PathShader {
    type Payload = PathState;
    type ShadowPayload = Contribution;
    type Memory = ();
    const MAX_BOUNCES: u32 = MAX_BOUNCES;

    // Compiled once, here.
    #[inline(never)]
    fn erased(shading: Arc<HitShading<Self>>) -> AnyRenderer {
        AnyRenderer::new(shading)
    }

    fn splats(&self, max_bounces: u32) -> u64 {
        // At each depth one splat of emission and one of a light sample. Scatterings in media splat nothing.
        2 * (u64::from(max_bounces) + 2)
    }

    fn shadow_rays_per_ray(&self, frame: &Frame) -> usize {
        // One towards a light; after the last bounce one to the environment; one to a lamp's reflection.
        let lights = frame.lights();
        let sky = usize::from(lights.are_sampled() && !lights.environment().is_black());
        1 + sky + usize::from(frame.reflectors().is_some())
    }

    fn prepare(&self, frame: Frame) -> Frame {
        frame.without_uniform_sky().passing_panes().mirroring_lamps()
    }

    fn camera(&self, frame: &Frame) -> impl Fn(u32, u32) -> PathState {
        let first = PathState::start(frame.cone());
        let seeks = if frame.has_features() { SEEKS } else { 0 };
        move |pixel, sample| PathState { pixel: pixel | seeks, sample, ..first }
    }

    fn shade(
        &self,
        frame: &Frame,
        _: &(),
        batch: Batch<'_, PathState>,
        out: &mut Output<'_, PathState, Contribution>,
    ) {
        frame.simd().run(Shading { shader: self, frame, batch, out });
    }

    #[inline]
    fn depth(&self, state: &PathState) -> u32 {
        state.depth()
    }

    #[inline]
    fn camera_sample(&self, state: &PathState) -> Option<CameraSample> {
        let (pixel, sample) = (state.pixel(), state.sample);
        (state.depth() == 0).then_some(CameraSample { pixel, sample })
    }

    #[inline]
    fn sample_of(&self, state: &PathState) -> Option<CameraSample> {
        Some(CameraSample { pixel: state.pixel(), sample: state.sample })
    }

    const ADDS_FIRST_HITS: bool = true;

    fn shadow(&self, frame: &Frame, _: &[Ray], payloads: &[Contribution], occluded: &[u32]) {
        frame.add_unoccluded(payloads, occluded);
    }
}
