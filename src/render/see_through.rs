//! Rays that pass surfaces of computed opacity, in all integrators, and clear walls, in those that ask for it.
//!
//! Before a shader sees a batch, the hits on such surfaces are shaded for the chance of passing alone. The scheduler
//! emits a ray that passes again as it was, from just behind its hit ([`crate::schedule::Renderer::passing`]). So
//! distances, cones, depths and payloads stay what they are without the surface. Each pass moves a ray's start, so a
//! ray passes a triangle once.
//!
//! Shadow rays that meet such a surface are traced on by the scheduler ([`SeeThrough`]). Their payloads tell no sample,
//! so a number of their line selects the random numbers.

use super::reflected_lamps::reflected_rays;
use super::{CameraSample, Frame, Passable, hits_of, rays_of};
use crate::geom::{Sampler, mix_lanes};
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num, Vector};
use crate::scene::Scene;
use crate::schedule::{Batch, ReflectedRay, SeeThrough};
use crate::shade::bsdf::Smoothness;
use crate::shade::{Bsdf, Cone, Interaction, sort};
use crate::stream::{Hit, MISS, Ray};
use std::cell::Cell;

thread_local! {
    /// The hits of the last batch of this thread that are on such surfaces. The list is reused.
    static SPARE: Cell<Vec<u32>> = const { Cell::new(Vec::new()) };
}

/// The numbers that decide about a ray, beside its hit: the pixel and the sample, which select its random numbers; and
/// [`IS_CAMERA_RAY`] or [`HAS_NO_SAMPLE`].
type Draw = [u32; 3];

/// A ray whose number in its path is 0. Those of others follow from the rays themselves.
const IS_CAMERA_RAY: u32 = 1;

/// A ray whose number stands for pixel and sample, too.
const HAS_NO_SAMPLE: u32 = 2;

impl Frame {
    /// The scene's surfaces that shadow rays may pass, or that mirror them, if there are any.
    pub(super) fn see_through(&self) -> Option<&dyn SeeThrough> {
        let there = self.passable().is_some() || self.reflectors().is_some();
        there.then_some(self as &dyn SeeThrough)
    }

    /// The rays of a batch that pass the surfaces that they have hit, in ascending order. `sample_of` tells the sample
    /// of a ray, and whether it is a camera ray.
    pub(super) fn passing_rays<P>(
        &self,
        batch: &Batch<'_, P>,
        sample_of: impl Fn(&P) -> (Option<CameraSample>, bool),
    ) -> Vec<u32> {
        let Some(passable) = self.passable() else { return Vec::new() };
        let draw = |i: usize| {
            let (sample, is_camera_ray) = sample_of(&batch.payloads[i]);
            let word = if is_camera_ray { IS_CAMERA_RAY } else { 0 };
            match sample {
                Some(CameraSample { pixel, sample }) => [pixel, sample, word],
                None => [0, 0, word | HAS_NO_SAMPLE],
            }
        };
        self.passed(passable, batch.rays, batch.hits, draw)
    }

    /// The rays that pass what they have hit, in ascending order.
    fn passed(
        &self,
        passable: &Passable,
        rays: &[Ray],
        hits: &[Hit],
        draw: impl Fn(usize) -> Draw,
    ) -> Vec<u32> {
        let mut met = SPARE.take();
        met.clear();
        self.simd().run(Find { passable, scene: self.scene(), hits, met: &mut met });
        let passed = self.passed_of(passable, &met, rays, hits, draw);
        SPARE.set(met);
        passed
    }

    /// The rays of these that pass the surfaces that they have hit, in ascending order.
    fn passed_of(
        &self,
        passable: &Passable,
        met: &[u32],
        rays: &[Ray],
        hits: &[Hit],
        draw: impl Fn(usize) -> Draw,
    ) -> Vec<u32> {
        if met.is_empty() {
            return Vec::new();
        }
        let places = || met.iter().map(|&i| i as usize);
        let rays: Vec<Ray> = places().map(|i| rays[i]).collect();
        let hits: Vec<Hit> = places().map(|i| hits[i]).collect();
        let draws: Vec<Draw> = places().map(draw).collect();
        let batch = Batch { rays: &rays, hits: &hits, payloads: &draws };
        let mut passed = self.simd().run(Decide { frame: self, passable, batch });
        passed.sort_unstable();
        passed.iter().map(|&i| met[i as usize]).collect()
    }
}

impl SeeThrough for Frame {
    fn may_meet(&self, rays: &[Ray], occluded: &[u32]) -> Vec<u32> {
        let Some(passable) = self.passable() else { return Vec::new() };
        self.simd().run(LieAhead { passable, rays, occluded })
    }

    fn passing(&self, rays: &[Ray], hits: &[Hit]) -> Vec<u32> {
        let Some(passable) = self.passable() else { return Vec::new() };
        self.passed(passable, rays, hits, |_| [0, 0, HAS_NO_SAMPLE])
    }

    fn reflected(&self, rays: &[Ray], occluded: &[u32]) -> Vec<ReflectedRay> {
        self.reflectors().map_or_else(Vec::new, |reflectors| reflected_rays(reflectors, rays, occluded))
    }

    fn is_mirror(&self, ray: &ReflectedRay, hit: &Hit) -> bool {
        self.reflectors().is_some_and(|reflectors| reflectors.is_on(ray.mirror, hit))
    }
}

/// Finds the hits on passable surfaces, in ascending order.
struct Find<'a> {
    passable: &'a Passable,
    scene: &'a Scene,
    hits: &'a [Hit],
    met: &'a mut Vec<u32>,
}

impl LaneTask for Find<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) {
        let Self { passable, scene, hits, met } = self;
        let count = hits.len() as u32;
        for start in (0..count).step_by(L::LANES) {
            let ids = (Int::iota(l) + start).at_most(count - 1);
            let [_, _, _, primitive] = ids.rows(bytemuck::cast_slice(hits));
            let is_hit = !primitive.is(MISS);
            if !is_hit.any() {
                continue;
            }
            let [material] = Int::select(is_hit, primitive, Int::splat(l, 0)).rows(&scene.mesh.materials);
            let found = is_hit & passable.is_of(material) & (Int::iota(l) + start).below(count);
            if found.any() {
                let mut some = L::array(0);
                let len = ids.append(found, some.as_mut());
                met.extend_from_slice(&some.as_ref()[..len]);
            }
        }
    }
}

/// Finds the occluded rays that may meet passable surfaces, in ascending order.
struct LieAhead<'a> {
    passable: &'a Passable,
    rays: &'a [Ray],
    occluded: &'a [u32],
}

impl LaneTask for LieAhead<'_> {
    type Output = Vec<u32>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> Vec<u32> {
        let count = self.rays.len() as u32;
        let mut ahead = Vec::new();
        for start in (0..count).step_by(L::LANES) {
            let ids = Int::iota(l) + start;
            let lanes = ids.below(count);
            let ids = Int::select(lanes, ids, Int::splat(l, start));
            let [occluded] = ids.rows(self.occluded);
            let lanes = lanes & !occluded.is(0);
            if !lanes.any() {
                continue;
            }
            let [ox, oy, oz, _, x, y, z, end] = ids.rows_of(bytemuck::cast_slice(self.rays));
            let (origin, direction) = (Vector::new(ox, oy, oz), Vector::new(x, y, z));
            let ahead_of = self.passable.lies_ahead(origin, direction, end);
            let mut some = L::array(0);
            let found = ids.append(lanes & ahead_of, some.as_mut());
            ahead.extend_from_slice(&some.as_ref()[..found]);
        }
        ahead
    }
}

/// A number of the line that each ray lies on.
#[cfg_attr(not(unoptimised), inline(always))]
fn hash<L: Lanes>(origin: Vector<L>, direction: Vector<L>) -> Int<L> {
    let mut hash = mix_lanes(origin.x.to_bits());
    hash = mix_lanes(hash ^ origin.y.to_bits());
    hash = mix_lanes(hash ^ origin.z.to_bits());
    hash = mix_lanes(hash ^ direction.x.to_bits());
    hash = mix_lanes(hash ^ direction.y.to_bits());
    mix_lanes(hash ^ direction.z.to_bits())
}

/// The first sampler dimension of passing. The dimensions below belong to integrators.
const FIRST_DIMENSION: u32 = 1 << 31;

/// Lanes whose rays pass surfaces with this chance of staying. `number` distinguishes the rays of a sample.
#[cfg_attr(not(unoptimised), inline(always))]
fn passes<L: Lanes>(stays: Num<L>, sampler: &Sampler<L>, number: Int<L>, primitive: Int<L>) -> Mask<L> {
    // A ray passes a triangle once, so triangle and ray name the decision. The samples of a pixel that see the same
    // triangle share a dimension, and their numbers are stratified.
    let dimension = mix_lanes(primitive ^ mix_lanes(number)) | FIRST_DIMENSION;
    !sampler.one(dimension).lt(stays)
}

/// Decides which rays of a batch pass. All have hit a passable surface, or a mix with one.
struct Decide<'a> {
    frame: &'a Frame,
    passable: &'a Passable,
    batch: Batch<'a, Draw>,
}

impl Decide<'_> {
    /// The chance that rays stay on a material that is no mix, numbered in the scene, if they may pass it.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn stays<L: Lanes>(&self, number: u32, at: &Interaction<L>) -> Option<Num<L>> {
        let scene = self.frame.scene();
        let material = &scene.materials[number as usize];
        if self.passable.is_pane(number) {
            let smoothness = Smoothness { stayed: true, ..Smoothness::EXACT };
            let Bsdf::Pane(pane) = Bsdf::new(scene, &material.surface, at, smoothness) else { return None };
            return Some(1.0 - pane.chance());
        }
        at.opacity(scene, material)
    }
}

impl LaneTask for Decide<'_> {
    /// The rays that pass, in no order.
    type Output = Vec<u32>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> Vec<u32> {
        let Self { frame, batch, .. } = &self;
        let scene = frame.scene();
        // All rays decide by camera rays' cones: rays and light samples that share a light pass with the same chance.
        let cone = Cone::unpack(Int::splat(l, frame.cone().pack().get()));
        let mut passed = Vec::new();
        for run in sort(l, batch.hits, scene).runs() {
            let Some(of_run) = run.material else { continue };
            let material = &scene.materials[of_run as usize];
            for rays in run.rays.chunks(L::LANES) {
                // Lanes that are left over repeat the first ray and count for nothing.
                let (ids, lanes) = Int::some(l, rays, rays[0]);
                let [pixel, sample, word] = ids.rows(batch.payloads.as_flattened());
                let hits = hits_of(batch, ids);
                let (origin, direction) = rays_of(batch, ids);
                let number = hash(origin, direction);
                let is_camera_ray = !(word & IS_CAMERA_RAY).is(0);
                let has_sample = (word & HAS_NO_SAMPLE).is(0);
                let pixel = Int::select(has_sample, pixel, number);
                let sample = Int::select(has_sample, sample, number);
                let number = Int::select(is_camera_ray, Int::splat(l, 0), number);
                // Shadow rays are as long as the way to their light.
                let length = direction.length_squared().sqrt();
                let (direction, width) = (direction / length, cone.at(hits.t * length).width);
                let at = &Interaction::new(scene, material, direction, &hits, width);
                let Some(stays) = self.stays(of_run, at) else { break };
                let sampler = Sampler::of(pixel, sample, frame.settings().seed);
                let passes = passes(stays, &sampler, number, at.texture.primitive);
                // Rays through the centres of pixels find what is there.
                let lanes = lanes & passes & !sample.is(CameraSample::CENTRE);
                let mut some = L::array(0);
                let count = ids.append(lanes, some.as_mut());
                passed.extend_from_slice(&some.as_ref()[..count]);
            }
        }
        passed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_pass_as_often_as_the_opacity_says() {
        for opacity in [0.0, 0.25, 0.8, 1.0] {
            let passes = (0..4096u32).filter(|&i| {
                let sampler = Sampler::new(i / 64, i % 64, 0);
                passes(Num::from(opacity), &sampler, 0.into(), (i % 3).into()).get()
            });
            let share = passes.count() as f32 / 4096.0;
            assert!((share - (1.0 - opacity)).abs() < 0.02, "{share} for {opacity}");
        }
    }
}
