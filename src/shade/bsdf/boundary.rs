//! The rough boundary of a transparent body.

use super::fresnel;
use super::transmission_albedo::{TransmissionAlbedo, grazing};
use super::transparency::Frost;
use crate::geom::warp::lanes as warp;
use crate::lanes::{Lanes, Mask, Num, Vector};
use std::f32::consts::FRAC_1_PI;

/// Facets that reflect and refract as Fresnel's equations say (Walter et al. 2007, *Microfacet Models for
/// Refraction through Rough Surfaces*), complete: what a single event loses is given back in lobes like Kulla and
/// Conty's, `d(wo) d(wi) / (π D)` with d the loss towards a direction on its side and D its mean there.
///
/// Fresnel's term is the same from both sides, and of the light in those lobes the same amount crosses either way;
/// so all is reciprocal, but for the square of the indices' ratio that radiance has (see [`super::Dielectric`]).
pub struct Boundary<'a, L: Lanes> {
    frost: &'a Frost<'a, L>,
    crossing: TransmissionAlbedo<L>,
    /// What a single event loses towards `wo`; its mean on this side and beyond.
    lost: Vector<L>,
    means: [Vector<L>; 2],
    /// Share of it that crosses.
    crosses: Vector<L>,
    /// The chance that a sample is of those lobes, and of these that it crosses.
    chances: [Num<L>; 2],
}

impl<'a, L: Lanes> Boundary<'a, L> {
    #[inline(always)]
    pub fn new(frost: &'a Frost<'a, L>) -> Self {
        let (through, fresnel) = (frost.through, &frost.layer.fresnel);
        let [along, across] = frost.facets.ggx.alpha;
        // Where facets are rougher along x: the loss of those that are as rough on the whole.
        let crossing = TransmissionAlbedo::new(through.index, (along * across).sqrt().sqrt());
        let (inside, outside) = (through.leaving, !through.leaving);
        let lost = crossing.towards(frost.wo.z, inside).of(fresnel);
        let means = [crossing.mean(inside).of(fresnel), crossing.mean(outside).of(fresnel)];
        // From inside less crosses by the square of the index: those directions are so many more.
        let one = Vector::grey(Num::splat(frost.wo.lanes(), 1.0));
        let passed = (one - fresnel.blend(crossing.grazing())) * squeeze(through.index, inside, frost.wo.z);
        let crosses = (passed * means[0].min(means[1])).over(means[0]);
        let chances = [mean(lost), mean(crosses)];
        Self { frost, crossing, lost, means, crosses, chances }
    }

    /// What a facet reflects at a cosine, and the chance of sampling that.
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
        let chance = (energy / (energy + passed)).clamp(0.0, 1.0);
        (reflected, chance)
    }

    /// The light from `wi` × |cosine|, and the density of [`Boundary::sample`].
    #[inline(always)]
    pub fn evaluate(&self, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let Frost { through, facets, wo, .. } = *self.frost;
        let (above, cosine) = (wi.z.above(0.0), wi.z.abs());
        let eta2 = through.eta * through.eta;
        // The facet between both directions; under the surface its normal is turned up.
        let sum = wo + Vector::select(above, wi, wi * through.eta);
        let (half, there) = sum.normalize_or(wo);
        let half = half * half.z.signum();
        let (near, far) = (half.dot(wo), half.dot(wi));
        let (reflected, chance) = self.reflected(near);
        let (perfect, mirrored) = facets.ggx.evaluate(wo, wi, half);
        let refracted = facets.ggx.visible(wo, half) * (far.abs() / sum.length_squared());
        let crosses = there & near.above(0.0) & far.below(0.0);
        let light = self.frost.passed(near, reflected) * (refracted * facets.ggx.unmasked(wi)).only(crosses);
        let single = Vector::select(above, reflected * perfect.only(there), light);
        let density = Num::select(
            above,
            (chance * mirrored).only(there),
            ((1.0 - chance) * refracted * eta2).only(crosses),
        );
        let side = through.leaving ^ !above;
        let one = Num::splat(cosine.lanes(), 1.0);
        let lost = self.crossing.towards(cosine, side).of(&self.frost.layer.fresnel);
        let shares = Vector::select(above, Vector::grey(one) - self.crosses, self.crosses / eta2);
        let further = (self.lost * lost * shares).over(Vector::select(above, self.means[0], self.means[1]));
        let [any, crossing] = self.chances;
        let side = Num::select(above, 1.0 - crossing, crossing);
        let pdf = (1.0 - any) * density + any * side * warp::cosine_hemisphere_pdf(cosine);
        let light = single + further * (cosine * FRAC_1_PI);
        (light * Vector::select(above, Vector::grey(through.share), through.tint), pdf)
    }

    /// Directions, and the lanes that have one.
    #[inline(always)]
    pub fn sample(&self, u: Num<L>, u2: [Num<L>; 2]) -> (Vector<L>, Mask<L>) {
        let Frost { through, facets, wo, .. } = *self.frost;
        let [any, crossing] = self.chances;
        let further = u.lt(any);
        let rest = Num::select(further, u / any, (u - any) / (1.0 - any));
        let normal = facets.ggx.sample(wo, u2);
        let cosine = wo.dot(normal);
        let (_, chance) = self.reflected(cosine);
        let (_, inner) = fresnel::dielectric(cosine, through.eta);
        let up = Num::select(further, rest - crossing, chance - rest).above(0.0);
        let refracted = (normal * (cosine / through.eta - inner) - wo / through.eta).normalize();
        let facet = Vector::select(up, normal * (2.0 * cosine) - wo, refracted);
        let spread = warp::cosine_hemisphere(u2);
        let spread = Vector::new(spread.x, spread.y, Num::select(up, spread.z, -spread.z));
        let wi = Vector::select(further, spread, facet);
        (wi, Mask::select(up, wi.z.above(0.0), wi.z.below(0.0)))
    }
}

/// 1, and in the lanes of `inside` the reciprocal of the index's square.
#[inline(always)]
fn squeeze<L: Lanes>(index: f32, inside: Mask<L>, like: Num<L>) -> Num<L> {
    let l = like.lanes();
    Num::select(inside, Num::splat(l, 1.0 / (index * index)), Num::splat(l, 1.0))
}

#[inline(always)]
fn mean<L: Lanes>(colour: Vector<L>) -> Num<L> {
    (colour.element_sum() * (1.0 / 3.0)).clamp(0.0, 1.0)
}
