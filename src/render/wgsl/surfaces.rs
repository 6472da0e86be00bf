//! The surfaces of a block of hits, which shaders ask by host functions.

use crate::lanes::{Int, Lanes, Mask, Num, OutlinedTask, Vector};
use crate::program::integrator::{HitFact, HostCall};
use crate::render::Frame;
use crate::scene::Material;
use crate::shade::bsdf::{Smooth, Smoothness};
use crate::shade::light::Receiver;
use crate::shade::{Bsdf, Hits, Interaction, LightSample, base_colour, lookup, medium};

/// Up to this many punctual lights have a number each.
const ALL_PUNCTUAL: usize = 3;

/// Makes the surfaces of some hits, out of line.
pub(super) struct MakeSurfaces<'a, 'b, L: Lanes> {
    pub frame: &'a Frame,
    pub material: &'a Material,
    pub direction: Vector<L>,
    pub hits: &'b Hits<L>,
    /// Of the ray's cone at the hit.
    pub width: Num<L>,
    /// Way in which the BSDF is made, if the shader asks for one.
    pub smoothness: Option<Smoothness>,
}

impl<'a, L: Lanes> OutlinedTask<L> for MakeSurfaces<'a, '_, L> {
    type Output = Surfaces<'a, L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Self::Output {
        let Self { frame, material, direction, hits, width, smoothness } = self;
        let scene = frame.scene();
        let at = Interaction::new(scene, material, direction, hits, width);
        let bsdf = match smoothness {
            Some(smoothness) => Some(Bsdf::new(scene, &material.surface, &at, smoothness)),
            None => None,
        };
        Surfaces { at, bsdf, t: hits.t }
    }
}

/// A number that the shader reads of hits, out of line.
pub(super) struct ReadFact<'a, 'b, L: Lanes> {
    pub surfaces: &'b Surfaces<'a, L>,
    pub frame: &'a Frame,
    pub material: &'a Material,
    pub what: HitFact,
    pub component: usize,
}

impl<L: Lanes> OutlinedTask<L> for ReadFact<'_, '_, L> {
    type Output = Int<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Int<L> {
        self.surfaces.fact(self.frame, self.material, self.what, self.component)
    }
}

/// Some hits on one material, one in each lane.
pub(super) struct Surfaces<'a, L: Lanes> {
    at: Interaction<L>,
    bsdf: Option<Bsdf<'a, L>>,
    t: Num<L>,
}

impl<'a, L: Lanes> Surfaces<'a, L> {
    /// A number that the shader reads of a hit, as a word.
    #[inline(always)]
    fn fact(&self, frame: &Frame, material: &Material, what: HitFact, component: usize) -> Int<L> {
        let at = &self.at;
        let l = self.t.lanes();
        let vector = match what {
            HitFact::Position => at.position,
            HitFact::Normal => at.basis.normal,
            HitFact::GeometricNormal => at.normal,
            HitFact::Wo => at.wo,
            HitFact::Colour => base_colour(frame.scene(), material, at),
            HitFact::Emitted => self.emitted(frame, material),
            HitFact::Passed => self.passed(material),
            HitFact::Uv => return at.texture.uv[component].to_bits(),
            HitFact::T => return self.t.to_bits(),
            HitFact::Width => return at.texture.width.to_bits(),
            HitFact::Front => return truth(at.front),
            HitFact::Lights => return Int::splat(l, self.lights(frame) as u32),
        };
        [vector.x, vector.y, vector.z][component].to_bits()
    }

    #[inline(always)]
    fn emitted(&self, frame: &Frame, material: &Material) -> Vector<L> {
        let (scene, at) = (frame.scene(), &self.at);
        let mut emitted = match &material.emission {
            None => Vector::zero(self.t.lanes()),
            Some(emission) => lookup::emission(scene, emission, &at.texture, at.front),
        };
        if let Some(computed) = at.computed_emission(scene, material) {
            emitted += computed;
        }
        match &material.medium {
            None => emitted,
            Some(medium) => emitted * medium::passed(medium, at, self.t),
        }
    }

    #[inline(always)]
    fn passed(&self, material: &Material) -> Vector<L> {
        match &material.medium {
            None => Vector::grey(Num::splat(self.t.lanes(), 1.0)),
            Some(medium) => medium::passed(medium, &self.at, self.t),
        }
    }

    #[inline(always)]
    fn lights(&self, frame: &Frame) -> usize {
        match frame.lights().punctual().len() {
            _ if self.bsdf.as_ref().is_some_and(|bsdf| bsdf.is_smooth()) => 0,
            few @ 0..=ALL_PUNCTUAL => 1 + few,
            _ => 2,
        }
    }

    /// `to_world`.
    #[inline(always)]
    pub fn world(&self, l: L, call: &HostCall<'_>, start: usize) {
        call.set_vector(0, start, self.at.basis.world(call.vector(l, 0, start)));
    }

    /// `leave`.
    #[inline(always)]
    pub fn leave(&self, l: L, call: &HostCall<'_>, start: usize) {
        let direction = call.vector(l, 0, start);
        set_ray(call, 0, start, self.at.scattered_origin(direction), direction);
    }

    /// `is_above`.
    #[inline(always)]
    pub fn is_above(&self, l: L, call: &HostCall<'_>, start: usize) {
        let above = truth(self.at.is_above(call.vector(l, 0, start)));
        call.set_number(0, start, above.to_num_bits());
    }

    /// `light_sample` in some lanes.
    #[inline(always)]
    pub fn light(&self, l: L, frame: &Frame, call: &HostCall<'_>, start: usize, lanes: Mask<L>) {
        let numbers = call.int(l, 0, start);
        let mut left = lanes;
        while let Some(first) = left.iter().next() {
            let number = call.word(0, start + first);
            let same = left & numbers.is(number);
            let light = self.light_of(l, frame, number, call, start);
            let (origin, direction, t_max) = light.rays(&self.at);
            let radiance = light.radiance.only(light.valid);
            let pdf = Num::select(light.valid, light.pdf, Num::splat(l, 1.0));
            if same.count() == lanes.count() {
                call.set_vector(0, start, origin);
                call.set_vector(3, start, direction);
                call.set_number(6, start, t_max);
                call.set_vector(7, start, light.wi);
                call.set_vector(10, start, radiance);
                call.set_number(13, start, pdf);
                return;
            }
            set_some_vector(call, 0, start, same, origin);
            set_some_vector(call, 3, start, same, direction);
            set_some(call, 6, start, same, t_max);
            set_some_vector(call, 7, start, same, light.wi);
            set_some_vector(call, 10, start, same, radiance);
            set_some(call, 13, start, same, pdf);
            left &= !same;
        }
    }

    #[inline(always)]
    fn light_of(
        &self,
        l: L,
        frame: &Frame,
        number: u32,
        call: &HostCall<'_>,
        start: usize,
    ) -> LightSample<L> {
        let (lights, at) = (frame.lights(), &self.at);
        let (u, u2) = (call.number(l, 1, start), [call.number(l, 2, start), call.number(l, 3, start)]);
        let punctual = lights.punctual().len();
        let number = number as usize;
        if number != 0 && punctual > ALL_PUNCTUAL {
            lights.sample_punctual(&Receiver::of(at), u)
        } else if (1..=punctual).contains(&number) {
            lights.illuminate(number - 1, at.raised)
        } else {
            let sample = lights.sample_surfaces(frame.scene(), &Receiver::of(at), u, u2);
            LightSample { valid: sample.valid & Mask::splat(l, number == 0), ..sample }
        }
    }

    /// `bsdf_evaluate`.
    #[inline(always)]
    pub fn evaluate(&self, l: L, call: &HostCall<'_>, start: usize) {
        let Some(bsdf) = &self.bsdf else { return };
        let (basis, wi) = (&self.at.basis, call.vector(l, 0, start));
        let (value, pdf) = bsdf.evaluate(basis.local(self.at.wo), basis.local(wi));
        call.set_vector(0, start, value);
        call.set_number(3, start, pdf);
    }

    /// `bsdf_sample`.
    #[inline(always)]
    pub fn sample(&self, l: L, call: &HostCall<'_>, start: usize) {
        let Some(bsdf) = &self.bsdf else { return };
        let (u, u2) = (call.number(l, 0, start), [call.number(l, 1, start), call.number(l, 2, start)]);
        let sample = bsdf.sample(self.at.basis.local(self.at.wo), u, u2);
        let smooth = self.at.smooth_direction(sample.wi, sample.crosses);
        let wi = Vector::select(sample.specular, smooth, self.at.basis.world(sample.wi));
        let from_surface = self.at.origin(self.at.position, wi);
        let origin = Vector::select(sample.specular, from_surface, self.at.scattered_origin(wi));
        set_ray(call, 0, start, origin, wi);
        call.set_vector(7, start, wi);
        call.set_vector(10, start, sample.weight.only(sample.valid));
        call.set_number(13, start, sample.pdf);
    }

    /// `bsdf_ways`.
    #[inline(always)]
    pub fn ways(&self, l: L, call: &HostCall<'_>, start: usize) {
        let Some(bsdf) = &self.bsdf else { return };
        let Smooth { reflected, reflection, transmitted, transmission, .. } =
            bsdf.smooth(self.at.basis.local(self.at.wo));
        self.way(call, 0, start, reflected, Mask::splat(l, false));
        call.set_vector(7, start, reflection);
        self.way(call, 10, start, transmitted, Mask::splat(l, true));
        call.set_vector(17, start, transmission);
    }

    #[inline(always)]
    fn way(&self, call: &HostCall<'_>, result: usize, start: usize, local: Vector<L>, crosses: Mask<L>) {
        let direction = self.at.smooth_direction(local, crosses);
        set_ray(call, result, start, self.at.origin(self.at.position, direction), direction);
    }
}

/// Sets a ray without an end.
#[inline(always)]
fn set_ray<L: Lanes>(
    call: &HostCall<'_>,
    result: usize,
    start: usize,
    origin: Vector<L>,
    direction: Vector<L>,
) {
    call.set_vector(result, start, origin);
    call.set_vector(result + 3, start, direction);
    call.set_number(result + 6, start, Num::splat(direction.lanes(), f32::INFINITY));
}

/// A mask as truth values.
#[inline(always)]
pub(super) fn truth<L: Lanes>(mask: Mask<L>) -> Int<L> {
    let l = mask.lanes();
    Int::select(mask, Int::splat(l, u32::MAX), Int::splat(l, 0))
}

/// Sets a number that a host function returns, in some lanes.
#[inline(always)]
fn set_some<L: Lanes>(call: &HostCall<'_>, place: usize, start: usize, lanes: Mask<L>, number: Num<L>) {
    let words = number.to_bits().to_array();
    for lane in lanes.iter() {
        call.set_word(place, start + lane, words[lane]);
    }
}

#[inline(always)]
fn set_some_vector<L: Lanes>(
    call: &HostCall<'_>,
    place: usize,
    start: usize,
    lanes: Mask<L>,
    vector: Vector<L>,
) {
    set_some(call, place, start, lanes, vector.x);
    set_some(call, place + 1, start, lanes, vector.y);
    set_some(call, place + 2, start, lanes, vector.z);
}
