//! Lamps that path-traced points see in flat mirrors and panes.
//!
//! Scattered rays that are mirrored towards a lamp find its reflection, and so do light samples
//! ([`Reflectors::sample`]). Both share it by their densities, as they share lamps themselves.

use super::NewRays;
use super::frame::Frame;
use super::path_state::{Mirrored, States};
use super::path_tracer::{Place, Shading};
use crate::geom::Sampler;
use crate::lanes::{Int, Lanes, Mask, Num, OutlinedTask, Vector};
use crate::scene::Scene;
use crate::schedule::ReflectedRay;
use crate::shade::light::{Emitters, Receiver, ReflectedSample, Reflection, Reflectors};
use crate::shade::{Bsdf, Interaction};
use crate::stream::Ray;

/// The first sampler dimension of reflections, which no integrator reaches, and how many each depth uses.
const FIRST_DIMENSION: u32 = 1 << 29;
const DIMENSIONS: u32 = 2;

/// The densities of a lamp's point for the path that hits it, and of light samples that find the same light: `pdf` and
/// `found` where the path was not mirrored by a reflector.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn reflected_densities<L: Lanes>(
    frame: &Frame,
    state: &States<L>,
    (primitive, t, cosine): (Int<L>, Num<L>, Num<L>),
    found: Num<L>,
) -> (Num<L>, Num<L>) {
    let Some(reflectors) = frame.reflectors() else { return (state.pdf, found) };
    let lanes = Mirrored::is_in(state.pdf);
    if lanes.none() {
        return (state.pdf, found);
    }
    let Mirrored { pdf, before } = Mirrored::of(state.pdf);
    let distance = before + t;
    let reflected = reflectors.pdf(frame.lights().emitters(), primitive, distance * distance, cosine);
    (Num::select(lanes, pdf, state.pdf), Num::select(lanes, reflected, found))
}

/// [`super::PathState::pdf`] of rays that hits on a material mirror, `t` from where they were scattered.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn mirrored<L: Lanes>(
    frame: &Frame,
    (material, at, bsdf): (u32, &Interaction<L>, &Bsdf<'_, L>),
    state: &States<L>,
    t: Num<L>,
) -> Num<L> {
    let far = Num::splat(t.lanes(), f32::INFINITY);
    let Some(reflectors) = frame.reflectors() else { return far };
    if !reflectors.has_material(material) {
        return far;
    }
    let lanes = reflectors.are_of(at.texture.primitive) & !Mirrored::is_in(state.pdf) & state.pdf.is_finite();
    if lanes.none() {
        return far;
    }
    let chance = chance(bsdf.mirrored_share(at.basis.local(at.wo)));
    Num::select(lanes, Mirrored::new(state.pdf * chance, t).word(), far)
}

/// About the chance with which a path is mirrored by a surface that mirrors this share of light.
#[cfg_attr(not(unoptimised), inline(always))]
fn chance<L: Lanes>(share: Vector<L>) -> Num<L> {
    share.max_element().clamp(0.0, 1.0)
}

/// [`Reflectors::sample`], out of line: few scenes have reflectors.
struct Sample<'a, L: Lanes> {
    reflectors: &'a Reflectors,
    scene: &'a Scene,
    emitters: &'a Emitters,
    from: Vector<L>,
    u: Num<L>,
    u2: [Num<L>; 2],
}

impl<L: Lanes> OutlinedTask<L> for Sample<'_, L> {
    type Output = Option<ReflectedSample<L>>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Self::Output {
        let Self { reflectors, scene, emitters, from, u, u2 } = self;
        reflectors.sample((scene, emitters), from, u, u2)
    }
}

/// [`Reflectors::reflectance`], out of line.
struct Reflectance<'a, L: Lanes> {
    reflectors: &'a Reflectors,
    scene: &'a Scene,
    lanes: Mask<L>,
    reflector: Int<L>,
    wi: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for Reflectance<'_, L> {
    type Output = Vector<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Vector<L> {
        let Self { reflectors, scene, lanes, reflector, wi } = self;
        reflectors.reflectance(scene, lanes, reflector, wi)
    }
}

impl Shading<'_, '_> {
    /// Sends a shadow ray to a lamp's reflection, if there are reflectors.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn sample_reflected_lamp<L: Lanes>(
        &mut self,
        place: &Place<'_, L>,
        receiver: &Receiver<L>,
        state: &States<L>,
        sampler: &Sampler<L>,
        lanes: Mask<L>,
    ) {
        let Place { number, at, bsdf, .. } = *place;
        let (frame, scene, l) = (self.frame, self.frame.scene(), lanes.lanes());
        let Some(reflectors) = frame.reflectors() else { return };
        // The reflector is a bounce more.
        let lanes = lanes & state.depth.below(frame.settings().max_bounces);
        if lanes.none() {
            return;
        }
        let dimension = state.depth * DIMENSIONS + FIRST_DIMENSION;
        let mut u = Num::zero(l);
        if reflectors.len() > 1 {
            u = sampler.one(dimension);
        }
        let (emitters, from, u2) = (frame.lights().emitters(), receiver.position, sampler.two(dimension + 1));
        let Some(lamp) = l.outlined(Sample { reflectors, scene, emitters, from, u, u2 }) else { return };
        let wi = at.basis.local(lamp.wi);
        let mut reached = at.is_above(lamp.wi);
        if bsdf.is_frosted() {
            reached = !(reached ^ wi.z.above(0.0));
        }
        let lanes = lanes & lamp.valid & reached;
        if lanes.none() {
            return;
        }
        let (value, pdf) = bsdf.evaluate(at.basis.local(at.wo), wi);
        let (value, _) = place.dispersed(value, wi.z.below(0.0), state);
        let lanes = lanes & !value.is_zero();
        if lanes.none() {
            return;
        }
        let (reflector, wi) = (lamp.reflector, lamp.wi);
        let reflectance = l.outlined(Reflectance { reflectors, scene, lanes, reflector, wi });
        // The density of scattered rays, and that of light samples as these know it.
        let known = Mirrored::new(pdf * chance(reflectance), lamp.before);
        let distance = known.before + (lamp.distance - lamp.before);
        let found = lamp.pdf * (distance / lamp.distance).squared();
        let ratio = known.pdf / found;
        let weight = 1.0 / (lamp.pdf * (1.0 + ratio * ratio));
        let radiance = state.throughput * value * lamp.radiance * reflectance * weight;
        let radiance = self.shader.clamped(radiance, state.depth + 2);
        let origin = at.scattered_origin(wi);
        let direction = lamp.image - origin;
        let meeting = reflectors.meeting(reflector, origin, direction);
        let t_max = Reflectors::end(meeting);
        let lanes = lanes & meeting.above(0.0) & t_max.lt(Reflectors::end(Num::splat(l, 1.0)));
        let rays = NewRays { origin, direction, t_max };
        frame.send_contributions(self.out, Some(number), lanes, &rays, radiance, state.target(frame));
    }
}

/// The shadow rays of these that end at reflectors, and how they go on.
pub(super) fn reflected_rays(reflectors: &Reflectors, rays: &[Ray], occluded: &[u32]) -> Vec<ReflectedRay> {
    let all = (0..).zip(rays.iter().zip(occluded));
    let open = all.filter(|(_, (_, occluded))| **occluded == 0);
    let reflected = |(place, (ray, _)): (u32, (&Ray, &u32))| {
        let Reflection { reflector, probe, rest } = reflectors.reflection(ray)?;
        Some(ReflectedRay { place, mirror: reflector, probe, rest })
    };
    open.filter_map(reflected).collect()
}
