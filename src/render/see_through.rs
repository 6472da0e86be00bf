//! Rays that pass surfaces of computed opacity, in all integrators.
//!
//! Before a shader sees a batch, the hits on such surfaces are shaded for their opacity alone. A ray that passes is
//! emitted again as it was, from just behind its hit, and the shader does not see it. So distances, cones, depths and
//! payloads stay what they are without the surface. Each pass moves a ray's start, so a ray passes a triangle once.
//!
//! Shadow rays that meet such a surface are traced on by the scheduler ([`SeeThrough`]). Their payloads tell no sample,
//! so a number of their line selects the random numbers.

use super::first_hits::GivenRays;
use super::{CameraSample, Frame, hits_of, rays_of};
use crate::geom::{Sampler, mix, mix_lanes};
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num};
use crate::scene::{Scene, Surface};
use crate::schedule::{Batch, Output, SeeThrough};
use crate::shade::{Cone, Interaction, sort};
use crate::stream::{Hit, Ray};
use bytemuck::Pod;

/// What selects a ray's random numbers: pixel, sample, and the ray's number in its path.
type Draw = [u32; 3];

impl Frame {
    /// True if rays may pass a surface of the scene.
    fn is_seen_through(&self) -> bool {
        self.scene().procedurals.iter().any(|surface| surface.effects().has_opacity)
    }

    /// The scene's surfaces that shadow rays may pass, if there are any.
    pub(super) fn see_through(&self) -> Option<&dyn SeeThrough> {
        self.is_seen_through().then_some(self)
    }

    /// Emits the rays of a batch again that pass the surfaces that they have hit. Returns the others, if any has
    /// passed. `sample_of` tells the sample of a ray, and whether it is a camera ray.
    pub(super) fn pass_on<P: Pod, S>(
        &self,
        batch: &Batch<'_, P>,
        sample_of: impl Fn(&P) -> (Option<CameraSample>, bool),
        out: &mut Output<'_, P, S>,
    ) -> Option<GivenRays<P>> {
        if !self.is_seen_through() {
            return None;
        }
        let draw = |(payload, ray): (&P, &Ray)| {
            let (sample, is_camera_ray) = sample_of(payload);
            let number = if is_camera_ray { 0 } else { hash(ray) };
            sample.map_or([number; 3], |CameraSample { pixel, sample }| [pixel, sample, number])
        };
        let draws: Vec<Draw> = batch.payloads.iter().zip(batch.rays).map(draw).collect();
        let passed = self.passed(Batch { rays: batch.rays, hits: batch.hits, payloads: &draws });
        for &i in &passed {
            let (ray, hit) = (batch.rays[i as usize], batch.hits[i as usize]);
            out.ray(Ray { t_min: hit.t.next_up(), ..ray }, batch.payloads[i as usize]);
        }
        (!passed.is_empty()).then(|| GivenRays::without(batch, &passed))
    }

    /// The rays that pass what they have hit, in ascending order.
    fn passed(&self, batch: Batch<'_, Draw>) -> Vec<u32> {
        let mut passed = self.simd().run(Decide { frame: self, batch });
        passed.sort_unstable();
        passed
    }
}

impl SeeThrough for Frame {
    fn passing(&self, rays: &[Ray], hits: &[Hit]) -> Vec<u32> {
        let draws: Vec<Draw> = rays.iter().map(|ray| [hash(ray); 3]).collect();
        self.passed(Batch { rays, hits, payloads: &draws })
    }
}

/// A number of the line that a ray lies on.
fn hash(ray: &Ray) -> u32 {
    let words = ray.origin.iter().chain(&ray.direction).map(|number| number.to_bits());
    words.fold(0, |hash, word| mix(hash ^ word))
}

/// The first sampler dimension of passing. The dimensions below belong to integrators.
const FIRST_DIMENSION: u32 = 1 << 31;

/// Lanes whose rays pass surfaces of this opacity. `number` distinguishes the rays of a sample.
#[cfg_attr(not(unoptimised), inline(always))]
fn passes<L: Lanes>(opacity: Num<L>, sampler: &Sampler<L>, number: Int<L>, primitive: Int<L>) -> Mask<L> {
    // A ray passes a triangle once, so triangle and ray name the decision. The samples of a pixel that see the same
    // triangle share a dimension, and their numbers are stratified.
    let dimension = mix_lanes(primitive ^ mix_lanes(number)) | FIRST_DIMENSION;
    !sampler.one(dimension).lt(opacity)
}

/// True if a material computes opacity.
fn computes_opacity(scene: &Scene, material: u32) -> bool {
    match scene.materials[material as usize].surface {
        Surface::Procedural(index) => scene.procedurals[index as usize].effects().has_opacity,
        _ => false,
    }
}

/// Decides which rays of a batch pass.
struct Decide<'a> {
    frame: &'a Frame,
    batch: Batch<'a, Draw>,
}

impl LaneTask for Decide<'_> {
    /// The rays that pass, in no order.
    type Output = Vec<u32>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> Vec<u32> {
        let Self { frame, batch } = self;
        let scene = frame.scene();
        let cone = Cone::unpack(Int::splat(l, frame.cone().pack().to_array()[0]));
        let mut passed = Vec::new();
        for run in sort(l, batch.hits, scene).runs() {
            let Some(material) = run.material else { continue };
            if !computes_opacity(scene, material) {
                continue;
            }
            let material = &scene.materials[material as usize];
            for rays in run.rays.chunks(L::LANES) {
                // Lanes that are left over repeat the first ray and count for nothing.
                let (ids, lanes) = Int::some(l, rays, rays[0]);
                let [pixel, sample, number] = ids.rows(batch.payloads.as_flattened());
                let hits = hits_of(&batch, ids);
                let width = cone.at(hits.t).width;
                let at = &Interaction::new(scene, material, rays_of(&batch, ids).1, &hits, width);
                let Some(opacity) = at.opacity(scene, material) else { continue };
                let sampler = Sampler::of(pixel, sample, frame.settings().seed);
                let passes = passes(opacity, &sampler, number, at.texture.primitive);
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
