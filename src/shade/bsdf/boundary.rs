//! The rough boundary of a transparent body.

use super::fresnel;
use super::transmission_albedo::{TransmissionAlbedo, grazing};
use super::transparency::Frost;
use crate::geom::warp::lanes as warp;
use crate::lanes::{Lanes, Mask, Num, Vector};
use std::f32::consts::FRAC_1_PI;

/// Facets that reflect and refract by Fresnel's equations (Walter et al. 2007, *Microfacet Models for
/// Refraction through Rough Surfaces*), without loss. The energy that a single event loses is given back in
/// lobes like those of Kulla and Conty, `d(wo) d(wi) / (π D)`. Here d is the loss towards a direction on its
/// side, and D is the mean of d there.
///
/// The Fresnel term is the same from both sides. Of the light in those lobes the same amount crosses either
/// way. So the BSDF is reciprocal, up to the square of the ratio of indices that radiance has (see
/// [`super::Dielectric`]).
pub struct Boundary<'a, L: Lanes> {
    frost: &'a Frost<'a, L>,
    crossing: TransmissionAlbedo<L>,
    /// Loss of a single event towards `wo`, and the mean losses on this side and on the far side.
    lost: Vector<L>,
    means: [Vector<L>; 2],
    /// Share of the loss that crosses the boundary.
    crosses: Vector<L>,
    /// Probability of sampling the lobes of the loss, and then of crossing the boundary.
    probabilities: [Num<L>; 2],
}

impl<'a, L: Lanes> Boundary<'a, L> {
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(frost: &'a Frost<'a, L>) -> Self {
        let (through, fresnel) = (frost.through, &frost.layer.fresnel);
        let [along, across] = frost.facets.ggx.alpha;
        // Anisotropic facets have the loss of isotropic ones of the same mean roughness.
        let crossing =
            TransmissionAlbedo::new(Num::splat(along.lanes(), through.index), (along * across).sqrt().sqrt());
        let (inside, outside) = (through.leaving, !through.leaving);
        let lost = crossing.towards(frost.wo.z, inside).of(fresnel);
        let means = [crossing.mean(inside).of(fresnel), crossing.mean(outside).of(fresnel)];
        // From inside, less light crosses by the square of the index: there are so many more directions
        // inside.
        let one = Vector::grey(Num::splat(frost.wo.lanes(), 1.0));
        let passed =
            (one - fresnel.blend(crossing.grazing())) * inverse_square(through.index, inside, frost.wo.z);
        let crosses = (passed * means[0].min(means[1])).over(means[0]);
        let probabilities = [mean(lost), mean(crosses)];
        Self { frost, crossing, lost, means, crosses, probabilities }
    }

    /// Reflectance of a facet at a cosine, and the probability of sampling the reflection.
    #[inline(always)]
    fn reflected(&self, cosine: Num<L>) -> (Vector<L>, Num<L>) {
        let Frost { through, layer, film, .. } = self.frost;
        let (share, _) = fresnel::dielectric(cosine, through.eta);
        let mut reflected = layer.fresnel.blend(grazing(share, through.index));
        if let Some(film) = film {
            reflected = film.over(reflected, layer.fresnel.f0, cosine);
        }
        let one = Num::splat(cosine.lanes(), 1.0);
        let reflected = Vector::select(share.ge(one), Vector::grey(one), reflected);
        let energy = mean(reflected);
        let passed = (1.0 - energy) * (through.tint.max_element() / through.share).clamp(0.0, 1.0);
        let probability = (energy / (energy + passed)).clamp(0.0, 1.0);
        (reflected, probability)
    }

    /// BSDF × |cosine| for light from `wi`, and the density of [`Boundary::sample`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn evaluate(&self, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let Frost { through, facets, wo, .. } = *self.frost;
        let (above, cosine) = (wi.z.above(0.0), wi.z.abs());
        let eta2 = through.eta * through.eta;
        // The normal of the facet that scatters one direction into the other, flipped to the upper
        // hemisphere.
        let sum = wo + Vector::select(above, wi, wi * through.eta);
        let (half, there) = sum.normalize_or(wo);
        let half = half * half.z.signum();
        let (near, far) = (half.dot(wo), half.dot(wi));
        let (reflected, probability) = self.reflected(near);
        let (perfect, mirrored) = facets.ggx.evaluate(wo, wi, half);
        let refracted = facets.ggx.visible(wo, half) * (far.abs() / sum.length_squared());
        let crosses = there & near.above(0.0) & far.below(0.0);
        let light = self.frost.passed(near, reflected) * (refracted * facets.ggx.g1(wi)).only(crosses);
        let single = Vector::select(above, reflected * perfect.only(there), light);
        let density = Num::select(
            above,
            (probability * mirrored).only(there),
            ((1.0 - probability) * refracted * eta2).only(crosses),
        );
        let side = through.leaving ^ !above;
        let one = Num::splat(cosine.lanes(), 1.0);
        let lost = self.crossing.towards(cosine, side).of(&self.frost.layer.fresnel);
        let shares = Vector::select(above, Vector::grey(one) - self.crosses, self.crosses / eta2);
        let further = (self.lost * lost * shares).over(Vector::select(above, self.means[0], self.means[1]));
        let [any, crossing] = self.probabilities;
        let side = Num::select(above, 1.0 - crossing, crossing);
        let pdf = (1.0 - any) * density + any * side * warp::cosine_hemisphere_pdf(cosine);
        let light = single + further * (cosine * FRAC_1_PI);
        (light * Vector::select(above, Vector::grey(through.share), through.tint), pdf)
    }

    /// Samples directions. Returns them and the lanes that have one.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn sample(&self, u: Num<L>, u2: [Num<L>; 2]) -> (Vector<L>, Mask<L>) {
        let Frost { through, facets, wo, .. } = *self.frost;
        let [any, crossing] = self.probabilities;
        let further = u.lt(any);
        let rest = Num::select(further, u / any, (u - any) / (1.0 - any));
        let normal = facets.ggx.sample(wo, u2);
        let cosine = wo.dot(normal);
        let (_, probability) = self.reflected(cosine);
        let (_, inner) = fresnel::dielectric(cosine, through.eta);
        let up = Num::select(further, rest - crossing, probability - rest).above(0.0);
        let refracted = (normal * (cosine / through.eta - inner) - wo / through.eta).normalize();
        let facet = Vector::select(up, normal * (2.0 * cosine) - wo, refracted);
        let spread = warp::cosine_hemisphere(u2);
        let spread = Vector::new(spread.x, spread.y, Num::select(up, spread.z, -spread.z));
        let wi = Vector::select(further, spread, facet);
        (wi, Mask::select(up, wi.z.above(0.0), wi.z.below(0.0)))
    }
}

/// The reciprocal of the squared index in the lanes of `inside`, and 1 in the others.
#[inline(always)]
fn inverse_square<L: Lanes>(index: f32, inside: Mask<L>, like: Num<L>) -> Num<L> {
    let l = like.lanes();
    Num::select(inside, Num::splat(l, 1.0 / (index * index)), Num::splat(l, 1.0))
}

#[inline(always)]
fn mean<L: Lanes>(colour: Vector<L>) -> Num<L> {
    (colour.element_sum() * (1.0 / 3.0)).clamp(0.0, 1.0)
}
